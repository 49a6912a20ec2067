"""Fixes of a recorded drive that only repeat an earlier one, as the fix behind them proves.

Receivers, phones and loggers fill gaps, such as a tunnel, with the last fix.  On line that looks
like a stop (`filter.vetting.repeats`).  In a recording the next place is known, and no vehicle
comes there from a stop.  Some hold the place with a jitter, as a standing receiver's place has it;
so the step that ends it has also to be far faster than the vehicle drives before and after.
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
HELD = 1.0  # m, up to which a place is held that is not the same,
_LONG = 20.0  # s for which it is, at least,
_FASTER = 1.5  # times as fast as the vehicle before and after it, that the step behind it is
_ABOUT = 60.0  # s before and after, by which that is judged
_MOVES, _SHORT = 2.0, 0.01  # m/s, of a vehicle that drives; s, the shortest step
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
    same = (step <= HELD) & ~begins[:-1]
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
        exact, begin = end, end
        while same[exact] and step[exact] <= _SAME:
            exact -= 1
        while same[begin] and np.hypot(*(place[begin - 1] - place[end])) <= HELD:
            begin -= 1
        if exact == begin or _is_held(time, place, begins, begin, end):
            wrong[begin + 1 : end + 1] = True
        else:
            wrong[exact + 1 : end + 1] = True
    return wrong


def _is_held(
    time: Array, place: Array, begins: NDArray[np.bool_], begin: int, end: int
) -> bool:  # fmt: skip
    """Whether rows within a jitter are a place that was held, as the step behind them is so fast.

    Args:
        time: (n,) s.
        place: (n, 2) m.
        begins: (n + 1,) whether a drive begins at a row.
        begin: The first of the rows.
        end: The last of them.
    """
    if time[end] - time[begin] < _LONG:
        return False
    low, high = begin, end + 1
    while not begins[low] and time[begin] - time[low] < _ABOUT:
        low -= 1
    while not begins[high + 1] and time[high] - time[end + 1] < _ABOUT:
        high += 1
    fastest = 0.0
    for a, b in ((low, begin), (end + 1, high)):
        steps = np.hypot(*np.diff(place[a : b + 1], axis=0).T)
        seconds = np.maximum(np.diff(time[a : b + 1]), _SHORT)
        fastest = max(fastest, float(np.max(steps / seconds, initial=0.0)))
    gone = float(np.hypot(*(place[end + 1] - place[end])))
    since = max(float(time[end + 1] - time[end]), _SHORT)
    return fastest > _MOVES and gone > _FASTER * fastest * since
