"""Readings of further sensors on line: an epoch's evidence, and how far was driven since."""

from collections.abc import Iterable
from typing import Any

from ..evidence.sensed import BESIDE, BETWEEN, Row, Sensed
from ..filter.gnss.silence import SPARSE
from ..filter.state import CLOCK
from ..observations import SensorReading
from ..roadmap import RoadMap
from ..sensors import Sensor
from .epoch_filter import EpochFilter, row_of


class Sensing:
    """What further sensors say, one reading at a time.

    Args:
        sensors: Those of the vehicle.
        roads: The map.

    Raises:
        SettingError: One is no sensor, or two have the same name.
    """

    def __init__(self, sensors: Iterable[Sensor], roads: RoadMap) -> None:
        self.sensed = Sensed(sensors, roads)
        self._metres, self._time = 0.0, 0.0

    def rows(self, reading: SensorReading, now: EpochFilter, skipped: dict[str, int]) -> list[Row]:
        """The rows of a reading; what is impossible in it is counted.

        Args:
            reading: At or after the one before.
            now: The filter, which knows about where the vehicle is.
            skipped: Counts, by reason.

        Raises:
            ReadError: It is no reading of one of the sensors.
        """
        usual, since = now.heard()
        if now.mode == CLOCK and usual > SPARSE and reading.time - since > BESIDE:
            skipped[BETWEEN] = skipped.get(BETWEEN, 0) + 1
            return []
        if self._time:
            self._metres += abs(now.speed) * max(reading.time - self._time, 0.0)
        self._time = reading.time
        where = row_of(now.estimate)
        rows = self.sensed.rows(reading, self._metres, (where.x, where.y))
        for why, count in self.sensed.skipped.items():
            skipped[why] = skipped.get(why, 0) + count
        self.sensed.skipped.clear()
        return rows

    def add(self, rows: list[Row], now: EpochFilter) -> None:
        """Make rows the evidence of an epoch."""
        now.add_evidence(self.sensed.evidence(rows))

    def kept(self) -> list[Any]:
        """All that is remembered, as numbers and text."""
        return [self._metres, self._time, *self.sensed.kept()]

    def restore(self, kept: list[Any]) -> None:
        """Remember that and nothing else."""
        self._metres, self._time = kept[:2]
        self.sensed.restore(kept[2:])
