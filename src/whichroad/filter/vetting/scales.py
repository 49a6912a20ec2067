"""Scales of odometry that differ from what is said: of its ways, and of its turns.

What the odometry measured of a *leg*, a chord or a corner, is held against what the fixes say of
it.  A scale that is wrong errs by the same share of every leg, and no receiver does.  What turns
drift by lasts for the way or the time, so that it is told apart where corners differ in these.
"""

import math
from typing import NamedTuple

import numpy as np

from ..._compile import Record, kernel

LEGS = 24  # that are kept

_LEG = np.dtype(
    [
        ("measured", "f8"),  # by the odometry, m or rad
        ("seen", "f8"),  # by the fixes
        ("variance", "f8"),  # of their difference
        ("seconds", "f8"),
        ("clock", "f8"),  # by how much a drift adds to what is seen, m or s
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
        ("straight", "f8", (2,)),  # weighted drift of what was no leg, and its weight
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
def forget_drift(scale: Record) -> None:
    """What turns drift by is another number from now on."""
    scale.straight[0] = scale.straight[1] = 0.0


class Fit(NamedTuple):
    """What explains some legs best."""

    change: float  # of the scale
    drift: float  # rad a metre or a second
    variance: float  # of the change
    cost: float  # -log likelihood, nats


@kernel
def variance_between(seconds: float, a: float, b: float) -> float:
    """Variance of the way between fixes of the sigmas a and b so many seconds apart, m²."""
    slow = 1.0 - math.exp(-seconds / _BIAS_TIME)
    return (_WHITE * _WHITE + slow) * (a * a + b * b) + _LEAST * _LEAST


@kernel
def add_leg(
    scale: Record, measured: float, seen: float, variance: float, seconds: float, clock: float
) -> None:  # fmt: skip
    """Keep what was measured of a leg (m, rad), and what the fixes say of it.

    Args:
        scale: In place.
        measured: By the odometry, m or rad.
        seen: By the fixes.
        variance: Of their difference, but for the scale and the drift.
        seconds: For which it lasted.
        clock: What a drift is multiplied by, m or s; 0: nothing drifts.
    """
    leg = scale.legs[scale.count % LEGS]
    leg.measured = measured
    leg.seen = seen
    leg.variance = variance
    leg.seconds = seconds
    leg.clock = clock
    scale.count += 1
    known = variance + measured * measured * scale.rate_variance
    if (seen - scale.rate * measured) ** 2 <= _FITS * _FITS * known:
        scale.agreed += 1


@kernel
def is_seasoned(scale: Record) -> bool:
    """Whether some legs have fitted what was learnt."""
    return bool(scale.agreed >= _SEASONED)


@kernel
def decide(scale: Record, time: float, known: float = 1.0) -> None:
    """How likely another scale is, by the last legs; it is taken from `_SURE` nats on.

    Errors of chords are Student's, as receivers err by far more at times.  With the misfits z of
    n legs by what was learnt, and y by the best scale, each with the drift that fits best, it gains

        ½ (ν + 1) Σ log((ν + z²) / (ν + y²))

    Args:
        scale: In place.
        time: Of the last leg, s.
        known: 1 over the variance of the drift, before legs tell it.
    """
    likely = 0.0
    best = 0.0
    change = 0.0
    variance = 0.0
    for n in range(2, min(scale.count, LEGS) + 1):
        as_learnt = _fit(scale, n, known, False)
        other = _fit(scale, n, known, True)
        gain = as_learnt.cost - other.cost
        likely = max(likely, gain)
        lasts = not is_seasoned(scale) or _seconds_of(scale, n, as_learnt, other) >= _LONGEST_PULL
        if gain > best and lasts and abs(other.change) <= _MOST * scale.rate:
            best = gain
            change = other.change
            variance = other.variance
    scale.p = 1.0 / (1.0 + math.exp(min(_ODDS - likely, 50.0)))
    if best > _SURE:
        _take(scale, change, variance, time)


@kernel
def _misfit(scale: Record, leg: Record, change: float, drift: float) -> float:
    """What is seen of a leg beyond what another scale and a drift explain."""
    return float(leg.seen - (scale.rate + change) * leg.measured - drift * leg.clock)


@kernel
def _seconds_of(scale: Record, n: int, learnt: Fit, other: Fit) -> float:
    """How long those of the last n legs took that fit another scale, and better, s."""
    seconds = 0.0
    for back in range(n):
        leg = scale.legs[(scale.count - 1 - back) % LEGS]
        z = _misfit(scale, leg, 0.0, learnt.drift)
        left = _misfit(scale, leg, other.change, other.drift)
        if abs(left) < abs(z) and left * left <= _FITS * _FITS * leg.variance:
            seconds += leg.seconds
    return seconds


@kernel
def _fit(scale: Record, n: int, known: float, free: bool) -> Fit:
    """Fit the last n legs by a drift, and by another scale where it is free, reweighted.

    With the weights w, the misfits z, what was measured m and the clocks c:

        [Σ w m², Σ w m c; Σ w m c, Σ w c² + known] [change; drift] = [Σ w m z; Σ w c z]
    """
    more = 0.0 if free else scale.rate_variance
    change = 0.0
    drift = 0.0
    variance = 0.0
    for turn in range(_ITERATIONS):
        mm, mc, mz = 0.0, 0.0, 0.0
        cc, cz = known + scale.straight[1], scale.straight[0]
        for back in range(n):
            leg = scale.legs[(scale.count - 1 - back) % LEGS]
            m, c = leg.measured, leg.clock
            z = _misfit(scale, leg, 0.0, 0.0)
            v = leg.variance + m * m * more
            share = 1.0 / v
            if turn > 0:
                left = z - change * m - drift * c
                share *= (_FREEDOM + 1.0) / (_FREEDOM + left * left / v)
            mm += share * m * m
            mc += share * m * c
            mz += share * m * z
            cc += share * c * c
            cz += share * c * z
        if free:
            variance = 1.0 / (mm - mc * mc / cc)
            change = variance * (mz - mc / cc * cz)
        drift = (cz - change * mc) / cc
    return Fit(change, drift, variance, _cost(scale, n, change, drift, known))


@kernel
def _cost(scale: Record, n: int, change: float, drift: float, known: float) -> float:
    """-log likelihood of the last n legs by a scale and a drift, nats; 0 change: as learnt."""
    more = scale.rate_variance if change == 0.0 else 0.0
    cost = 0.0
    for back in range(n):
        leg = scale.legs[(scale.count - 1 - back) % LEGS]
        z = _misfit(scale, leg, change, drift)
        square = z * z / (leg.variance + leg.measured * leg.measured * more)
        cost += math.log((_FREEDOM + square) / _FREEDOM)
    weight = known + scale.straight[1]
    cost *= 0.5 * (_FREEDOM + 1.0)
    return float(cost + drift * (0.5 * weight * drift - scale.straight[0]))


@kernel
def _take(scale: Record, change: float, variance: float, time: float) -> None:
    """Take another scale."""
    scale.factor *= (scale.rate + change) / scale.rate
    scale.rate_variance = variance + (_OF_LEG * scale.rate) ** 2
    scale.time = time
    scale.found = 1
    scale.count = 0
    scale.p = 0.0
