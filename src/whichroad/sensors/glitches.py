"""Single readings of a speed or turn rate that are nonsense between sound ones.

A bus says 0, or all ones, for a reading now and then.  One that is off from the last sound one as
no car's is counts as nonsense, and the sound one holds instead, for three readings and 0.2 s at
most.  What stays longer is believed, and held against what cars do (`filter.vetting.plausibility`).
So is all of a sensor of which many readings are off.
In a recording what comes after is known: a change that stays is none from its first reading on.
"""

from dataclasses import replace
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from ..observations import (
    Array,
    Distance,
    OdometryLog,
    SpeedYaw,
    SpeedYawRate,
    WheelSpeed,
    WheelSpeeds,
    WheelTicks,
    WithGyro,
    YawRate,
    YawRates,
)
from .validation import Skipped

GLITCH = "rate off from those around it (bridged)"
_MOST, _LONGEST = 3, 0.21  # readings, and s since the last sound one, that it holds
_UNUSUAL, _NEW = 4.0, 0.02  # times the usual change; share of a change in what is usual,
_ROUGH = 2.0  # and of which it is at most so many times the slack
_ON_THE_SPOT = 2.5  # rad/s, up to which who stands may be turned
_LATELY, _OFTEN = 0.05, 0.3  # share of a reading in the last ones; of them, that is no exception


Reading = TypeVar("Reading", bound=WheelTicks | WheelSpeed | Distance | SpeedYaw | YawRate)
Log = TypeVar("Log", bound=OdometryLog | YawRates)


class _Change(NamedTuple):
    """By how much a rate changes at most, beyond four times what is usual."""

    by_second: float  # m/s² or rad/s²
    slack: float  # m/s or rad/s


_SPEED, _TURN = _Change(12.0, 1.0), _Change(4.0, 0.6)
_RATES: dict[type, tuple[tuple[str, _Change], ...]] = {
    WheelSpeed: (("left", _SPEED), ("right", _SPEED)),
    SpeedYaw: (("speed", _SPEED), ("yaw_rate", _TURN)),
    YawRate: (("yaw_rate", _TURN),),
    WheelSpeeds: (("left", _SPEED), ("right", _SPEED)),
    SpeedYawRate: (("speed", _SPEED), ("yaw_rate", _TURN)),
    YawRates: (("rate", _TURN),),
}

_READ = {kind: attrgetter(rates[0][0], rates[-1][0]) for kind, rates in _RATES.items()}
_SLACK = {  # of the first and the last rate: by second, and at once
    kind: (
        (rates[0][1].by_second, rates[-1][1].by_second), (rates[0][1].slack, rates[-1][1].slack)
    )
    for kind, rates in _RATES.items()
}  # fmt: skip


class Glitches:
    """The same reading by reading, of one sensor on line."""

    def __init__(self) -> None:
        self._sound, self._count = 0.0, 0  # s, time of the last sound one; how many were not since
        self._share = 0.0  # of the last readings that are off
        self._usual = (0.0, 0.0)  # change of each from reading to reading, m/s or rad/s

    def without(self, before: Any, reading: Reading, skipped: Skipped) -> Reading:
        """The reading; where it is nonsense, the one before at its time.

        Args:
            before: What this gave of the reading before; None: it is the first.
            reading: What is no rate is given back as it is.
            skipped: Counts what is nonsense.
        """
        read = _READ.get(type(reading))
        if read is None:
            return reading
        since, off = reading.time - self._sound, False
        if type(before) is type(reading):
            (fast, slew), (one, two) = _SLACK[type(reading)]
            (x, y), (p, q) = read(reading), read(before)
            turns = type(reading) is not SpeedYaw or x != 0.0 or p != 0.0 or abs(y) > _ON_THE_SPOT
            u, v = self._usual
            x, y = abs(x - p), abs(y - q)
            if x > one or y > two:
                off = x > one + fast * since + _UNUSUAL * u
                off = off or (turns and y > two + slew * since + _UNUSUAL * v)
                x, y = min(x, _ROUGH * one), min(y, _ROUGH * two)
            self._usual = u + _NEW * (x - u), v + _NEW * (y - v)
        if off or self._share:
            self._share += _LATELY * (off - self._share)
        if off and self._count < _MOST and self._share < _OFTEN and 0.0 <= since <= _LONGEST:
            self._count += 1
            skipped[GLITCH] = skipped.get(GLITCH, 0) + 1
            return cast(Reading, replace(before, time=reading.time))
        self._sound, self._count = reading.time, 0
        return reading

    def kept(self) -> list[float]:
        """What it knows, as numbers."""
        return [self._sound, self._count, self._share, *self._usual]

    def restore(self, kept: list[float]) -> None:
        """Know again what `kept` gave."""
        self._sound, count, self._share, *usual = kept
        self._count, self._usual = int(count), (usual[0], usual[1])


