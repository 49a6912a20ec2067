"""Fixes of a recorded drive that only repeat an earlier one, as the fix behind them proves.

Receivers, phones and loggers fill gaps, such as a tunnel, with the last fix.  On line that looks
like a stop (`filter.vetting.repeats`).  In a recording the next place is known, and no vehicle
comes there from a stop.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..observations import Array

_FEWEST = 3  # fixes
_SAME = 1e-3  # m, up to which two places are one
_GAINS = 4.0  # m/s², at most, of a vehicle that drives off,
_HOLDS = 20.0  # m for which a receiver may go on to hold the place of its stop,
_LEAST, _SIGMAS = 10.0, 3.0  # m, and sigmas of the fix behind it, by which it is farther away
_STAYS = 0.5  # of that way, that the fix after next is away as well: else one fix is wrong


def filled_gaps(
    time: Array, place: Array, sigma: Array, first: Sequence[int]
) -> NDArray[np.bool_]:  # fmt: skip
    """Which fixes repeat a place that the vehicle had left.

    Args:
        time: (n,) s, of drives one behind the other, each in the order of time.
        place: (n, 2) x, y, plane.
        sigma: (n,) m.
        first: (d,) the row at which each drive begins.

    Returns:
        (n,).
    """
    n = len(time)
    wrong = np.zeros(n, bool)
    if n < _FEWEST:
        return wrong
    begins = np.zeros(n + 1, bool)
    begins[list(first)] = begins[n] = True
    step = np.zeros(n)
    step[1:] = np.hypot(*np.diff(place, axis=0).T)
    same = (step <= _SAME) & ~begins[:-1]
    last = np.flatnonzero(same & ~np.append(same[1:], False))  # repeats before another place
    last = last[~begins[last + 1]]
    if not len(last):
        return wrong
    behind = last + 1
    since = time[behind] - time[last]
    least = 0.5 * _GAINS * since**2 + _HOLDS + _LEAST + _SIGMAS * sigma[behind]
    far = step[behind]
    after = np.where(begins[behind + 1], behind, behind + 1)
    stays = np.hypot(*(place[after] - place[last]).T) > _STAYS * far
    for end in last[(far > least) & stays].tolist():
        begin = end
        while same[begin]:
            wrong[begin] = True
            begin -= 1
    return wrong
