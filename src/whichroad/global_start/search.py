"""The search: a large mixture, predicted by odometry until the ordinary belief holds it."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..epochs import Timeline
from ..errors import DriveError
from ..filter.evidence.observe import observe_evidence
from ..filter.gnss.inflation import COARSE
from ..filter.hypotheses.population import (
    branch_all,
    initialise,
    match_moments,
    merge_neighbours,
    predict_all,
)
from ..filter.motion import Increment
from ..filter.road import observe_map
from ..filter.state import (
    KEPT,
    OFF_ROAD,
    WHEELS,
    Belief,
    Context,
    H,
    Path,
    X,
    Y,
    new_belief,
    new_path,
    new_work,
    normalise,
)
from ..filter.summary.estimate import Output, summarise
from ..graph.network import plane_scale
from ..observations import Array, StartPose
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle, parameters
from . import elsewhere
from .answers import recentre, repeat
from .pose import initial_state
from .prior import DROP, KNOWN_BEARING, prior_components
from .steps import Step, have_fine_fix, steps

MAP = "map"
"""The start that is anywhere on the map."""

_MERGE = 0.05  # nats, cost of a merge of neighbours
_SWING = 10.0  # m, distance constant of the sum of recent turns
_STRAIGHT = 0.15  # rad; a smaller recent turn is a bend that centre lines show
_LOOSE = 3.0  # 1/rad, growth of the map's noise with recent turns
_FEW = 500  # hypotheses that are followed epoch by epoch
_DECIDED = 1e-3  # weight left out when the ordinary belief takes over
_LANE, _LANE_LENGTH = 1.5, 60.0  # m; one evasion must not lose to 100,000 other roads
_PROBATION = 500.0  # m for which the left-out weight must have been small
_AGAIN = 25.0  # m until off-road hypotheses may first return to any road
_LESS_OFTEN = 1.1  # growth of that distance from one return to the next
_FITS = 25.0  # chi-square of a fix that a hypothesis can explain
_YARD, _ELSEWHERE, _OFF = 0, 1, 2  # rows of what is off the roads, the first; how many


def is_vague(start: StartPose | str | None, mode: int) -> bool:
    """Whether a start must be searched for on the map."""
    if isinstance(start, StartPose):
        vague = start.sigma_m > COARSE or start.sigma_bearing_deg > KNOWN_BEARING
        return mode == WHEELS and vague
    return start == MAP


class _Table(NamedTuple):
    """A mixture, and its tables as plain arrays, which Python reads faster."""

    belief: Belief
    hyp: NDArray[np.void]
    state: NDArray[np.void]


def _new_table(capacity: int) -> _Table:
    belief = new_belief(capacity=capacity)
    return _Table(belief, belief.hyp.view(np.ndarray), belief.state.view(np.ndarray))


class _Search:
    """The mixture and what is done to it at each step."""

    def __init__(
        self, roads: RoadMap, vehicle: Vehicle, settings: Settings, start: StartPose | None,
        timeline: Timeline,
    ) -> None:  # fmt: skip
        self.settings = settings
        par = parameters(settings, vehicle, WHEELS)
        par.lane_sigma = max(settings.lane_sigma, _LANE)
        par.lane_length = min(settings.lane_length, _LANE_LENGTH)
        self.ctx = Context(par, roads.arrays, new_work(evidence=timeline.evidence))
        self.prior = prior_components(roads, settings, start)
        capacity = 3 * len(self.prior.edge) + 1000
        self.table, self.spare = _new_table(capacity), _new_table(capacity)
        self.reduced = new_belief()
        self.path = new_path(max(1 << 16, 16 * len(self.prior.edge)))
        self.since_beginning, self.again = 0.0, _AGAIN
        self.swing = 0.0  # rad, sum of recent turns
        self.turned, self.bend = 0.0, 0.0  # rad since the map was observed; rad/m before
        self.behind = elsewhere.behind_ends(roads.arrays)
        initial_state(self.mixture, float(timeline.epochs.time[0]), settings)
        self._begin_off_road()
        self._begin((1.0 - settings.off_road_start) * (1.0 - elsewhere.PRIOR))
        self._reduce()

    @property
    def mixture(self) -> Belief:
        """The hypotheses."""
        return self.table.belief

    @property
    def state(self) -> NDArray[np.void]:
        """What all hypotheses share, (1,) FILTER."""
        return self.table.state

    @property
    def size(self) -> int:
        """Number of hypotheses."""
        return int(self.table.state["count"][0])

    def column(self, name: str) -> Array:
        """A field of all hypotheses, as a view."""
        rows: Array = self.table.hyp[name][: self.size]
        return rows

    def _begin_off_road(self) -> None:
        """The rows of a vehicle on no road: somewhere in the region, or elsewhere."""
        p = self.prior
        w = np.exp(p.log_weight)
        x, y = float(w @ p.x), float(w @ p.y)
        yard = max(self.settings.off_road_start, 1e-300)
        self.state["scale"] = plane_scale(self.ctx.roads, x, y)
        initialise(
            self.mixture, self.ctx, p.edge[[0, 0]], p.s[[0, 0]], p.sigma[[0, 0]],
            np.log([yard * (1.0 - elsewhere.PRIOR), elsewhere.PRIOR]),
        )  # fmt: skip
        mean, cov = self.column("mu"), self.column("cov")
        mean[:, X], mean[:, Y], mean[:, H] = x, y, 0.0
        cov[:, :3, :], cov[:, :, :3] = 0.0, 0.0
        region = np.cov(np.stack([p.x, p.y]), aweights=w, ddof=0) + 50.0**2 * np.eye(2)
        cov[_YARD, :2, :2], cov[_ELSEWHERE, :2, :2] = region, elsewhere.SIGMA**2 * np.eye(2)
        cov[:, H, H] = math.pi**2 / 3.0
        self.column("edge")[:] = OFF_ROAD
        self.column("along")[:] = _YARD, _ELSEWHERE  # rows are sorted by it

    def _begin(self, share: float) -> None:
        """A vehicle begins somewhere on the roads, with that much of the weight."""
        p = self.prior
        log_weight = p.log_weight + math.log(max(share, 1e-300))
        initialise(self.mixture, self.ctx, p.edge, p.s, p.sigma, log_weight)
        self.since_beginning = 0.0

    def step(self, step: Step) -> None:
        """Predict, branch, observe the map, weigh, merge, prune."""
        move = Increment(step.arc, step.turn, step.forward, step.left, step.arc)
        predict_all(self.mixture, self.ctx, move, step.measured)
        self._branch(step.arc)
        self.state["since_map"] += step.metres
        self.swing = self.swing * math.exp(-step.metres / _SWING) + abs(step.turn)
        self.turned += step.turn
        if self.state["since_map"][0] >= self.settings.map_spacing:
            self._observe()
        self._reduce()

    def _branch(self, arc: float) -> None:
        self.ctx.par.prune = self._floor()
        while not branch_all(
            self.mixture, self.spare.belief, self.reduced, self.path, self.ctx, arc
        ):
            self._reduce(2 * self.size // 3)
            self.ctx.par.prune = self._floor()
        self.table, self.spare = self.spare, self.table
        self._leave_the_map()

    def _leave_the_map(self) -> None:
        """Where a road of the map ends a vehicle turns round, or goes on and is elsewhere."""
        edge, weight = self.column("edge"), self.column("weight")
        share = elsewhere.leaving(edge, self.column("new_edge") == 1, self.behind)
        share[_OFF:][edge[_OFF:] == OFF_ROAD] = 1.0
        gone = float(share @ weight)
        if gone > 0.0:
            log_weight = self.column("log_weight")
            log_weight += np.log(np.maximum(1.0 - share, 1e-300))
            log_weight[_ELSEWHERE] = np.logaddexp(log_weight[_ELSEWHERE], math.log(gone))

    def _observe(self) -> None:
        given, par = self.settings, self.ctx.par
        self._exchange_off_road(float(self.state["since_map"][0]))
        loose = min(max(_LOOSE * (self.swing - _STRAIGHT), 0.0), 1.0)
        par.relative_sigma = math.hypot(given.relative_sigma, loose * given.node_sigma)
        par.edge_heading_sigma = math.hypot(
            given.edge_heading_sigma, loose * given.node_heading_sigma
        )
        before = self.column("log_weight").copy()
        observe_map(self.mixture, self.ctx, True)
        self._weigh_elsewhere(before, float(self.state["since_map"][0]))
        self.state["since_map"] = 0.0

    def _weigh_elsewhere(self, before: Array, metres: float) -> None:
        """Weigh the vehicle elsewhere by its own road and turns, in place of the map's rows."""
        log_weight = self.column("log_weight")
        gain = log_weight - before
        usual = float(gain[_ELSEWHERE]) + self.settings.off_road_cost * metres  # wide: on any road
        log_weight[_YARD] = before[_YARD] + gain[_ELSEWHERE]
        own = elsewhere.gain_of(before[_OFF:], gain[_OFF:], usual, metres, self.swing)
        cost = elsewhere.turn_cost(self.turned, metres, self.bend)
        log_weight[_ELSEWHERE] = before[_ELSEWHERE] + own - cost
        self.turned, self.bend = 0.0, self.turned / metres if metres > 0.0 else 0.0

    def hear(self, epochs: Records) -> None:
        """What further sensors say in these epochs, all at the last one."""
        count = int(epochs.evidence.sum(dtype=np.int64))
        if count:
            first = int(epochs.first_evidence[np.flatnonzero(epochs.evidence)[0]])
            observe_evidence(self.mixture, self.ctx, first, count)
            self._reduce()

    def least(self) -> float:
        """How far to go in one step, m; 0: epoch by epoch."""
        return self.settings.map_spacing if self.size > _FEW else 0.0

    def _floor(self) -> float:
        """Weight below which a hypothesis is dropped."""
        return min(DROP / max(self.size, 1), 0.1 * self.settings.prune)

    def _exchange_off_road(self, metres: float) -> None:
        """Rates per metre, as in the filter; only this map's roads are left for its yards."""
        normalise(self.mixture)
        log_weight = self.column("log_weight")
        p_leave = min(self.settings.off_road_leave * metres, 0.5)
        p_off = np.exp(log_weight[:_OFF])
        log_weight[_OFF:] += math.log1p(-p_leave)
        p_off += 0.5 * p_leave * max(1.0 - float(p_off.sum()), 0.0)
        self.since_beginning += metres
        rates = np.array([self.settings.off_road_return, elsewhere.RETURN])
        back = p_off * np.minimum(rates * self.since_beginning, 0.5)
        if self.since_beginning >= self.again and back.sum() > 1e-3:
            p_off -= back
            self._begin(float(back.sum()))
            self.again *= _LESS_OFTEN
        log_weight[:_OFF] = np.log(np.maximum(p_off, 1e-300))
        normalise(self.mixture)

    def _reduce(self, most: int | None = None) -> None:
        """Drop what is too light, or all but so many; merge what is close."""
        normalise(self.mixture)
        evidence = float(self.state["log_evidence"][0])
        edge, off = self.column("edge"), np.arange(self.size) < _OFF
        keep = np.flatnonzero((self.column("weight") > self._floor()) | off)
        if most is not None:
            keep = self.heaviest()[:most]
        order = keep[np.lexsort((self.column("along")[keep], edge[keep]))]
        merge_neighbours(self.mixture, self.spare.belief, self.path, order, _MERGE)
        self.table, self.spare = self.spare, self.table
        normalise(self.mixture)
        self.state["log_evidence"] = evidence
        if self.path.size[0] > 0.8 * len(self.path.entry):
            self._compact_path()

    def _compact_path(self) -> None:
        """Keep the path entries that current hypotheses descend from."""
        path, newest = self.path, self.column("path_entry")
        keep = np.zeros(int(path.size[0]) + 1, bool)
        front = np.unique(newest)
        while len(front):
            keep[front] = True
            front = np.unique(path.entry.parent[front])
            front = front[(front >= 0) & ~keep[front]]
        kept = np.flatnonzero(keep[:-1])
        number = np.full(len(keep), -1, np.int64)
        number[kept] = np.arange(len(kept))
        rows = path.entry[kept]
        rows.parent = number[rows.parent]
        path.entry[: len(kept)] = rows
        path.size[0] = len(kept)
        newest[:] = number[newest]

    def heaviest(self) -> NDArray[np.int64]:
        """All rows, those off the roads first, then those of most weight."""
        p = self.column("weight").copy()
        p[_YARD], p[_ELSEWHERE] = 3.0, 2.0
        return np.argsort(-p)

    def is_decided(self) -> bool:
        """Whether the ordinary belief holds what is left, in few Gaussians on each edge."""
        p, edge = self.column("weight"), self.column("edge")
        if len(p) > _FEW or 1.0 - p[self.heaviest()[_OFF:KEPT]].sum() > _DECIDED:
            return False
        counts = np.unique(edge[p > self.settings.prune], return_counts=True)[1]
        return bool(counts.max() <= self.settings.components)

    def summarise(self, output: Output, k: int) -> None:
        """Write the estimate of epoch k, about the most probable hypothesis on a road."""
        order = np.delete(self.heaviest(), _ELSEWHERE)
        match_moments(self.mixture, self.reduced, order, min(KEPT - 1, len(order)))
        off = self.reduced.hyp[:1]
        off.weight += self.column("weight")[_ELSEWHERE]
        off.log_weight = np.log(off.weight)
        summarise(self.reduced, self.ctx, output, k, 0.0)
        output.rows.live[k] = self.size
        if len(order) > 1:
            recentre(output.rows[k], self.reduced.hyp[1], float(self.state["scale"][0]))

    def fill_belief(self, belief: Belief, rows: NDArray[np.int64]) -> None:
        """Copy rows to the ordinary belief."""
        match_moments(self.mixture, belief, rows, len(rows))
        normalise(belief)
        belief.state.log_evidence = self.state["log_evidence"]

    def fitting(self, fix: Array, moved: float) -> NDArray[np.int64]:
        """The rows that fit a GNSS fix best, none when no row does."""
        c, s = math.cos(fix[4]), math.sin(fix[4])
        turn = np.array([[c, -s], [s, c]])
        noise = turn @ np.diag(4.0 * fix[2:4] ** 2) @ turn.T + moved**2 * np.eye(2)
        cov = self.column("cov")[:, :2, :2] + noise
        apart = (fix[:2] - self.column("mu")[:, :2]) / self.state["scale"]
        chi2 = np.einsum("ni,ni->n", apart, np.linalg.solve(cov, apart[..., None])[..., 0])
        weight = self.column("log_weight") - 0.5 * (chi2 + np.log(np.linalg.det(cov)))
        best = np.argsort(-weight)[:KEPT]
        if best[0] < _OFF or chi2[best[0]] > _FITS:
            return best[:0]
        rows: NDArray[np.int64] = best[best >= _OFF]
        return rows


