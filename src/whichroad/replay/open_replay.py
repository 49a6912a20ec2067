"""Recorded messages from a drive's logs or from a table of points."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..epochs import mask_windows
from ..errors import DriveError
from ..matching import match
from .player import Player
from .points import check_map, read_points
from .recorded_messages import RecordedMessages, Window
from .signals import Signals
from .truth import Truth

if TYPE_CHECKING:
    from ..observations import Drive
    from ..places import Places
    from ..roadmap import RoadMap
    from ..sensors import Sensor
    from ..settings import Vehicle
    from ..tables.result import Result

_TABLES = (".parquet", ".geoparquet", ".arrow", ".feather")
_ENDS = 1 << 16  # bytes at either end of a file in which the columns of points are named
_END = 1e8  # s; a mask that is not over, below the ten years from which on times are absolute


def is_points(path: str | Path) -> bool:
    """Whether a file seems to hold points that `match` wrote, rather than a log."""
    path = Path(path)
    if path.suffix.lower() not in (*_TABLES, ".csv", ".geojson", ".json"):
        return False
    try:
        with open(path, "rb") as file:
            head = file.read(_ENDS)
            file.seek(max(path.stat().st_size - _ENDS, 0))
            return b"p_road" in head + file.read(_ENDS)
    except OSError:
        return False  # the reader will report the error


@dataclass(frozen=True, slots=True)
class Remaking:
    """Matches one drive again with fixes withheld in chosen windows."""

    drive: "Drive"
    roads: "RoadMap"
    vehicle: "Vehicle | None" = None
    start: Any = None
    model: str = "default"
    places: "Places | None" = None
    sensors: "Sequence[Sensor]" = ()

    def __call__(self, windows: Sequence[Window]) -> RecordedMessages:
        """The messages with fixes withheld in windows of seconds since 1970."""
        begin = _begin(self.drive)
        since = [(a - begin, min(b - begin, _END)) for a, b in windows]
        result = match(
            self.drive, self.roads, vehicle=self.vehicle, start=self.start, mask=since,
            model=self.model, hypotheses=True, places=self.places, sensors=self.sensors,
        )  # fmt: skip
        return self.recorded(result, windows)

    def recorded(self, result: "Result", windows: Sequence[Window] = ()) -> RecordedMessages:
        """The messages of an existing result."""
        signals = Signals(self.drive, self.vehicle, self.sensors)
        return RecordedMessages(result, self.roads, signals, windows)

    def absolute(self, mask: Sequence[tuple[Any, Any]]) -> list[Window]:
        """Windows in seconds since 1970 from what `match` takes as `mask`."""
        pairs = [(_seconds(a), _seconds(b)) for a, b in mask]
        return mask_windows(pairs, _begin(self.drive))


def play_drive(
    remaking: Remaking, mask: Sequence[tuple[Any, Any]] = (), truth: Truth | None = None
) -> Player:
    """A player of a drive; masking answers it anew."""
    return Player(remaking(remaking.absolute(mask)), remaking, truth=truth)


def play_result(
    path: str | Path, roads: "RoadMap", drive_id: str | None = None, route: Path | None = None,
    truth: Truth | None = None, places: "Places | None" = None,
) -> Player:  # fmt: skip
    """A player of points, of the route and of places, from files; there is no drive to mask.

    Raises:
        ReadError: A file is no such table.
        MapError: They are of another map.
    """
    result = read_points(path, drive_id, route)
    check_map(result, roads, path)
    return Player(RecordedMessages(result, roads, places=places), truth=truth)


def one_of(drives: "list[Drive]", drive_id: str | None) -> "Drive":
    """The drive of that name, or the only one.

    Raises:
        DriveError: There is none, or there are several and none was named.
    """
    chosen = [one for one in drives if drive_id is None or one.drive_id == drive_id]
    if len(chosen) == 1:
        return chosen[0]
    known = ", ".join(one.drive_id for one in drives[:10])
    raise DriveError(
        f"{len(drives)} drives ({known}) are in the input; one was expected; name it by --drive-id"
    )


def _begin(drive: "Drive") -> float:
    """Time of the first epoch, s since 1970."""
    logs = [log.time for log in (drive.fixes, drive.odometry) if log is not None and len(log.time)]
    return float(min(np.min(time[:1]) for time in logs)) if logs else 0.0


def _seconds(moment: Any) -> float:
    return float(moment.timestamp()) if hasattr(moment, "timestamp") else float(moment)
