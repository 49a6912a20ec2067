"""The wheels' epochs, joined or cut to steps of the map's spacing."""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ..core.epoch import Epochs
from ..core.motion import arc_chord

_LONGEST = 6.0  # m, in which wheels are followed


class Step(NamedTuple):
    """Wheels since the step before, in the frame of then."""

    epoch: int  # the last one that it holds, wholly if `whole`
    whole: bool
    forward: float
    left: float
    turn: float
    arc: float
    metres: float
    measured: bool


def steps(epochs: Epochs, least: Callable[[], float]) -> Iterator[Step]:
    """Join epochs, or cut them, to steps, up to the first fix.

    Args:
        epochs: The drive.
        least: Says how many metres a step should have at least; 0: no epochs are joined.

    Yields:
        Steps in time order; the first epoch is where the wheels begin to count.
    """
    x = y = turn = arc = metres = 0.0
    measured = True
    fixes = np.flatnonzero(epochs.has_fix)
    last = int(fixes[0]) if len(fixes) else len(epochs.time)
    for k in range(1, last):
        pieces = max(1, math.ceil(abs(epochs.arc[k]) / _LONGEST))
        forward, left = float(epochs.forward[k]), float(epochs.left[k])
        piece_arc, piece_turn = float(epochs.arc[k]) / pieces, float(epochs.turn[k]) / pieces
        if pieces > 1:  # the same circle
            forward, left = arc_chord(piece_arc, piece_turn)
        for piece in range(pieces):
            c, s = math.cos(turn), math.sin(turn)
            x, y = x + c * forward - s * left, y + s * forward + c * left
            turn, arc, metres = turn + piece_turn, arc + piece_arc, metres + abs(piece_arc)
            measured = measured and bool(epochs.moved[k])
            whole = piece == pieces - 1
            if metres >= least() or (whole and k == last - 1):
                yield Step(k, whole, x, y, turn, arc, metres, measured)
                x = y = turn = arc = metres = 0.0
                measured = True
