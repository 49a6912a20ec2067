"""Tables to files, one file per format; the suffix chooses.

Nothing half-written is ever left under the name asked for: bytes go to a neighbour
file that takes the name when it is whole.
"""

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import WriteError

if TYPE_CHECKING:
    import pyarrow as pa

    Writer = Callable[["pa.Table", Path], None]

SUFFIXES = (".parquet", ".geojson", ".json", ".csv", ".gpx", ".arrow", ".feather")


def write_table(table: "pa.Table", path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a points or path table (any table will do) in the format its suffix names.

    Args:
        table: columns as in `tables.schema`; `geometry` (WKB) or `lat`, `lon` make it spatial.
        path: where to; one of `SUFFIXES`.
        force: replace a file that exists.

    Raises:
        WriteError: the suffix is unknown, the file exists, the folder does not, or the
            table has nothing that the format can hold.
    """
    path = Path(path)
    writer = _writer(path)
    with replacing(path, force=force) as part:
        writer(table, part)


def check(path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Refuse now what `write_table` would refuse later, before hours of work.

    Raises:
        WriteError: as `write_table`.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise WriteError(
            f"{path}: the suffix {path.suffix or '(none)'!r} names no format; one of "
            f"{', '.join(SUFFIXES)} was expected; rename the output"
        )
    if path.exists() and not force:
        raise WriteError(
            f"{path}: exists already; a new name was expected; choose another or give --force"
        )
    if not path.parent.is_dir():
        raise WriteError(
            f"{path}: there is no folder {str(path.parent)!r}; an existing folder was expected; "
            "create it first"
        )


@contextmanager
def replacing(path: Path, *, force: bool = False) -> Iterator[Path]:
    """Give a neighbour file to write to; it takes `path`'s name when the block ends well.

    Raises:
        WriteError: the file exists without `force`, or the system refuses.
    """
    if path.exists() and not force:
        raise WriteError(
            f"{path}: exists already; a new name was expected; choose another or give --force"
        )
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent
        )
        os.close(handle)
        part = Path(name)
        try:
            yield part
            os.chmod(part, 0o666 & ~_umask())
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise WriteError(
            f"{path}: cannot be written ({error.strerror or error}); a folder that exists and "
            "may be written to was expected; choose another place"
        ) from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _writer(path: Path) -> "Writer":
    """The writer for this suffix, imported only now."""
    match path.suffix.lower():
        case ".parquet":
            from .parquet import write
        case ".geojson" | ".json":
            from .geojson import write
        case ".csv":
            from .csv import write
        case ".gpx":
            from .gpx import write
        case ".arrow" | ".feather":
            from .arrow import write
        case _:
            check(path, force=True)
            raise AssertionError(f"{path.suffix} stands in SUFFIXES without a writer")
    return write
