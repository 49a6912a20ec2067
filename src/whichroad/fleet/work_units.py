"""Work units: ranges of rows of Parquet files that hold whole trips."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ..errors import ReadError
from ..readers.arrow_columns import decoded
from .inputs import used_columns

UNIT_ROWS = 1 << 17  # rows of a unit, at most, but for a last trip
_BATCH = 1 << 15  # rows read at once


class Piece(NamedTuple):
    """Consecutive rows of a file."""

    path: str
    low: int
    high: int


class Unit(NamedTuple):
    """Rows of whole trips, and the name of the files that they become."""

    name: str  # part-00000
    rows: int
    pieces: tuple[Piece, ...]


def plan(
    files: Sequence[Path], trip_id: str, unit_rows: int, own: Mapping[str, str | int]
) -> list[Unit]:
    """Cut files, in which the rows of a trip lie together, into one or an even number of units.

    They are about equal, so that workers end at about the same time.
    Only the columns that name trips are read.  `own` is that of `inputs.used_columns`.

    Raises:
        ReadError: A file cannot be read, or a trip comes again after others.
    """
    unit_rows = _equal(rows_of(files), unit_rows)
    units: list[Unit] = []
    pieces: list[Piece] = []
    rows = 0
    seen: set[int] = set()
    last: Any = None

    def close() -> None:
        nonlocal pieces, rows
        if rows:
            units.append(Unit(f"part-{len(units):05d}", rows, tuple(pieces)))
        pieces, rows = [], 0

    for path in files:
        low = at = 0
        for column in _names(path, trip_id, own):
            begins = _begins(column, last)
            for place in begins:
                _check(path, column[place].as_py(), seen)
                if rows + at + place - low >= unit_rows:
                    if at + place > low:
                        pieces.append(Piece(str(path), low, at + place))
                        rows += at + place - low
                    close()
                    low = at + place
            at += len(column)
            last = column[-1].as_py()
        if at > low:
            pieces.append(Piece(str(path), low, at))
            rows += at - low
    close()
    return units


def rows_of(files: Sequence[Path]) -> int:
    """Rows of Parquet files, by what their ends say.

    Raises:
        ReadError: A file cannot be read.
    """
    rows = 0
    for path in files:
        with _read(path):
            rows += pq.read_metadata(path).num_rows
    return rows


def _equal(rows: int, most: int) -> int:
    """Rows of each unit, so that the last is as large as the others, and their number even."""
    if rows <= most:
        return most
    return -(-rows // (2 * -(-rows // (2 * most))))


@contextmanager
def _read(path: Path | str) -> Iterator[None]:
    """Errors of a Parquet file by its name.

    Raises:
        ReadError: There was one.
    """
    try:
        yield
    except (pa.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0]
        raise ReadError(f"{path}: cannot be read as parquet ({reason})") from None


def _names(path: Path, trip_id: str, own: Mapping[str, str | int]) -> Iterator[pa.Array]:
    """The trips of the rows of a file, part by part."""
    with _read(path), pq.ParquetFile(path) as file:
        used = used_columns(file.schema_arrow.names, trip_id, str(path), own)
        for batch in file.iter_batches(_BATCH, columns=[used.trip]):
            column = decoded(pa.chunked_array([batch.column(0)])).combine_chunks()
            if pa.types.is_dictionary(column.type):
                column = column.cast(column.type.value_type)
            if len(column):
                yield column


def _begins(column: pa.Array, last: Any) -> list[int]:
    """The rows at which another trip begins, after one of the name `last`."""
    first = [] if last is not None and column[0].as_py() == last else [0]
    after, before = column.slice(1), column.slice(0, len(column) - 1)
    same = pc.coalesce(pc.equal(after, before), pc.and_(pc.is_null(after), pc.is_null(before)))
    return [*first, *(row + 1 for row in pc.indices_nonzero(pc.invert(same)).to_pylist())]


def _check(path: Path, name: Any, seen: set[int]) -> None:
    """Refuse a name that comes again.

    Raises:
        ReadError: It does.
    """
    if name is None:
        return
    mark = hash(name)
    if mark in seen:
        raise ReadError(
            f"{path}: the rows are not in order: trip {str(name)!r} comes again after others; all "
            "rows of a trip were expected together; give --order any"
        )
    seen.add(mark)


def batches_of(unit: Unit, trip_id: str, own: Mapping[str, str | int]) -> Iterator[pa.RecordBatch]:
    """The rows of a unit, some at a time; `own` as in `inputs.used_columns`.

    Raises:
        ReadError: A file cannot be read.
    """
    for path, low, high in unit.pieces:
        with _read(path), pq.ParquetFile(path) as file:
            yield from _rows(file, low, high, trip_id, own)


def _rows(
    file: pq.ParquetFile, low: int, high: int, trip_id: str, own: Mapping[str, str | int]
) -> Iterator[pa.RecordBatch]:
    """Rows low to high - 1 of a file; row groups without any are not read."""
    used = used_columns(file.schema_arrow.names, trip_id, "trips", own)
    ends = np.cumsum([file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)])
    first = int(np.searchsorted(ends, low, "right"))
    last = int(np.searchsorted(ends, high, "left"))
    at = int(ends[first - 1]) if first else 0
    groups = list(range(first, min(last, len(ends) - 1) + 1))
    for batch in file.iter_batches(_BATCH, row_groups=groups, columns=used.columns):
        a, b = max(low - at, 0), min(high - at, batch.num_rows)
        if a < b:
            yield batch.slice(a, b - a)
        at += batch.num_rows
        if at >= high:
            return
