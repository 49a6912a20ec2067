"""Batches of whole trips from a table or a stream of any size.

A trip of a stream is complete once enough rows of other trips have followed its last row.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import ReadError
from .arrow_columns import decoded, texts
from .checks import listed
from .csv_text import no_column
from .dates import UNSAID, Writing, taken_as_utc
from .mixed_files import MixedFiles
from .names import NAMES, Column, column_called, find, quantity_of
from .reading import Reading, check_one, own_columns
from .splitting import split_trips
from .table_drives import paired
from .table_units import Units
from .tables_in_memory import are_rows, flattened, in_memory, refuse_without_rows, rows_as_columns
from .trip_files import batches_in, dataset_of, in_batches, is_dataset, is_partitioned, is_scanner
from .zone_notes import zone_note_of

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.dataset as ds

Own = Mapping[str, str | int]  # aliases and names of columns, as `names.find` takes them
_NONE: Own = {}
APART = 1 << 16  # rows of other trips after which a trip of a stream is complete
BATCH_ROWS = 1 << 14  # rows of a batch of short trips
_BATCH = 1 << 15  # rows read from a file at once
_TABLE = ("schema", "columns", "__arrow_c_stream__")  # what tables in memory and readers have
_PLACES = ({"lat", "lon"}, {"geometry"}, {"x", "y"})  # quantities that locate a trip


class TripBatch(NamedTuple):
    """Rows of whole trips, trip after trip."""

    table: "pa.Table"
    names: list[str]  # of the trips; empty: rows without one
    first: list[int]  # where each begins, and the number of rows
    again: tuple[int, ...] = ()  # trips whose name a trip before them had
    standing: dict[int, int] = {}  # noqa: RUF012 - rows behind trips that belong to none
    units: Units | None = None  # of columns that name none, by `trip_units.with_units`


class Trip(NamedTuple):
    """Rows of one trip."""

    name: str
    table: "pa.Table"
    standing: int = 0


def trip_batches(
    source: Any, drive_id: str = "drive_id", *, split: float | None = None, strict: bool = False,
    own: Own = _NONE, written: Writing = UNSAID,
) -> Iterator[TripBatch]:  # fmt: skip
    """Cut a source into whole trips, in the order in which they begin (a stream: end).

    Args:
        source: An Arrow table, record batch, DataFrame, dict of columns, structured array or list
            of dicts, one for each row, or anything with `__arrow_c_stream__`; or a stream: the
            path of a Parquet or Arrow file or a folder of them, a dataset, a Scanner, a
            RecordBatchReader, or any iterator of batches or tables.
        drive_id: The column that names the trip; "drive_id" also finds its usual aliases.
        split: Cut the rows of each name at pauses, stops and jumps (`splitting`) of so many s,
            into trips called `name/1`, `name/2`, ...
        strict: Refuse a stream in which the name of a complete trip comes again.
        own: Own names of columns, by documented names, and further columns that are kept.
        written: How times are written, where they do not show it, for `split`.

    Raises:
        ReadError: The source is none of these, or has no such column.
    """

    def of_stream(batches: Iterable[Any]) -> Iterator[TripBatch]:
        trips = (Trip(*trip) for trip in _whole(batches, drive_id, own))
        yield from packed(split_each(trips, split, own, written) if split else trips, strict)

    refuse_without_rows(source)
    if are_rows(source):
        source = rows_as_columns(source)
    if is_scanner(source):
        source = in_batches(source)
    if isinstance(source, str | PathLike):
        yield from of_stream(_of_path(Path(source), drive_id, own))
    elif hasattr(source, "to_batches") and hasattr(source, "scanner"):
        yield from of_stream(_of_dataset(source, drive_id, own))
    elif isinstance(source, dict) or any(hasattr(source, name) for name in _TABLE):
        if hasattr(source, "read_next_batch"):
            flat = _flat_names(source.schema, own)
            _check(flat, find(flat, own))
            yield from of_stream(source)
            return
        rows, names = _table(source, drive_id, own)
        _check(names, find(rows.column_names, own))
        table = of_vehicles(_named(rows, names, drive_id, own), own)
        if split:
            trips = (Trip(*trip) for trip in cut(table))
            yield from packed(split_each(trips, split, own, written), strict)
        else:
            yield from parts_of(table)
    elif isinstance(source, Iterable):
        yield from of_stream(source)
    else:
        raise ReadError(
            f"table: {type(source).__name__} is not a table of trips; an Arrow table, a path, a "
            "dataset or an iterator of record batches was expected"
        )


def _of_path(path: Path, drive_id: str, own: Own = _NONE) -> Iterable[Any]:
    """The batches of a Parquet or Arrow file, or of a folder of Parquet files."""
    return _of_dataset(dataset_of(path, own=own, trip=drive_id), drive_id, own)


def _of_dataset(data: Any, drive_id: str, own: Own) -> Iterable[Any]:
    names, flat = data.schema.names, _flat_names(data.schema, own)
    found = find(flat, own)
    _check(flat, found)
    used = {c.name if c.name in names else c.name.partition(".")[0] for c in found.values()}
    used |= {column_called(names, drive_id)} & set(names)
    return batches_in(data, sorted(used), _BATCH)


def _table(source: Any, drive_id: str, own: Own) -> tuple["pa.Table", list[str]]:
    """Any table in memory as Arrow, and the names of all its columns."""
    if hasattr(source, "to_frame") and not hasattr(source, "columns"):  # of pandas or polars
        raise ReadError(
            f"table: {type(source).__name__} is one column; a table with time, lat, lon and one "
            "that names the trip was expected; give the whole frame"
        )
    names = list(getattr(source, "columns", ()))
    if hasattr(source, "rename") and hasattr(source, "reset_index"):  # a frame of pandas
        given = column_called(map(str, names), drive_id)
        others = ["drive_id"] if given in names and given != "drive_id" else []
        source = source.drop(columns=others, errors="ignore").rename(columns={given: "drive_id"})
        return in_memory(source, Reading(columns=own)).table, [str(name) for name in names]
    seen = in_memory(source, Reading(columns=own))
    return seen.table, seen.names


def usual_rows(batch: Any, drive_id: str, own: Own = _NONE) -> "pa.Table":
    """The columns of a batch whose meaning is known, and trips' names in a column `drive_id`."""
    return _named(*_table(batch, drive_id, own), drive_id, own)


