"""Files that are dropped onto the page of a replay: a log, or an answer."""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import SettingError, WhichroadError
from .open_replay import Remaking, is_points, one_of, play_result
from .player import Remake
from .recorded_messages import RecordedMessages

if TYPE_CHECKING:
    from ..places import Places
    from ..roadmap import RoadMap
    from ..sensors import Sensor
    from ..settings import Vehicle

LARGEST = 32 * 1024 * 1024  # bytes of a file
_LONGEST_NAME = 200  # bytes

Opened = tuple[RecordedMessages, Remake | None]
Opener = Callable[[str, bytes], Opened]


@dataclass(frozen=True, slots=True)
class DroppedFile:
    """Opens one file on the map of the replay, for its vehicle."""

    roads: "RoadMap"
    vehicle: "Vehicle | None" = None
    dbc: Path | None = None
    places: "Places | None" = None
    sensors: "Sequence[Sensor]" = ()

    def __call__(self, name: str, content: bytes) -> Opened:
        """Read a log and match it, or read an answer.

        Args:
            name: Of the file; its suffix says what it is.
            content: All of it.

        Raises:
            WhichroadError: It cannot be read or matched.
        """
        safe = Path(name.replace("\\", "/")).name
        if not safe or safe.startswith(".") or "\0" in safe or len(safe.encode()) > _LONGEST_NAME:
            raise SettingError("the name of a file was expected")
        with tempfile.TemporaryDirectory(prefix="whichroad-dropped-") as folder:
            path = Path(folder) / safe
            path.write_bytes(content)
            try:
                return self._opened(path)
            except WhichroadError as error:
                raise WhichroadError(str(error).replace(f"{folder}/", "")) from None

    def _opened(self, path: Path) -> Opened:
        if is_points(path):
            return play_result(path, self.roads).recorded, None
        from ..evidence.sensed import columns_of
        from ..readers import read_drive

        columns = columns_of(self.sensors)
        drives = read_drive([path], vehicle=self.vehicle, dbc=self.dbc, columns=columns or None)
        remake = Remaking(
            one_of(drives, None), self.roads, self.vehicle, places=self.places,
            sensors=self.sensors,
        )  # fmt: skip
        return remake([]), remake
