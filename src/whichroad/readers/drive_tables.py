"""Drive tables: CSV, Parquet and Arrow files, and tables in memory, by the names of their columns.

One table may hold fixes, odometry or both, of one drive or of many.  Empty cells hold
no value; what cannot be understood is skipped and counted.
"""

import csv
import io
import re
from collections import Counter
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import ReadError
from ..observations import Array, Drive
from ..settings import Settings, Vehicle
from .arrow_columns import numbers, texts, times
from .checks import LAST, NO_TIME, Skipped, keep, listed, read_bytes
from .drive_columns import Columns, drive_of
from .names import NAMES, Column, find

if TYPE_CHECKING:
    import pyarrow as pa

Path_ = str | PathLike[str]
Seen = tuple["pa.Table", list[str]]  # the columns that are used, and the names of all


class _Source(NamedTuple):
    """Where a table comes from."""

    where: str  # in messages
    stem: str  # the drive's name, if the table has none
    paths: tuple[str, ...]


_WIDTH = "row with a wrong number of cells"


def read_table(
    path: Path_,
    *,
    vehicle: Vehicle | None = None,
    settings: Settings | None = None,
    crs: Any = None,
) -> list[Drive]:
    """Read a drive table: .csv, .tsv, .txt, .parquet, .geoparquet, .arrow or .feather.

    Args:
        path: The file.
        vehicle: Gives the scale and width of wheel counters.
        settings: Gives the sigma of fixes that report none.
        crs: Reference system of `x, y` columns, anything that pyproj takes.

    Returns:
        One drive, or one for each value of a `drive_id` column, in the order of the file.

    Raises:
        ReadError: The file is no table, or holds no time or nothing that locates a drive.
    """
    skipped: Skipped = Counter()
    data = read_bytes(path)
    suffix = Path(path).suffix.lower()
    where = Path(path).name
    if suffix in (".parquet", ".geoparquet", ".pq"):
        table = _parquet(data, where)
    elif suffix in (".arrow", ".feather", ".ipc"):
        table = _arrow(data, where, skipped)
    else:
        table = _csv(data, where, skipped)
    source = _Source(where, Path(path).stem, (str(path),))
    return _drives(table, source, skipped, vehicle, settings, crs)


def drive_from_table(
    table: Any,
    *,
    vehicle: Vehicle | None = None,
    settings: Settings | None = None,
    crs: Any = None,
) -> list[Drive]:
    """The drives of a table in memory.

    Args:
        table: A pandas DataFrame, a GeoDataFrame of points, a pyarrow Table or RecordBatch,
            a dict of columns, or a list of dicts, one for each row.
        vehicle: Gives the scale and width of wheel counters.
        settings: Gives the sigma of fixes that report none.
        crs: Reference system of `x, y` columns, anything that pyproj takes.

    Returns:
        One drive, or one for each value of a `drive_id` column.

    Raises:
        ReadError: It is no table, or holds no time or nothing that locates a drive.
    """
    source = _Source("table", "drive", ())
    return _drives(in_memory(table), source, Counter(), vehicle, settings, crs)


def in_memory(table: Any) -> Seen:
    """The used columns of any table in memory as Arrow, and the names of all.

    Raises:
        ReadError: It is no table.
    """
    import pyarrow as pa

    try:
        if isinstance(table, pa.RecordBatch):
            table = pa.Table.from_batches([table])
        elif isinstance(table, list) and table and all(isinstance(row, dict) for row in table):
            table = _of_rows(table)
        elif hasattr(table, "geometry") and hasattr(table, "to_crs"):
            table = _points(table)
        if hasattr(table, "reset_index"):
            return _frame(table)
        table = table if isinstance(table, pa.Table) else pa.table(table)
        return table, table.column_names
    except (pa.ArrowException, TypeError, ValueError, KeyError, AttributeError) as error:
        raise ReadError(
            f"table: {type(table).__name__} cannot be read as a table ({_first_line(error)}); a "
            "DataFrame, GeoDataFrame, pyarrow Table or list of dicts was expected"
        ) from None


def _of_rows(rows: list[dict[str, Any]]) -> Any:
    import pandas as pd

    return pd.DataFrame(rows)


def _frame(frame: Any) -> Seen:
    """The used columns of a DataFrame; an index that is a time, or named like a column, is one."""
    import pyarrow as pa

    if find([str(name) for name in frame.index.names if name is not None]):
        frame = frame.reset_index()
    elif str(frame.index.dtype).startswith("datetime64"):
        frame = frame.rename_axis("time").reset_index()
    names = [str(name) for name in frame.columns]
    # columns that are not used may be of types that Arrow does not know
    arrays = {
        column.name: pa.array(frame.iloc[:, column.place], from_pandas=True)
        for column in find(names).values()
    }
    return pa.table(arrays), names


