"""Files that cannot be understood, beside files that are drives of their own."""

from collections import Counter
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any, NamedTuple

from ..errors import ReadError
from ..observations import Drive
from .combining import Part
from .drive_columns import MOTION
from .formats import kind_of_path
from .reading import Reading
from .source import Source
from .table_files import table_of

_PLACES = frozenset(("lat", "lon", "x", "y", "geometry"))


class Unread(NamedTuple):
    """A file that could not be understood."""

    path: str
    error: ReadError
    moves: bool  # whether it is of odometry, which is a part of a drive

    @classmethod
    def of(cls, file: Any, reading: Reading, error: ReadError) -> "Unread":
        """What can be told of a path, or of a source."""
        path = file.path if isinstance(file, Source) else str(file)
        return cls(path, error, _moves(file, reading))

    @property
    def drive(self) -> Drive:
        """A drive without contents, with the reason."""
        return Drive(PurePath(self.path).stem, sources=(self.path,), notes=(str(self.error),))


def check_apart(unread: Sequence[Unread], parts: Sequence[Part], drives: Sequence[Drive]) -> None:
    """Refuse files that cannot be understood and may be parts of the drives that were read.

    Args:
        unread: These files.
        parts: What the others gave.
        drives: What that is together.

    Raises:
        ReadError: Of the first file: nothing else was read, there is odometry without fixes of
            its own, the others are together one drive, or one of them has the file's name.
    """
    together = len(parts) > 1 and len(drives) < 2
    placed = all(any(drive.fixes is not None for drive in part.drives) for part in parts)
    stems = {PurePath(part.name).stem for part in parts}
    for file in unread:
        own = not (file.moves or PurePath(file.path).stem in stems)
        if not parts or together or not placed or not own:
            raise file.error


def _moves(file: Any, reading: Reading) -> bool:
    """Whether a file is of odometry: a CAN log, or a table of motion without places."""
    try:
        if not isinstance(file, Source) and kind_of_path(file) == "can":
            return True
        has = table_of(Source.of(file), Counter(), reading).found.keys()
    except ReadError:
        return False
    return bool(has & MOTION) and not has & _PLACES
