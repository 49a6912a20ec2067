"""A table of roads from wherever it comes: columns by name, geometries, coordinate system."""

import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError

GEOMETRY = ("geometry", "geom", "geom_wkt", "wkt", "the_geom", "wkb", "wkb_geometry", "shape")


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table in memory."""

    where: str  # what to call it in messages
    columns: dict[str, NDArray[Any]]  # (n,) each, by lower-case name
    geometry: NDArray[Any]  # (n,) shapely geometries or None
    crs: Any  # as pyproj takes it; None: not given
    bad: int = 0  # geometries that could not be understood, now None

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.geometry)


def open_sheet(table: Any) -> Sheet:
    """A table of roads, whatever it is.

    Args:
        table: GeoDataFrame, DataFrame or Arrow table with WKB or WKT, or a path to CSV with WKT,
            Parquet, GeoJSON or anything else that geopandas reads.

    Raises:
        MapError: It cannot be read, or has no geometry.
    """
    if isinstance(table, (str, Path)):
        return _open_file(Path(table))
    if hasattr(table, "column_names"):
        return _from_arrow(table, "table of edges")
    if hasattr(table, "columns") and hasattr(table, "reset_index"):
        return _from_frame(table, "table of edges")
    raise MapError(
        f"table of edges: it is a {type(table).__name__}; a GeoDataFrame, an Arrow table or a path "
        "was expected; convert it"
    )


def _open_file(path: Path) -> Sheet:
    import pyarrow as pa
    from shapely.errors import ShapelyError

    if not path.is_file():
        raise MapError(f"{path}: there is no such file; a table of roads was expected; check it")
    name = path.name.lower()
    try:
        if name.endswith((".csv", ".csv.gz", ".tsv")):
            return _from_arrow(_read_csv(path), str(path))
        if name.endswith((".parquet", ".geoparquet", ".pq")):
            import pyarrow.parquet

            return _from_arrow(pyarrow.parquet.read_table(path), str(path))
        import geopandas

        with warnings.catch_warnings():
            # what could not be read has no geometry, and `lines` counts it
            warnings.simplefilter("ignore", RuntimeWarning)
            frame = geopandas.read_file(path)
        return _from_frame(frame, str(path))
    except (pa.ArrowException, ShapelyError, OSError, RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise MapError(
            f"{path}: {reason}; a table of roads (CSV with WKT, GeoParquet, GeoJSON) was expected; "
            "check that it is one"
        ) from error


def _read_csv(path: Path) -> Any:
    import pyarrow as pa
    from pyarrow import csv

    with path.open("rb") as f:
        compressed = f.read(2) == b"\x1f\x8b"
    if compressed:
        source: Any = pa.CompressedInputStream(str(path), "gzip")
    else:
        source = str(path)
    delimiter = "\t" if path.suffix == ".tsv" else ","
    table = csv.read_csv(
        source,
        read_options=csv.ReadOptions(block_size=1 << 24),  # a long road is a long line
        parse_options=csv.ParseOptions(delimiter=delimiter, newlines_in_values=True),
    )
    for i, column in enumerate(table.columns):
        if pa.types.is_binary(column.type):  # one word of it is not UTF-8
            words = [c if c is None else c.decode(errors="replace") for c in column.to_pylist()]
            table = table.set_column(i, table.column_names[i], pa.array(words))
    return table


def _from_arrow(table: Any, where: str) -> Sheet:
    """The sheet of an Arrow table; GeoParquet's metadata name geometry and system."""
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


def _from_frame(frame: Any, where: str) -> Sheet:
    """The sheet of a pandas or geopandas frame; named index levels are columns."""
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
        raise MapError(
            f"{where}: columns {', '.join(columns) or '(none)'}; a geometry in one of "
            f"{', '.join(GEOMETRY)} was expected; rename the column"
        )
    cells = columns.pop(name)
    absent = np.array([is_absent(c) for c in cells.tolist()], dtype=bool)
    there = cells[~absent].astype(object)
    words = np.array([isinstance(c, str) for c in there], dtype=bool)
    raw = np.array([isinstance(c, bytes) for c in there], dtype=bool)
    found = there.copy()
    found[~shapely.is_geometry(there)] = None
    with np.errstate(invalid="ignore", over="ignore"):  # no numbers: `lines` counts them
        found[words] = shapely.from_wkt(there[words], on_invalid="ignore")
        found[raw] = shapely.from_wkb(there[raw], on_invalid="ignore")
    geometry = np.full(len(cells), None, dtype=object)
    geometry[~absent] = found
    bad = int(sum(g is None for g in found))
    return Sheet(where, columns, geometry, crs, bad)


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
