"""What is to be matched: files, folders, patterns and queries, and the columns that are used."""

import glob
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

from ..errors import ReadError
from ..readers.checks import listed
from ..readers.names import NAMES, NoSuchColumn, column_called, find
from ..readers.trip_files import schemas_of, unreadable

_KINDS = {
    ".parquet": "parquet", ".geoparquet": "parquet", ".pq": "parquet", ".arrow": "ipc",
    ".feather": "ipc", ".ipc": "ipc", ".csv": "csv", ".csv.gz": "csv", ".tsv": "csv",
}  # fmt: skip
_QUERY = ("select ", "from ", "with ")


class Inputs(NamedTuple):
    """Files by their kind, in order, and queries of DuckDB."""

    files: dict[str, list[Path]]  # parquet, ipc, csv
    queries: list[str]

    @property
    def is_parquet(self) -> bool:
        """Whether all are Parquet files whose columns are all in the files."""
        folders = [part for path in self.files.get("parquet", ()) for part in path.parts[:-1]]
        others = self.queries or set(self.files) - {"parquet"}
        return not others and not any("=" in folder for folder in folders)

    def stamps(self) -> list[list[str | int]]:
        """Path, size and time of change of each file; the text of each query."""
        found: list[list[str | int]] = [[query] for query in self.queries]
        for paths in self.files.values():
            for path in paths:
                there = path.stat()
                found.append([str(path.resolve()), there.st_size, there.st_mtime_ns])
        return sorted(found, key=str)


def inputs_of(trips: Sequence[str | Path]) -> Inputs:
    """The files and queries that arguments name.

    Args:
        trips: Files, folders (also partitioned ones), patterns, and queries that begin with
            SELECT, FROM or WITH.

    Raises:
        ReadError: A file is not there, or of no kind that is read.
    """
    files: dict[str, list[Path]] = {}
    queries = []
    for one in map(str, trips):
        if one.lstrip().lower().startswith(_QUERY):
            queries.append(one.strip().rstrip(";"))
            continue
        for path in _paths(one):
            kind = _kind(path)
            if kind is None:
                raise ReadError(
                    f"{path}: a file of this kind holds no table of trips; {', '.join(_KINDS)} was "
                    "expected; `whichroad match` reads the others"
                )
            files.setdefault(kind, []).append(path)
    return Inputs(files, queries)


def _paths(text: str) -> list[Path]:
    path = Path(text)
    if path.is_dir():
        found = [p for p in sorted(path.rglob("*")) if _kind(p) and not _hidden(p, path)]
        if not found:
            raise ReadError(f"{path}: no file of trips is in it; {', '.join(_KINDS)} was expected")
        return found
    if path.exists():
        return [path]
    found = [Path(name) for name in sorted(glob.glob(text, recursive=True))]
    if not found:
        raise ReadError(f"{text}: it is not there; a file, a folder or a query was expected")
    return found


def _hidden(path: Path, folder: Path) -> bool:
    """Whether engines would not read a file: `_SUCCESS`, `.crc` and the like."""
    return any(part.startswith(("_", ".")) for part in path.relative_to(folder).parts)


def _kind(path: Path) -> str | None:
    name = path.name.lower()
    return next((kind for suffix, kind in _KINDS.items() if name.endswith(suffix)), None)


class Used(NamedTuple):
    """The columns of a table of trips that are read."""

    trip: str
    time: str
    columns: list[str]  # all, the trip's first


def used_columns(
    names: Iterable[str], trip_id: str, where: str, own: Mapping[str, str | int]
) -> Used:
    """Which columns of a table are read; `own`: own names, and columns that sensors read.

    Raises:
        ReadError: None names trips, none has times, or one of `own` is not there.
    """
    names = list(names)
    try:
        found = find(names, own)
    except NoSuchColumn as error:
        raise ReadError(f"{where}: {str(error).removeprefix('table: ')}") from None
    usual = found.get("drive_id") or found.get("vehicle_id")
    trip_id = column_called(names, trip_id)
    trip = trip_id if trip_id in names else usual.name if usual and trip_id == "drive_id" else None
    if trip is None:
        raise ReadError(
            f"{where}: no column {trip_id!r} among {listed(names)}; one that names the trip of "
            f"each row was expected, for example {', '.join(NAMES['drive_id'])}; name it by "
            "--trip-id"
        )
    if "time" not in found:
        raise ReadError(f"{where}: no time among the columns {listed(names)}; one was expected")
    has_places = {"lat", "lon"} <= found.keys()
    keep = {c.name for q, c in found.items() if not (q == "geometry" and has_places)}
    apart = found.get("vehicle_id")
    if apart is not None and usual is not None and trip == usual.name != apart.name:
        keep.add(apart.name)  # trips of several vehicles may have the same name
    time = found["time"].name
    return Used(trip, time, [trip, *(name for name in names if name in keep and name != trip)])


def schema_of(path: Path, kind: str) -> pa.Schema:
    """The columns of a file.

    Raises:
        ReadError: It cannot be read.
    """
    schemas, unread = schemas_of([path], kind)
    if unread:
        raise ReadError(unreadable(unread))
    return schemas[path]


def check_readable(inputs: Inputs) -> None:
    """See that all files but those of CSV, which have no header of their own, can be read.

    Raises:
        ReadError: Some cannot; it names them.
    """
    others = {kind: paths for kind, paths in inputs.files.items() if kind != "csv"}
    unread = [bad for kind, paths in others.items() for bad in schemas_of(paths, kind)[1]]
    if unread:
        raise ReadError(unreadable(unread))
