"""Single places that no vehicle reaches from the others: a stale one, or one that was misread.

A receiver reports where it was switched off until it has a fix.  Rows have latitude and longitude
swapped, or a sign is lost.  The filter starts at the first fix, so that such a row would take those
behind it with it.
"""

import numpy as np

from ..observations import Array
from .checks import Bools
from .units_by_places import distances, reachable

_MOST = 5  # places on end that are strays; more are another place where the vehicle was
_SHARE = 3  # times as many places does the rest have on end
_JUMPING = 0.2  # of the rows, from which on times are wrong or rows are of several vehicles
_PAUSE = 300.0  # s, after which a vehicle or a phone may have been carried anywhere


def strays(time: Array, lat: Array, lon: Array) -> Bools:
    """Which places of a drive cannot be reached from the longest stretch of possible steps.

    The drive is cut at steps that no vehicle makes.  From the longest part outwards, parts of few
    places are strays that cannot be reached from the last part that is none.  Rows that
    repeat a place are one place.

    Args:
        time: (n,) s, in order.
        lat: (n,) degrees.
        lon: (n,) degrees.

    Returns:
        (n,).
    """
    n = len(time)
    found = np.zeros(n, np.bool_)
    if n <= _SHARE:
        return found
    moved = distances(lat, lon)
    cut = np.flatnonzero(_is_jump(moved, np.diff(time))) + 1
    if not len(cut) or len(cut) > _JUMPING * n:
        return found
    begin, end = np.append(0, cut), np.append(cut, n)
    places = np.append(0, np.cumsum(moved > 0.0))
    size = places[end - 1] - places[begin] + 1
    longest = int(np.argmax(size))
    few = size <= min(_MOST, int(size[longest]) // _SHARE)

    def leave_out(parts: range, near: Array, far: Array, last: int) -> None:
        for part in parts:
            ends = [last, int(near[part])]
            way, seconds = distances(lat[ends], lon[ends]), np.abs(np.diff(time[ends]))
            if few[part] and _is_jump(way, seconds)[0]:
                found[begin[part] : end[part]] = True
            else:
                last = int(far[part])

    leave_out(range(longest + 1, len(begin)), begin, end - 1, int(end[longest]) - 1)
    leave_out(range(longest - 1, -1, -1), end - 1, begin, int(begin[longest]))
    return found


def _is_jump(moved: Array, seconds: Array) -> Bools:
    """Whether no vehicle makes so many metres in so many seconds, (n,)."""
    return np.asarray((moved > reachable(seconds)) & (seconds < _PAUSE))
