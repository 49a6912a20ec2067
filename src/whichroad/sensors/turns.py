"""Turns by a gyro that stands beside an odometer, each read at its own times.

Beside wheels a gyro is not used: weighing the turns of both, with the gyro's bias learnt from the
wheels, was tried and made outages worse (docs/experiments-log.md).
"""

import math
from collections import deque

import numpy as np

from ..observations import Array, Distance, Observation, SpeedYaw, YawRate, YawRates

_UNUSED = "yaw rate beside wheels or another one (not used)"
STALE = 0.5  # s, of a yaw rate that still holds
_COVERED = 0.9  # share of an odometer's readings that have one beside them, at least


def turns_at(time: Array, gyro: YawRates) -> tuple[Array, np.ndarray]:
    """Cumulative turn (rad) by a gyro at some times, (n,), and whether a reading is near."""
    steps = 0.5 * (gyro.rate[1:] + gyro.rate[:-1]) * np.diff(gyro.time)
    turned = np.interp(time, gyro.time, np.concatenate([[0.0], np.cumsum(steps)]))
    after = np.searchsorted(gyro.time, time).clip(0, len(gyro.time) - 1)
    before = np.maximum(after - 1, 0)
    apart = np.minimum(np.abs(gyro.time[after] - time), np.abs(gyro.time[before] - time))
    return turned, apart <= STALE


def covers(gyro: YawRates, time: Array) -> bool:
    """Whether a gyro was heard at most of some times, (n,) s, so that it can stand beside them."""
    return bool(len(time) and turns_at(time, gyro)[1].mean() >= _COVERED)


class GyroTurns:
    """The turns that a gyro has measured lately, on line."""

    def __init__(self) -> None:
        self._turned: deque[tuple[float, float, float]] = deque(maxlen=32)  # time, rate, turn
        self._until: tuple[float, float] | None = None  # the last odometry: time, turn until then
        self.alone = False  # whether a gyro alone measures the turn

    def take(self, reading: YawRate, beside: Observation | None, skipped: dict[str, int]) -> bool:
        """Take a reading.

        Args:
            reading: Of the gyro.
            beside: The last reading of other odometry.
            skipped: Counts readings beside what measures turns itself, and late ones.

        Returns:
            Whether it was taken.
        """
        last, rate, turned = self._turned[-1] if self._turned else (-math.inf, 0.0, 0.0)
        why = "late" if reading.time <= last else ""
        if beside is not None and not isinstance(beside, Distance):
            why = _UNUSED
        if why:
            skipped[why] = skipped.get(why, 0) + 1
            return False
        if self._turned:
            turned += 0.5 * (rate + reading.yaw_rate) * (reading.time - last)
        self._turned.append((reading.time, reading.yaw_rate, turned))
        return True

    def steered(self, before: Observation, reading: Observation, turn: float) -> float:
        """Turn between two readings of odometry by what there is, rad.

        Args:
            before: The earlier reading.
            reading: The later one, of the same kind.
            turn: By these readings, rad; an odometer's is none.
        """
        self.alone = isinstance(reading, SpeedYaw)
        if not isinstance(reading, Distance) or not self._turned:
            return turn
        then, now = self._until, self._at(reading.time)
        first = then[1] if then and then[0] == before.time else self._at(before.time)
        self._until = None if now is None else (reading.time, now)
        self.alone = first is not None and now is not None
        return turn if first is None or now is None else now - first

    def kept(self) -> list[list[float]]:
        """What it knows, as numbers."""
        return [[float(self.alone)], list(self._until or ()), *map(list, self._turned)]

    def restore(self, kept: list[list[float]]) -> None:
        """Know again what `kept` gave."""
        (alone,), until, *turned = kept
        self.alone = bool(alone)
        self._until = (until[0], until[1]) if until else None
        self._turned.clear()
        self._turned.extend((time, rate, turn) for time, rate, turn in turned)

    def _at(self, time: float) -> float | None:
        """Turn until a time, rad; None where no reading is near."""
        for k in range(len(self._turned) - 1, -1, -1):
            at, rate, turned = self._turned[k]
            if at > time:
                continue
            if time - at > STALE:
                return None
            if k + 1 < len(self._turned):
                then, later, _ = self._turned[k + 1]
                rate += 0.5 * (later - rate) * (time - at) / (then - at)
            return turned + rate * (time - at)
        return None
