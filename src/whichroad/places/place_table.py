"""Tables of point objects: files and frames to columns."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError, ReadError, comes_with, first_line
from ..observations import Array
from ..roadmap.lines import degrees_of
from ..roadmap.open_table import read_csv
from ..roadmap.sheet import GEOMETRY, Sheet, from_arrow, from_frame, is_absent, plain

# accepted column names by meaning; the first that is there wins; case does not matter
NAMES = {
    "id": ("id", "place_id", "osm_id", "osmid", "fid", "gid", "name"),
    "lat": ("lat", "latitude", "lat_deg"),
    "lon": ("lon", "lng", "long", "longitude", "lon_deg"),
    "edge": ("edge_id", "edge"),
    "offset": ("abscissa_m", "offset_m", "offset"),
    "bearing": ("bearing_deg", "bearing", "heading_deg"),
    "sigma": ("sigma_m", "accuracy_m"),
    "on_map": ("on_map",),
}
LARGEST_SIGMA_M = 1000.0  # of a place
MOST_EDGES = 2**31  # that a map can have
_EXPECTED = "columns lat and lon, edge_id and abscissa_m, or a geometry of points were expected"
_TRUE = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False, "": False}


@dataclass(frozen=True, slots=True)
class PlaceTable:
    """Point objects as they were given, (n,) each."""

    where: str  # what to call the table in messages
    ids: list[int] | list[str]
    lat: Array  # degrees; NaN: none
    lon: Array
    edge: NDArray[np.int64]  # -1: none
    offset: Array  # m from the edge's start
    bearing: Array  # degrees, of the traffic that it is for; NaN: both directions
    sigma: Array  # m
    on_map: NDArray[np.bool_]  # whether it shares the map's error


def read_places(table: Any, crs: Any = None) -> PlaceTable:
    """Read a table of point objects.

    Args:
        table: Path of a CSV, Parquet, GeoParquet, GeoJSON or another file that geopandas reads,
            a frame, an Arrow table, a dict of columns or a list of dicts.
        crs: Reference system of a geometry that names none, as pyproj takes it.

    Returns:
        Its rows, with those that have no place among them.

    Raises:
        ReadError: It is no such table, or a cell is no number.
    """
    where = str(table) if isinstance(table, str | Path) else "places"
    columns, sheet = _columns(table, where)
    n = len(next(iter(columns.values()))) if columns else 0 if sheet is None else sheet.rows
    found = {name: _find(columns, names) for name, names in NAMES.items()}
    lat, lon = _numbers(found, "lat", n, where), _numbers(found, "lon", n, where)
    if sheet is not None and found["lat"] is None:
        lat, lon = _points(sheet, crs)
    elif found["edge"] is None and (found["lat"] is None or found["lon"] is None):
        raise ReadError(
            f"{where}: columns {', '.join(columns) or '(none)'}; {_EXPECTED}; rename them"
        )
    lat = np.where(np.abs(lat) <= 90.0, lat, math.nan)
    edge = _numbers(found, "edge", n, where)
    at_edge = np.isfinite(edge)
    whole = ~at_edge | (edge == np.round(edge)) & (np.abs(edge) < MOST_EDGES)
    _check(whole, edge, "edge_id", "the whole number of an edge of the map", where)
    sigma = _numbers(found, "sigma", n, where)
    possible = np.isnan(sigma) | (sigma >= 0.0) & (sigma <= LARGEST_SIGMA_M)
    _check(possible, sigma, "sigma_m", f"0 to {LARGEST_SIGMA_M:g} m", where)
    return PlaceTable(
        where, _ids(found["id"], n), lat, lon,
        np.where(at_edge, edge, -1).astype(np.int64),
        np.nan_to_num(_numbers(found, "offset", n, where)),
        _numbers(found, "bearing", n, where),
        np.where(sigma > 0.0, sigma, 0.0),
        at_edge if found["on_map"] is None else _flags(found["on_map"], where),
    )  # fmt: skip


def _columns(table: Any, where: str) -> tuple[dict[str, NDArray[Any]], Sheet | None]:
    """Columns by lower-case name, and the sheet that has the geometry, if there is one."""
    import pyarrow as pa

    if isinstance(table, str | Path):
        table = _opened(Path(table))
    try:
        if isinstance(table, Mapping):
            table = pa.table(dict(table))
        elif isinstance(table, list | tuple):
            table = pa.Table.from_pylist(list(table))
        elif not hasattr(table, "column_names") and not hasattr(table, "reset_index"):
            table = pa.table(table)
        names = [str(c) for c in getattr(table, "column_names", getattr(table, "columns", ()))]
        geometric = hasattr(table, "crs") or any(name.lower() in GEOMETRY for name in names)
        if hasattr(table, "column_names"):
            if geometric:
                sheet = from_arrow(table, where)
                return sheet.columns, sheet
            return {name.lower(): table.column(name).to_numpy() for name in names}, None
        if geometric:
            sheet = from_frame(table, where)
            return sheet.columns, sheet
        return {str(name).lower(): np.asarray(table[name]) for name in table.columns}, None
    except (MapError, pa.ArrowException, TypeError, ValueError, AttributeError) as error:
        first = first_line(error)
        raise ReadError(f"{where}: it cannot be read as a table ({first}); {_EXPECTED}") from None


def _opened(path: Path) -> Any:
    """A file as an Arrow table or a frame."""
    import pyarrow as pa

    if not path.is_file():
        raise ReadError(f"{path}: the file does not exist; a table of places was expected")
    name = path.name.lower()
    try:
        if name.endswith((".csv", ".csv.gz", ".tsv")):
            return read_csv(path)
        if name.endswith((".parquet", ".geoparquet", ".pq")):
            import pyarrow.parquet

            return pyarrow.parquet.read_table(path)
        with comes_with("geo", f"{path}: this format"):
            import geopandas
        return geopandas.read_file(path)
    except (pa.ArrowException, OSError, RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ReadError(
            f"{path}: {reason}; a table of places (CSV, GeoJSON, GeoParquet) was expected"
        ) from None


def _find(columns: Mapping[str, NDArray[Any]], names: tuple[str, ...]) -> NDArray[Any] | None:
    return next((columns[name] for name in names if name in columns), None)


def _numbers(found: Mapping[str, NDArray[Any] | None], name: str, n: int, where: str) -> Array:
    """A column of numbers; NaN where there is none."""
    column = found[name]
    if column is None:
        return np.full(n, math.nan)
    out = np.full(n, math.nan)
    for row, cell in enumerate(column.tolist()):
        if is_absent(cell) or cell == "":
            continue
        try:
            out[row] = float(cell)
        except (TypeError, ValueError):
            raise ReadError(
                f"{where}, row {row + 1}: {NAMES[name][0]} is {cell!r}; a number was expected"
            ) from None
    return out


def _check(good: NDArray[np.bool_], values: Array, name: str, expected: str, where: str) -> None:
    """Refuse the first value that cannot be.

    Raises:
        ReadError: There is one.
    """
    for row in np.flatnonzero(~good)[:1]:
        raise ReadError(
            f"{where}, row {row + 1}: {name} is {values[row]:g}; {expected} was expected"
        )


def _flags(column: NDArray[Any], where: str) -> NDArray[np.bool_]:
    out = np.zeros(len(column), bool)
    for row, cell in enumerate(column.tolist()):
        word = "" if is_absent(cell) else str(cell).strip().lower().removesuffix(".0")
        if word not in _TRUE:
            raise ReadError(
                f"{where}, row {row + 1}: on_map is {cell!r}; true or false was expected"
            )
        out[row] = _TRUE[word]
    return out


def _ids(column: NDArray[Any] | None, n: int) -> list[int] | list[str]:
    """Ids as whole numbers or as text; the number of the row, from 0, where there are none."""
    if column is None:
        return list(range(n))
    cells: list[Any] = plain(column).tolist()
    if all(type(cell) is int for cell in cells):
        return cells
    return [str(row) if cell is None else str(cell) for row, cell in enumerate(cells)]


def _points(sheet: Sheet, crs: Any) -> tuple[Array, Array]:
    """Latitude and longitude of points; NaN of anything else."""
    import shapely

    lat, lon = np.full(sheet.rows, math.nan), np.full(sheet.rows, math.nan)
    is_point = np.array([g is not None and g.geom_type == "Point" for g in sheet.geometry], bool)
    is_point[is_point] = ~shapely.is_empty(sheet.geometry[is_point])
    if is_point.any():
        xy = shapely.get_coordinates(sheet.geometry[is_point])
        try:
            lon[is_point], lat[is_point] = degrees_of(xy, sheet.crs if crs is None else crs, sheet)
        except MapError as error:
            raise ReadError(str(error)) from None
    return lat, lon
