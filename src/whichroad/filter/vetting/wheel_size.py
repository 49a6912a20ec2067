"""An odometer that counts too much or too little: tyres, a trailer, another vehicle's numbers.

A scale that is wrong by some percent moves the vehicle away from its fixes slowly, as errors of a
receiver do.  But the odometer errs by the same share of every way, and a receiver's error does
not grow with the way.  Chords of some hundred metres are compared, by odometer and by fixes.
"""

import math

import numpy as np

from ..._compile import Record, kernel
from .windows import ANCHORS, BY_WHEELS

LEGS = 24  # that are kept

_LEG = np.dtype(
    [
        ("way", "f8"),  # chord by the odometer, m
        ("seen", "f8"),  # chord by the fixes, m
        ("variance", "f8"),  # of their difference, m²
        ("seconds", "f8"),
    ],
    align=True,
)

WHEEL_SIZE = np.dtype(
    [
        ("legs", _LEG, (LEGS,)),  # the last ones, row (number % LEGS)
        ("count", "i8"),  # of legs since they were last forgotten
        ("agreed", "i8"),  # legs that the scale has fitted, of the drive
        ("begin", "f8", (6,)),  # of the leg now: s, fix (plane), its sigma, place by odometer
        ("way", "f8"),  # by the odometer until then, m,
        ("path", "f8"),  # and by the receiver's speed
        ("speeds", "u1"),  # 1: that was reported with each fix since
        ("begun", "u1"),  # 1: there is one
        ("rate", "f8"),  # metres for a metre of the odometer, as learnt,
        ("rate_variance", "f8"),  # and its variance; infinite: the odometer is not used
        ("before", "f8"),  # the same at the fix before
        ("p", "f8"),  # P(the scale is another one)
        ("at", "f8", (3,)),  # the last fix: plane, plane, its sigma in m
        ("found", "u1"),  # 1: with this fix it is; 2: with this fix it was learnt otherwise
        ("factor", "f8"),  # what the scale was found to be, over what it was said to be
        ("time", "f8"),  # s, when it last was found; minus infinity: never
    ],
    align=True,
)

_SHORTEST, _LEAST_TIME, _MOST_TIME = 150.0, 15.0, 60.0  # m, s, s of a leg
_AT_FIRST = 0.4  # of these, until some legs have fitted
_STRAIGHT = 0.9  # least chord over way
_BENT = 0.04  # error of a chord for what it is shorter than the way
_OF_WAY, _LEAST = 0.002, 0.5  # error of a chord, relative and m
_WHITE, _BIAS_TIME = 0.5, 80.0  # new part of a fix's error; s for which the rest lasts
_ODDS, _SURE = 12.0, 14.0  # nats that another scale needs to be as likely, and to be taken
_FREEDOM, _ITERATIONS = 4.0, 5  # degrees of it, of errors; steps to the best scale
_SEASONED = 4  # legs that fitted, after which
_LONGEST_PULL = 90.0  # s tell another scale from a receiver that is pulled along
_MOST = 0.4  # change of a scale, relative,
_JUMP = 0.02  # and what is none that is learnt by and by
_FITS = 2.5  # sigmas
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
    size.found = 0
    sudden = abs(size.rate - size.before) > _JUMP * size.rate  # learnt by a misfit
    if sudden:
        size.count = 0
        size.found = 2
    size.before = size.rate
    if not valid or sudden or size.rate_variance == math.inf:
        size.begun = 0
        size.p = 0.0
    if not valid or size.rate_variance == math.inf:
        return
    size.at[0] = epoch.fix[0]
    size.at[1] = epoch.fix[1]
    size.at[2] = math.sqrt(epoch.fix[2] * epoch.fix[3])
    if not _reports_speed(windows, epoch.time):
        size.speeds = 0
    seconds = epoch.time - size.begin[0]
    part = 1.0 if size.agreed >= _SEASONED else _AT_FIRST
    if size.begun == 1 and seconds >= part * _LEAST_TIME:
        straight = _is_straight(size, windows.now)
        if straight and _way(size, windows.now) >= part * _SHORTEST and seconds <= _MOST_TIME:
            _end_leg(size, windows.now, scale, seconds)
            decide(size, epoch.time)
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
    begin[0] = time
    for i in range(3):
        begin[1 + i] = size.at[i]
    begin[4] = now.ox
    begin[5] = now.oy
    size.way = now.arc
    size.path = now.path
    size.speeds = 1
    size.begun = 1


@kernel
def _way(size: Record, now: Record) -> float:
    """Chord of the leg by the odometer, m."""
    return math.hypot(now.ox - size.begin[4], now.oy - size.begin[5])


@kernel
def _is_straight(size: Record, now: Record) -> bool:
    """Whether turns that are measured wrong leave the chord of the leg nearly as it is."""
    return bool(_way(size, now) >= _STRAIGHT * (now.arc - size.way))


@kernel
def forget_size(size: Record) -> None:
    """Begin anew: the odometry counts as it is said to."""
    size.factor = 1.0
    size.time = -math.inf
    size.count = 0
    size.begun = 0
    size.p = 0.0


