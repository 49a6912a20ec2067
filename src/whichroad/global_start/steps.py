"""Wheel odometry as steps that a large mixture is predicted by."""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..filter.gnss.inflation import COARSE
from ..filter.motion import arc_chord

_LONGEST = 6.0  # m, longest step of the prediction


class Step(NamedTuple):
    """Wheel odometry since the step before, in the vehicle's frame at that step."""

    epoch: int  # the last one that it holds, entirely if `whole`
    whole: bool
    forward: float
    left: float
    turn: float
    arc: float
    metres: float
    measured: bool


def have_fine_fix(epochs: Records) -> NDArray[np.bool_]:
    """Which epochs have a fix that a search ends at, (n,)."""
    fine: NDArray[np.bool_] = (epochs.has_fix == 1) & (epochs.fix[:, 2] <= COARSE)
    return fine


def steps(epochs: Records, least: Callable[[], float]) -> Iterator[Step]:
    """Join epochs, or cut them, to steps, up to the first fix that is not coarse.

    Args:
        epochs: The drive, (n,) EPOCH.
        least: Gives how many metres a step should have at least; 0: no epochs are joined.

    Yields:
        Steps in time order; the first epoch is where the wheels begin to count.
    """
    arcs, turns, measurements = epochs.arc, epochs.turn, epochs.odometry_valid
    forwards, lefts = epochs.forward, epochs.left
    x = y = turn = arc = metres = 0.0
    measured = True
    fixes = np.flatnonzero(have_fine_fix(epochs))
    last = int(fixes[0]) if len(fixes) else len(epochs)
    for k in range(1, last):
        parts = max(1, math.ceil(abs(arcs[k]) / _LONGEST))
        forward, left = float(forwards[k]), float(lefts[k])
        part_arc, part_turn = float(arcs[k]) / parts, float(turns[k]) / parts
        if parts > 1:  # the same circle
            forward, left = arc_chord(part_arc, part_turn)
        for k_part in range(parts):
            c, s = math.cos(turn), math.sin(turn)
            x, y = x + c * forward - s * left, y + s * forward + c * left
            turn, arc, metres = turn + part_turn, arc + part_arc, metres + abs(part_arc)
            measured = measured and bool(measurements[k])
            whole = k_part == parts - 1
            if metres >= least() or (whole and k == last - 1):
                yield Step(k, whole, x, y, turn, arc, metres, measured)
                x = y = turn = arc = metres = 0.0
                measured = True
