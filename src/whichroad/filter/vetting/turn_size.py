"""Turns that are measured too large or too small: a track width, or a gyro of another scale.

The turn from one chord of the fixes to the next one is held against that of the dead-reckoned
places, once in each corner.  What decides is as for wheels of another size.  Wheels of two sizes
and a gyro's bias turn the vehicle, too.  They do so by the metre or the second: stretches between
corners show by how much.
"""

import math
from typing import NamedTuple

import numpy as np

from ..._compile import Record, kernel
from .scales import SCALE, add_leg, decide, forget_drift, variance_between
from .windows import ANCHORS, far_enough, turn_of_places

_CORNER = np.dtype(
    [
        ("time", "f8"),  # s, of its last fix
        ("measured", "f8"),  # turn by the odometry, rad,
        ("seen", "f8"),  # and by the fixes
        ("variance", "f8"),  # of the latter, rad²
        ("seconds", "f8"),
        ("clock", "f8"),  # m or s, what a drift is multiplied by
    ],
    align=True,
)

TURN_SIZE = np.dtype(
    [
        ("scale", SCALE),  # of the turns
        ("corner", _CORNER),  # where the turn of the one now was largest
        ("begun", "u1"),  # 1: there is one
        ("until", "f8"),  # s, when the one before was over,
        ("straight_until", "f8"),  # and the last stretch that told the drift
        ("gyro", "u1"),  # 1: of a gyro, and not of wheels
    ],
    align=True,
)


class Chords(NamedTuple):
    """Two chords, one after the other."""

    measured: float  # turn from one to the other by the odometry, rad,
    seen: float  # and by the fixes
    variance: float  # of the latter, rad²
    first: int  # anchor, from which on; negative: there are none
    begin: float  # s
    seconds: float
    way: float  # by the odometer, m


_FAR = 3.0  # times the distance from which on a direction tells something
_LEAST, _MOST = 0.35, 2.2  # rad, of a turn that is compared
_PAST = 0.7  # of the largest turn of a corner: below it the corner is over
_ERROR = 0.02  # rad, of a turn by chords
_RATE_SIGMA = 0.03  # of what turns are said to be, relative
_BY_WAY, _BY_TIME = 3e-3, 0.015  # rad/m of wheels, rad/s of a gyro: drift before it is known
_NEAR = 2.0  # times that distance, of a stretch without a corner, which tells the drift:
_STRAIGHT, _OF_TURN = 0.15, 0.2  # rad that it turns at most, and error of that, relative
_KEPT = 0.97  # of what such stretches say, with each further one
_FITS = 3.0  # sigmas


@kernel
def watch_turns(
    size: Record, windows: Record, scale: float, valid: bool, anew: bool, gyro: bool
) -> None:  # fmt: skip
    """Take a fix that became an anchor; decide whether turns are measured by another scale.

    Args:
        size: TURN_SIZE, in place.
        windows: With its anchors.
        scale: Plane metres per true metre.
        valid: Whether turns were measured, and may be right but for their scale.
        anew: Whether the odometer's scale, and with it that of wheels' turns, is another one now.
        gyro: Whether a gyro measures the turns, and not wheels.
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
    if size.gyro != gyro:
        size.gyro = gyro
        forget_drift(turns)
    last = windows.count - 1
    _watch_drift(size, windows, _chords(windows, last - 1, _NEAR, scale))
    chords = _chords(windows, last, _FAR, scale)
    corner = size.corner
    if size.begun == 1 and abs(chords.measured) < _PAST * abs(corner.measured):
        sign = math.copysign(1.0, corner.measured)
        add_leg(
            turns, sign * corner.measured, sign * corner.seen, corner.variance, corner.seconds,
            sign * corner.clock,
        )  # fmt: skip
        decide(turns, windows.anchors[last % ANCHORS].time, 1.0 / _drift_sigma(size) ** 2)
        size.begun = 0
        size.until = corner.time
    if not _LEAST <= abs(chords.measured) <= _MOST or chords.begin < size.until:
        return
    if size.begun == 1 and abs(chords.measured) <= abs(corner.measured):
        return
    corner.time = windows.anchors[last % ANCHORS].time
    corner.measured = chords.measured
    corner.seen = chords.seen
    corner.variance = chords.variance
    corner.seconds = corner.time - chords.begin
    corner.clock = _clock(size, chords)
    size.begun = 1


@kernel
def _chords(windows: Record, last: int, times: float, scale: float) -> Chords:
    """Two chords until an anchor, each so many times as long as is needed; of no turn: none."""
    middle = far_enough(windows, last, scale, math.inf, times) if last > 0 else -1
    first = far_enough(windows, middle, scale, math.inf, times) if middle > 0 else -1
    if first < 0:
        return Chords(0.0, 0.0, math.inf, -1, 0.0, 0.0, 0.0)
    seen, measured = turn_of_places(windows, first, middle, last)
    a = windows.anchors[first % ANCHORS]
    m = windows.anchors[middle % ANCHORS]
    b = windows.anchors[last % ANCHORS]
    variance = _variance(a, m, scale) + _variance(m, b, scale) + _ERROR * _ERROR
    return Chords(measured, seen, variance, first, a.time, b.time - a.time, b.arc - a.arc)


@kernel
def _clock(size: Record, chords: Chords) -> float:
    """What a drift is multiplied by, from the middle of one chord to that of the next, m or s."""
    return 0.5 * (chords.seconds if size.gyro == 1 else chords.way)


@kernel
def _drift_sigma(size: Record) -> float:
    """Sigma of a drift that is not known, rad a metre or a second."""
    return _BY_TIME if size.gyro == 1 else _BY_WAY


@kernel
def _watch_drift(size: Record, windows: Record, chords: Chords) -> None:
    """Learn the drift by a stretch without a corner, and without one a second before and after."""
    oldest = max(windows.count - ANCHORS, 0)
    if chords.first <= oldest or chords.begin < size.straight_until:
        return
    before = windows.anchors[(chords.first - 1) % ANCHORS].turn
    if abs(windows.now.turn - before) > _STRAIGHT or abs(chords.measured) > _STRAIGHT:
        return
    clock = _clock(size, chords)
    beyond = chords.seen - chords.measured
    variance = chords.variance + (_OF_TURN * chords.measured) ** 2
    if beyond * beyond > _FITS * _FITS * (variance + (_drift_sigma(size) * clock) ** 2):
        return
    straight = size.scale.straight
    straight[0] = _KEPT * straight[0] + clock * beyond / variance
    straight[1] = _KEPT * straight[1] + clock * clock / variance
    size.straight_until = chords.begin + chords.seconds


@kernel
def _variance(a: Record, b: Record, scale: float) -> float:
    """Variance of the direction from one anchor to another, rad²."""
    square = ((b.x - a.x) ** 2 + (b.y - a.y) ** 2) / (scale * scale)
    return float(variance_between(b.time - a.time, a.sigma, b.sigma) / square)
