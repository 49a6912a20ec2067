"""Turns by a gyro that stands beside an odometer or wheels, each read at its own times.

Beside wheels a gyro is used where the wheels are wrong or silent (`sensors.takeover`).  Weighing
the turns of both, with the gyro's bias learnt from the wheels, was tried and made outages worse
(docs/experiments-log.md).
"""

import math
from collections import deque
from typing import Any

import numpy as np

from ..filter.vetting.windows import BY_GYRO, BY_WHEELS
from ..observations import Array, Distance, Observation, SpeedYaw, YawRate, YawRates
from .glitches import Glitches
from .takeover import Takeover

_UNUSED = "yaw rate beside another one (not used)"
STALE = 0.5  # s, of a yaw rate that still holds
_COVERED = 0.5  # share of an odometer's readings that have one beside them, at least


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
    """The turns that a gyro has measured lately, on line.

    Args:
        track_width: Of wheels beside it, m.
    """

    def __init__(self, track_width: float) -> None:
        self._turned: deque[tuple[float, float, float]] = deque(maxlen=32)  # time, rate, turn
        self._until: tuple[float, float] | None = None  # the last odometry: time, turn until then
        self._glitches = Glitches()
        self.by = BY_WHEELS  # what measures the turn
        self.takeover = Takeover(track_width)

    @property
    def alone(self) -> bool:
        """Whether a gyro alone measures the turn."""
        return self.by == BY_GYRO

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
        if isinstance(beside, SpeedYaw):
            why = _UNUSED
        if why:
            skipped[why] = skipped.get(why, 0) + 1
            return False
        if self._turned:
            reading = self._glitches.without(YawRate(last, rate), reading, skipped)
            turned += 0.5 * (rate + reading.yaw_rate) * (reading.time - last)
        self._turned.append((reading.time, reading.yaw_rate, turned))
        return True

    def steered(
        self, before: Observation, reading: Observation, arc: float, turn: float
    ) -> tuple[float, float]:
        """Arc (m) and turn (rad) between two readings of odometry by what there is.

        Args:
            before: The earlier reading.
            reading: The later one, of the same kind.
            arc: By these readings, m.
            turn: By these readings, rad; an odometer's is none.
        """
        self.by = BY_GYRO if isinstance(reading, SpeedYaw) else BY_WHEELS
        if isinstance(reading, SpeedYaw) or not self._turned:
            return arc, turn
        then, now = self._until, self._at(reading.time)
        first = then[1] if then and then[0] == before.time else self._at(before.time)
        self._until = None if now is None else (reading.time, now)
        gyro = None if first is None or now is None else now - first
        if not isinstance(reading, Distance):
            arc, turn, self.by = self.takeover.moved(reading.time, arc, turn, gyro)
            return arc, turn
        self.by = BY_WHEELS if gyro is None else BY_GYRO
        return arc, turn if gyro is None else gyro

    def in_silence(self, since: float, until: float) -> float | None:
        """Turn between two moments while wheels say nothing, rad; None: it was not heard."""
        first, now = self._at(since), self._at(until)
        return None if first is None or now is None else now - first

    def kept(self) -> list[Any]:
        """What it knows, as numbers."""
        until = list(self._until or ())
        by = [float(self.by), *self._glitches.kept()]
        return [by, until, self.takeover.kept(), *map(list, self._turned)]

    def restore(self, kept: list[Any]) -> None:
        """Know again what `kept` gave."""
        (by, *glitches), until, takeover, *turned = kept
        self.by = int(by)
        self._glitches.restore(glitches)
        self.takeover.restore(takeover)
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
