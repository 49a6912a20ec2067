"""Rows of Overture's segments: Parquet, Arrow, frames, and files whose lists are JSON text."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .overture_rules import items
from .sheet import Sheet, from_frame, is_absent

_NEEDED = frozenset(("id", "geometry", "connectors"))
_COLUMNS = (
    "id", "geometry", "subtype", "class", "subclass", "subclass_rules", "names", "connectors",
    "routes", "road_flags", "speed_limits", "access_restrictions", "level_rules", "width_rules",
    "prohibited_transitions",
)  # fmt: skip
_BATCH = 1 << 14  # segments read at once
_PARQUET = (".parquet", ".geoparquet", ".pq")
_LETTERS = 10
_DEGREES = "OGC:CRS84"


def segments_in(table: Any) -> Any:
    """What holds Overture's segments, as `rows_of` takes it; None: it does not.

    Args:
        table: A file, a frame, an Arrow table, or an open one.
    """
    import pyarrow as pa

    if isinstance(table, Sheet):
        if not {*table.columns, "geometry"} >= _NEEDED:
            return None
        return table if any(items(cell) for cell in table.columns["connectors"].tolist()) else None
    if isinstance(table, str | Path):
        name = str(table).lower()
        if not name.endswith(_PARQUET) or not Path(table).is_file():
            return None
        import pyarrow.parquet

        try:
            names = set(pyarrow.parquet.read_schema(table).names)
        except (pa.ArrowException, OSError, ValueError):
            return None  # the reader of tables says what is wrong
        return table if names >= _NEEDED else None
    names = set(map(str, getattr(table, "column_names", getattr(table, "columns", ()))))
    if not names >= _NEEDED:
        return None
    return table if isinstance(table, pa.Table) else from_frame(table, "Overture's segments")


def rows_of(table: Any) -> Iterator[Mapping[str, Any]]:
    """The segments, cell by cell, geometries as WKB or as shapes."""
    import pyarrow as pa
    import pyarrow.parquet

    if isinstance(table, str | Path):
        with pyarrow.parquet.ParquetFile(table) as file:
            names = [name for name in _COLUMNS if name in file.schema_arrow.names]
            for batch in file.iter_batches(_BATCH, columns=names):
                yield from batch.to_pylist()
    elif isinstance(table, pa.Table):
        names = [name for name in _COLUMNS if name in table.column_names]
        for batch in table.select(names).to_batches(_BATCH):
            yield from batch.to_pylist()
    else:
        yield from _of_sheet(table)


def _of_sheet(sheet: Sheet) -> Iterator[Mapping[str, Any]]:
    columns = {}
    for name in _COLUMNS:  # a shapefile has ten letters of them
        known = name if name in sheet.columns else name[:_LETTERS]
        if known in sheet.columns:
            columns[name] = sheet.columns[known].tolist()
    columns["geometry"] = _in_degrees(sheet)
    for cells in zip(*columns.values(), strict=True):
        row = dict(zip(columns, cells, strict=True))
        yield {name: None if is_absent(cell) else cell for name, cell in row.items()}


def _in_degrees(sheet: Sheet) -> list[Any]:
    """Its lines in degrees, from the system that it names."""
    import pyproj
    import shapely

    shapes = sheet.geometry
    if sheet.crs is not None and not pyproj.CRS.from_user_input(sheet.crs).is_geographic:
        to = pyproj.Transformer.from_crs(sheet.crs, _DEGREES, always_xy=True)
        shapes = shapely.transform(shapes, lambda xy: np.column_stack(to.transform(*xy.T)))
    return list(shapes)