def without_glitches(log: OdometryLog) -> tuple[OdometryLog, Skipped]:
    """Odometry in which sound readings hold over nonsense, and how many that were, by reason."""
    if isinstance(log, WithGyro):
        (distance, a), (gyro, b) = _mended(log.distance), _mended(log.gyro)
        log, count = (replace(log, distance=distance, gyro=gyro) if a + b else log), a + b
    else:
        log, count = _mended(log)
    return log, {GLITCH: count} if count else {}


def _mended(log: Log) -> tuple[Log, int]:
    """A log of one sensor, and how many of its readings were nonsense."""
    if len(log.time) < 3:
        return log, 0
    rates = _RATES.get(type(log), ())
    columns: list[Array] = [getattr(log, name) for name, _ in rates]
    changes = [np.abs(np.diff(column)) for column in columns]
    slack = [  # beyond what is usual
        most.slack + _UNUSUAL * float(np.minimum(change, _ROUGH * most.slack).sum()) / len(log.time)
        for change, (_, most) in zip(changes, rates, strict=True)
    ]
    dt = np.diff(log.time)
    off = np.zeros(len(dt), bool)  # from each reading to the next
    drives = np.ones(len(dt), bool)  # who stands may be turned on the spot
    if isinstance(log, SpeedYawRate):
        drives = (log.speed[1:] != 0.0) | (log.speed[:-1] != 0.0)
        drives |= np.maximum(np.abs(log.yaw_rate[1:]), np.abs(log.yaw_rate[:-1])) > _ON_THE_SPOT
    for change, (_, most), more in zip(changes, rates, slack, strict=True):
        off |= (change > more + most.by_second * dt) & drives
    source = np.arange(len(log.time))  # of which reading each has the values
    limits = [(most.by_second, more) for (_, most), more in zip(rates, slack, strict=True)]
    for last in np.flatnonzero(off).tolist():
        if source[last] != last:
            continue
        for back in range(last + 1, min(last + 1 + _MOST, len(dt))):
            if log.time[back] - log.time[last] > _LONGEST:
                break
            if off[back] and _agree(last, back + 1, log.time, columns, limits):
                source[last : back + 1] = last
                break
    count = int((source != np.arange(len(source))).sum())
    held: dict[str, Any] = {
        name: column[source] for (name, _), column in zip(rates, columns, strict=True)
    }
    return (replace(log, **held), count) if count else (log, 0)


def _agree(
    a: int, b: int, time: Array, columns: list[Array], limits: list[tuple[float, float]]
) -> bool:
    """Whether each rate may have changed from one reading to another later one.

    Args:
        a: The earlier one.
        b: The later one.
        time: (n,) s.
        columns: Rates of (n,).
        limits: Of each its change by the second, and at once.
    """
    since = time[b] - time[a]
    return all(
        abs(column[b] - column[a]) <= by_second * since + slack
        for column, (by_second, slack) in zip(columns, limits, strict=True)
    )