@kernel
def mend_size(size: Record, turns: Record, reading: Record) -> None:
    """Multiply what the odometry has measured by what its scale was found to be.

    Where the difference of two wheels is the turn, it is too large by as much as their ways.  A
    scale that is learnt to be an unusual one is a size of the wheels, too.

    Args:
        size: With the factor.
        turns: The same of turns.
        reading: What the sensors measured, in place.
    """
    if size.factor != 1.0:
        reading.arc *= size.factor
        reading.forward *= size.factor
        reading.left *= size.factor
    by = turns.factor
    if reading.gyro == BY_WHEELS:
        by *= size.factor
        if abs(size.rate - 1.0) > _OTHER:
            by *= size.rate
    if by != 1.0:
        reading.turn *= by
        reading.left *= by


@kernel
def variance_between(seconds: float, a: float, b: float) -> float:
    """Variance of the way between fixes of the sigmas a and b so many seconds apart, m²."""
    slow = 1.0 - math.exp(-seconds / _BIAS_TIME)
    return (_WHITE * _WHITE + slow) * (a * a + b * b) + _LEAST * _LEAST


@kernel
def _end_leg(size: Record, now: Record, scale: float, seconds: float) -> None:
    """End a leg; where the receiver's speed agrees with the odometer, positions prove nothing."""
    begin = size.begin
    way = _way(size, now)
    arc = now.arc - size.way
    bent = _BENT * (1.0 - way / arc) * way
    variance = variance_between(seconds, begin[3], size.at[2])
    variance += (_OF_WAY * way) ** 2 + bent * bent
    expected = size.rate * way
    seen = math.hypot(size.at[0] - begin[1], size.at[1] - begin[2]) / scale
    if size.speeds == 1:
        reported = (now.path - size.path) * way / arc
        if abs(reported - expected) < abs(seen - expected):
            seen = reported
    add_leg(size, way, seen, variance, seconds)


@kernel
def add_leg(size: Record, way: float, seen: float, variance: float, seconds: float) -> None:
    """Keep what was measured (m, rad), and what the fixes say of it."""
    leg = size.legs[size.count % LEGS]
    leg.way = way
    leg.seen = seen
    leg.variance = variance
    leg.seconds = seconds
    size.count += 1
    known = variance + way * way * size.rate_variance
    if (seen - size.rate * way) ** 2 <= _FITS * _FITS * known:
        size.agreed += 1


@kernel
def decide(size: Record, time: float) -> None:
    """How likely another scale is, by the last legs; it is taken from `_SURE` nats on.

    Errors of chords are Student's, as receivers err by far more at times.  With the misfits z of
    n legs by what was learnt, and y by the best scale, it gains

        ½ (ν + 1) Σ log((ν + z²) / (ν + y²))
    """
    likely = 0.0
    best = 0.0
    change = 0.0
    variance = 0.0
    for n in range(2, min(size.count, LEGS) + 1):
        off, weight = _best_change(size, n)
        gain = _cost(size, n, 0.0, size.rate_variance) - _cost(size, n, off, 0.0)
        likely = max(likely, gain)
        lasts = size.agreed < _SEASONED or _seconds_of(size, n, off) >= _LONGEST_PULL
        if gain > best and lasts and abs(off) <= _MOST * size.rate:
            best = gain
            change = off
            variance = 1.0 / weight
    size.p = 1.0 / (1.0 + math.exp(min(_ODDS - likely, 50.0)))
    if best > _SURE:
        _take(size, change, variance, time)


@kernel
def _seconds_of(size: Record, n: int, change: float) -> float:
    """How long those of the last n legs took that fit another scale, and better, s."""
    seconds = 0.0
    for back in range(n):
        leg = size.legs[(size.count - 1 - back) % LEGS]
        z = leg.seen - size.rate * leg.way
        left = z - change * leg.way
        if abs(left) < abs(z) and left * left <= _FITS * _FITS * leg.variance:
            seconds += leg.seconds
    return seconds


@kernel
def _cost(size: Record, n: int, change: float, more: float) -> float:
    """-log likelihood of the last n legs by a scale, whose variance is `more`, nats."""
    cost = 0.0
    for back in range(n):
        leg = size.legs[(size.count - 1 - back) % LEGS]
        z = leg.seen - (size.rate + change) * leg.way
        square = z * z / (leg.variance + leg.way * leg.way * more)
        cost += math.log((_FREEDOM + square) / _FREEDOM)
    return 0.5 * (_FREEDOM + 1.0) * cost


@kernel
def _best_change(size: Record, n: int) -> tuple[float, float]:
    """By how much another scale fits the last n legs best, and its information."""
    change = 0.0
    weight = 0.0
    for turn in range(_ITERATIONS):
        weight = 0.0
        off = 0.0
        for back in range(n):
            leg = size.legs[(size.count - 1 - back) % LEGS]
            z = leg.seen - size.rate * leg.way
            share = 1.0 / leg.variance
            if turn > 0:
                left = z - change * leg.way
                share *= (_FREEDOM + 1.0) / (_FREEDOM + left * left / leg.variance)
            weight += share * leg.way * leg.way
            off += share * leg.way * z
        change = off / weight
    return change, weight


@kernel
def _take(size: Record, change: float, variance: float, time: float) -> None:
    """Take another scale."""
    size.factor *= (size.rate + change) / size.rate
    size.rate_variance = variance + (_OF_WAY * size.rate) ** 2
    size.time = time
    size.found = 1
    size.count = 0
    size.p = 0.0
