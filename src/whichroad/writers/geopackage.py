"""GeoPackage: one layer, `points` or `path`; lists as JSON, as GDAL knows no lists of records."""

import errno
import shutil
from pathlib import Path

import pyarrow as pa

from ..errors import WriteError, comes_with, first_line
from ..tables.schema import geometry
from .csv import as_json

_LEAST = 1 << 17  # bytes of a GeoPackage without rows, and some


def check_gdal() -> None:
    """See that GDAL is there.

    Raises:
        SettingError: The extra `geo` is not installed.
    """
    with comes_with("geo", "GeoPackage"):
        import pyogrio  # noqa: F401


def write(table: pa.Table, path: Path) -> None:
    """Write the table as a layer: `path` where it has lines, `points` where it has lat and lon.

    Raises:
        SettingError: The extra `geo` is not installed.
        WriteError: The table has neither, or GDAL refuses it.
        OSError: The disk is full.
    """
    check_gdal()
    import pyogrio

    wkb = geometry(table)
    if wkb is None:
        raise WriteError(
            f"{path}: the table has no positions (columns {', '.join(table.column_names)}); lines, "
            "or lat and lon, were expected for a GeoPackage; write .csv or .parquet"
        )
    lines = "geometry" in table.column_names
    plain = table.drop_columns(["geometry"]) if lines else table
    for index, column in enumerate(plain.schema):
        if pa.types.is_nested(column.type):
            plain = plain.set_column(index, column.name, as_json(plain.column(index)))
    try:
        pyogrio.write_arrow(
            plain.append_column("geometry", wkb).replace_schema_metadata(None), path,
            layer="path" if lines else "points", driver="GPKG", geometry_name="geometry",
            geometry_type="LineString" if lines else "Point", crs="EPSG:4326",
        )  # fmt: skip
    except (RuntimeError, ValueError) as error:
        if shutil.disk_usage(path.parent).free < plain.nbytes + _LEAST:  # which GDAL does not say
            raise OSError(errno.ENOSPC, "No space left on device") from None
        first = first_line(error)
        raise WriteError(
            f"{path}: GDAL cannot write it ({first}); a table of points or of a path was expected; "
            "write .parquet"
        ) from None
