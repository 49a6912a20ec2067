"""Rows in any order to one file by trip and time: DuckDB sorts, and spills what memory lacks.

Files that are in order but cannot be read by parts (CSV, Arrow, queries) are copied as they are.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import ReadError, SettingError, first_line
from ..readers.names import find, normal
from ..readers.trip_files import unreadable
from .inputs import Inputs, Used, schema_of, used_columns

_LOCAL = r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?"
_ZONED = _LOCAL + r"(Z|[+-]\d\d(:?\d\d)?)"
_SAMPLE = 10_000  # rows of which the times are looked at
_GROUP = 65_536  # rows
_OPTIONS = "union_by_name=true, auto_type_candidates=['BIGINT', 'DOUBLE', 'VARCHAR']"  # of CSV
_SORTABLE = ("TIMESTAMP", "BIGINT", "INTEGER", "DOUBLE", "FLOAT", "DECIMAL", "UBIGINT", "HUGEINT")


def stage(
    inputs: Inputs, target: Path, trip_id: str, *, ordered: bool, memory: str, threads: int,
    own: Mapping[str, str | int],
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

    Raises:
        ReadError: An input cannot be read, or lacks columns.
        SettingError: DuckDB is not installed, or the limit is none.
    """
    connected, texts = _connection(target.parent, memory, threads), inputs.files.get("csv", ())
    with connected as con, _named(con, texts):
        return _staged(con, inputs, target, trip_id, ordered=ordered, own=own)


def _staged(
    con: Any, inputs: Inputs, target: Path, trip_id: str, *, ordered: bool,
    own: Mapping[str, str | int],
) -> Used:  # fmt: skip
    """As `stage`, on a connection."""
    sources = [_source(con, inputs, kind, trip_id, own) for kind in inputs.files]
    sources += [f"SELECT * FROM ({query})" for query in inputs.queries]
    union = " UNION ALL BY NAME ".join(sources)
    kinds = {row[0]: row[1] for row in _run(con, f"DESCRIBE {union}").fetchall()}  # types
    used = used_columns(kinds, trip_id, "trips", own)
    wanted = ", ".join(_quoted(name) for name in used.columns)
    rows = f"SELECT {wanted} FROM ({union})"
    if not ordered:
        rows = _sorted_rows(used, kinds, union)
    beside = target.with_name(f".{target.name}.part")
    _run(con, f"COPY ({rows}) TO {_text(beside)} (FORMAT parquet, ROW_GROUP_SIZE {_GROUP})")
    beside.replace(target)
    return used


def _sorted_rows(used: Used, kinds: dict[str, str], union: str) -> str:
    """The query of all rows by trip, time, and where they stood."""
    trip, time = _quoted(used.trip), _quoted(used.time)
    wanted = ", ".join(_quoted(name) for name in used.columns)
    by_time = f"{time}, " if str(kinds[used.time]).startswith(_SORTABLE) else ""
    numbered = f"SELECT {wanted}, row_number() OVER () AS __row FROM ({union})"
    return f"SELECT {wanted} FROM ({numbered}) ORDER BY CAST({trip} AS VARCHAR), {by_time}__row"


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
    except duckdb.Error as error:
        raise SettingError(f"memory is {memory!r}; a size such as 256MB was expected") from error
    try:
        yield con
    finally:
        con.close()


def _run(con: Any, query: str) -> Any:
    """The answer to a query.

    Raises:
        ReadError: DuckDB refuses it.
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
                con.execute(f"SELECT count(*) FROM read_csv([{_text(path)}], {_OPTIONS})")
            except duckdb.Error as error:
                unread.append((path, first_line(error)))
        if unread:
            raise ReadError(unreadable(unread)) from None
        raise


def _source(con: Any, inputs: Inputs, kind: str, trip_id: str, own: Mapping[str, str | int]) -> str:
    """The query of all rows of the files of a kind."""
    paths = inputs.files[kind]
    names = ", ".join(_text(path) for path in paths)
    if kind == "csv":
        return _csv(con, inputs, trip_id, own)
    if kind == "parquet":
        columns = schema_of(paths[0], kind).names
        found = find(columns, _there(own, columns))
        if {"lat", "lon"} <= found.keys() or "geometry" not in found:
            return f"SELECT * FROM read_parquet([{names}], union_by_name=true)"
    import pyarrow.dataset as ds

    con.register(f"files_{kind}", ds.dataset([str(path) for path in paths], format=kind))
    return f"SELECT * FROM files_{kind}"


def _there(own: Mapping[str, str | int], names: Iterable[str]) -> dict[str, str | int]:
    """Those own names whose columns this table has: a union may have others."""
    there = {normal(name) for name in names}
    return {alias: column for alias, column in own.items() if normal(str(column)) in there}


def _csv(con: Any, inputs: Inputs, trip_id: str, own: Mapping[str, str | int]) -> str:
    """The query of CSV files: trips stay text, times are read only where they are ISO 8601."""
    paths = inputs.files["csv"]
    names = ", ".join(_text(path) for path in paths)
    options = _OPTIONS
    seen = _run(con, f"DESCRIBE SELECT * FROM read_csv([{names}], {options})").fetchall()
    kinds = {row[0]: row[1] for row in seen}
    others = inputs.queries or len(inputs.files) > 1
    own = _there(own, kinds) if others else own
    used = used_columns(kinds, trip_id, str(paths[0]), own)
    options += f", types={{{_text(used.trip)}: 'VARCHAR'}}"
    rows = f"read_csv([{names}], {options})"
    time = _quoted(used.time)
    if kinds[used.time] == "VARCHAR":
        few = f"SELECT {time} AS t FROM {rows} LIMIT {_SAMPLE}"
        for form, kind in ((_ZONED, "TIMESTAMPTZ"), (_LOCAL, "TIMESTAMP")):
            test = f"SELECT bool_and(t IS NULL OR regexp_full_match(t, '{form}')) FROM ({few})"
            if _run(con, test).fetchone()[0]:
                moment = f"TRY_CAST({time} AS {kind})"
                moment = f"CASE WHEN regexp_full_match({time}, '{form}') THEN {moment} END"
                return f"SELECT * REPLACE ({moment} AS {time}) FROM {rows}"
    return f"SELECT * FROM {rows}"


def _text(value: Any) -> str:
    return "'" + str(value).replace("'", "''") + "'"


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
