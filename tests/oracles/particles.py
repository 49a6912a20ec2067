"""A Rao-Blackwellised particle filter over the roads: what merging and pruning approximate.

Every particle has taken one branch at each fork of its way (edge, off the roads, turned
round) and holds the Gaussian that this leaves.  Prediction, fixes, roads and the
probabilities of handing over are the filter's own kernels; but no two particles are ever
merged.  While there are fewer than N ways all are kept, so that the result is exact;
from there on they are sampled without bias, the heavy ones being kept as they are
(Fearnhead and Clifford 2003): those above a threshold c with their weights, of the rest
some, systematically drawn, with weight c.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from whichroad.core import drive, fixes
from whichroad.core._jit import Vector, kernel
from whichroad.core.belief import (
    GNSS_SCALE,
    LAST_FIX,
    MOVING,
    NOW,
    OFF_ROAD,
    SINCE_FIX,
    SINCE_LEFT,
    TRAVELLED,
    Belief,
    N,
    Route,
    X,
    Y,
    new_belief,
    new_route,
    normalise,
)
from whichroad.core.epoch import Epochs
from whichroad.core.gnss import age_receiver, gnss_root, observe_fix
from whichroad.core.network import Roads
from whichroad.core.road import observe_roads
from whichroad.core.start import leave_and_return, turn_with_heading
from whichroad.core.switching import Work, hand_over, new_work

from scenes.filter import steps
from scenes.kernels import call
from whichroad.settings import Settings

Array = NDArray[np.float64]

_LEAST = 1e-6  # shares of a particle below this are not followed
_ROOM = 8  # rows for children, in units of the particles kept


@kernel
def _copy(source: Belief, i: int, target: Belief, j: int) -> None:
    for a in range(N):
        target.mean[j, a] = source.mean[i, a]
        for b in range(N):
            target.cov[j, a, b] = source.cov[i, a, b]
    target.log_weight[j] = source.log_weight[i]
    target.probability[j] = source.probability[i]
    target.edge[j] = source.edge[i]
    target.segment[j] = source.segment[i]
    target.abscissa[j] = source.abscissa[i]
    target.spread[j] = source.spread[i]
    target.stay[j] = source.stay[i]


@kernel
def _take(source: Belief, rows: Vector, target: Belief) -> None:
    for j in range(len(rows)):
        _copy(source, int(rows[j]), target, j)


@kernel
def _branch(
    crowd: Belief, one: Belief, roads: Roads, route: Route, work: Work, scale: float, arc: float,
    side: float, lane_sigma: float, least: float,
) -> bool:  # fmt: skip
    """Hand over, one particle at a time, each as if there were no other; False: no room."""
    n = crowd.size[0]
    for i in range(n):
        _copy(crowd, i, one, 0)
        one.probability[0] = 1.0
        one.size[0] = 1
        hand_over(one, roads, route, work, scale, arc, side, lane_sigma, least, 0.0, False)
        if not _return_children(crowd, one, i):
            return False
    return True


@kernel
def _leave(
    crowd: Belief, one: Belief, roads: Roads, work: Work, scale: float, travelled: float,
    leave: float, back: float, side: float, lane_sigma: float, map_sigma: float,
    search_radius: float, wrong_way: float,
) -> bool:  # fmt: skip
    """The same for leaving the roads and returning, where that is due, and for turning round."""
    n = crowd.size[0]
    for i in range(n):
        _copy(crowd, i, one, 0)
        one.probability[0] = 1.0
        one.size[0] = 1
        if travelled > 0.0:
            leave_and_return(
                one, roads, work, scale, travelled, leave, back, side, lane_sigma, map_sigma,
                search_radius, wrong_way, False,
            )  # fmt: skip
        turn_with_heading(one, roads, side, lane_sigma)
        if not _return_children(crowd, one, i):
            return False
    return True


@kernel
def _return_children(crowd: Belief, one: Belief, i: int) -> bool:
    _copy(one, 0, crowd, i)
    for c in range(1, one.size[0]):
        at = crowd.size[0]
        if at >= len(crowd.log_weight):
            return False
        _copy(one, c, crowd, at)
        crowd.size[0] = at + 1
    return True


def _rows(capacity: int, small: Belief) -> Belief:
    """A belief with so many rows, and the clock and size of a small one."""
    big = [np.zeros((capacity, *a.shape[1:]), a.dtype) for a in small[:-4]]
    scratch = np.zeros((len(small.scratch), capacity))
    return Belief(*big, small.size, small.clock, scratch, np.zeros((capacity, 0)))


def thinned(weight: Array, most: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Which to keep, at most about `most`, and their new weights, without bias.

    Args:
        weight: Normalised, (n,).
        most: How many remain.
        rng: Draws one number.
    """
    if len(weight) <= most:
        return np.arange(len(weight), dtype=float), weight
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
    return rows.astype(float), np.where(heavy[rows], weight[rows], threshold)


