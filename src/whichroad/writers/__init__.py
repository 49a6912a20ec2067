"""Tables to files, one file per format; the suffix chooses.

Nothing half-written is ever left under the name asked for: bytes go to a neighbour
file that takes the name when it is whole.
"""

import glob
import json
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import WriteError, refused

if TYPE_CHECKING:
    import pyarrow as pa

    Writer = Callable[["pa.Table", Path], None]

SUFFIXES = (".parquet", ".geojson", ".json", ".csv", ".gpkg", ".gpx", ".arrow", ".feather",
            ".geoparquet")  # fmt: skip
OF_POINTS = (".nmea", ".mcap", ".bag", ".db3")  # for receivers and robots
OF_PATHS = (".rou.xml",)  # a path by source for SUMO


def write_table(table: "pa.Table", path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a points or path table (any table will do) in the format its suffix names.

    Args:
        table: columns as in `tables.schema`; `geometry` (WKB) or `lat`, `lon` make it spatial.
        path: where to; one of `SUFFIXES`, `OF_POINTS` or `OF_PATHS`.
        force: replace a file that exists.

    Raises:
        WriteError: the suffix is unknown, the file exists, the folder does not, or the
            table has nothing that the format can hold.
    """
    path = Path(path)
    writer = _writer(path)
    with replacing(path, force=force) as part:
        try:
            writer(table, part)
        except WriteError as error:
            raise WriteError(str(error).replace(str(part), str(path))) from None


def check(path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Refuse now what `write_table` would refuse later, before hours of work.

    Raises:
        WriteError: as `write_table`.
        SettingError: the suffix needs an extra that is not installed.
    """
    path = Path(path)
    known = (*SUFFIXES, *OF_POINTS, *OF_PATHS)
    if _suffix(path) not in known:
        short = _suffix(path) == ".shp"
        hint = (
            "write .gpkg, as names in a Shapefile have 10 letters" if short else "rename the output"
        )
        raise WriteError(
            f"{path}: the suffix {path.suffix or '(none)'!r} names no format; one of "
            f"{', '.join(known)} was expected; {hint}"
        )
    if _suffix(path) == ".gpkg":
        from .geopackage import check_gdal

        check_gdal()
    check_place(path, force=force)


def check_folder(out: Path, note: str, made_by: str, whose: str, *, force: bool) -> None:
    """Refuse to fill a folder that holds anything but what an earlier run left there.

    Args:
        out: The folder; it need not exist.
        note: The JSON file in it whose `made_by` tells what filled it.
        made_by: What it must tell.
        whose: Which earlier folder would do, for the message.
        force: Whether any folder will do.

    Raises:
        WriteError: It holds something else.
    """
    if force or not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    try:
        if json.loads((out / note).read_text("utf-8"))["made_by"] == made_by:
            return
    except (OSError, ValueError, KeyError, TypeError):
        pass
    raise WriteError(
        f"{out}: exists and holds other files; an empty folder or {whose} was expected; "
        "choose another with --out or give --force"
    )


def check_place(path: Path, *, force: bool = False) -> None:
    """Refuse a file that exists, or whose folder does not.

    Raises:
        WriteError: That is so.
    """
    if path.exists() and not force:
        raise WriteError(
            f"{path}: exists already; a new name was expected; choose another or give --force"
        )
    if not path.parent.is_dir():
        raise WriteError(
            f"{path}: the folder {str(path.parent)!r} does not exist; an existing one was "
            "expected; create it first"
        )


def check_apart(
    outputs: Mapping[str, str | os.PathLike[str] | None],
    inputs: Iterable[str | os.PathLike[str] | None],
) -> None:
    """Refuse an output that is an input or another output, however its path is written.

    Links are followed.  A file inside an input folder counts as an input.

    Args:
        outputs: By the option that names each; None: not asked for.
        inputs: Files, folders and patterns such as `day1/*.csv` that are read; None: not given.

    Raises:
        WriteError: An output would replace an input, or two outputs are one file.
    """
    given = {name: Path(path) for name, path in outputs.items() if path is not None}
    for name, output in given.items():
        if str(output) == "-":
            raise WriteError(
                f"{name} -: results are not written to standard output; the name of a file was "
                "expected"
            )
    read = [one for path in inputs if path is not None for one in _named(path)]
    for name, output in given.items():
        replaced = next((one for one in read if _replaces(output, one)), None)
        if replaced is not None:
            inside = f", in the folder {replaced}" if replaced.is_dir() else ""
            raise WriteError(
                f"{output}: {name} would replace a file that is read{inside}; another name was "
                "expected, with --force too; choose one"
            )
    names = list(given)
    for k, name in enumerate(names):
        other = next((one for one in names[:k] if _same(given[one], given[name])), None)
        if other is not None:
            raise WriteError(
                f"{given[name]}: {other} and {name} would write the same file; two names were "
                "expected; change one"
            )


def _named(path: str | os.PathLike[str]) -> list[Path]:
    """The path itself, and what it names as a pattern."""
    text = os.fspath(path)
    found = glob.glob(text, recursive=True) if glob.has_magic(text) else []
    return [Path(text), *map(Path, found)]


def _replaces(output: Path, read: Path) -> bool:
    """Whether an output is an input, or a file that is there within an input folder."""
    if _same(output, read):
        return True
    if not read.is_dir() or not output.exists():
        return False
    return any(_same(folder, read) for folder in (*output.parents, *output.resolve().parents))


def _same(a: Path, b: Path) -> bool:
    """Whether two paths name one file, through links too; it need not be there yet."""
    try:
        if a.samefile(b):
            return True
    except (OSError, ValueError):
        pass
    try:
        return a.resolve() == b.resolve()
    except (OSError, RuntimeError, ValueError):
        return False


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
        else_ = "a folder that exists and may be written to was expected; choose another place"
        raise refused(path, error, else_) from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _suffix(path: Path) -> str:
    name = path.name.lower()
    return next((suffix for suffix in OF_PATHS if name.endswith(suffix)), path.suffix.lower())


def _writer(path: Path) -> "Writer":
    """The writer for this suffix, imported only now."""
    match _suffix(path):
        case ".parquet" | ".geoparquet":
            from .parquet import write
        case ".geojson" | ".json":
            from .geojson import write
        case ".csv":
            from .csv import write
        case ".gpkg":
            from .geopackage import write
        case ".gpx":
            from .gpx import write
        case ".arrow" | ".feather":
            from .arrow import write
        case ".nmea":
            from .nmea_text import write
        case ".mcap":
            from .robots import write_mcap as write
        case ".bag":
            from .robots import write_bag as write
        case ".db3":
            from .robots import write_ros2 as write
        case ".rou.xml":
            from .routes import write
        case _:
            check(path, force=True)
            raise AssertionError(f"{path.suffix} stands in SUFFIXES without a writer")
    return write
