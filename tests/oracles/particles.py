"""A Rao-Blackwellised particle filter over the roads: what merging and pruning approximate.

Every particle has taken one branch at each fork of its way (edge, off the roads, turned
round) and holds the Gaussian that this leaves.  Prediction, fixes, roads and the
probabilities of branching are the filter's own kernels; but no two particles are ever
merged.  While there are fewer than N ways all are kept, so that the result is exact;
from there on they are sampled without bias, the heavy ones being kept as they are
(Fearnhead and Clifford 2003): those above a threshold c with their weights, of the rest
some, systematically drawn, with weight c.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from oracles.compiled import compiled
from scenes.filter import steps
from whichroad._compile import Record, Records, kernel
from whichroad.filter._simd import N, copy_record
from whichroad.filter.creeping import count_motion
from whichroad.filter.gnss import bias as gnss_bias
from whichroad.filter.gnss import noise as gnss_noise
from whichroad.filter.gnss import position as gnss
from whichroad.filter.gnss.position import Axes
from whichroad.filter.hypotheses import branching
from whichroad.filter.hypotheses.births import exchange_off_road, turn_with_heading
from whichroad.filter.modes import follow_odometer
from whichroad.filter.motion import increment_of, pieces_of, predict_plane, wheel_noise
from whichroad.filter.road import observe_map
from whichroad.filter.state import (
    OFF_ROAD,
    WHEELS,
    Belief,
    Context,
    Epochs,
    Path,
    X,
    Y,
    new_belief,
    new_path,
    new_work,
    normalise,
)  # fmt: skip
from whichroad.filter.step import _EXCHANGE
from whichroad.graph.network import Roads, plane_scale
from whichroad.settings import Settings, Vehicle, parameters

Array = NDArray[np.float64]

_LEAST = 1e-6  # shares of a particle below this are not followed
_ROOM = 8  # rows for children, in units of the particles kept


@kernel
def _predict(crowd: Belief, ctx: Context, epochs: Epochs, k: int, pieces: int) -> None:
    """Move all particles by one of equal pieces of epoch k."""
    state = crowd.state[0]
    move = increment_of(epochs[k], pieces, 0.0)
    q = wheel_noise(ctx.par[0], abs(move.arc), move.turn)
    for i in range(state.count):
        predict_plane(crowd.hyp[i].mu, crowd.hyp[i].cov, move, state.scale, q)


@kernel
def _branch(crowd: Belief, one: Belief, ctx: Context, path: Path, arc: float) -> bool:
    """Branch, one particle at a time, each as if there were no other; False: no room."""
    for i in range(crowd.state[0].count):
        _single_out(crowd, one, i)
        branching.branch(one, path, ctx, arc, 0.0)
        if not _return_children(crowd, one, i):
            return False
    return True


@kernel
def _exchange(crowd: Belief, one: Belief, ctx: Context, metres: float) -> bool:
    """The same for the off-road mode, where that is due, and for turning round."""
    for i in range(crowd.state[0].count):
        _single_out(crowd, one, i)
        if metres > 0.0:
            one.state[0].since_exit = metres
            exchange_off_road(one, ctx)
        turn_with_heading(one, ctx)
        if not _return_children(crowd, one, i):
            return False
    return True


@kernel
def _single_out(crowd: Belief, one: Belief, i: int) -> None:
    copy_record(one.hyp[0], crowd.hyp[i])
    one.hyp[0].weight = 1.0
    one.state[0].count = 1
    one.state[0].scale = crowd.state[0].scale
    one.state[0].knows_heading = 1
    one.state[0].odometer_speed = crowd.state[0].odometer_speed


@kernel
def _return_children(crowd: Belief, one: Belief, i: int) -> bool:
    state = crowd.state[0]
    copy_record(crowd.hyp[i], one.hyp[0])
    for c in range(1, one.state[0].count):
        if state.count >= len(crowd.hyp):
            return False
        copy_record(crowd.hyp[state.count], one.hyp[c])
        state.count += 1
    return True


age_receiver = compiled(gnss_bias.age_receiver)
update_root = compiled(gnss_noise.update_root)
observe_position = compiled(gnss.observe_position)
predict, branch, exchange = compiled(_predict), compiled(_branch), compiled(_exchange)


def thinned(weight: Array, most: int, rng: np.random.Generator) -> tuple[NDArray[np.int64], Array]:
    """Which to keep, at most about `most`, and their new weights, without bias.

    Args:
        weight: Normalised, (n,).
        most: How many remain.
        rng: Draws one number.
    """
    if len(weight) <= most:
        return np.arange(len(weight)), weight
    falling = np.sort(weight)[::-1]
    rest = np.concatenate([np.cumsum(falling[::-1])[::-1], [0.0]])
    # With the k heaviest kept, the rest is drawn with the threshold c = rest / (most - k).
    k = np.arange(most)
    c = rest[:most] / (most - k)
    threshold = c[int(np.argmax(falling[:most] <= c))]
    heavy = weight > threshold
    light = np.flatnonzero(~heavy & (weight > 0.0))
    ladder = np.cumsum(weight[light]) / threshold + rng.random()
    drawn = light[np.diff(np.floor(ladder), prepend=0.0) >= 1.0]
    rows = np.concatenate([np.flatnonzero(heavy), drawn])
    return rows, np.where(heavy[rows], weight[rows], threshold)


class Particles:
    """The particle filter on the epochs of one drive; vehicles with wheels only.

    Args:
        roads: The network.
        epochs: What the sensors measured; the first epoch has a fix.
        settings: Without learning of the GNSS noise, gates and faults: they look at the
            most probable hypothesis, of which there is none here.
        most: Particles kept.
        seed: Of the sampling.
    """

    def __init__(
        self, roads: Roads, epochs: Records, settings: Settings, most: int, seed: int
    ) -> None:
        self.roads, self.epochs, self.most = roads, epochs, most
        par = parameters(settings, Vehicle(), WHEELS)
        work = new_work()._replace(gains=np.zeros((2 * _ROOM * most, N)))
        self.ctx, self.par = Context(par, roads, work), par[0]
        every = par.copy()
        every.prune = _LEAST
        self.branching = self.ctx._replace(par=every)
        self.rng = np.random.default_rng([seed, 5])
        self.path, self.one = new_path(64), new_belief()
        self.crowd, self.spare = (new_belief(capacity=_ROOM * most) for _ in range(2))
        self._begin(settings)

    def _begin(self, settings: Settings) -> None:
        """The filter's own cold start, unreduced."""
        whole = replace(settings, prune=0.0, merge=0.0, components=8)
        _, start, _ = next(steps(self.roads, self.epochs, settings=whole))
        n = int(start.state[0].count)
        self.crowd.hyp[:n] = start.hyp[:n]
        self.crowd.hyp.path_entry = -1
        self.crowd.state[:] = start.state

    def probabilities(self) -> dict[int, float]:
        """P of each edge, `OFF_ROAD` included."""
        normalise(self.crowd)
        alive = self.crowd.hyp[: self.crowd.state[0].count]
        edges, at = np.unique(alive.edge, return_inverse=True)
        p = np.bincount(at, alive.weight)
        return dict(zip(edges.tolist(), p.tolist(), strict=True))

    def run(self) -> Iterator[dict[int, float]]:
        """P of each edge after every epoch, the first included."""
        yield self.probabilities()
        for k in range(1, len(self.epochs)):
            epoch = self.epochs[k]
            state, x = self.crowd.state[0], self.crowd.hyp["mu"][0]
            state.scale = plane_scale(self.roads, x[X], x[Y])
            dt = epoch.time - state.time
            state.time = epoch.time
            pieces = pieces_of(epoch.arc)
            for piece in range(pieces):
                self._step(k, pieces, piece == pieces - 1, dt / pieces)
            yield self.probabilities()

    def _step(self, k: int, pieces: int, done: bool, dt: float) -> None:
        """What `filter.step.run` does with one piece of epoch k, up to the reduction."""
        epoch = self.epochs[k]
        arc = epoch.arc / pieces
        predict(self.crowd, self.ctx, self.epochs, k, pieces)
        count_motion(self.crowd.state[0], abs(arc), dt)
        if done:
            follow_odometer(self.crowd.state[0], epoch.arc, dt * pieces)
        if epoch.has_fix and done:
            self._observe_fix(epoch)
        self._expand(lambda: branch(self.crowd, self.one, self.branching, self.path, arc))
        if done and self.crowd.state[0].since_map >= self.par.map_spacing:
            self._observe_map()

    def _observe_fix(self, epoch: Record) -> None:
        state, par, fix = self.crowd.state[0], self.par, epoch["fix"]
        interval = epoch.time - state.last_fix
        age_receiver(self.crowd, self.ctx, self.ctx.par[0].gnss_time, True)
        update_root(self.crowd, fix, state.gnss_factor, interval)
        state.moving = state.since_fix = 0.0
        state.last_fix = epoch.time
        normalise(self.crowd)
        white = math.sqrt(state.gnss_factor) * par.gnss_white_ratio
        variance = (white * fix[2:4]) ** 2 * max(1.0, 1.0 / interval)
        axes = Axes(math.cos(fix[4]), math.sin(fix[4]), *variance)
        observe_position(self.crowd, self.ctx, fix, axes, par.gnss_gate, False, 0.0)
        normalise(self.crowd)

    def _observe_map(self) -> None:
        state = self.crowd.state[0]
        normalise(self.crowd)
        alive = self.crowd.hyp[: state.count]
        off = alive.weight[alive.edge == OFF_ROAD].sum()
        due = state.since_exit >= _EXCHANGE or off > 1e-3
        metres = float(state.since_exit) if due else 0.0
        self._expand(lambda: exchange(self.crowd, self.one, self.ctx, metres))
        state = self.crowd.state[0]
        if due:
            state.since_exit = 0.0
        observe_map(self.crowd, self.ctx, True)
        state.since_map = 0.0
        self._thin()

    def _expand(self, children: Callable[[], bool]) -> None:
        """Sample, then branch; one that does not fit in is a mistake of `_ROOM`."""
        self._thin()
        if not children():
            raise MemoryError("particles had more children than there is room for")
        normalise(self.crowd)

    def _thin(self) -> None:
        normalise(self.crowd)
        n = int(self.crowd.state[0].count)
        if n > self.most:
            rows, weight = thinned(self.crowd.hyp.weight[:n], self.most, self.rng)
            self.spare.hyp[: len(rows)] = self.crowd.hyp[rows]
            self.spare.state[:] = self.crowd.state
            self.crowd, self.spare = self.spare, self.crowd
            self.crowd.state[0].count = len(rows)
            with np.errstate(divide="ignore"):
                self.crowd.hyp.log_weight[: len(rows)] = np.log(weight)
            normalise(self.crowd)
