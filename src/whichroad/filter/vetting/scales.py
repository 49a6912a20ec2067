"""Scales of odometry that differ from what is said: of its ways, and of its turns.

What the odometry measured of a *leg*, a chord or a corner, is held against what the fixes say of
it.  A scale that is wrong errs by the same share of every leg, and no receiver does.
"""

import math

import numpy as np

from ..._compile import Record, kernel

LEGS = 24  # that are kept

_LEG = np.dtype(
    [
        ("measured", "f8"),  # by the odometry, m or rad
        ("seen", "f8"),  # by the fixes
        ("variance", "f8"),  # of their difference
        ("seconds", "f8"),
    ],
    align=True,
)

SCALE = np.dtype(
    [
        ("legs", _LEG, (LEGS,)),  # the last ones, row (number % LEGS)
        ("count", "i8"),  # of legs since they were last forgotten
        ("agreed", "i8"),  # legs that the scale has fitted, of the drive
        ("rate", "f8"),  # true for measured, as learnt,
        ("rate_variance", "f8"),  # and its variance; infinite: the odometry is not used
        ("p", "f8"),  # P(the scale is another one)
        ("found", "u1"),  # 1: with this fix it is
        ("factor", "f8"),  # what the scale was found to be, over what it was said to be
        ("time", "f8"),  # s, when it last was found; minus infinity: never
    ],
    align=True,
)

_OF_LEG, _LEAST = 0.002, 0.5  # error of a scale that was found; m, of a way by fixes
_WHITE, _BIAS_TIME = 0.5, 80.0  # new part of a fix's error; s for which the rest lasts
_ODDS, _SURE = 12.0, 14.0  # nats that another scale needs to be as likely, and to be taken
_FREEDOM, _ITERATIONS = 4.0, 5  # degrees of it, of errors; steps to the best scale
_SEASONED = 4  # legs that fitted, after which
_LONGEST_PULL = 90.0  # s tell another scale from a receiver that is pulled along
_MOST = 0.4  # change of a scale, relative
_FITS = 2.5  # sigmas


@kernel
def forget_scale(scale: Record) -> None:
    """Begin anew: the odometry counts as it is said to."""
    scale.factor = 1.0
    scale.time = -math.inf
    scale.count = 0
    scale.p = 0.0


@kernel
def variance_between(seconds: float, a: float, b: float) -> float:
    """Variance of the way between fixes of the sigmas a and b so many seconds apart, m²."""
    slow = 1.0 - math.exp(-seconds / _BIAS_TIME)
    return (_WHITE * _WHITE + slow) * (a * a + b * b) + _LEAST * _LEAST


@kernel
def add_leg(scale: Record, measured: float, seen: float, variance: float, seconds: float) -> None:
    """Keep what was measured of a leg (m, rad), and what the fixes say of it."""
    leg = scale.legs[scale.count % LEGS]
    leg.measured = measured
    leg.seen = seen
    leg.variance = variance
    leg.seconds = seconds
    scale.count += 1
    known = variance + measured * measured * scale.rate_variance
    if (seen - scale.rate * measured) ** 2 <= _FITS * _FITS * known:
        scale.agreed += 1


@kernel
def is_seasoned(scale: Record) -> bool:
    """Whether some legs have fitted what was learnt."""
    return bool(scale.agreed >= _SEASONED)


@kernel
def decide(scale: Record, time: float) -> None:
    """How likely another scale is, by the last legs; it is taken from `_SURE` nats on.

    Errors of chords are Student's, as receivers err by far more at times.  With the misfits z of
    n legs by what was learnt, and y by the best scale, it gains

        ½ (ν + 1) Σ log((ν + z²) / (ν + y²))
    """
    likely = 0.0
    best = 0.0
    change = 0.0
    variance = 0.0
    for n in range(2, min(scale.count, LEGS) + 1):
        off, weight = _best_change(scale, n)
        gain = _cost(scale, n, 0.0, scale.rate_variance) - _cost(scale, n, off, 0.0)
        likely = max(likely, gain)
        lasts = not is_seasoned(scale) or _seconds_of(scale, n, off) >= _LONGEST_PULL
        if gain > best and lasts and abs(off) <= _MOST * scale.rate:
            best = gain
            change = off
            variance = 1.0 / weight
    scale.p = 1.0 / (1.0 + math.exp(min(_ODDS - likely, 50.0)))
    if best > _SURE:
        _take(scale, change, variance, time)


@kernel
def _seconds_of(scale: Record, n: int, change: float) -> float:
    """How long those of the last n legs took that fit another scale, and better, s."""
    seconds = 0.0
    for back in range(n):
        leg = scale.legs[(scale.count - 1 - back) % LEGS]
        z = leg.seen - scale.rate * leg.measured
        left = z - change * leg.measured
        if abs(left) < abs(z) and left * left <= _FITS * _FITS * leg.variance:
            seconds += leg.seconds
    return seconds


@kernel
def _cost(scale: Record, n: int, change: float, more: float) -> float:
    """-log likelihood of the last n legs by a scale, whose variance is `more`, nats."""
    cost = 0.0
    for back in range(n):
        leg = scale.legs[(scale.count - 1 - back) % LEGS]
        z = leg.seen - (scale.rate + change) * leg.measured
        square = z * z / (leg.variance + leg.measured * leg.measured * more)
        cost += math.log((_FREEDOM + square) / _FREEDOM)
    return 0.5 * (_FREEDOM + 1.0) * cost


@kernel
def _best_change(scale: Record, n: int) -> tuple[float, float]:
    """By how much another scale fits the last n legs best, and its information."""
    change = 0.0
    weight = 0.0
    for turn in range(_ITERATIONS):
        weight = 0.0
        off = 0.0
        for back in range(n):
            leg = scale.legs[(scale.count - 1 - back) % LEGS]
            z = leg.seen - scale.rate * leg.measured
            share = 1.0 / leg.variance
            if turn > 0:
                left = z - change * leg.measured
                share *= (_FREEDOM + 1.0) / (_FREEDOM + left * left / leg.variance)
            weight += share * leg.measured * leg.measured
            off += share * leg.measured * z
        change = off / weight
    return change, weight


@kernel
def _take(scale: Record, change: float, variance: float, time: float) -> None:
    """Take another scale."""
    scale.factor *= (scale.rate + change) / scale.rate
    scale.rate_variance = variance + (_OF_LEG * scale.rate) ** 2
    scale.time = time
    scale.found = 1
    scale.count = 0
    scale.p = 0.0
