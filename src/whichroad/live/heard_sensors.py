"""Sensors as they were heard: how often, when last, whether they are believed, what was learnt."""

from collections import deque
from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

from ..diagnosis.sensor_states import DISTANCE, GNSS, TURNS, SensorState
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
from ..sensors import Sensor
from .message_types import HeardMessage, LearntMessage

KINDS: dict[type, str] = {
    GeoFix: "gnss", WheelTicks: "wheels", WheelSpeed: "wheels", Distance: "odometer",
    SpeedYaw: "speed_and_gyro", YawRate: "gyro",
}  # fmt: skip
_MEASURE = {  # what the filter holds of each
    "gnss": (GNSS,), "wheels": (DISTANCE, TURNS), "odometer": (DISTANCE,),
    "speed_and_gyro": (DISTANCE, TURNS), "gyro": (TURNS,),
}  # fmt: skip
_RECENT = 64  # readings that give a rate
_PAUSE = 5.0  # usual intervals without a reading after which there is no rate, and at least
_LEAST = 2.0  # s


class _Times:
    """When one sensor was heard, by its own times."""

    def __init__(self) -> None:
        self.count = 0
        self.recent: deque[float] = deque(maxlen=_RECENT)

    def rate(self, now: float) -> float:
        """Readings a second; 0 where it has been silent for long."""
        if len(self.recent) < 2:
            return 0.0
        first, last = min(self.recent), max(self.recent)
        usual = (last - first) / (len(self.recent) - 1)
        return 1.0 / usual if usual > 0.0 and now - last <= max(_PAUSE * usual, _LEAST) else 0.0


class HeardSensors:
    """Counts the observations of each sensor.

    Args:
        sensors: The further ones.
    """

    def __init__(self, sensors: Sequence[Sensor] = ()) -> None:
        self._columns = {one.name: frozenset(one.columns) for one in sensors}
        self._times: dict[str, _Times] = {}
        self._moved = -inf  # when odometry was last heard to move, or first heard, s
        self._counted: dict[type, tuple[float, ...]] = {}

    def take(self, one: Observation) -> None:
        """An observation has come."""
        if isinstance(one, SensorReading):
            for name, columns in self._columns.items():
                if one.sensor == name or (not one.sensor and columns & one.values.keys()):
                    self._hear(name, one.time)
        else:
            self._hear(KINDS[type(one)], one.time)
            if self._moves(one) and one.time > self._moved:
                self._moved = one.time

    def stood(self, at: float) -> float:
        """For how many seconds up to a time, s, odometry was not heard to move."""
        return at - self._moved

    def _moves(self, one: Observation) -> bool:
        """Whether a reading says that the vehicle moves; the first of a counter does."""
        if isinstance(one, WheelSpeed):
            return one.left != 0.0 or one.right != 0.0
        if isinstance(one, SpeedYaw):
            return one.speed != 0.0
        if not isinstance(one, WheelTicks | Distance):
            return False
        told = (one.left, one.right) if isinstance(one, WheelTicks) else (one.distance,)
        before, self._counted[type(one)] = self._counted.get(type(one)), told
        return told != before

    def turns(self, since: float) -> bool:
        """Whether odometry that measures turns, too, was heard since a time, s."""
        heard = {n for n, one in self._times.items() if max(one.recent, default=-inf) >= since}
        return bool(heard & {"wheels", "speed_and_gyro"}) or {"odometer", "gyro"} <= heard

    def forget_after(self, time: float) -> None:
        """A recording was turned back to a time, s."""
        self._moved = min(self._moved, time)
        for times in self._times.values():
            kept = [one for one in times.recent if one <= time]
            times.recent = deque(kept, maxlen=_RECENT)

    def messages(self, now: float, states: Sequence[SensorState]) -> list[HeardMessage]:
        """What is published at a time of the sensors, s; sensors that were never heard, too."""
        known = {one.name: one for one in states}
        names = [name for name in _MEASURE if name in self._times] + list(self._columns)
        return [self._message(name, now, known) for name in names]

    def _hear(self, name: str, time: float) -> None:
        times = self._times.get(name)
        if times is None:
            times = self._times[name] = _Times()
        times.count += 1
        times.recent.append(time)

    def _message(self, name: str, now: float, known: Mapping[str, SensorState]) -> HeardMessage:
        times = self._times.get(name, _Times())
        age = max(now - max(times.recent), 0.0) if times.recent else None
        return heard_message(
            name, times.count, times.rate(now), age, known, further=name in self._columns
        )


def heard_message(
    name: str, count: int, rate: float, age: float | None, known: Mapping[str, SensorState], *,
    further: bool,
) -> HeardMessage:  # fmt: skip
    """One sensor as it is published.

    Args:
        name: One of `KINDS`, or that of a further sensor.
        count: Its readings so far.
        rate: Readings a second.
        age: s since the last one; None: there was none.
        known: What the filter holds, by name; empty: not known.
        further: Whether it is a further sensor.
    """
    states = [known[of] for of in ((name,) if further else _MEASURE[name]) if of in known]
    one = states[0] if further and states else SensorState(name)
    return HeardMessage(
        name=name,
        further=further,
        count=count,
        rate_hz=round(rate, 2),
        age_s=None if age is None else round(age, 3),
        doubted=[part for state in states for part in state.doubted] if states else None,
        misfits=one.misfits,
        withheld=one.withheld,
        learnt=[_learnt(number) for state in states for number in state.learnt],
    )


def _learnt(one: Any) -> LearntMessage:
    sigma = None if one.sigma is None else round(one.sigma, 6)
    return LearntMessage(what=one.what, value=round(one.value, 6), sigma=sigma, unit=one.unit)