def _flat_names(schema: "pa.Schema", own: Own) -> list[str]:
    """Names of columns as `in_memory` has them."""
    return [str(name) for name in flattened(schema.empty_table(), own).column_names]


def _check(names: list[str], found: Mapping[str, Column]) -> None:
    """Refuse a table none of whose trips could be matched."""
    if "time" not in found:
        raise ReadError(no_column("table", "no time", names, ("time",)))
    if not any(places <= found.keys() for places in _PLACES):
        raise ReadError(no_column("table", "no position", names, ("lat", "lon")))


def own_names(columns: Own | None, drive_id: str) -> tuple[dict[str, str | int], str]:
    """Own names of the columns of a table of trips, and the column that names the trip.

    Args:
        columns: The documented names, and the columns that they stand for.
        drive_id: The column that names the trip, unless `columns` has one.

    Raises:
        ReadError: A documented name is unknown, or a column is given by its number.
        SettingError: More than one column is to name the trip.
    """
    check_one(drive_id)
    own = own_columns(columns)
    for alias, column in own.items():
        quantity_of(alias)
        if not isinstance(column, str) or column.isdecimal():
            raise ReadError(
                f"columns: {alias} is {column!r}; the name of a column was expected: columns of "
                "tables of many trips are known by their names"
            )
    named = [str(column) for alias, column in own.items() if quantity_of(alias) == "drive_id"]
    trip = named[0] if named and drive_id == "drive_id" else drive_id
    kinds = {alias: quantity_of(alias) for alias in own}  # what names trips is no vehicle's
    apart = [alias for alias in own if (kinds[alias], own[alias]) != ("vehicle_id", trip)]
    return {alias: own[alias] for alias in apart if kinds[alias] != "drive_id"}, trip


