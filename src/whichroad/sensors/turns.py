"""Turns by a gyro that stands beside an odometer, each read at its own times.

Beside wheels a gyro is not used: weighing the turns of both, with the gyro's bias learnt from the
wheels, was tried and made outages worse (docs/experiments-log.md).
"""

from collections import deque

import numpy as np

from ..observations import Array, Distance, Observation, SpeedYaw, YawRate, YawRates

_UNUSED = "yaw rate beside wheels or another one (not used)"
STALE = 0.5  # s, of a yaw rate that still holds


def turns_at(time: Array, gyro: YawRates) -> tuple[Array, np.ndarray]:
    """Cumulative turn (rad) by a gyro at some times, (n,), and whether a reading is near."""
    steps = 0.5 * (gyro.rate[1:] + gyro.rate[:-1]) * np.diff(gyro.time)
    turned = np.interp(time, gyro.time, np.concatenate([[0.0], np.cumsum(steps)]))
    after = np.searchsorted(gyro.time, time).clip(0, len(gyro.time) - 1)
    before = np.maximum(after - 1, 0)
    apart = np.minimum(np.abs(gyro.time[after] - time), np.abs(gyro.time[before] - time))
    return turned, apart <= STALE


class GyroTurns:
    """The turns that a gyro has measured lately, on line."""

    def __init__(self) -> None:
        self._turned: deque[tuple[float, float, float]] = deque(maxlen=256)  # time, rate, turn
        self.alone = False  # whether a gyro alone measures the turn

    def take(self, reading: YawRate, beside: Observation | None, skipped: dict[str, int]) -> None:
        """Take a reading; one that is not later than the last one is passed over.

        Args:
            reading: Of the gyro.
            beside: The last reading of other odometry.
            skipped: Counts readings beside what measures turns itself.
        """
        if beside is not None and not isinstance(beside, Distance):
            skipped[_UNUSED] = skipped.get(_UNUSED, 0) + 1
            return
        time, rate, turned = reading.time, reading.yaw_rate, 0.0
        if self._turned:
            last, before, turned = self._turned[-1]
            if time <= last:
                return
            turned += 0.5 * (before + rate) * (time - last)
        self._turned.append((time, rate, turned))

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
        first, last = self._at(before.time), self._at(reading.time)
        self.alone = first is not None and last is not None
        return turn if first is None or last is None else last - first

    def kept(self) -> list[list[float]]:
        """What it knows, as numbers."""
        return [*map(list, self._turned), [float(self.alone)]]

    def restore(self, kept: list[list[float]]) -> None:
        """Know again what `kept` gave."""
        self.alone = bool(kept[-1][0])
        self._turned.clear()
        self._turned.extend((time, rate, turned) for time, rate, turned in kept[:-1])

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