class Particles:
    """The particle filter on the epochs of one drive; vehicles with wheels only.

    Args:
        roads: The network.
        epochs: What the sensors said; the first epoch has a fix.
        settings: Without learning of the GNSS scale, gates and faults: they look at the
            most probable hypothesis, of which there is none here.
        most: Particles kept.
        seed: Of the sampling.
    """

    def __init__(
        self, roads: Roads, epochs: Epochs, settings: Settings, most: int, seed: int
    ) -> None:
        self.roads, self.epochs, self.most = roads, epochs, most
        self.par = settings.parameters()
        self.rng = np.random.default_rng([seed, 5])
        self.route, self.work = new_route(64), new_work()
        small, self.one = new_belief(), new_belief()
        self.crowd, self.spare = _rows(_ROOM * most, small), _rows(_ROOM * most, small)
        self._begin(settings)

    def _begin(self, settings: Settings) -> None:
        """The filter's own cold start, unreduced."""
        whole = replace(settings, prune=0.0, merge=0.0, components=8)
        _, start, _ = next(steps(self.roads, self.epochs, settings=whole))
        n = int(start.size[0])
        for a, b in zip(self.crowd[:-3], start[:-3], strict=True):
            a[:n] = b[:n]  # all but size, clock and scratch
        self.crowd.node[:] = self.spare.node[:] = -1
        self.crowd.size[0] = n
        self.crowd.clock[:] = start.clock

    def _call(self, function: Any, **given: Any) -> Any:
        shared = {
            **self.par._asdict(), "belief": self.crowd, "roads": self.roads, "route": self.route,
            "work": self.work, "epochs": self.epochs, "par": self.par, "row": self.work.row,
            "heading_sigma": self.par.edge_heading_sigma,
        }  # fmt: skip
        names = function.py_func.__code__.co_varnames[: function.py_func.__code__.co_argcount]
        return call(function, **{k: v for k, v in {**shared, **given}.items() if k in names})

    def probabilities(self) -> dict[int, float]:
        """P of each edge, `OFF_ROAD` included."""
        normalise(self.crowd)
        n = int(self.crowd.size[0])
        edges, at = np.unique(self.crowd.edge[:n], return_inverse=True)
        p = np.bincount(at, self.crowd.probability[:n])
        return dict(zip(edges.tolist(), p.tolist(), strict=True))

    def run(self) -> Iterator[dict[int, float]]:
        """P of each edge after every epoch, the first included."""
        yield self.probabilities()
        for k in range(1, len(self.epochs.time)):
            clock, x = self.crowd.clock, self.crowd.mean[0]
            scale = 1.0 + self.roads.curvature * (x[X] ** 2 + x[Y] ** 2)
            dt = self.epochs.time[k] - clock[NOW]
            clock[NOW] = self.epochs.time[k]
            pieces = max(1, math.ceil(abs(self.epochs.arc[k]) / drive._STEP))
            for piece in range(pieces):
                self._step(k, pieces, piece == pieces - 1, dt / pieces, scale)
            yield self.probabilities()

    def _step(self, k: int, pieces: int, done: bool, dt: float, scale: float) -> None:
        """What `core.drive.run` does with one piece of an epoch, up to the reduction."""
        clock, arc = self.crowd.clock, self.epochs.arc[k] / pieces
        self._call(drive._roll, scale=scale, k=k, pieces=pieces)
        drive._count_motion(clock, abs(arc), dt)
        if self.epochs.has_fix[k] and done:
            self._see_fix(k, scale)
        self._expand(
            lambda: _branch(
                self.crowd, self.one, self.roads, self.route, self.work, scale, arc, 1.0,
                self.par.lane_sigma, _LEAST,
            )
        )  # fmt: skip
        if done and clock[TRAVELLED] >= self.par.map_spacing:
            self._see_roads(scale)

    def _see_fix(self, k: int, scale: float) -> None:
        clock, par, fix = self.crowd.clock, self.par, self.epochs.fix[k]
        interval = self.epochs.time[k] - clock[LAST_FIX]
        age_receiver(self.crowd, clock[MOVING], par.gnss_time, par.gnss_fault_time)
        factor = clock[GNSS_SCALE]
        gnss_root(self.crowd, fix, factor, interval, fixes._SMOOTHING, self.work.root)
        clock[MOVING] = clock[SINCE_FIX] = 0.0
        clock[LAST_FIX] = self.epochs.time[k]
        normalise(self.crowd)
        self._call(
            observe_fix, fix=fix, root=self.work.root, interval=interval, scale=scale,
            white_ratio=math.sqrt(factor) * par.gnss_white_ratio, gate=par.gnss_gate, jumps=False,
        )  # fmt: skip
        normalise(self.crowd)

    def _see_roads(self, scale: float) -> None:
        clock, par = self.crowd.clock, self.par
        normalise(self.crowd)
        n = int(self.crowd.size[0])
        off = self.crowd.probability[:n][self.crowd.edge[:n] == OFF_ROAD].sum()
        due = clock[SINCE_LEFT] >= drive._LEAVING or off > 1e-3
        travelled = float(clock[SINCE_LEFT]) if due else 0.0
        self._expand(
            lambda: _leave(
                self.crowd, self.one, self.roads, self.work, scale, travelled,
                par.off_road_leave, par.off_road_return, 1.0, par.lane_sigma, par.map_sigma,
                par.search_radius, par.wrong_way,
            )
        )  # fmt: skip
        if due:
            clock[SINCE_LEFT] = 0.0
        self._call(observe_roads, scale=scale, with_heading=True)
        clock[TRAVELLED] = 0.0
        self._thin()

    def _expand(self, branch: Any) -> None:
        """Branch, then sample; one that does not fit in is a mistake of `_ROOM`."""
        self._thin()
        if not branch():
            raise MemoryError("particles had more children than there is room for")
        normalise(self.crowd)

    def _thin(self) -> None:
        normalise(self.crowd)
        n = int(self.crowd.size[0])
        if n > self.most:
            rows, weight = thinned(self.crowd.probability[:n], self.most, self.rng)
            _take(self.crowd, rows, self.spare)
            self.crowd, self.spare = self.spare, self.crowd
            self.crowd.size[0] = len(rows)
            with np.errstate(divide="ignore"):
                self.crowd.log_weight[: len(rows)] = np.log(weight)
            normalise(self.crowd)