def _named(table: "pa.Table", names: list[str], drive_id: str, own: Own) -> "pa.Table":
    """The columns whose meaning is known, and trips' names in a column `drive_id`."""
    found = find(table.column_names, own)
    if "time" not in found:
        _check(names, found)
    usual = found.get("drive_id") or found.get("vehicle_id")
    drive_id = column_called(table.column_names, drive_id)
    if drive_id in table.column_names:
        place = table.column_names.index(drive_id)
    elif usual and (drive_id == "drive_id" or "drive_id" in table.column_names):
        place = usual.place
    else:
        raise ReadError(
            f"table: no column {drive_id!r} among {listed(names)}; one that names "
            f"the trip of each row was expected, for example {', '.join(NAMES['drive_id'])}"
        )
    apart = place != usual.place or table.column_names[place] == "drive_id" if usual else True
    others = ("drive_id", "row_id", "vehicle_id") if apart else ("drive_id", "row_id")
    places = [c.place for q, c in found.items() if c.place != place and q not in others]
    keep = list(dict.fromkeys(places))  # a further sensor may read a column that has a meaning
    used = [table.column_names[i] for i in keep if table.column_names[i] != "drive_id"]
    return table.select(used).append_column("drive_id", table.column(place))


def of_vehicles(table: "pa.Table", own: Own = _NONE) -> "pa.Table":
    """The table whose trips that several vehicles have are one of each."""
    import pyarrow as pa

    vehicle = find(table.column_names, own).get("vehicle_id")
    if vehicle is None or not table.num_rows:
        return table
    trips = texts(table["drive_id"])
    names, codes = paired(*trips, *texts(table.column(vehicle.place)))
    if len(names) == len(np.unique(trips[1])):
        return table
    at = table.column_names.index("drive_id")
    return table.set_column(at, "drive_id", pa.DictionaryArray.from_arrays(codes, names))


def _sorted(table: "pa.Table") -> tuple["pa.Table", list[str], list[int]]:
    """The rows trip after trip, in the order in which trips first appear.

    Returns:
        The table, the trips' names, and where the rows of each begin and all end.
    """
    import pyarrow as pa

    column = table["drive_id"]
    if column.num_chunks > 1 and pa.types.is_string(column.type):  # chunk by chunk it takes longer
        column = pa.chunked_array(column.combine_chunks())
    labels, codes = texts(column)
    runs = np.flatnonzero(np.diff(codes, prepend=-1))
    if len(np.unique(codes[runs])) < len(runs):  # rows of several trips are interleaved
        _, first, code = np.unique(codes, return_index=True, return_inverse=True)
        order = np.argsort(first[code], kind="stable")
        table, codes = table.take(order), codes[order]
        runs = np.flatnonzero(np.diff(codes, prepend=-1))
    names = [labels[code] for code in codes[runs].tolist()]
    return table, names, [*runs.tolist(), len(codes)]


def cut(table: "pa.Table") -> Iterator[tuple[str, "pa.Table"]]:
    """Each trip and its rows."""
    table, names, first = _sorted(table)
    for name, (low, high) in zip(names, pairwise(first), strict=True):
        yield name, table.slice(low, high - low)


def parts_of(table: "pa.Table") -> Iterator[TripBatch]:
    """Batches of a table in memory."""
    table, names, first = _sorted(table)
    trip = 0
    while trip < len(names):
        low = first[trip]
        end = max(bisect_right(first, low + BATCH_ROWS) - 1, trip + 1)
        rows = first[end] - low
        begins = [row - low for row in first[trip : end + 1]]
        yield TripBatch(table.slice(low, rows), names[trip:end], begins)
        trip = end


def split_each(
    trips: Iterable[Trip], pause: float, own: Own = _NONE, written: Writing = UNSAID
) -> Iterator[Trip]:
    """The trips of each name, numbered from 1; rows without a name stay together."""
    for name, rows, _ in trips:
        if not name:
            yield Trip(name, rows)
            continue
        ordered, parts = split_trips(rows, pause, own, written)
        for number, (low, high, standing) in enumerate(parts, 1):
            yield Trip(f"{name}/{number}", ordered.slice(low, high - low), standing)


