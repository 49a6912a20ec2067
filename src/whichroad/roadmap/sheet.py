"""A table of roads from wherever it comes: columns by name, geometries, coordinate system."""

import json
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
    crs: Any  # as pyproj takes it; None: unsaid
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

        return _from_frame(geopandas.read_file(path), str(path))
    except (pa.ArrowException, OSError, RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise MapError(
            f"{path}: {reason}; a table of roads (CSV with WKT, GeoParquet, GeoJSON) was expected; "
            "check that it is one"
        ) from error


def _read_csv(path: Path) -> Any:
    from pyarrow import csv

    with path.open("rb") as f:
        compressed = f.read(2) == b"\x1f\x8b"
    if compressed:
        import pyarrow as pa

        source: Any = pa.CompressedInputStream(str(path), "gzip")
    else:
        source = str(path)
    delimiter = "\t" if path.suffix == ".tsv" else ","
    return csv.read_csv(
        source,
        read_options=csv.ReadOptions(block_size=1 << 24),  # a long road is a long line
        parse_options=csv.ParseOptions(delimiter=delimiter, newlines_in_values=True),
    )


def _from_arrow(table: Any, where: str) -> Sheet:
    """The sheet of an Arrow table; GeoParquet's metadata tell geometry and system."""
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
    columns = {c.lower(): table.column(c).to_numpy() for c in table.column_names}
    return _sheet(where, columns, name.lower() if name else None, crs)


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
    absent = np.array([c is None or c != c for c in cells.tolist()], dtype=bool)
    there = cells[~absent]
    geometry = np.full(len(cells), None, dtype=object)
    with np.errstate(invalid="ignore"):  # a NaN in a geometry is for `lines` to count
        if len(there) and isinstance(there[0], str):
            found = shapely.from_wkt(there, on_invalid="ignore")
        elif len(there) and isinstance(there[0], bytes):
            found = shapely.from_wkb(there, on_invalid="ignore")
        else:
            is_geometry = shapely.is_geometry(there) if len(there) else np.empty(0, bool)
            found = np.where(is_geometry, there, None)
    geometry[~absent] = found
    bad = int(sum(g is None for g in found))
    return Sheet(where, columns, geometry, crs, bad)