def search(
    roads: RoadMap, timeline: Timeline, belief: Belief, output: Output, *, vehicle: Vehicle,
    settings: Settings, start: StartPose | None, progress: Callable[[int], None] | None = None,
) -> tuple[int, Path]:  # fmt: skip
    """Predict from every road by odometry until the ordinary belief holds what is left.

    Args:
        roads: The map.
        timeline: The drive in epochs, with odometry that measures turns.
        belief: Empty; filled when the search ends with few hypotheses.
        output: Rows of the epochs that the search estimates are filled.
        vehicle: The car.
        settings: The model's numbers.
        start: Where to search, roughly; None: the whole map.
        progress: Called with the number of epochs that are done.

    Returns:
        The first epoch without an estimate, and the tree of edges entered.  The belief is
        empty when the drive ends undecided, or a fix comes that fits nothing.

    Raises:
        DriveError: The odometry has no turns, or the map is too large to search.
    """
    if timeline.mode != WHEELS:
        raise DriveError(
            "the drive has no odometry that measures turns; both wheels, or speed and yaw rate, "
            "were expected to start from the map alone; give a fix or a start pose"
        )
    epochs = timeline.epochs
    time = epochs.time
    n = len(epochs)
    mixture = _Search(roads, vehicle, settings, start, timeline)
    if have_fine_fix(epochs[:1])[0]:
        return _meet_fix(mixture, belief, epochs, 0)
    mixture.hear(epochs[:1])
    mixture.summarise(output, 0)
    done, firm = 1, 0.0
    for step in steps(epochs, mixture.least):
        k = step.epoch
        repeat(output, done, k)
        mixture.state["time"] = time[k]
        mixture.state["speed"] = step.metres / max(time[k] - time[done - 1], 1e-3)
        mixture.step(step)
        if step.whole:
            mixture.hear(epochs[done : k + 1])
            mixture.summarise(output, k)
            done = k + 1
            firm = firm + step.metres if mixture.is_decided() else 0.0
            if firm > _PROBATION:
                mixture.fill_belief(belief, mixture.heaviest()[_OFF:KEPT])
                return done, mixture.path
        if progress is not None:
            progress(done)
    if done < n:
        return _meet_fix(mixture, belief, epochs, done)
    rows = mixture.heaviest()[_OFF:KEPT]
    if mixture.column("weight")[rows].sum() > 0.5:
        mixture.fill_belief(belief, rows)
    return n, mixture.path


def _meet_fix(search: _Search, belief: Belief, epochs: Records, k: int) -> tuple[int, Path]:
    """A fix at epoch k ends the search; where it fits nothing, it starts the filter."""
    rows = search.fitting(epochs.fix[k], abs(float(epochs.arc[k])) + 1.0)
    if len(rows):
        search.fill_belief(belief, rows)
    return k, search.path
