"""Turns that are measured too large or too small: a track width, or a gyro of another scale.

The turn from one chord of the fixes to the next one is held against that of the dead-reckoned
places, once in each corner.  What decides is as for wheels of another size.
"""

import math

import numpy as np

from ..._compile import Record, kernel
from .scales import SCALE, add_leg, decide, variance_between
from .windows import ANCHORS, far_enough, turn_of_places

_CORNER = np.dtype(
    [
        ("time", "f8"),  # s, of its last fix
        ("measured", "f8"),  # turn by the odometry, rad,
        ("seen", "f8"),  # and by the fixes
        ("variance", "f8"),  # of the latter, rad²
        ("seconds", "f8"),
    ],
    align=True,
)

TURN_SIZE = np.dtype(
    [
        ("scale", SCALE),  # of the turns
        ("corner", _CORNER),  # where the turn of the one now was largest
        ("begun", "u1"),  # 1: there is one
        ("until", "f8"),  # s, when the one before was over
    ],
    align=True,
)

_FAR = 3.0  # times the distance from which on a direction tells something
_LEAST, _MOST = 0.35, 2.2  # rad, of a turn that is compared
_PAST = 0.7  # of the largest turn of a corner: below it the corner is over
_ERROR = 0.02  # rad, of a turn by chords
_RATE_SIGMA = 0.03  # of what turns are said to be, relative


@kernel
def watch_turns(size: Record, windows: Record, scale: float, valid: bool, anew: bool) -> None:
    """Take a fix that became an anchor; decide whether turns are measured by another scale.

    Args:
        size: TURN_SIZE, in place.
        windows: With its anchors.
        scale: Plane metres per true metre.
        valid: Whether turns were measured, and may be right but for their scale.
        anew: Whether the odometer's scale, and with it that of wheels' turns, is another one now.
    """
    turns = size.scale
    turns.found = 0
    turns.rate = 1.0
    turns.rate_variance = _RATE_SIGMA * _RATE_SIGMA
    if anew:
        turns.count = 0
    if not valid or anew:
        size.begun = 0
        turns.p = 0.0
        return
    last = windows.count - 1
    middle = far_enough(windows, last, scale, math.inf, _FAR)
    first = far_enough(windows, middle, scale, math.inf, _FAR) if middle > 0 else -1
    measured = 0.0
    seen = 0.0
    if first >= 0:
        seen, measured = turn_of_places(windows, first, middle, last)
    corner = size.corner
    if size.begun == 1 and abs(measured) < _PAST * abs(corner.measured):
        sign = math.copysign(1.0, corner.measured)
        add_leg(turns, sign * corner.measured, sign * corner.seen, corner.variance, corner.seconds)
        decide(turns, windows.anchors[last % ANCHORS].time)
        size.begun = 0
        size.until = corner.time
    if first < 0 or not _LEAST <= abs(measured) <= _MOST:
        return
    a = windows.anchors[first % ANCHORS]
    m = windows.anchors[middle % ANCHORS]
    b = windows.anchors[last % ANCHORS]
    if a.time < size.until or (size.begun == 1 and abs(measured) <= abs(corner.measured)):
        return
    corner.time = b.time
    corner.measured = measured
    corner.seen = seen
    corner.variance = _variance(a, m, scale) + _variance(m, b, scale) + _ERROR * _ERROR
    corner.seconds = b.time - a.time
    size.begun = 1


@kernel
def _variance(a: Record, b: Record, scale: float) -> float:
    """Variance of the direction from one anchor to another, rad²."""
    square = ((b.x - a.x) ** 2 + (b.y - a.y) ** 2) / (scale * scale)
    return float(variance_between(b.time - a.time, a.sigma, b.sigma) / square)
