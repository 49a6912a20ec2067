"""A table of roads in memory: columns by name, geometries, coordinate system."""

import json
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError

GEOMETRY = ("geometry", "geom", "geom_wkt", "wkt", "the_geom", "wkb", "wkb_geometry", "shape")
_HEX = re.compile(r"\s*0[01](?:[0-9A-Fa-f]{2}){8,}\s*")  # byte order, kind, and more


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table in memory."""

    where: str  # what to call it in messages
    columns: dict[str, NDArray[Any]]  # (n,) each, by lower-case name
    geometry: NDArray[Any]  # (n,) shapely geometries or None
    crs: Any  # as pyproj takes it; None: not given
    bad: int = 0  # geometries that could not be understood, now None
    directed: bool | None = None  # whether a row is one direction of a road; None: not known

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.geometry)


def from_arrow(table: Any, where: str) -> Sheet:
    """The sheet of an Arrow table; GeoParquet's metadata name geometry and system.

    Raises:
        MapError: It has no geometry, or its metadata cannot be understood.
    """
    metadata = (table.schema.metadata or {}).get(b"geo")
    name, crs = None, None
    if metadata:
        try:
            geo = json.loads(metadata)
            name = geo.get("primary_column", "geometry")
            crs = geo["columns"][name].get("crs", "OGC:CRS84")
        except (ValueError, KeyError, AttributeError) as error:
            raise MapError(
                f"{where}: its metadata `geo` cannot be understood; GeoParquet's were expected; "
                "write the file again"
            ) from error
    columns = {c.lower(): _decoded(table.column(c)).to_numpy() for c in table.column_names}
    return _sheet(where, columns, name.lower() if name else None, crs)


def _decoded(column: Any) -> Any:
    """A column of Arrow without its dictionary, if it has one."""
    return column.cast(column.type.value_type) if hasattr(column.type, "index_type") else column


def from_frame(frame: Any, where: str) -> Sheet:
    """The sheet of a pandas or geopandas frame; named index levels are columns.

    Raises:
        MapError: It has no geometry.
    """
    if any(level is not None for level in frame.index.names):
        frame = frame.reset_index()
    name = getattr(frame, "_geometry_column_name", None)
    if name is not None and name not in frame.columns:
        name = None
    crs = getattr(frame[name], "crs", None) if name is not None else None
    columns = {str(c).lower(): np.asarray(frame[c]) for c in frame.columns}
    return _sheet(where, columns, str(name).lower() if name is not None else None, crs)


def _sheet(where: str, columns: dict[str, NDArray[Any]], name: str | None, crs: Any) -> Sheet:
    """Find the geometry and turn it into shapely's."""
    import shapely

    name = name or next((n for n in GEOMETRY if n in columns), None)
    if name is None or name not in columns:
        drive = {"lat", "latitude"} & columns.keys() and {"lon", "longitude"} & columns.keys()
        hint = "this seems to be a drive and not a map" if drive else "rename the column"
        raise MapError(
            f"{where}: columns {', '.join(columns) or '(none)'}; lines in one of "
            f"{', '.join(GEOMETRY)} were expected; {hint}"
        )
    cells = columns.pop(name)
    absent = np.array([is_absent(c) for c in cells.tolist()], dtype=bool)
    there = cells[~absent].astype(object)
    words = np.array([isinstance(c, str) for c in there], dtype=bool)
    raw = np.array([isinstance(c, bytes) for c in there], dtype=bool)
    found = there.copy()
    found[~shapely.is_geometry(there)] = None
    with np.errstate(invalid="ignore", over="ignore"):  # no numbers: `lines` counts them
        found[words] = from_texts(there[words])
        found[raw] = shapely.from_wkb(there[raw], on_invalid="ignore")
    geometry = np.full(len(cells), None, dtype=object)
    geometry[~absent] = found
    bad = int(sum(g is None for g in found))
    return Sheet(where, columns, geometry, crs, bad)


def from_texts(cells: NDArray[Any]) -> NDArray[Any]:
    """Shapes of WKT, or of WKB in hexadecimal digits, as PostGIS writes it; None of other texts."""
    import shapely

    wkb = np.array([bool(_HEX.fullmatch(cell)) for cell in cells], dtype=bool)
    found = np.full(len(cells), None, dtype=object)
    found[wkb] = shapely.from_wkb(cells[wkb], on_invalid="ignore")
    found[~wkb] = shapely.from_wkt(cells[~wkb], on_invalid="ignore")
    return found


def is_absent(value: Any) -> bool:
    """Whether a cell is empty: None, NaN and their like."""
    if value is None:
        return True
    different = value != value
    if isinstance(different, (bool, np.bool_)):
        return bool(different)
    return not isinstance(value, np.ndarray)  # pandas' NA answers NA to everything


def plain(column: NDArray[Any]) -> NDArray[Any]:
    """A column as whole numbers, floats, flags, or plain Python objects with None for absence."""
    if column.dtype.kind in "bf":
        return column
    if column.dtype.kind == "O":
        cells = [None if is_absent(c) else _as_python(c) for c in column.tolist()]
    elif column.dtype.kind in "iu":
        cells = column.tolist()
    else:
        cells = [str(c) for c in column]
    if all(type(c) is int and abs(c) < 2**63 for c in cells):
        return np.array(cells, dtype=np.int64)
    objects = np.full(len(cells), None, dtype=object)
    objects[:] = cells
    return objects


def _as_python(value: Any) -> Any:
    """Of numpy's things Python's."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value
