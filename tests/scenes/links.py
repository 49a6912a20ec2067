"""One hypothesis predicted over some epochs by the filter, and by the smoother's process model.

The only test module that knows how the smoother stores a link.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from whichroad.core.belief import (
    LAST_FIX,
    NOW,
    OFF_ROAD,
    SPEED,
    STARTED,
    Belief,
    H,
    N,
    Route,
    new_belief,
    new_route,
)
from whichroad.core.drive import run
from whichroad.core.epoch import Epochs, new_epochs
from whichroad.core.gain import new_bench
from whichroad.core.memory import Memory, new_memory
from whichroad.core.motion import arc_chord
from whichroad.core.network import Roads
from whichroad.core.output import new_output
from whichroad.core.switching import new_work
from whichroad.core.transition import predict_link
from whichroad.settings import Settings

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


def _epochs(motion: Motion) -> Epochs:
    """An epoch without motion, then the motion; no fixes."""
    n = len(motion.time)
    epochs = new_epochs(n + 1)
    epochs.time[1:], epochs.arc[1:], epochs.turn[1:] = motion.time, motion.arc, motion.turn
    for k in range(1, n + 1):
        epochs.forward[k], epochs.left[k] = arc_chord(epochs.arc[k], epochs.turn[k])
    epochs.moved[1:] = motion.valid
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
        scale: Local scale of the plane; the map's curvature has to be right for it.
    """

    def __init__(
        self, roads: Roads, motion: Motion, mode: int, mean: Array, *, off_road: bool = False,
        scale: float = 1.0,
    ) -> None:  # fmt: skip
        self.roads, self.mode, self.mean, self.scale = roads, mode, mean, scale
        self.epochs = _epochs(motion)
        self.edge = OFF_ROAD if off_road else 0
        self.unit = np.ones(N)
        self.unit[:2] = scale

    def _run(self, mean: Array, cov: Array) -> tuple[Belief, Memory, Route]:
        """The belief, memory and route after the filter's run over the link."""
        belief, source = new_belief(True), belief_on(self.roads, [On(self.edge)])
        for mine, other in zip(belief, source, strict=True):
            if mine.shape[1:] == other.shape[1:] and len(mine) > 1 and len(mine) < len(other):
                mine[:1] = other[:1]
        belief.mean[0], belief.cov[0] = mean, cov
        belief.edge[0], belief.probability[0], belief.log_weight[0] = self.edge, 1.0, 0.0
        belief.size[0] = 1
        belief.clock[[NOW, STARTED, LAST_FIX, SPEED]] = 0.0, 1.0, 0.0, 10.0
        memory, route = new_memory(64), new_route(1 << 12)
        n = len(self.epochs.time)
        run(
            belief, self.roads, route, new_work(), self.epochs, new_output(n, False), 0, n,
            self.mode, 1.0, np.zeros(2), SETTINGS.parameters(), 3.0, 0.95, False, memory,
        )  # fmt: skip
        assert belief.size[0] == 1
        return belief, memory, route

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
                ends.append(self._run(mean, none)[0].mean[0].copy())
            off = ends[0] - ends[1]
            off[H] = np.angle(np.exp(1j * off[H]))
            f[:, a] = off / (2.0 * step[a])
        f = f * self.unit[None, :] / self.unit[:, None]
        return Moved(belief.mean[0].copy(), f, belief.cov[0].copy())

    def retraced(self, step: Array) -> Moved:
        """The smoother's process model of the link."""
        cov = np.diag((1e-3 * step) ** 2)
        _, memory, route = self._run(self.mean, cov)
        steps = int(memory.size[0])
        assert steps == 2
        bench, q = new_bench(), np.zeros(N)
        predict_link(
            bench, q, memory, self.roads, route, 1, 0, 1, memory.mean[0].copy(), cov,
            self.mode, self.scale, 1.0, SETTINGS.parameters(),
        )  # fmt: skip
        f = bench.f.copy()
        return Moved(bench.mean.copy(), f, bench.cov - f @ cov @ f.T)