def _whole(batches: Iterable[Any], drive_id: str, own: Own) -> Iterator[tuple[str, "pa.Table"]]:
    """Each trip of a stream and its rows, once it is complete."""
    waiting: dict[str, list[Any]] = {}
    last: dict[str, int] = {}
    rows = 0
    for batch in batches:
        table = usual_rows(batch, drive_id, own)
        for name, part in cut(table):
            waiting.setdefault(name, []).append(part)
        labels, codes = texts(table["drive_id"])
        from_end = np.unique(codes[::-1], return_index=True)[1]
        for row in sorted((len(codes) - 1 - from_end).tolist()):
            last[labels[codes[row]]] = rows + row
        rows += table.num_rows
        for name in [n for n, row in last.items() if row < rows - APART]:
            del last[name]
            yield from cut(of_vehicles(joined_rows(waiting.pop(name)), own))
    for parts in waiting.values():
        yield from cut(of_vehicles(joined_rows(parts), own))


def joined_rows(parts: "list[pa.Table]") -> "pa.Table":
    """Parts of a trip as one table; columns whose types do not go together as text."""
    import pyarrow as pa

    try:
        return pa.concat_tables(parts, promote_options="permissive")
    except pa.ArrowException:
        texts = [p.cast(pa.schema([(n, pa.string()) for n in p.column_names])) for p in parts]
        return pa.concat_tables(texts, promote_options="permissive")


def packed(trips: Iterable[Trip], strict: bool) -> Iterator[TripBatch]:
    """Batches of consecutive trips with `BATCH_ROWS` rows or more."""
    import pyarrow as pa

    seen: set[int] = set()
    held: list[Trip] = []
    again: list[int] = []
    rows = 0

    def batch() -> TripBatch:
        first = [0, *np.cumsum([trip.table.num_rows for trip in held]).tolist()]
        table = pa.concat_tables([trip.table for trip in held])
        standing = {k: trip.standing for k, trip in enumerate(held) if trip.standing}
        return TripBatch(table, [trip.name for trip in held], first, tuple(again), standing)

    for trip in trips:
        mark = hash(trip.name)
        known = bool(trip.name) and mark in seen
        if known and strict:
            raise ReadError(
                f"table: trip {trip.name!r} comes again after {APART:,} rows of others or more; "
                "all rows of a trip were expected together; sort them by trip and time"
            )
        seen.add(mark)
        size = trip.table.num_rows
        full = rows + size > BATCH_ROWS
        if held and (full or not trip.table.schema.equals(held[0].table.schema)):
            yield batch()
            held, again, rows = [], [], 0
        if known:
            again.append(len(held))
        held.append(trip)
        rows += size
    if held:
        yield batch()


def zone_note(data: "ds.Dataset | MixedFiles", drive_id: str, columns: Own | None) -> str | None:
    """What to say of trips whose times name no zone, by the first time; None: nothing."""
    if isinstance(data, MixedFiles) and data.zoneless:
        return taken_as_utc(data.zoneless)
    own, drive_id = own_names(columns, drive_id)
    return zone_note_of(_of_dataset(data, drive_id, own), own)


def are_many(path: str | PathLike[str], drive_id: str | None = None, columns: Own = _NONE) -> bool:
    """Whether a file is a stream of more than one trip: Parquet or Arrow with names of trips.

    A partitioned folder is one also with a single trip.

    Args:
        path: The file, or a folder.
        drive_id: The column that names trips; None: any of the usual ones.
        columns: Own names of columns.
    """
    import pyarrow as pa

    path = Path(path)
    if not is_dataset(path):
        return False
    seen: set[str] = set()
    try:
        own, drive_id = own_names(columns, drive_id or "drive_id")
        data = dataset_of(path, [], own=own, trip=drive_id)
        for batch in _of_dataset(data, drive_id, own):
            found = find(batch.schema.names, own)
            usual = found.get("drive_id") or found.get("vehicle_id")
            name = drive_id if drive_id != "drive_id" else usual and usual.name
            if name is None or name not in batch.schema.names:
                return False
            column = batch.column(batch.schema.names.index(name))
            labels, codes = texts(decoded(pa.chunked_array([column])))
            seen.update(labels[code] for code in np.unique(codes).tolist())
            if len(seen) > 1:
                return True
    except (ReadError, OSError, ValueError):  # the reader of the file will report the error
        return False
    return bool(seen) and is_partitioned(path)  # whose parts no other reader takes together
