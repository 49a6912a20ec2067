"""What the filter says of a drive, recorded or on line, beside where the vehicle was."""

from typing import Any

import pyarrow as pa

from whichroad import Localizer, RoadMap, Settings, match

from ..worlds.online import ON_LINE, Answer, row_of
from .sensors import CAR, Heard


def answered(
    heard: list[Heard], roads: RoadMap, settings: Settings | None, lag: str | None
) -> Answer:
    """The answer to all readings.

    Args:
        heard: In the order in which they come.
        roads: The map.
        settings: None: as they are by default.
        lag: As `match` takes it, or `online`.
    """
    if lag == ON_LINE:
        return _on_line(heard, roads, settings)
    readings = sorted((h.reading for h in heard), key=lambda reading: reading.time)
    result = match(readings, roads, vehicle=CAR, settings=settings, lag=lag)
    return Answer(result.to_arrow(), result.diagnosis)


def _on_line(heard: list[Heard], roads: RoadMap, settings: Settings | None) -> Answer:
    """Estimates after each reading, at the moment at which it came, whatever its stamp says."""
    localizer = Localizer(roads, vehicle=CAR, settings=settings)
    rows: list[dict[str, Any]] = []
    for when, reading in heard:
        estimate = localizer.update(reading)
        if estimate.answered:
            rows.append({**row_of(estimate), "time": round(1e6 * when)})
    return Answer(pa.Table.from_pylist(rows), localizer.diagnosis)
