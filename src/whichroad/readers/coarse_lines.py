"""Places on lines between fixes, in coordinates of five decimals: steps of a metre hide the bends.

Few lines explain a drive within that rounding, and from one to the next the velocity jumps by more
than a smooth drive changes it on lines as long.
"""

import numpy as np

from ..geodesy.angles import radians, wrap_degrees
from ..geodesy.units import METRES_PER_DEGREE
from ..observations import Array
from .checks import Bools, Ints

STEP = 1e-5  # degrees
TOLERANCE = 1.05 * STEP  # by which rounding moves a place off its line
_ROWS = 5  # of a line that is long
_LINES = 5  # of these, at least
_MOST = 0.9  # of the moving rows, from which on they are on long lines
_STANDS = 1.0  # m/s
_NEXT = 2  # rows from a long line to the next one, at most
_BENT = 0.125  # of a tolerance and the square of its time: acceleration of an arc within a line
_KINK = 1.0  # of that acceleration over a line, above which the velocity jumps
_EVEN = 0.02  # of a speed, and tolerances over a line's time,
_PACES = 2.0  # by which speeds differ from line to line


def lined_up(time: Array, lat: Array, lon: Array) -> Bools | None:
    """Which rows of one drive, (n,), lie on lines between others; None: it is no such drive.

    Args:
        time: (n,) s, in order.
        lat: (n,) degrees, of five decimals.
        lon: (n,) degrees.
    """
    east = wrap_degrees(lon - lon[0])
    bends = _bends(time, lat, east)
    a, b = bends[:-1], bends[1:]
    lasts, rows = time[b] - time[a], b - a
    v_east = METRES_PER_DEGREE * float(np.cos(radians(lat[0]))) * (east[b] - east[a]) / lasts
    v_north = METRES_PER_DEGREE * (lat[b] - lat[a]) / lasts
    speed = np.hypot(v_east, v_north)
    moves = speed > _STANDS
    at = np.flatnonzero(moves & (rows >= _ROWS))
    if len(at) <= _LINES or rows[at].sum() < _MOST * rows[moves].sum():
        return None
    i, j = at[:-1], at[1:]
    follows = a[j] - b[i] <= _NEXT
    i, j = i[follows], j[follows]
    if len(i) < _LINES or len(i) < 0.5 * len(at):
        return None
    jump = np.hypot(v_east[j] - v_east[i], v_north[j] - v_north[i])
    off = TOLERANCE * METRES_PER_DEGREE / np.minimum(lasts[i], lasts[j])
    paces = np.abs(speed[j] - speed[i])
    if np.median(_BENT * jump / off) <= _KINK:
        return None
    if np.median(paces / np.maximum(_EVEN * speed[i], _PACES * off)) <= 1.0:
        return None  # one speed on all lines: it was computed
    made = np.zeros(len(time), np.bool_)
    for line in at.tolist():
        made[a[line] + 1 : b[line]] = True
    return made


def _bends(time: Array, lat: Array, lon: Array) -> Ints:
    """The rows between which all others lie on lines, by Douglas and Peucker, over time."""
    kept = [0, len(time) - 1]
    open_lines = [(0, len(time) - 1)]
    while open_lines:
        a, b = open_lines.pop()
        if b - a < 2:
            continue
        share = (time[a + 1 : b] - time[a]) / (time[b] - time[a])
        off = np.maximum(*(np.abs(c[a] + share * (c[b] - c[a]) - c[a + 1 : b]) for c in (lat, lon)))
        farthest = int(np.argmax(off))
        if off[farthest] > TOLERANCE:
            middle = a + 1 + farthest
            kept.append(middle)
            open_lines += [(a, middle), (middle, b)]
    return np.sort(np.array(kept))