def _points(frame: Any) -> Any:
    """A GeoDataFrame as a DataFrame with lon and lat."""
    points = frame.geometry
    if points.crs is not None:
        points = points.to_crs(4326)
    plain = frame.drop(columns=frame.geometry.name)
    if not {"lat", "lon"} & find([str(c) for c in plain.columns]).keys():
        plain = plain.assign(lon=points.x.to_numpy(), lat=points.y.to_numpy())
    return plain


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]


def _parquet(data: bytes, where: str) -> Seen:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(io.BytesIO(data))
        names = file.schema_arrow.names
        table = file.read(columns=[column.name for column in find(names).values()] or names[:1])
        table.validate(full=True)
        return table, names
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise ReadError(
            f"{where}: no readable Parquet ({_first_line(error)}); was the file cut short?"
        ) from None


def _arrow(data: bytes, where: str, skipped: Skipped) -> Seen:
    import pyarrow as pa

    from ..tables.schema import read_arrow

    try:
        table, whole = read_arrow(data)
        keep(np.array([whole]), "end of a recording, torn", skipped)
        table.validate(full=True)
        return table, table.column_names
    except (pa.ArrowException, OSError, ValueError, KeyError) as error:
        raise ReadError(
            f"{where}: no readable Arrow file ({_first_line(error)}); was the file cut short?"
        ) from None


def _csv(data: bytes, where: str, skipped: Skipped) -> Seen:
    import pyarrow as pa
    import pyarrow.csv as pc

    data = _in_utf8(data)
    first = re.search(rb"[^\r\n]+", data)
    head = first[0].decode() if first else ""
    delimiter = max(",;\t", key=head.count)
    try:
        names = next(csv.reader([head], delimiter=delimiter), [])
    except csv.Error as error:
        raise ReadError(
            f"{where}: no readable line of column names ({error}); a table was expected"
        ) from None
    wanted = [column.name for column in find(names).values()]
    if not wanted:
        raise ReadError(no_column(where, "no known column", names, ("time", "lat", "lon")))

    def widths(row: Any) -> str:
        skipped[_WIDTH] += 1
        return "skip"

    def read(types: dict[str, Any] | None) -> "pa.Table":
        skipped.pop(_WIDTH, None)
        return pc.read_csv(
            io.BytesIO(data),
            read_options=pc.ReadOptions(use_threads=False, block_size=1 << 22),
            parse_options=pc.ParseOptions(delimiter=delimiter, invalid_row_handler=widths),
            convert_options=pc.ConvertOptions(include_columns=wanted, column_types=types),
        )

    try:
        try:
            table = read(None)
        except pa.ArrowInvalid:  # a cell unlike those before it: take them one by one
            table = read(dict.fromkeys(wanted, pa.string()))
        return table if delimiter == "," else _with_points(table), names
    except (pa.ArrowException, KeyError, ValueError) as error:
        raise ReadError(
            f"{where}: no readable table ({_first_line(error)}); comma-separated columns under "
            "one line of names were expected"
        ) from None


def _with_points(table: "pa.Table") -> "pa.Table":
    """Numbers with decimal commas, where the comma does not part columns, with points."""
    import pyarrow as pa
    import pyarrow.compute as pc

    for i, column in enumerate(table.columns):
        if pa.types.is_string(column.type):
            commas = pc.match_substring_regex(column, r"^\s*[-+]?\d+,\d+\s*$")
            if pc.any(commas).as_py() and not pc.any(pc.match_substring(column, ".")).as_py():
                points = pc.if_else(commas, pc.replace_substring(column, ",", "."), column)
                table = table.set_column(i, table.column_names[i], points)
    return table


