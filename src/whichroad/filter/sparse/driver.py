"""How fast a vehicle drives, and how evenly, learnt between sparse fixes.

Maps do not know how fast their roads are driven, and one driver keeps to a share of the usual
speed, while another one stands in traffic.  What was driven between two fixes shows it.  On roads
that are usually fast the same way was driven at a slower pace than on slow ones, so that each
hypothesis has its own.
"""

import math

import numpy as np

from ..._compile import Record, kernel

DRIVER = np.dtype(
    [
        ("pace", "f8"),  # speed over the usual one; 0: nothing is known yet
        ("speed_sigma", "f8"),  # sigma of the speed about that, m/s
        ("known", "f8"),  # information on the pace
        ("energy", "f8", (2,)),  # of deviations, (m/s)², and their number
        ("odometer", "f8"),  # as read at the last epoch, m; 0: not read
        ("scale", "f8"),  # metres for each of its metres,
        ("scale_variance", "f8"),  # and how unsure that is
        ("wrong", "f8"),  # P(what it reads of a leg says nothing)
    ],
    align=True,
)

LEG = np.dtype(
    [
        ("at", "f8"),  # time of its end, s
        ("seconds", "f8"),  # that it took; 0: there is none
        ("length", "f8"),  # to the start of the last edge, m
        ("free", "f8"),  # average usual speed of its roads, m/s
        ("begun", "f8"),  # what the speed at its start had the vehicle drive, m
        ("variance", "f8"),  # of the place at its start, m²
        ("pace", "f8"),  # of the vehicle's way so far, speed over the usual one; 0: as the drive's
        ("known", "f8"),  # information on it
        ("driven", "f8"),  # by the odometer, m; < 0: it told nothing
        ("driven_variance", "f8"),  # of that, by its steps and its scale, m²
        ("haste", "f8"),  # what its speed has said against its roads, nats, >= 0: filter.haste
    ],
    align=True,
)

PACE, SPEED_SIGMA = 0.7, 5.0  # of a driver of whom nothing is known; m/s

_SCALE_SIGMA = 0.03  # of an odometer: tyres wear
_WRONG, _MOST_WRONG = 0.01, 0.9  # P(a leg of it says nothing): at first, and of one that never fits
_LEGS = 6.0  # over which that is learnt
_CONTRADICTS = 16.0  # squared sigmas from which on a leg says nothing of it
_PACE_SIGMA = 0.25  # of a driver's pace about the usual one
_SPREADS = 4.0  # legs that count as much as what is believed before
_FREEDOM = 4.0  # of the Student distribution of deviations: vehicles stop
_LEAST_PACE, _MOST_PACE = 0.3, 2.0
_LEAST_SIGMA, _MOST_SIGMA = 1.5, 12.0  # m/s
_KEPT = 1800.0  # s, for which legs are remembered

_EXCESS = 10.0  # m, likely excess of a route over the straight line,
_EXCESS_RATE = 1.8  # m/s, its growth with time,
_MAX_EXCESS = 120.0  # m, and the limit of that growth


@kernel
def begin_driver(driver: Record) -> None:
    """Nothing is known of the driver."""
    driver.pace = PACE
    driver.speed_sigma = SPEED_SIGMA
    driver.known = 1.0 / (_PACE_SIGMA * _PACE_SIGMA)
    driver.energy[0] = _SPREADS * SPEED_SIGMA * SPEED_SIGMA
    driver.energy[1] = _SPREADS
    driver.scale, driver.scale_variance = 1.0, _SCALE_SIGMA * _SCALE_SIGMA
    driver.wrong = _WRONG


@kernel
def likely_excess(dt: float) -> float:
    """By how much a route of dt seconds is likely to exceed the straight line, m."""
    return _EXCESS + min(_EXCESS_RATE * dt, _MAX_EXCESS)


@kernel
def begin_leg(leg: Record) -> None:
    """There is none, and the pace is that of the drive."""
    leg.pace = leg.known = leg.haste = 0.0
    forget_leg(leg)


@kernel
def forget_leg(leg: Record) -> None:
    """There is none."""
    leg.at = leg.seconds = leg.length = leg.free = leg.begun = leg.variance = 0.0
    leg.driven, leg.driven_variance = -1.0, 0.0


@kernel
def pace_of(leg: Record, pace: float) -> float:
    """Speed over the usual one as a hypothesis has it, else as the drive has it."""
    return float(leg.pace) if leg.pace > 0.0 else pace


@kernel
def learn_leg(driver: Record, hyp: Record, by_speed: float, unit: float, leads: bool) -> None:
    """Learn from the leg that a hypothesis has driven: its pace, and the drive's if it leads.

        off = metres − pace · free (Δt − by_speed) − begun
        off ~ Student(0, speed_sigma² unit + what is not known of both ends)

    Args:
        driver: In place.
        hyp: The hypothesis; its abscissa is up to date, and its pace changed.
        by_speed: Derivative of the distance by the speed at its start, s.
        unit: Variance of the distance for a sigma of 1 m/s, m².
        leads: Whether the drive's pace and the spread of its speeds are this hypothesis'.
    """
    leg = hyp.leg
    if leg.pace == 0.0:
        leg.pace, leg.known = driver.pace, driver.known
    metres = leg.length + hyp.along
    ends = leg.variance + hyp.along_sigma**2
    slope = leg.free * max(leg.seconds - by_speed, 0.0)
    off = metres - leg.pace * slope - leg.begun
    wide = driver.speed_sigma**2 * unit + ends
    share = (_FREEDOM + 1.0) / (_FREEDOM + off * off / wide)
    kept = math.exp(-leg.seconds / _KEPT)
    before = 1.0 / (_PACE_SIGMA * _PACE_SIGMA)
    leg.known = max(kept * leg.known, before) + share * slope * slope / wide
    leg.pace += share * slope * off / (wide * leg.known)
    leg.pace = min(max(leg.pace, _LEAST_PACE), _MOST_PACE)
    if not leads:
        return
    driver.pace, driver.known = leg.pace, leg.known
    seen = hyp.weight * (driver.speed_sigma**2 * unit / wide) ** 2
    excess = max(off * off - ends, 0.0) / unit
    driver.energy[0] = kept * driver.energy[0] + seen * min(share, 1.0) * excess
    driver.energy[1] = kept * driver.energy[1] + seen
    short = (1.0 - kept) * _SPREADS  # what is believed before does not fade
    sigma2 = (driver.energy[0] + short * SPEED_SIGMA * SPEED_SIGMA) / (driver.energy[1] + short)
    driver.speed_sigma = min(max(math.sqrt(sigma2), _LEAST_SIGMA), _MOST_SIGMA)


@kernel
def learn_scale(driver: Record, hyp: Record) -> None:
    """Learn the odometer's scale from the leg that a hypothesis has driven, and whether it fits.

    Args:
        driver: In place.
        hyp: The hypothesis; its abscissa is up to date.
    """
    leg = hyp.leg
    if leg.driven < 0.0:
        return
    read = leg.driven / driver.scale
    off = leg.length + hyp.along - leg.driven
    wide = leg.variance + hyp.along_sigma**2 + leg.driven_variance
    odd = off * off > _CONTRADICTS * wide
    driver.wrong += ((_MOST_WRONG if odd else _WRONG) - driver.wrong) / _LEGS
    if odd:
        return
    gain = driver.scale_variance * read / wide
    driver.scale += gain * off
    driver.scale_variance *= 1.0 - gain * read
