"""Geometries of a table as lines in longitude and latitude."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError
from ..observations import Array
from ..wording import by_reason
from .sheet import Sheet
from .streets import Ints


class NoSystem(MapError):
    """A table of roads is in a plane, and does not name it."""


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines one after the other.  n lines, V vertices."""

    row: Ints  # (n,) the table's row
    first: Ints  # (n+1,) first vertex of each
    lat_deg: Array  # (V,)
    lon_deg: Array  # (V,)

    def take(self, kept: NDArray[np.bool_]) -> "Lines":
        """Some of the lines."""
        count = np.diff(self.first)
        inside = np.repeat(kept, count)
        first = np.concatenate([[0], np.cumsum(count[kept])])
        return Lines(self.row[kept], first, self.lat_deg[inside], self.lon_deg[inside])


def read_lines(sheet: Sheet, crs: Any, skipped: Counter[str]) -> Lines:
    """The lines of a table, each part of a multi-line on its own.

    Args:
        sheet: The table.
        crs: Coordinate system where the table does not name it.
        skipped: Counts what is left out, by reason.

    Returns:
        Lines of two finite points and more, in WGS84 degrees.

    Raises:
        MapError: There are none, or their coordinate system is unknown.
        NoSystem: They are no degrees, and no system is given.
    """
    import shapely

    absent = np.array([g is None for g in sheet.geometry], dtype=bool) | shapely.is_empty(
        sheet.geometry
    )
    _count(skipped, "rows whose geometry could not be understood", sheet.bad)
    _count(skipped, "rows without geometry", int(absent.sum()) - sheet.bad)
    rows = np.flatnonzero(~absent)
    geometry = sheet.geometry[rows]
    multiple = shapely.get_type_id(geometry) == 5  # MultiLineString
    geometry[multiple] = shapely.line_merge(geometry[multiple])
    parts, index = shapely.get_parts(geometry, return_index=True)
    parts, part = shapely.get_parts(parts, return_index=True)  # multi-lines in collections
    index = index[part]
    is_line = np.isin(shapely.get_type_id(parts), (1, 2))  # LineString, LinearRing
    used = np.unique(index[is_line])
    beside = int((~is_line & np.isin(index, used)).sum())
    _count(skipped, "points and areas beside the lines of a row", beside)
    _count(skipped, "geometries that are not lines", len(geometry) - len(used))
    rows, parts = rows[index[is_line]], parts[is_line]
    xy = shapely.get_coordinates(parts)
    count = shapely.get_num_coordinates(parts)
    line = np.repeat(np.arange(len(parts)), count)
    finite = np.isfinite(xy).all(axis=1)
    lat, lon = np.full(len(xy), np.nan), np.full(len(xy), np.nan)
    lon[finite], lat[finite] = degrees_of(xy[finite], crs if crs is not None else sheet.crs, sheet)
    good = finite & np.isfinite(lat) & np.isfinite(lon) & (np.abs(lat) <= 90.0)
    bad_line = np.zeros(len(parts), bool)
    bad_line[line[~good]] = True
    _count(skipped, "lines with points that are not on Earth", int(bad_line.sum()))
    lines = Lines(rows, np.concatenate([[0], np.cumsum(count)]), lat, lon).take(~bad_line)
    if len(lines.row) == 0:
        reasons = by_reason(skipped) or "no row"
        raise MapError(
            f"{sheet.where}: no line was found ({reasons}); LineString geometries were expected; "
            "check the table"
        )
    return lines


def _count(skipped: Counter[str], why: str, number: int) -> None:
    if number:
        skipped[why] += number


def degrees_of(xy: Array, crs: Any, sheet: Sheet) -> tuple[Array, Array]:
    """Longitude and latitude on WGS84."""
    x, y = xy.T
    if crs is None:
        if len(xy) and not (np.abs(x).max() <= 360.0 and np.abs(y).max() <= 90.0):
            raise NoSystem(
                f"{sheet.where}: coordinates up to {np.abs(xy).max():,.0f} without a coordinate "
                'system; longitude and latitude, or crs="EPSG:..." (--crs) were expected; name the '
                "system, or compile the table: `whichroad map build --crs EPSG:... -o roads.map`"
            )
        return x, y
    import pyproj

    try:
        system = pyproj.CRS.from_user_input(crs)
        if system.equals("EPSG:4326", ignore_axis_order=True):
            return x, y
        to_wgs84 = pyproj.Transformer.from_crs(system, "EPSG:4326", always_xy=True)
        lon, lat = to_wgs84.transform(x, y)
    except pyproj.exceptions.ProjError as error:
        raise MapError(
            f"{sheet.where}: the coordinate system {crs!r} is not known; one such as "
            '"EPSG:3067" was expected; pass another'
        ) from error
    return lon, lat
