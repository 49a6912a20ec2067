"""The population, what is done to it at each step, and when it is small enough."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..core.belief import (
    EVIDENCE,
    GNSS_SCALE,
    GNSS_XX,
    GNSS_YY,
    KEPT,
    LAST_FIX,
    NOW,
    OFF_ROAD,
    QUICK_SCALE,
    SCALED_AT,
    SLOW_SCALE,
    SPEED,
    STARTED,
    TRAVELLED,
    WANDER_SCALE,
    Belief,
    H,
    Route,
    X,
    Y,
    new_belief,
    new_route,
    normalise,
)
from ..core.drive import _roll
from ..core.epoch import WHEELS, Epochs, new_epochs
from ..core.output import Output, say
from ..core.population import collect, hand_over_all, lay_out, new_population, sum_up
from ..core.road import observe_roads
from ..core.switching import new_work
from ..epochs import Timeline
from ..errors import DriveError
from ..records import Array, StartPose
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle
from .pieces import DROP, KNOWN, pieces_of
from .wheels import Step, steps

MAP = "map"
"""The start that is anywhere on the map."""

_MERGE = 0.05  # nats
_SWING = 10.0  # m, over which the wheels' turns are summed
_STRAIGHT = 0.15  # rad; less is a bend, which centre lines tell
_LOOSE = 3.0  # 1/rad
_FEW = 500  # hypotheses that are followed epoch by epoch
_DECIDED = 1e-3  # of the weight left out, when the ordinary belief takes over
_LANE, _LANE_LENGTH = 1.5, 60.0  # m; one evasion must not lose to 100,000 other roads
_PROBATION = 500.0  # m for which it must have been small, lest the search be in vain
_AGAIN = 25.0  # m until those that began off the roads may come on to any
_LESS_OFTEN = 1.1  # times as far until they may the next time
_NEAR = 40.0  # m; a pose known better than this needs no search
_FITS = 25.0  # chi-square of a fix that a hypothesis can explain


def is_vague(start: StartPose | str | None, mode: int) -> bool:
    """Whether a start must be searched for on the map."""
    if isinstance(start, StartPose):
        vague = start.sigma_m > _NEAR or start.sigma_bearing_deg > KNOWN
        return mode == WHEELS and vague
    return start == MAP


def set_clock(clock: Array, time: float, settings: Settings) -> None:
    """The clock of a belief that begins before any fix."""
    clock[[NOW, SCALED_AT]] = time
    clock[LAST_FIX] = -math.inf
    clock[STARTED] = 1.0
    clock[GNSS_XX] = clock[GNSS_YY] = settings.default_sigma_m**2
    clock[[GNSS_SCALE, QUICK_SCALE, WANDER_SCALE, SLOW_SCALE]] = 1.0


class _Search:
    """The population and what is done to it at each step."""

    def __init__(
        self, roads: RoadMap, vehicle: Vehicle, settings: Settings, start: StartPose | None,
        time: float,
    ) -> None:  # fmt: skip
        self.arrays, self.settings = roads.arrays, settings
        par = settings.parameters()
        self.par = par._replace(
            lane_sigma=max(par.lane_sigma, _LANE), lane_length=min(par.lane_length, _LANE_LENGTH)
        )
        self.side = 1.0 if vehicle.driving_side == "right" else -1.0
        self.pieces = pieces_of(roads, settings, start)
        self.part, self.work = new_belief(), new_work()
        self.clock = self.part.clock
        set_clock(self.clock, time, settings)
        room = 3 * len(self.pieces.edge) + 1000
        self.population = new_population(room, self.clock)
        self.spare = new_population(room, self.clock)
        self.route = new_route(max(1 << 16, 16 * len(self.pieces.edge)))
        self.one = new_epochs(1)
        self.since_beginning, self.again = 0.0, _AGAIN
        self.swing = 0.0  # rad, turned of late
        self._centre(start, roads)
        self._begin(1.0 - settings.off_road_start)
        self._reduce()

    def _centre(self, start: StartPose | None, roads: RoadMap) -> None:
        """The row of a vehicle on no road: somewhere there, with any heading."""
        p = self.pieces
        w = np.exp(p.log_weight)
        x, y = float(w @ p.x), float(w @ p.y)
        self.scale = 1.0 + self.arrays.curvature * (x * x + y * y)
        lay_out(
            self.population, self.arrays, p.edge[:1], p.s[:1], p.spread[:1],
            np.array([math.log(max(self.settings.off_road_start, 1e-300))]),
            self.scale, self.side, self.par,
        )  # fmt: skip
        mean, cov = self.population.mean[0], self.population.cov[0]
        mean[X], mean[Y], mean[H] = x, y, 0.0
        cov[:3, :], cov[:, :3] = 0.0, 0.0
        cov[:2, :2] = np.cov(np.stack([p.x, p.y]), aweights=w, ddof=0) + 50.0**2 * np.eye(2)
        cov[H, H] = math.pi**2 / 3.0
        self.population.edge[0] = OFF_ROAD

    def _begin(self, share: float) -> None:
        """A vehicle begins somewhere on the roads, with that much of the weight."""
        p = self.pieces
        lay_out(
            self.population, self.arrays, p.edge, p.s, p.spread,
            p.log_weight + math.log(max(share, 1e-300)), self.scale, self.side, self.par,
        )  # fmt: skip
        self.since_beginning = 0.0

    @property
    def size(self) -> int:
        return int(self.population.size[0])

    @property
    def off(self) -> int:
        """The row of no road."""
        return int(np.flatnonzero(self.population.edge[: self.size] == OFF_ROAD)[0])

    def step(self, step: Step) -> None:
        """Predict, branch, observe the map, weigh, merge, prune."""
        par, one = self.par, self.one
        one.arc[0], one.turn[0], one.moved[0] = step.arc, step.turn, step.measured
        one.forward[0], one.left[0] = step.forward, step.left
        _roll(self.population, self.scale, one, 0, 1, par)
        self._hand_over(step.arc)
        self.clock[TRAVELLED] += step.metres
        self.swing = self.swing * math.exp(-step.metres / _SWING) + abs(step.turn)
        if self.clock[TRAVELLED] >= par.map_spacing:
            self._observe()
        self._reduce()

    def _hand_over(self, arc: float) -> None:
        while not hand_over_all(
            self.population, self.spare, self.part, self.arrays, self.route, self.work,
            self.scale, arc, self.side, self.par.lane_sigma, self._floor(),
        ):  # fmt: skip
            self._reduce(2 * self.size // 3)
        self.population, self.spare = self.spare, self.population

    def _observe(self) -> None:
        par = self.par
        self._leave_and_return(float(self.clock[TRAVELLED]))
        loose = min(max(_LOOSE * (self.swing - _STRAIGHT), 0.0), 1.0)
        observe_roads(
            self.population, self.arrays, self.scale, self.side, True,
            math.hypot(par.relative_sigma, loose * par.node_sigma),
            math.hypot(par.edge_heading_sigma, loose * par.node_heading_sigma), par.node_radius,
            par.node_sigma, par.node_heading_sigma, par.lane_sigma, par.lane_length,
            par.map_sigma, par.map_length, par.off_road_cost, self.work.row,
        )  # fmt: skip
        self.clock[TRAVELLED] = 0.0

    def least(self) -> float:
        """How far to go in one step, m; 0: epoch by epoch."""
        return self.par.map_spacing if self.size > _FEW else 0.0

    def _floor(self) -> float:
        return min(DROP / max(self.size, 1), 0.1 * self.par.prune)

    def _leave_and_return(self, metres: float) -> None:
        """Rates per metre, as in the filter; who returns may do so anywhere."""
        normalise(self.population)
        n, off = self.size, self.off
        log_weight = self.population.log_weight[:n]
        leave = min(self.par.off_road_leave * metres, 0.5)
        p_off = math.exp(log_weight[off])
        log_weight += math.log1p(-leave)
        p_off += leave * (1.0 - p_off)
        self.since_beginning += metres
        share = p_off * min(self.par.off_road_return * self.since_beginning, 0.5)
        if self.since_beginning >= self.again and share > 1e-3:
            p_off -= share
            self._begin(share)
            self.again *= _LESS_OFTEN
        self.population.log_weight[off] = math.log(max(p_off, 1e-300))
        normalise(self.population)

    def _reduce(self, most: int | None = None) -> None:
        """Drop what is too light, or all but so many; merge what is close; tidy up."""
        normalise(self.population)
        evidence = self.clock[EVIDENCE]
        n = self.size
        p, edge = self.population.probability[:n], self.population.edge[:n]
        keep = np.flatnonzero((p > self._floor()) | (edge == OFF_ROAD))
        if most is not None:
            keep = self.heaviest()[:most]
        order = keep[np.lexsort((self.population.abscissa[keep], edge[keep]))]
        collect(self.population, self.spare, self.route, order, _MERGE, self.scale)
        self.population, self.spare = self.spare, self.population
        normalise(self.population)
        self.clock[EVIDENCE] = evidence
        if self.route.size[0] > 0.8 * len(self.route.edge):
            self._tidy()

    def _tidy(self) -> None:
        """Keep the nodes that living hypotheses descend from."""
        route, node = self.route, self.population.node[: self.size]
        keep = np.zeros(int(route.size[0]) + 1, bool)
        front = np.unique(node)
        while len(front):
            keep[front] = True
            front = np.unique(route.parent[front])
            front = front[(front >= 0) & ~keep[front]]
        kept = np.flatnonzero(keep[:-1])
        number = np.full(len(keep), -1, np.int64)
        number[kept] = np.arange(len(kept))
        for column in (route.edge, route.time, route.abscissa):
            column[: len(kept)] = column[kept]
        route.parent[: len(kept)] = number[route.parent[kept]]
        route.size[0] = len(kept)
        node[:] = number[node]

    def heaviest(self) -> NDArray[np.int64]:
        """All rows, the off-road one first, then those of most weight."""
        p = self.population.probability[: self.size].copy()
        p[self.off] = 2.0
        return np.argsort(-p)

    def decided(self) -> bool:
        """Whether the ordinary belief holds what is left, in few Gaussians on each edge."""
        p, edge = self.population.probability[: self.size], self.population.edge[: self.size]
        if len(p) > _FEW or 1.0 - p[self.heaviest()[1:KEPT]].sum() > _DECIDED:
            return False
        counts = np.unique(edge[p > self.par.prune], return_counts=True)[1]
        return bool(counts.max() <= self.par.components)

    def tell(self, output: Output, k: int) -> None:
        """Answer epoch k."""
        order = self.heaviest()
        sum_up(self.population, self.part, order, min(KEPT - 1, len(order)), self.scale)
        say(
            self.part, self.arrays, output, k, self.scale, self.settings.outage_after_s,
            self.settings.ambiguous_below, self.par.protection_risk, self.par.unknown, 0.0,
        )  # fmt: skip
        output.live[k] = self.size

    def settle(self, belief: Belief, rows: NDArray[np.int64]) -> None:
        """Hand rows over to the ordinary belief."""
        sum_up(self.population, belief, rows, len(rows), self.scale)
        belief.clock[:] = self.clock
        normalise(belief)
        belief.clock[EVIDENCE] = self.clock[EVIDENCE]

    def fitting(self, fix: Array, moved: float) -> NDArray[np.int64]:
        """The rows that go best with a fix, none when no row does."""
        n = self.size
        c, s = math.cos(fix[4]), math.sin(fix[4])
        turn = np.array([[c, -s], [s, c]])
        noise = turn @ np.diag(4.0 * fix[2:4] ** 2) @ turn.T + moved**2 * np.eye(2)
        cov = self.population.cov[:n, :2, :2] + noise
        apart = (fix[:2] - self.population.mean[:n, :2]) / self.scale
        chi2 = np.einsum("ni,ni->n", apart, np.linalg.solve(cov, apart[..., None])[..., 0])
        weight = self.population.log_weight[:n] - 0.5 * (chi2 + np.log(np.linalg.det(cov)))
        best = np.argsort(-weight)[:KEPT]
        if best[0] == self.off or chi2[best[0]] > _FITS:
            return best[:0]
        rows: NDArray[np.int64] = best[best != self.off]
        return rows


def search(
    roads: RoadMap, timeline: Timeline, belief: Belief, output: Output, *, vehicle: Vehicle,
    settings: Settings, start: StartPose | None, progress: Callable[[int], None] | None = None,
) -> tuple[int, Route]:  # fmt: skip
    """Follow the wheels from every road until the ordinary belief holds what is left.

    Args:
        roads: The map.
        timeline: The drive in epochs, with wheels that tell turns.
        belief: Empty; filled when the search ends with few hypotheses.
        output: Rows of the epochs that the search answers are filled.
        vehicle: The car.
        settings: The model's numbers.
        start: Where to look, roughly; None: the whole map.
        progress: Told how many epochs are done.

    Returns:
        The first epoch that is not answered, and the tree of edges entered.  The belief is
        empty when the drive ends undecided, or a fix comes that fits nothing.

    Raises:
        DriveError: The drive tells no turns, or the map is too large to search.
    """
    if timeline.mode != WHEELS:
        raise DriveError(
            "the drive has no odometry that tells turns; both wheels, or speed and yaw rate, "
            "were expected to start from the map alone; give a fix or a start pose"
        )
    epochs = timeline.epochs
    n = len(epochs.time)
    search = _Search(roads, vehicle, settings, start, float(epochs.time[0]))
    if epochs.has_fix[0]:
        return _meet(search, belief, epochs, 0)
    search.tell(output, 0)
    done, firm = 1, 0.0
    for step in steps(epochs, search.least):
        k = step.epoch
        _repeat(output, done, k)
        search.clock[NOW] = epochs.time[k]
        search.clock[SPEED] = step.metres / max(epochs.time[k] - epochs.time[done - 1], 1e-3)
        search.step(step)
        if step.whole:
            search.tell(output, k)
            done = k + 1
            firm = firm + step.metres if search.decided() else 0.0
            if firm > _PROBATION:
                search.settle(belief, search.heaviest()[1:KEPT])
                return done, search.route
        if progress is not None:
            progress(done)
    if done < n:
        return _meet(search, belief, epochs, done)
    rows = search.heaviest()[1:KEPT]
    if search.population.probability[rows].sum() > 0.5:
        search.settle(belief, rows)
    return n, search.route


def _repeat(output: Output, first: int, last: int) -> None:
    """Epochs first … last − 1 are less than a step later than the one before."""
    for column in output:
        if len(column):
            column[first:last] = column[first - 1]


def _meet(search: _Search, belief: Belief, epochs: Epochs, k: int) -> tuple[int, Route]:
    """A fix at epoch k ends the search; where it fits nothing, it starts the filter."""
    rows = search.fitting(epochs.fix[k], abs(float(epochs.arc[k])) + 1.0)
    if len(rows):
        search.settle(belief, rows)
    return k, search.route
