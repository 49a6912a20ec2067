"""Validation of single observations for the on-line filter.

One value that is not finite would corrupt the filter state for good.  Recorded logs are
checked by the readers.
"""

import math
from dataclasses import fields, replace
from numbers import Real
from typing import Any

from ..errors import ReadError
from ..observations import (
    Distance,
    GeoFix,
    Observation,
    SensorReading,
    SpeedYaw,
    WheelSpeed,
    WheelTicks,
    YawRate,
)

FASTEST = 90.0  # m/s, of a vehicle and of its wheels
BACKS, UNSEEN = 8.0, 2.0  # m/s, at which nobody backs up for s without a reading: counts began anew
SPINNING = 10.0  # rad/s
LATEST = 253_402_300_800.0  # s, the year 10000: later times are milliseconds
NO_VARIANCE = "variance of 0 or less (settings' default used)"
NOT_A_COVARIANCE = "covariance not positive definite (settings' default used)"
WORST = 1000.0  # m, sigma beyond which a fix says nothing; assumed ones are 500 m at most
TOO_VAGUE = f"sigma beyond {WORST:,.0f} m (says nothing of the place)"
Skipped = dict[str, int]


def validated(observation: Observation, skipped: Skipped) -> Observation | None:
    """The observation without impossible parts; None: it is impossible altogether.

    Args:
        observation: The observation.
        skipped: Counts what is impossible, by reason.

    Raises:
        ReadError: It is no observation, holds what is no number, or its time is not in
            seconds since 1970.
    """
    try:
        if not math.isfinite(observation.time):
            _count("no time", skipped)
            return None
        if observation.time >= LATEST:
            raise _no_time("observation", observation.time)
        if isinstance(observation, GeoFix):
            return _fix(observation, skipped)
        if isinstance(observation, SensorReading):
            return observation  # its sensor reads it
        why = _wrong(observation)
        if why is None:
            return observation
        _count(why, skipped)
        return None
    except (AttributeError, TypeError, ValueError):
        raise ReadError(
            f"observation: {_seen(observation)} was given; a GeoFix, WheelTicks, WheelSpeed, "
            "SpeedYaw, Distance or YawRate of numbers was expected, its time in seconds since 1970 "
            "(datetime.timestamp())"
        ) from None


def _seen(observation: Any) -> str:
    """What is wrong with an observation: the field that is no number, or all of it."""
    if isinstance(observation, Observation):
        for f in fields(observation):
            value = getattr(observation, f.name)
            if f.type in (float, "float") and not isinstance(value, Real):
                return f"{type(observation).__name__}({f.name}={str(value)[:80]!r})"
    return str(observation)[:80]


def check_time(time: float, where: str) -> None:
    """See that a moment which is asked for is one.

    Raises:
        ReadError: It is not in seconds since 1970; `where` names who asked.
    """
    try:
        possible = -math.inf < time < LATEST
    except TypeError:
        possible = False
    if not possible:
        raise _no_time(where, time)


def _no_time(where: str, time: Any) -> ReadError:
    late = isinstance(time, int | float) and math.isfinite(time)
    unit = "milli" if late and time < 1e14 else "micro" if late and time < 1e17 else "nano"
    what_to_do = f"are these {unit}seconds?" if late else "as datetime.timestamp() gives them"
    seen = f"{time:g}" if late else repr(time)
    return ReadError(f"{where}: time is {seen}; seconds since 1970 were expected; {what_to_do}")


def _count(why: str, skipped: Skipped) -> None:
    skipped[why] = skipped.get(why, 0) + 1


def _fix(fix: GeoFix, skipped: Skipped) -> GeoFix | None:
    """A fix without impossible values; None: its position is impossible, or says nothing."""
    lat, lon = fix.lat_deg, fix.lon_deg
    # receivers without a fix write 0, 0
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0 and (lat != 0.0 or lon != 0.0)):
        _count("impossible position", skipped)
        return None
    ee, en, nn = fix.cov_ee, fix.cov_en, fix.cov_nn
    if WORST**2 < max(ee, nn) < math.inf:
        _count(TOO_VAGUE, skipped)
        return None
    unsaid = ee == math.inf and nn == math.inf
    if not unsaid and not (0.0 < ee < math.inf and 0.0 < nn < math.inf and en * en < ee * nn):
        _count(NO_VARIANCE if ee <= 0.0 or nn <= 0.0 else NOT_A_COVARIANCE, skipped)
        fix = replace(fix, cov_ee=math.inf, cov_en=0.0, cov_nn=math.inf)
    if fix.sigma_speed != math.inf and not (fix.sigma_speed > 0.0 and 0.0 <= fix.speed < 1e3):
        _count("impossible speed (not used)", skipped)
        fix = replace(fix, speed=0.0, sigma_speed=math.inf)
    if fix.sigma_bearing_deg != math.inf and not (
        fix.sigma_bearing_deg > 0.0 and abs(fix.bearing_deg) <= 720.0
    ):
        _count("impossible course (not used)", skipped)
        fix = replace(fix, bearing_deg=0.0, sigma_bearing_deg=math.inf)
    return fix


def _wrong(observation: WheelTicks | WheelSpeed | SpeedYaw | Distance | YawRate) -> str | None:
    """Why an odometry reading is impossible; None: it is valid."""
    if isinstance(observation, WheelTicks):  # first, as the most frequent
        if not (math.isfinite(observation.left) and math.isfinite(observation.right)):
            return "missing wheel count"
    elif isinstance(observation, WheelSpeed):
        left, right = observation.left, observation.right
        if math.isnan(left) or math.isnan(right):
            return "missing wheel speed"
        if abs(left) > FASTEST or abs(right) > FASTEST:
            return f"wheel speed beyond {FASTEST:g} m/s"
    elif isinstance(observation, SpeedYaw | YawRate):
        speed = observation.speed if isinstance(observation, SpeedYaw) else 0.0
        if math.isnan(speed) or math.isnan(observation.yaw_rate):
            return "missing speed" if math.isnan(speed) else "missing yaw rate"
        if abs(speed) > FASTEST:
            return f"speed beyond {FASTEST:g} m/s"
        if abs(observation.yaw_rate) > SPINNING:
            return f"yaw rate beyond {SPINNING:g} rad/s"
    elif not math.isfinite(observation.distance):
        return "no distance"
    return None
