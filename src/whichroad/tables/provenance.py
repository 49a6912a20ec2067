"""Which map a table was matched on: in its metadata, and back from a file."""

import json
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ..errors import ReadError, first_line

MAP_KEY = b"whichroad_map"
"""Of a table's metadata: fingerprint, source and source date of its map, as JSON."""


def with_map(table: pa.Table, identity: Mapping[str, Any]) -> pa.Table:
    """The table, whose metadata name the map that it was matched on."""
    kept = table.schema.metadata or {}
    return table.replace_schema_metadata({**kept, MAP_KEY: json.dumps(dict(identity)).encode()})


def map_of(result: Any) -> dict[str, Any]:
    """Which map a result was matched on.

    Args:
        result: A Parquet or Arrow file of points, path or drives, the folder of a fleet, an
            Arrow table, or a `Result`.

    Returns:
        `fingerprint`, as of `RoadMap.fingerprint`; `source`, the file or table that the map was
        made of; `source_date`, the date of its data (ISO 8601), None where it is not known.

    Raises:
        ReadError: It is no such file, or its metadata name no map.
    """
    if isinstance(result, str | PathLike):
        metadata, name = _metadata(Path(result)), str(result)
    else:
        table = result.to_arrow() if hasattr(result, "to_arrow") else result
        metadata, name = getattr(getattr(table, "schema", None), "metadata", None), "table"
    text = (metadata or {}).get(MAP_KEY)
    if text is None:
        raise ReadError(
            f"{name}: its metadata name no map; Parquet or Arrow written by this version was "
            "expected; match the drives again"
        )
    found: dict[str, Any] = json.loads(text)
    return found


def _metadata(path: Path) -> Mapping[bytes, bytes] | None:
    """The schema's metadata of a file, or of the first file in a folder."""
    if path.is_dir():
        files = sorted(path.rglob("*.parquet"))
        if not files:
            raise ReadError(f"{path}: no .parquet is in it; the folder of a result was expected")
        path = files[0]
    try:
        if path.suffix.lower() in (".arrow", ".feather"):
            with pa.memory_map(str(path)) as source:
                return pa.ipc.open_file(source).schema.metadata  # type: ignore[no-any-return]
        return pq.read_schema(path).metadata  # type: ignore[no-any-return]
    except (pa.ArrowException, OSError) as error:
        reason = first_line(error)
        raise ReadError(
            f"{path}: cannot be read ({reason}); a Parquet or Arrow file of a result was expected"
        ) from None
