"""Turns that are measured too large or too small: a track width, or a gyro of another scale.

The turn from one chord of the fixes to the next one is held against that of the dead-reckoned
places, once in each corner.  What decides is as for wheels of another size.
"""

import math

from ..._compile import Record, kernel
from .wheel_size import add_leg, decide, variance_between
from .windows import ANCHORS, far_enough, turn_of_places

_FAR = 3.0  # times the distance from which on a direction tells something
_LEAST, _MOST = 0.35, 2.2  # rad, of a turn that is compared
_PAST = 0.7  # of the largest turn of a corner: below it the corner is over
_ERROR = 0.02  # rad, of a turn by chords
_RATE_SIGMA = 0.03  # of what turns are said to be, relative


@kernel
def watch_turns(size: Record, windows: Record, scale: float, valid: bool, anew: bool) -> None:
    """Take a fix that became an anchor; decide whether turns are measured by another scale.

    Args:
        size: WHEEL_SIZE of the turns, in place; `begin` has the largest turn of a corner: time,
            turn by the odometry, by the fixes, variance, seconds.
        windows: With its anchors.
        scale: Plane metres per true metre.
        valid: Whether turns were measured, and may be right but for their scale.
        anew: Whether the odometer's scale, and with it that of wheels' turns, is another one now.
    """
    size.found = 0
    size.rate = 1.0
    size.rate_variance = _RATE_SIGMA * _RATE_SIGMA
    if anew:
        size.count = 0
    if not valid or anew:
        size.begun = 0
        size.p = 0.0
        return
    last = windows.count - 1
    middle = far_enough(windows, last, scale, math.inf, _FAR)
    first = far_enough(windows, middle, scale, math.inf, _FAR) if middle > 0 else -1
    turned = 0.0
    if first >= 0:
        by_fixes, turned = turn_of_places(windows, first, middle, last)
    best = size.begin
    if size.begun == 1 and abs(turned) < _PAST * abs(best[1]):
        add_leg(size, abs(best[1]), math.copysign(1.0, best[1]) * best[2], best[3], best[4])
        decide(size, windows.anchors[last % ANCHORS].time)
        size.begun = 0
        size.way = best[0]
    if first < 0 or not _LEAST <= abs(turned) <= _MOST:
        return
    a = windows.anchors[first % ANCHORS]
    m = windows.anchors[middle % ANCHORS]
    b = windows.anchors[last % ANCHORS]
    if a.time < size.way or (size.begun == 1 and abs(turned) <= abs(best[1])):
        return
    best[0] = b.time
    best[1] = turned
    best[2] = by_fixes
    best[3] = _variance(a, m, scale) + _variance(m, b, scale) + _ERROR * _ERROR
    best[4] = b.time - a.time
    size.begun = 1


@kernel
def _variance(a: Record, b: Record, scale: float) -> float:
    """Variance of the direction from one anchor to another, rad²."""
    square = ((b.x - a.x) ** 2 + (b.y - a.y) ** 2) / (scale * scale)
    return float(variance_between(b.time - a.time, a.sigma, b.sigma) / square)
