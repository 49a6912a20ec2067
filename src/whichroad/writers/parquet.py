"""GeoParquet 1.1: WKB in a column `geometry`, its metadata under the key `geo`."""

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ..tables.schema import geometry

ROWS_AT_A_TIME = 1 << 18  # bounds the memory, and keeps WKB offsets within 32 bits


def write(table: pa.Table, path: Path) -> None:
    """Write the table; one without geometry becomes a plain Parquet file."""
    schema = schema_of(table)
    words = repeating(schema)
    with pq.ParquetWriter(path, schema, compression="zstd", use_dictionary=words) as writer:
        for start in range(0, table.num_rows, ROWS_AT_A_TIME):
            part = spatial(table.slice(start, ROWS_AT_A_TIME))
            writer.write_table(part.cast(schema))


def repeating(schema: pa.Schema) -> list[str]:
    """The columns whose values repeat, for Parquet's dictionaries.

    To try one on measured numbers takes three quarters of the time of writing points.
    """
    known = (pa.types.is_string, pa.types.is_boolean, pa.types.is_integer)
    return [field.name for field in schema if any(is_one(field.type) for is_one in known)]


def spatial(table: pa.Table) -> pa.Table:
    """The table with its geometry as a column, where it has one."""
    wkb = geometry(table)
    if wkb is None or "geometry" in table.column_names:
        return table
    return table.append_column("geometry", wkb)


def schema_of(table: pa.Table, *, bounds: bool = True) -> pa.Schema:
    """The columns of the file, with GeoParquet's metadata; `bounds`: and the table's box."""
    names = set(table.column_names)
    if "geometry" not in names and not {"lat", "lon"} <= names:
        return table.schema
    schema = table.schema
    if "geometry" not in names:
        schema = schema.append(pa.field("geometry", pa.binary()))
    return schema.with_metadata({**(schema.metadata or {}), b"geo": _geo(table, bounds)})


def _geo(table: pa.Table, bounds: bool) -> bytes:
    """The `geo` metadata: encoding, kinds, reference system and perhaps the bounding box."""
    from pyproj import CRS

    column: dict[str, Any] = {
        "encoding": "WKB",
        "geometry_types": ["LineString" if "geometry" in table.column_names else "Point"],
        "crs": CRS.from_epsg(4326).to_json_dict(),
    }
    box = _bounds(table) if bounds else None
    if box is not None:
        column["bbox"] = box
    geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
    return json.dumps(geo).encode()


def _bounds(table: pa.Table) -> list[float] | None:
    """West, south, east, north in degrees; None when no row has a position."""
    if "geometry" in table.column_names:
        import shapely

        shapes = shapely.from_wkb(table["geometry"].drop_null().to_numpy())
        if len(shapes) == 0:
            return None
        return [float(value) for value in shapely.total_bounds(shapes)]
    lon, lat = (pc.min_max(table[name]).as_py() for name in ("lon", "lat"))
    if lon["min"] is None or lat["min"] is None:
        return None
    return [lon["min"], lat["min"], lon["max"], lat["max"]]
