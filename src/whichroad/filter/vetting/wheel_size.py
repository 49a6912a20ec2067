"""An odometer that counts too much or too little: tyres, a trailer, another vehicle's numbers.

A scale that is wrong by some percent moves the vehicle away from its fixes slowly, as errors of a
receiver do.  But the odometer errs by the same share of every way, and a receiver's error does
not grow with the way.  Chords of some hundred metres are compared, by odometer and by fixes.
"""

import math

import numpy as np

from ..._compile import Record, kernel
from .scales import SCALE, add_leg, decide, is_seasoned, variance_between
from .windows import ANCHORS, BY_WHEELS

_BEGIN = np.dtype(
    [
        ("time", "f8"),  # s
        ("x", "f8"),  # fix, plane m
        ("y", "f8"),
        ("sigma", "f8"),  # m
        ("ox", "f8"),  # place by the odometer, m,
        ("oy", "f8"),
        ("way", "f8"),  # way by it, m,
        ("path", "f8"),  # and by the receiver's speed
    ],
    align=True,
)

WHEEL_SIZE = np.dtype(
    [
        ("scale", SCALE),  # of the odometer's ways
        ("begin", _BEGIN),  # of the leg now
        ("begun", "u1"),  # 1: there is one
        ("speeds", "u1"),  # 1: the receiver's speed was reported with each fix since
        ("before", "f8"),  # the learnt scale at the fix before
        ("sudden", "u1"),  # 1: with this fix it was learnt otherwise, by a misfit
        ("at", "f8", (3,)),  # the last fix: plane, plane, its sigma in m
    ],
    align=True,
)

_SHORTEST, _LEAST_TIME, _MOST_TIME = 150.0, 15.0, 60.0  # m, s, s of a leg
_AT_FIRST = 0.4  # of these, until some legs have fitted
_STRAIGHT = 0.9  # least chord over way
_BENT = 0.04  # error of a chord for what it is shorter than the way
_OF_WAY = 0.002  # error of a chord, relative
_JUMP = 0.02  # change of a scale that is not learnt by and by, relative
_OTHER = 0.05  # from which on a learnt scale is no usual one


@kernel
def watch_size(size: Record, epoch: Record, windows: Record, scale: float, valid: bool) -> None:
    """Take a fix; decide whether the odometer has another scale than was learnt.

    Args:
        size: In place.
        epoch: With a fix.
        windows: With that fix.
        scale: Plane metres per true metre.
        valid: Whether the odometry was measured, and may be right but for its scale.
    """
    ways = size.scale
    ways.found = 0
    size.sudden = abs(ways.rate - size.before) > _JUMP * ways.rate
    if size.sudden:
        ways.count = 0
    size.before = ways.rate
    known = valid and ways.rate_variance < math.inf
    if size.sudden or not known:
        size.begun = 0
        ways.p = 0.0
    if not known:
        return
    size.at[0] = epoch.fix[0]
    size.at[1] = epoch.fix[1]
    size.at[2] = math.sqrt(epoch.fix[2] * epoch.fix[3])
    if not _reports_speed(windows, epoch.time):
        size.speeds = 0
    seconds = epoch.time - size.begin.time
    part = 1.0 if is_seasoned(ways) else _AT_FIRST
    if size.begun == 1 and seconds >= part * _LEAST_TIME:
        straight = _is_straight(size, windows.now)
        if straight and _way(size, windows.now) >= part * _SHORTEST and seconds <= _MOST_TIME:
            _end_leg(size, windows.now, scale, seconds)
            decide(ways, epoch.time)
            size.begun = 0
        elif seconds > _MOST_TIME or not straight:
            size.begun = 0
    if size.begun == 0:
        _begin_leg(size, windows.now, epoch.time)


@kernel
def _reports_speed(windows: Record, time: float) -> bool:
    """Whether a fix and those since the last anchor have a speed of the receiver."""
    last = windows.anchors[(windows.count - 1) % ANCHORS]
    before = windows.count == 0 or last.speeds == 1
    return bool(windows.speed_time == time and windows.now.speeds == 1 and before)


@kernel
def _begin_leg(size: Record, now: Record, time: float) -> None:
    """Begin a leg at the last fix."""
    begin = size.begin
    begin.time = time
    begin.x = size.at[0]
    begin.y = size.at[1]
    begin.sigma = size.at[2]
    begin.ox = now.ox
    begin.oy = now.oy
    begin.way = now.arc
    begin.path = now.path
    size.speeds = 1
    size.begun = 1


@kernel
def _way(size: Record, now: Record) -> float:
    """Chord of the leg by the odometer, m."""
    return math.hypot(now.ox - size.begin.ox, now.oy - size.begin.oy)


@kernel
def _is_straight(size: Record, now: Record) -> bool:
    """Whether turns that are measured wrong leave the chord of the leg nearly as it is."""
    return bool(_way(size, now) >= _STRAIGHT * (now.arc - size.begin.way))


@kernel
def _end_leg(size: Record, now: Record, scale: float, seconds: float) -> None:
    """End a leg; where the receiver's speed agrees with the odometer, positions prove nothing."""
    begin = size.begin
    way = _way(size, now)
    arc = now.arc - begin.way
    bent = _BENT * (1.0 - way / arc) * way
    variance = variance_between(seconds, begin.sigma, size.at[2])
    variance += (_OF_WAY * way) ** 2 + bent * bent
    expected = size.scale.rate * way
    seen = math.hypot(size.at[0] - begin.x, size.at[1] - begin.y) / scale
    if size.speeds == 1:
        reported = (now.path - begin.path) * way / arc
        if abs(reported - expected) < abs(seen - expected):
            seen = reported
    add_leg(size.scale, way, seen, variance, seconds, 0.0)


@kernel
def mend_scales(ways: Record, turns: Record, reading: Record) -> None:
    """Multiply what the odometry has measured by what its scales were found to be.

    Where the difference of two wheels is the turn, it is too large by as much as their ways.  A
    scale that is learnt to be an unusual one is a size of the wheels, too.

    Args:
        ways: SCALE of its ways.
        turns: The same of its turns.
        reading: What the sensors measured, in place.
    """
    if ways.factor != 1.0:
        reading.arc *= ways.factor
        reading.forward *= ways.factor
        reading.left *= ways.factor
    by = turns.factor
    if reading.gyro == BY_WHEELS:
        by *= ways.factor
        if abs(ways.rate - 1.0) > _OTHER:
            by *= ways.rate
    if by != 1.0:
        reading.turn *= by
        reading.left *= by
