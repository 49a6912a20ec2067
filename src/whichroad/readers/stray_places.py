"""Single places that no vehicle reaches from the others: a stale one, or one that was misread.

A receiver reports where it was switched off until it has a fix.  Rows have latitude and longitude
swapped, or a sign is lost.  The filter starts at the first fix, so that such a row would take those
behind it with it.  A network's fix among those of satellites is some hundred metres off: a vehicle
would have to drive there, turn round and be back at a speed at which nobody turns.
"""

import numpy as np

from ..observations import Array
from .checks import Bools
from .units_by_places import distances, reachable

_MOST = 5  # places on end that are strays; more are another place where the vehicle was
_SHARE = 3  # times as many places does the rest have on end
_JUMPING = 0.2  # of the rows, from which on times are wrong or rows are of several vehicles
_PAUSE = 300.0  # s, after which a vehicle or a phone may have been carried anywhere
_SPIKE = 200.0  # m, there and back, of a spike at least
_TURNING = 40.0  # m/s on average, there and back, of which no vehicle turns round between
_SOON = 20.0  # s of each way: in more a vehicle stops, turns and is fast again
_SIGMAS = 5.0  # of a step, that its fixes' errors explain
_SPIKES = 0.1  # of the rows, from which on places scatter, or rows are of several vehicles


def strays(time: Array, lat: Array, lon: Array, sigma: Array | float = 0.0) -> Bools:
    """Which places of a drive no vehicle reaches from those around them, (n,).

    Args:
        time: (n,) s, in order.
        lat: (n,) degrees.
        lon: (n,) degrees.
        sigma: (n,) m, of each place; what it explains is none.
    """
    moved = distances(lat, lon)
    found = _spikes(time, lat, lon, moved, np.broadcast_to(sigma, len(time)))
    if not found.any():
        return _out_of_reach(time, lat, lon, moved)
    left = np.flatnonzero(~found)
    found[left] = _out_of_reach(time[left], lat[left], lon[left], distances(lat[left], lon[left]))
    return found


def may_be_spikes(moved: Array, seconds: Array) -> Bools:
    """Which steps, of so many metres, may lead to a spike or from it, (n,)."""
    far = (moved > _SPIKE) & (moved > _TURNING * seconds)
    return np.asarray(far & (seconds <= _SOON))


def _spikes(time: Array, lat: Array, lon: Array, moved: Array, sigma: Array) -> Bools:
    """Single places from which a vehicle would have to turn round at speed."""
    found = np.zeros(len(time), np.bool_)
    far = may_be_spikes(moved, np.diff(time)) & (moved > _SIGMAS * np.hypot(sigma[1:], sigma[:-1]))
    if not (far[1:] & far[:-1]).any():
        return found
    there, back, across = moved[:-1], moved[1:], distances(lat, lon, 2)
    turned = across**2 < there**2 + back**2 - there * back  # by 120 degrees or more
    beside = np.concatenate([[0.0], moved, [0.0]])  # steps of the places before and behind
    lone = np.minimum(there, back) > np.maximum(beside[:-3], beside[3:]) + _SPIKE
    found[1:-1] = far[1:] & far[:-1] & turned & lone
    return found if found.sum() <= _SPIKES * len(time) else np.zeros_like(found)


def _out_of_reach(time: Array, lat: Array, lon: Array, moved: Array) -> Bools:
    """Which places of a drive cannot be reached from the longest stretch of possible steps.

    The drive is cut at steps that no vehicle makes.  From the longest part outwards, parts of few
    places are strays that cannot be reached from the last part that is none.  Rows that
    repeat a place are one place.
    """
    n = len(time)
    found = np.zeros(n, np.bool_)
    if n <= _SHARE:
        return found
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
