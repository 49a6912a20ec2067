"""Readings of further sensors as lines of JSON, one object each.

    {"time": 1780300800.5, "compass_deg": 91.5}
    {"time": "2026-06-01T08:00:00.5Z", "sensor": "compass", "compass_deg": 91.5}

Without a time a reading is of the moment at which it comes.
"""

import json
import math
import time
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from ..observations import GeoFix, Observation, SensorReading
from ..sensors import Sensor
from .message_types import UNKNOWN, ReceiverStatus

_LONGEST = 1 << 12  # bytes of a line
_MOST = 64  # numbers in it


class ReadingLines:
    """Bytes in, readings out; it stands where `NmeaStream` does.

    Args:
        sensors: Whose columns are taken; lines without one are counted.
        offset: s added to the times that lines name.

    Attributes:
        skipped: Lines that could not be used.
    """

    def __init__(self, sensors: Sequence[Sensor], offset: float = 0.0) -> None:
        self._names = {one.name for one in sensors}
        self._columns = {column for one in sensors for column in one.columns}
        self._offset = offset
        self._held, self._endless = b"", False
        self._ready: list[SensorReading] = []
        self.skipped = 0

    @property
    def skipped_why(self) -> Counter[str]:
        """The same by reason."""
        return Counter({"line without a reading": self.skipped})

    @property
    def receiver(self) -> ReceiverStatus:
        """Nothing is known of a receiver."""
        return UNKNOWN

    def sensed(self) -> list[Observation]:
        """No odometry comes here."""
        return []

    def feed(self, data: bytes) -> list[GeoFix]:
        """Take bytes; no fix comes of them."""
        if self._endless:  # what follows of a line that was given up
            _, end, data = data.partition(b"\n")
            self._endless = not end
        *lines, self._held = (self._held + data).split(b"\n")
        if len(self._held) > _LONGEST:
            self._held, self._endless = b"", True
            self.skipped += 1
        for line in lines:
            if line.strip():
                reading = self._reading(line)
                self.skipped += reading is None
                self._ready += [] if reading is None else [reading]
        return []

    def readings(self) -> list[SensorReading]:
        """The readings since the last call."""
        made, self._ready = self._ready, []
        return made

    def flush(self) -> list[GeoFix]:
        """The line is silent."""
        return []

    def _reading(self, line: bytes) -> SensorReading | None:
        """A line's reading; None: it is none."""
        try:
            said = json.loads(line)
        except (ValueError, RecursionError):
            return None
        if len(line) > _LONGEST or not isinstance(said, dict) or len(said) > _MOST:
            return None
        sensor, when = said.get("sensor", ""), self._time(said.get("time"))
        values = {name: float(said[name]) for name in self._columns if _is_number(said.get(name))}
        if when is None or not values or (sensor != "" and sensor not in self._names):
            return None
        return SensorReading(when, values, sensor)

    def _time(self, said: Any) -> float | None:
        """Seconds since 1970; None: it is no time."""
        if said is None:
            return time.time()
        if _is_number(said):
            return float(said) + self._offset
        try:
            moment = datetime.fromisoformat(str(said))
        except ValueError:
            return None
        aware = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        return aware.timestamp() + self._offset


def _is_number(value: Any) -> bool:
    is_one = isinstance(value, int | float) and not isinstance(value, bool)
    return is_one and abs(value) < 1e15 and math.isfinite(value)