def _in_utf8(data: bytes) -> bytes:
    """The text with a mark in place of what is none, as in tables of older programs."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    try:
        data.decode()
    except UnicodeDecodeError:
        return data.decode(errors="replace").encode()
    return data


def no_column(where: str, what: str, seen: list[str], quantities: tuple[str, ...]) -> str:
    """The message about a table that lacks something, with what it has and what would do."""
    accepted = "; ".join(f"{q}: {', '.join(list(NAMES[q])[:8])}" for q in quantities)
    return (
        f"{where}: {what} among the columns ({listed(seen)}); accepted names are {accepted}; "
        "rename the columns"
    )


def _drives(
    seen: Seen,
    source: _Source,
    skipped: Skipped,
    vehicle: Vehicle | None,
    settings: Settings | None,
    crs: Any,
) -> list[Drive]:
    """Each drive of a table; what is skipped before the split counts with the first."""
    table, names = seen
    where = source.where
    found = find(table.column_names)
    if "time" not in found:
        raise ReadError(no_column(where, "no time", names, ("time",)))
    if table.num_rows == 0:
        raise ReadError(f"{where}: no rows; at least one fix or odometry reading was expected")
    time = times(table.column(found["time"].place), found["time"], where, skipped)
    columns: Columns = {"time": time}
    for quantity, column in found.items():
        if quantity not in ("time", "drive_id", "geometry"):
            values = numbers(table.column(column.place), column.name, skipped)
            columns[quantity] = values * column.factor
    placed = {"lat", "lon"} <= columns.keys()
    _locate(table, found, columns, crs, where)
    _usable(columns, names, where, crs)
    good = np.flatnonzero(keep(np.abs(time) < LAST, NO_TIME, skipped))
    if len(good) == 0:
        first = next((str(c) for c in table.column(found["time"].place).to_pylist() if c), "")
        raise ReadError(
            f"{where}: column {found['time'].name!r} holds no time that can be understood, such as "
            f"{first[:40]!r}; ISO 8601 (2026-06-01T08:00:00Z, or +02:00) or seconds since 1970 "
            "were expected; write it so"
        )
    notes: tuple[str, ...] = ()
    if {"x", "y"} <= columns.keys() and "lat" not in columns:
        notes = ("columns x, y not used: no crs (--crs) was given for them",)
    elif crs is not None and placed:
        notes = (f"crs (--crs) {crs} not used: columns lat, lon give the places, in degrees",)
    drives: list[Drive] = []
    for name, rows in _trips(table, found, good, source.stem):
        part = {quantity: values[rows] for quantity, values in columns.items()}
        here: Skipped = skipped if not drives else Counter()
        drive = drive_of(part, vehicle or Vehicle(), settings or Settings(), here)
        drives.append(
            Drive(name, drive.fixes, drive.odometry, source.paths, dict(here), notes + drive.notes)
        )
    return drives


def _trips(
    table: "pa.Table", found: dict[str, Column], good: Any, stem: str
) -> list[tuple[str, Any]]:
    """The rows of each drive, in the order in which drives first appear."""
    if "drive_id" not in found:
        return [(stem, good)]
    labels, codes = texts(table.column(found["drive_id"].place))
    codes = codes[good]
    order = np.argsort(codes, kind="stable")
    bounds = np.flatnonzero(np.diff(codes[order], prepend=-1))
    pieces = np.split(order, bounds[1:])
    pieces.sort(key=lambda piece: int(piece[0]))
    return [(labels[codes[piece[0]]], good[piece]) for piece in pieces]


def _locate(
    table: "pa.Table", found: dict[str, Column], columns: Columns, crs: Any, where: str
) -> None:
    """Fill `lat` and `lon` from a geometry column or from x and y in `crs`."""
    if {"lat", "lon"} <= columns.keys():
        return
    if "geometry" in found:
        geometry = table.column(found["geometry"].place)
        columns["lon"], columns["lat"] = _geometry(geometry, where)
    elif crs is not None and {"x", "y"} <= columns.keys():
        columns["lon"], columns["lat"] = _unproject(columns["x"], columns["y"], crs, where)


def _geometry(column: Any, where: str) -> tuple[Array, Array]:
    import shapely

    values = column.to_pylist()
    try:
        if any(isinstance(v, str) for v in values):
            points = shapely.from_wkt(values)
        else:
            points = shapely.from_wkb(values)
        return shapely.get_x(points), shapely.get_y(points)
    except (shapely.errors.ShapelyError, TypeError, ValueError) as error:
        raise ReadError(
            f"{where}: the geometry cannot be read ({_first_line(error)}); points as WKB or WKT "
            "in EPSG:4326 were expected"
        ) from None


def _unproject(x: Array, y: Array, crs: Any, where: str) -> tuple[Array, Array]:
    import pyproj

    try:
        transformer = pyproj.Transformer.from_crs(crs, 4326, always_xy=True)
        lon, lat = transformer.transform(x, y)
    except pyproj.exceptions.ProjError as error:
        raise ReadError(f"{where}: crs {crs!r} cannot be used ({_first_line(error)})") from None
    known = np.isfinite(x) & np.isfinite(y)
    # pyproj returns infinity for what lies outside its grid, and for NaN
    return np.where(known, lon, np.nan), np.where(known, lat, np.nan)


def _usable(columns: Columns, names: list[str], where: str, crs: Any) -> None:
    """Raise where a table neither locates nor moves a vehicle."""
    has = columns.keys()
    fixes = {"lat", "lon"} <= has
    wheels = {"wheel_rl", "wheel_rr"} <= has or {"wheel_rl_ticks", "wheel_rr_ticks"} <= has
    if fixes or wheels or "odometer" in has or "speed" in has:
        return
    if {"x", "y"} <= has and crs is None:
        raise ReadError(
            f"{where}: columns x and y without a reference system; latitude and longitude, or "
            "crs= (--crs) for x and y were expected"
        )
    wanted = ("lat", "lon", "wheel_rl", "wheel_rl_ticks", "odometer", "speed", "yaw_rate")
    raise ReadError(no_column(where, "neither position nor odometry", names, wanted))
