"""One hypothesis predicted over some epochs by the filter, and by the smoother's process model.

The only test module that knows how the smoother stores a link.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from whichroad._compile import Records
from whichroad.filter.lookback.history import History, new_history
from whichroad.filter.lookback.link_motion import LINK_MODEL, predict_link
from whichroad.filter.lookback.link_road import Link as Between
from whichroad.filter.motion import arc_chord
from whichroad.filter.state import (
    OFF_ROAD,
    Belief,
    Context,
    H,
    N,
    Path,
    new_belief,
    new_epochs,
    new_path,
    new_work,
)
from whichroad.filter.step import run
from whichroad.filter.summary.estimate import new_output
from whichroad.graph.network import Roads, records
from whichroad.settings import Settings, Vehicle, parameters

from .beliefs import On, belief_on

Array = NDArray[np.float64]

SETTINGS = Settings(map_spacing=50.0, u_turn_rate=0.0)  # no map observation within a link


class Motion(NamedTuple):
    """Odometry of n epochs."""

    time: Array  # s after the link's beginning
    arc: Array  # m
    turn: Array  # rad
    valid: NDArray[np.bool_]  # whether it was measured


class Moved(NamedTuple):
    """A Gaussian before and after a link: x' = f(x), P' = F P Fᵀ + Q; positions in true metres."""

    mean: Array  # (N,)
    f: Array  # (N, N)
    q: Array  # (N, N)


def motion(
    count: int, interval: float, arc: float, turn: float = 0.0, valid: ArrayLike = True
) -> Motion:
    """Equal epochs."""
    full = np.full(count, 1.0)
    return Motion(
        interval * np.arange(1, count + 1), arc * full, turn * full,
        np.broadcast_to(np.asarray(valid), (count,)),
    )  # fmt: skip


def _epochs(motion: Motion) -> Records:
    """An epoch without motion, then the motion; no fixes."""
    n = len(motion.time)
    epochs = new_epochs(n + 1)
    epochs.time[1:], epochs.arc[1:], epochs.turn[1:] = motion.time, motion.arc, motion.turn
    for k in range(1, n + 1):
        epochs.forward[k], epochs.left[k] = arc_chord(epochs.arc[k], epochs.turn[k])
    epochs.odometry_valid[1:] = motion.valid
    epochs.speed_sigma[:] = epochs.course_sigma[:] = np.inf
    return epochs


class Link:
    """A hypothesis on edge 0 of a map, or off its roads, and its motion.

    Args:
        roads: The map.
        motion: Odometry.
        mode: WHEELS, DISTANCE or CLOCK.
        mean: State at the beginning, (N,).
        off_road: Whether it is on no road.
        course: Whether a course over ground was heard just before.
        scale: Local scale of the plane; the map's curvature has to be right for it.
    """

    def __init__(
        self, roads: Roads, motion: Motion, mode: int, mean: Array, *, off_road: bool = False,
        course: bool = False, scale: float = 1.0,
    ) -> None:  # fmt: skip
        self.roads, self.mode, self.mean, self.scale = roads, mode, mean, scale
        self.course = course
        self.epochs = _epochs(motion)
        self.ctx = Context(parameters(SETTINGS, Vehicle(), mode), roads, new_work())
        self.edge = OFF_ROAD if off_road else 0
        self.unit = np.ones(N)
        self.unit[:2] = scale

    def _run(self, mean: Array, cov: Array) -> tuple[Belief, History, Path]:
        """The belief, history and path tree after the filter's run over the link."""
        belief = new_belief(True)
        belief.hyp[0] = belief_on(self.roads, [On(self.edge)]).hyp[0]
        belief.hyp["mu"][0], belief.hyp["cov"][0] = mean, cov
        state = belief.state[0]
        state.count, state.started, state.scale, state.speed = 1, 1, self.scale, 10.0
        state.mode = self.mode
        if self.course:
            state.course_time = 0.0
        history, path = new_history(64), new_path(1 << 12)
        n = len(self.epochs)
        run(belief, path, history, self.epochs, new_output(n, False), self.ctx, 0, n)
        assert state.count == 1
        return belief, history, path

    def filtered(self, step: Array) -> Moved:
        """The filter's prediction: F by central differences of the mean, Q from P = 0.

        Args:
            step: Of the differences, (N,).
        """
        none = np.diag((1e-9 * step) ** 2)
        belief, _, _ = self._run(self.mean, none)
        f = np.zeros((N, N))
        for a in range(N):
            ends = []
            for sign in (1.0, -1.0):
                mean = self.mean.copy()
                mean[a] += sign * step[a]
                ends.append(self._run(mean, none)[0].hyp["mu"][0].copy())
            off = ends[0] - ends[1]
            off[H] = np.angle(np.exp(1j * off[H]))
            f[:, a] = off / (2.0 * step[a])
        f = f * self.unit[None, :] / self.unit[:, None]
        return Moved(belief.hyp["mu"][0].copy(), f, belief.hyp["cov"][0].copy())

    def retraced(self, step: Array, freed: float = 0.0) -> Moved:
        """The smoother's process model of the link.

        Args:
            step: See `filtered`.
            freed: Variance that the GNSS bias was given meanwhile.
        """
        cov = np.diag((1e-3 * step) ** 2)
        _, history, path = self._run(self.mean, cov)
        assert history.count[0].steps == 2
        history.nodes.freed[1] += freed
        model = records(1, LINK_MODEL)[0]
        model.then_mean[:], model.then_cov[:] = history.states["mu"][0], cov
        model.scale = self.scale
        predict_link(model, history, path, self.ctx, Between(1, 0, 1))
        f = model.f.copy()
        return Moved(model.mu.copy(), f, model.cov - f @ cov @ f.T)
