"""GeoJSON (RFC 7946): one feature per row, streamed; lon before lat."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa

from ..errors import WriteError
from ..tables.schema import with_iso_times

ROWS_AT_A_TIME = 10_000


def write(table: pa.Table, path: Path) -> None:
    """Write the table as a FeatureCollection.

    Raises:
        WriteError: a number is infinite or not a number, which JSON cannot hold.
    """
    with open(path, "w", encoding="utf-8") as sink:
        sink.write('{"type": "FeatureCollection", "features": [')
        separator = "\n"
        for start in range(0, table.num_rows, ROWS_AT_A_TIME):
            part = with_iso_times(table.slice(start, ROWS_AT_A_TIME))
            for text in _features(part, path):
                sink.write(separator)
                sink.write(text)
                separator = ",\n"
        sink.write("\n]}\n")


def _features(table: pa.Table, path: Path) -> Iterator[str]:
    columns = [name for name in table.column_names if name != "geometry"]
    rows = table.select(columns).to_pylist()
    for row, shape in zip(rows, _shapes(table, rows), strict=True):
        try:
            properties = json.dumps(row, ensure_ascii=False, allow_nan=False)
        except ValueError as error:
            raise WriteError(
                f"{path}: a value of {row} is infinite or not a number; finite numbers or null "
                "were expected; write .parquet instead"
            ) from error
        yield f'{{"type": "Feature", "geometry": {shape}, "properties": {properties}}}'


def _shapes(table: pa.Table, rows: list[dict[str, Any]]) -> Iterator[str]:
    """Each row's geometry as JSON text."""
    if "geometry" in table.column_names:
        import shapely

        shapes = shapely.from_wkb(table["geometry"].to_numpy())
        yield from (text or "null" for text in shapely.to_geojson(shapes))
        return
    for row in rows:
        lon, lat = row.get("lon"), row.get("lat")
        if lon is None or lat is None:
            yield "null"
        else:
            yield f'{{"type": "Point", "coordinates": [{lon!r}, {lat!r}]}}'
