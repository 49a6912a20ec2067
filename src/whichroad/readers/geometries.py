"""Places out of geometries and out of coordinates in a plane, as longitude and latitude."""

import json
import threading
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ReadError, first_line
from ..observations import Array
from .names import Column
from .whole_trips import LINES

if TYPE_CHECKING:
    import pyarrow as pa

_MOST_METRES = 1.1e7  # of a northing
_MOST_MINUTES = 18_000.0  # of degrees and minutes, as NMEA writes them
_POINT, _LINES = 0, {1, 5}  # shapely's numbers of a point; of a line, and of several in one
_UNSAID = object()  # a geometry whose metadata say nothing of its reference system


def places_of(table: "pa.Table", column: Column, crs: Any, where: str) -> tuple[Array, Array]:
    """Longitudes and latitudes of a column of points.

    The reference system is that of the file's metadata (GeoParquet, GeoArrow), else `crs`,
    else degrees on WGS 84.

    Args:
        table: Of the file.
        column: The geometry.
        crs: Of geometries that name none, as pyproj takes it.
        where: The source, for errors.

    Raises:
        ReadError: The points cannot be read, or are no degrees although no system is known.
    """
    field = table.schema.field(column.place)
    own = system_of(table.schema.metadata or {}, field)
    x, y = _points(table.column(column.place), where)
    known = np.isfinite(x) & np.isfinite(y)
    if own is _UNSAID or own is None:
        own = crs
    if own is not None:
        return unproject(x, y, own, where)
    if known.any() and (np.abs(x[known]).max() > 180.0 or np.abs(y[known]).max() > 90.0):
        middle = np.flatnonzero(known)[0]
        raise ReadError(
            f"{where}: column {column.name!r} holds points such as {x[middle]:.1f}, "
            f"{y[middle]:.1f} without a reference system; longitude and latitude were expected; "
            "give crs= (--crs), for example EPSG:32632"
        )
    return x, y


def system_of(metadata: dict[bytes, bytes], field: "pa.Field") -> Any:
    """The reference system that a GeoParquet or GeoArrow column names."""
    try:
        geo = json.loads(metadata.get(b"geo", b"{}"))
        about = geo.get("columns", {}).get(field.name)
        if isinstance(about, dict):  # where it names none, degrees on WGS 84 are the rule
            return about.get("crs", "OGC:CRS84")
        extension = json.loads((field.metadata or {}).get(b"ARROW:extension:metadata", b"{}"))
        return extension.get("crs", _UNSAID)
    except (ValueError, AttributeError):
        return _UNSAID


def _points(column: "pa.ChunkedArray", where: str) -> tuple[Array, Array]:
    import pyarrow as pa
    import shapely

    from ..roadmap.sheet import from_texts

    kind = getattr(column.type, "storage_type", column.type)
    try:
        if pa.types.is_struct(kind):  # GeoArrow's own encoding of points
            cells = column.combine_chunks()
            cells = getattr(cells, "storage", cells)
            x, y = (np.array(pa.compute.struct_field(cells, n), np.float64) for n in ("x", "y"))
            return x, y
        if pa.types.is_fixed_size_list(kind):  # the same, of each point both together
            cells = column.combine_chunks()
            cells = getattr(cells, "storage", cells)
            x, y = (np.array(pa.compute.list_element(cells, k), np.float64) for k in (0, 1))
            return x, y
        values = column.to_pylist()
        words = [isinstance(value, str) and bool(value.strip()) for value in values]
        if not any(words):
            points = shapely.from_wkb(values)
        else:
            points = np.full(len(values), None, object)
            points[words] = from_texts(np.array(values, object)[words])
        kinds = set(shapely.get_type_id(points).tolist())
        if kinds & _LINES and _POINT not in kinds:
            raise ReadError(f"{where}: the geometry holds {LINES}")
        points[shapely.is_empty(points)] = None  # an empty point has no coordinates to ask for
        return shapely.get_x(points), shapely.get_y(points)
    except (shapely.errors.ShapelyError, pa.ArrowException, TypeError, ValueError) as error:
        raise ReadError(
            f"{where}: the geometry cannot be read ({first_line(error)}); points as WKB or WKT "
            "were expected"
        ) from None


def unproject(x: Array, y: Array, crs: Any, where: str) -> tuple[Array, Array]:
    """Longitudes and latitudes on WGS 84 of coordinates in a reference system.

    Raises:
        ReadError: pyproj does not know the system.
    """
    import pyproj

    try:
        told = json.dumps(crs) if isinstance(crs, dict) else crs
        lon, lat = _transformer(told, threading.get_ident()).transform(x, y)
    except (pyproj.exceptions.ProjError, TypeError, ValueError):
        shown = crs if isinstance(crs, str | int) else "of the file"
        raise ReadError(
            f"{where}: crs {shown!r} is not a known coordinate system; one such as EPSG:32632 was "
            "expected"
        ) from None
    known = np.isfinite(x) & np.isfinite(y)
    # pyproj returns infinity for what lies outside its grid, and for NaN
    return np.where(known, lon, np.nan), np.where(known, lat, np.nan)


@lru_cache(maxsize=32)  # of many files each has its own
def _transformer(crs: Any, thread: int) -> Any:
    """From a reference system to degrees; two threads share none."""
    import pyproj

    return pyproj.Transformer.from_crs(crs, 4326, always_xy=True)


def said_of_degrees(lat: Array, lon: Array) -> str:
    """What to do with numbers that are no degrees, by their size."""
    sizes = [np.abs(column[np.isfinite(column)]) for column in (lat, lon)]
    north, east = (float(size.max(initial=0.0)) for size in sizes)
    whole = all((size == np.round(size)).all() for size in sizes)
    if whole and max(north, east) > _MOST_METRES:
        unit = "e7" if north > 90e6 or east > 180e6 else "e6"
        return (
            f"where they are in 1{unit[0]}-{unit[1]} degrees, give them by --columns "
            f"lat_{unit}=...,lon_{unit}=... (columns=)"
        )
    if max(north, east) > _MOST_MINUTES:
        return (
            "where they are metres in a plane, give them by --columns x=...,y=... (columns=) and "
            "its system by --crs (crs=), for example EPSG:32632"
        )
    return "write them so"
