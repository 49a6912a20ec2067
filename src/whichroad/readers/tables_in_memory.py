"""Tables in memory, of any library, as columns of Arrow."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import ReadError, first_line
from .arrow_columns import decoded_columns
from .names import Seen, find
from .reading import Reading
from .whole_trips import LINES

_ROW = ("time", "lat", "lon")  # what the numbers of a tuple are
_ABSENT = ("None", "nan", "NaT", "<NA>")  # texts of cells without a value
_NO_TABLE = (
    "a DataFrame, GeoDataFrame, pyarrow Table, list of dicts or of (time, lat, lon), or anything "
    "with __arrow_c_stream__ was expected"
)


def in_memory(table: Any, reading: Reading | None = None) -> Seen:
    """The used columns of any table in memory as Arrow, and the names of all.

    Args:
        table: A frame of pandas, geopandas, polars or movingpandas, an Arrow table or batch, a
            dict of columns, a list of dicts, or rows (time, lat, lon) or (lat, lon) as
            tuples or as a NumPy array.
        reading: Gives own names of columns.

    Raises:
        ReadError: It is no table.
    """
    import pyarrow as pa

    refuse_without_rows(table)
    own = reading.columns if reading is not None else {}
    given = table
    try:
        if isinstance(table, pa.RecordBatch):
            table = pa.Table.from_batches([table])
        elif isinstance(table, np.ndarray | list | tuple):
            table = _of_rows(table)
        elif hasattr(table, "geometry") and hasattr(table, "to_crs"):
            table = _points(table)
        if hasattr(table, "reset_index"):
            return _frame(table, own)
        if isinstance(table, dict):
            table = pa.table({name: _arrow(cells) for name, cells in table.items()})
        table = flattened(table if isinstance(table, pa.Table) else _of_stream(table), own)
        found = find(table.column_names, own)
        return Seen(decoded_columns(table, found), table.column_names, found)
    except (
        pa.ArrowException, TypeError, ValueError, KeyError, AttributeError, OverflowError
    ) as error:  # fmt: skip
        raise ReadError(
            f"table: {type(given).__name__} cannot be read as a table ({first_line(error)}); "
            f"{_NO_TABLE}"
        ) from None


def refuse_without_rows(table: Any) -> None:
    """Refuse the LazyFrame of polars, and what Dask has not computed.

    Raises:
        ReadError: It is one.
    """
    if type(table).__module__.partition(".")[0] == "dask":
        raise ReadError(
            f"table: a {type(table).__name__} of Dask has no rows yet; a table was expected; give "
            "its .compute(), or whichroad.match_many to its .map_partitions() where each trip lies "
            "in one partition"
        )
    if type(table).__name__ == "LazyFrame":
        raise ReadError(
            "table: a LazyFrame has no rows yet; a table was expected; give its .collect()"
        )


def _of_stream(table: Any) -> Any:
    """A table with `__arrow_c_stream__` as Arrow; objects of Python, as polars has them, as text.

    For such objects polars gives where they are in memory.
    """
    import pyarrow as pa

    rows, kinds = pa.table(table), getattr(table, "schema", None)
    for name, kind in kinds.items() if isinstance(kinds, Mapping) else ():
        if str(kind) == "Object":
            cells = [None if cell is None else str(cell) for cell in table[name]]
            at = rows.column_names.index(name)
            rows = rows.set_column(at, name, pa.array(cells, pa.string()))
    return rows


def flattened(table: Any, own: Any = None) -> Any:
    """An Arrow table with the fields of its structs as columns, where these hold the places.

    `location` of `lat` and `lon` becomes `location.lat` and `location.lon`.  So it does where
    the caller names such a field.
    """
    named = {str(column) for column in (own or {}).values()} - set(table.column_names)
    if named and not named.isdisjoint((flat := table.flatten()).column_names):
        return flat
    if {"lat", "lon"} <= (found := find(table.column_names, own)).keys() or "geometry" in found:
        return table
    flat = table.flatten()
    return flat if {"lat", "lon"} <= find(flat.column_names, own).keys() else table


def is_gpx(thing: Any) -> bool:
    """Whether something is a GPX of gpxpy."""
    return hasattr(thing, "tracks") and hasattr(thing, "routes") and hasattr(thing, "to_xml")


def frames_of(thing: Any) -> list[tuple[str, Any]] | None:
    """Names and frames of the trajectories of movingpandas; None of anything else."""
    if hasattr(thing, "trajectories"):
        return [(str(one.id), one.df) for one in thing.trajectories]
    if hasattr(thing, "df") and hasattr(thing, "to_linestring"):
        return [(str(getattr(thing, "id", "drive")), thing.df)]
    return None


def are_rows(thing: Any) -> bool:
    """Whether something is a list of dicts, one for each row, or an array of records."""
    if isinstance(thing, np.ndarray):
        return thing.dtype.names is not None
    if not isinstance(thing, list | tuple) or not thing or not isinstance(thing[0], dict):
        return False
    return not any(np.ndim(cell) for cell in thing[0].values())


def rows_as_columns(rows: Any) -> dict[str, Any]:
    """Columns of a list of dicts, by all names that any of them has, or of records."""
    if isinstance(rows, np.ndarray):
        return {name: rows[name] for name in rows.dtype.names or ()}
    keys = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in keys}


def _of_rows(rows: Any) -> Any:
    """A table of dicts, of tuples or of an array, one for each row."""
    if isinstance(rows, np.ndarray) and rows.dtype.names:
        return _table(rows_as_columns(rows))
    if not len(rows):
        raise ValueError("no rows")
    if isinstance(rows[0], dict):
        return _table(rows_as_columns(rows))
    if isinstance(rows[0], str | bytes):
        raise TypeError("rows are text")
    width = {len(row) for row in rows}
    if width not in ({2}, {3}):
        raise ValueError("rows of (time, lat, lon) or of (lat, lon) were expected")
    columns = [[row[k] for row in rows] for k in range(width.pop())]
    names = _ROW[-len(columns) :]
    if len(columns) == 3 and _is_time(columns[2]) and not _is_time(columns[0]):
        names = ("lat", "lon", "time")
    named = dict(zip(names, columns, strict=True))
    if float(np.abs(np.array(named["lat"], float)).max()) > 90.0:
        raise ValueError(f"latitudes beyond 90 degrees; the order ({', '.join(names)}) is expected")
    return _table(named)


def _table(columns: dict[str, Any]) -> Any:
    """A frame of pandas where that is installed, as cells may be of its own kinds."""
    try:
        import pandas as pd
    except ModuleNotFoundError:
        return columns
    return pd.DataFrame(columns)


def _is_time(values: list[Any]) -> bool:
    """Whether values can be no angles, so that they are times."""
    return not isinstance(values[0], int | float | np.number) or abs(float(values[0])) > 360.0


def _frame(frame: Any, own: Any) -> Seen:
    """The used columns of a DataFrame; an index that is a time, or named like a column, is one."""
    import pyarrow as pa

    index, columns = frame.index.names, {str(name) for name in frame.columns}
    named = {str(name) for name in index if name is not None}
    if find(sorted(named)) or named & {str(column) for column in own.values()}:
        # a level that is also a column, as of set_index(drop=False), stays where it is
        more = [k for k, n in enumerate(index) if n is not None and str(n) not in columns]
        frame = frame.reset_index(level=more)
    elif str(frame.index.dtype).startswith("datetime64") and "time" not in columns:
        frame = frame.rename_axis("time").reset_index()
    names = [str(name) for name in frame.columns]
    found = find(names, own)
    # columns that are not used may be of types that Arrow does not know
    arrays = {column.name: _arrow(frame.iloc[:, column.place]) for column in found.values()}
    seen = Seen.of(pa.table(arrays), names, found)
    return seen._replace(table=decoded_columns(seen.table, seen.found))


def _arrow(cells: Any) -> Any:
    """A column as an array of Arrow; as text of cells such as 49.4 and "n/a", or beyond 64 bits."""
    import pyarrow as pa

    if isinstance(cells, pa.Array | pa.ChunkedArray):
        return cells
    try:
        return pa.array(cells)
    except (pa.ArrowInvalid, TypeError, OverflowError):  # numbers of more than 64 bits
        if np.ndim(cells) != 1:
            raise
        texts = [c.decode("utf-8", "replace") if isinstance(c, bytes) else str(c) for c in cells]
        return pa.array([None if text in _ABSENT else text for text in texts], pa.string())


def _points(frame: Any) -> Any:
    """A GeoDataFrame of points as a DataFrame with lon and lat, NaN where there is no point.

    Points of no system that are no degrees become x and y.
    """
    points = frame.geometry.where(~frame.geometry.is_empty, None)
    strange = set(points.geom_type.dropna()) - {"Point"}
    if strange:
        kinds = ", ".join(sorted(strange))
        if strange <= {"LineString", "MultiLineString"}:
            raise ReadError(f"table: the geometry holds {LINES}")
        raise ValueError(f"geometries of kind {kinds}; points were expected")
    if points.crs is not None:
        points = points.to_crs(4326)
    plain = frame.drop(columns=frame.geometry.name)
    if not {"lat", "lon"} & find([str(c) for c in plain.columns]).keys():
        x, y = points.x.to_numpy(), points.y.to_numpy()
        degrees = points.crs is not None or not ((abs(x) > 180.0) | (abs(y) > 90.0)).any()
        plain = plain.assign(lon=x, lat=y) if degrees else plain.assign(x=x, y=y)  # in that of crs=
    return plain
