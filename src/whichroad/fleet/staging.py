"""Rows in any order to one file by trip and time: DuckDB sorts, and spills what memory lacks.

Files that are in order but cannot be read by parts (CSV, Arrow, queries) are copied as they are.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import timedelta, tzinfo
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

from ..errors import ReadError, SettingError, WriteError, first_line
from ..readers.clock_change import shown_twice
from ..readers.dates import zone_of
from ..readers.trip_files import unreadable
from .inputs import Inputs, Used, used_columns
from .sources import CSV, OTHER_FORM, ZONED, Reader, quoted, text, union_of

_GROUP = 65_536  # rows
_FULL = ("No space left on device", "max_temp_directory_size", "Disk quota exceeded")
_SORTABLE = ("TIMESTAMP", "BIGINT", "INTEGER", "DOUBLE", "FLOAT", "DECIMAL", "UBIGINT", "HUGEINT")


def stage(
    inputs: Inputs, target: Path, trip_id: str, *, ordered: bool, memory: str, threads: int,
    own: Mapping[str, str | int], tz: str | None = None, crs: Any = None,
) -> Used:  # fmt: skip
    """Write the used columns of all inputs to one Parquet file.

    Args:
        inputs: What is read.
        target: The file; its folder takes what memory lacks.
        trip_id: The column that names trips.
        ordered: The rows stay in their order; else they are sorted by trip and time.
        memory: Limit of the sort, such as 256MB.
        threads: Of DuckDB.
        own: Own names of columns, and those that further sensors read.
        tz: Zone of times that name none; None: UTC.
        crs: Reference system of geometries that name none.

    Raises:
        ReadError: An input cannot be read, or lacks columns.
        SettingError: DuckDB is not installed, or the limit is none.
        WriteError: The disk of the target is full.
    """
    connected, texts = _connection(target.parent, memory, threads), inputs.files.get("csv", ())
    with connected as con, _named(con, texts):
        reader = Reader(
            lambda query: _run(con, query, target.parent), con, target.parent, trip_id, own, crs
        )
        try:
            return _staged(reader, inputs, target, zone_of(tz), ordered=ordered)
        except ReadError as error:
            if OTHER_FORM not in str(error):
                raise
        return _staged(reader._replace(as_text=True), inputs, target, zone_of(tz), ordered=ordered)


def _staged(
    reader: Reader, inputs: Inputs, target: Path, zone: tzinfo | None, *, ordered: bool
) -> Used:
    """As `stage`, on a connection."""
    union = union_of(reader.sources(inputs), reader.trip_id, reader.own)
    kinds = {row[0]: str(row[1]) for row in reader.run(f"DESCRIBE {union}").fetchall()}  # types
    used = used_columns(kinds, reader.trip_id, "trips", reader.own)
    wanted = ", ".join(quoted(name) for name in used.columns)
    rows = f"SELECT {wanted} FROM ({union})"
    if not ordered:
        rows = _sorted_rows(reader, used, kinds[used.time], union, zone)
    beside = target.with_name(f".{target.name}.part")
    reader.run(f"COPY ({rows}) TO {text(beside)} (FORMAT parquet, ROW_GROUP_SIZE {_GROUP})")
    beside.replace(target)
    return used


def _sorted_rows(reader: Reader, used: Used, kind: str, union: str, zone: tzinfo | None) -> str:
    """The query of all rows by trip, time, and where they stood."""
    wanted = ", ".join(quoted(name) for name in used.columns)
    trip, local = f"CAST({quoted(used.trip)} AS VARCHAR)", _local(used, kind)
    rows = f"SELECT {wanted}, row_number() OVER () AS __row FROM ({union})"
    nulls = " NULLS FIRST" if kind == "VARCHAR" else ""
    moment = quoted(used.time) if kind.startswith(_SORTABLE) else "NULL"
    if kind == "VARCHAR":  # a time that is not understood stays behind the row before it
        key = f"coalesce({_in_utc(local, zone)}, TRY_CAST({quoted(used.time)} AS TIMESTAMPTZ))"
        over = f"OVER (PARTITION BY {trip} ORDER BY __row)"
        rows = f"SELECT *, last_value({key} IGNORE NULLS) {over} AS __time FROM ({rows})"
        moment = "__time"
    kept = _in_their_order(reader, f"SELECT {trip} AS trip, {local} AS time FROM ({union})", zone)
    if kept:
        moment = f"IF({trip} IN ({', '.join(map(text, kept))}), NULL, {moment})"
    return f"SELECT {wanted} FROM ({rows}) ORDER BY {trip}, {moment}{nulls}, __row"


def _local(used: Used, kind: str) -> str:
    """The times that name no zone, NULL where they name one or are numbers."""
    time = quoted(used.time)
    if kind == "VARCHAR":
        return f"IF(regexp_full_match({time}, '{ZONED}'), NULL, TRY_CAST({time} AS TIMESTAMP))"
    naive = kind.startswith("TIMESTAMP") and "TZ" not in kind and "ZONE" not in kind
    return f"CAST({time} AS TIMESTAMP)" if naive else "CAST(NULL AS TIMESTAMP)"


def _in_utc(local: str, zone: tzinfo | None) -> str:
    """Times on the clocks of a zone as moments."""
    if isinstance(zone, ZoneInfo):
        return f"timezone({text(zone.key)}, {local})"
    offset = (zone and zone.utcoffset(None)) or timedelta()
    return f"timezone('UTC', {local} - to_seconds({offset.total_seconds()}))"


def _in_their_order(reader: Reader, rows: str, zone: tzinfo | None) -> list[str]:
    """Trips during which clocks go back, and whose rows lie in the order in which they were driven.

    Their times step back once, by an hour at most.
    """
    if not isinstance(zone, ZoneInfo):
        return []
    ends = f"SELECT epoch(min(time)), epoch(max(time)) FROM ({rows})"
    low, high = reader.run(ends).fetchone()
    hours = [] if low is None else shown_twice(low, high, zone)
    if not hours:
        return []
    within = " OR ".join(f"epoch(time) >= {begin} AND epoch(time) < {end}" for begin, end in hours)
    step = "epoch(time) - lag(epoch(time)) OVER (PARTITION BY trip ORDER BY row)"
    numbered = f"SELECT *, row_number() OVER () AS row FROM ({rows})"
    found = reader.run(
        f"SELECT trip FROM (SELECT trip, {step} AS step FROM ({numbered}) WHERE trip IN "
        f"(SELECT trip FROM ({rows}) WHERE {within})) GROUP BY trip "
        "HAVING count(*) FILTER (step < 0) = 1 AND min(step) >= -3600"
    )
    return [row[0] for row in found.fetchall()]


@contextmanager
def _connection(folder: Path, memory: str, threads: int) -> Iterator[Any]:
    try:
        import duckdb
    except ImportError:
        raise SettingError(
            "fleet: the package duckdb is not installed; it was expected to sort rows and to read "
            'CSV, Arrow and queries; pip install "whichroad[fleet]", or give --order sorted for '
            "Parquet files in which the rows of a trip lie together"
        ) from None
    spill = folder / "spill"
    try:
        con = duckdb.connect(
            config={"memory_limit": memory, "temp_directory": str(spill), "threads": threads}
        )
        con.execute("SET enable_progress_bar = false")
        con.execute("SET TimeZone = 'UTC'")  # that of the machine decides nothing
    except duckdb.Error as error:
        raise SettingError(f"memory is {memory!r}; a size such as 256MB was expected") from error
    try:
        yield con
    finally:
        con.close()


def _run(con: Any, query: str, folder: Path = Path()) -> Any:
    """The answer to a query.

    Raises:
        ReadError: DuckDB refuses it.
        WriteError: The disk of the folder is full.
    """
    import duckdb

    try:
        return con.execute(query)
    except RuntimeError as error:
        if "interrupted" in str(error):  # as DuckDB says that Ctrl-C came
            raise KeyboardInterrupt from None
        raise
    except duckdb.Error as error:
        reason = str(error).splitlines()[0]
        if any(word in str(error) for word in _FULL):
            raise WriteError(
                f"{folder}: the disk is full ({reason}); space for all rows that are sorted was "
                "expected, and as much again for what --memory does not hold; make space, or "
                "choose another folder by -o"
            ) from None
        raise ReadError(f"trips: DuckDB cannot read them ({reason}); check files, query") from None


@contextmanager
def _named(con: Any, paths: Sequence[Path]) -> Iterator[None]:
    """Where DuckDB refuses a query, the CSV files that it refuses alone are named.

    Raises:
        ReadError: It was refused.
    """
    import duckdb

    try:
        yield
    except ReadError:
        unread = []
        for path in paths:
            try:
                con.execute(f"SELECT count(*) FROM read_csv([{text(path)}], {CSV})")
            except duckdb.Error as error:
                unread.append((path, first_line(error)))
        if unread:
            raise ReadError(unreadable(unread)) from None
        raise
