"""Points that were written to a file, as an answer again."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from ..errors import MapError, ReadError
from ..evaluate.input_tables import read_table
from ..geodesy.angles import radians
from ..geodesy.units import METRES_PER_DEGREE
from ..tables.result import Result
from ..tables.schema import PATH, POINTS, TIME
from .driven_path import COLUMNS

if TYPE_CHECKING:
    from ..roadmap import RoadMap

_COMPARED = 100  # points that are compared with the map
_ELSEWHERE = 20.0  # m between a point on its edge and that place of the map
_NEEDED = ("time", "lat", "lon", "p_road", "status")


def read_points(
    path: str | Path, drive_id: str | None = None, route: str | Path | None = None
) -> Result:
    """An answer that `match` wrote, of one drive.

    Args:
        path: .parquet, .arrow, .geojson or .csv.
        drive_id: Which drive, where there are several.
        route: The path that `match` wrote beside it.

    Raises:
        ReadError: It is no table of points, or holds several drives and none was named.
    """
    points = _written(path, POINTS, _NEEDED, "points that `whichroad match -o` wrote were expected")
    drives = points["drive_id"].unique().to_pylist()
    if drive_id is not None or len(drives) == 1:
        wanted = drive_id if drive_id is not None else drives[0]
        points = points.filter(pc.equal(points["drive_id"], wanted))
    if (len(drives) != 1 and drive_id is None) or not points.num_rows:
        known = ", ".join(map(str, drives[:10]))
        raise ReadError(
            f"{path}: {len(drives)} drives ({known}) are in it; one of them was expected; name it "
            "by --drive-id"
        )
    return Result(points, pa.table({}) if route is None else read_path(route), {})


def check_map(result: Result, roads: "RoadMap", where: str | Path) -> None:
    """See that an answer read from a file is of a map.

    Args:
        result: As `read_points` gives it.
        roads: The map.
        where: The file.

    Raises:
        MapError: Its edges are not there, or elsewhere.
    """
    points, path = result.to_arrow(), result.path_arrow()
    edges = [points["edge_id"], *([path["edge_id"]] if "edge_id" in path.column_names else [])]
    last = max((pc.max(column).as_py() or 0 for column in edges), default=0)
    expected = "the map that it was matched to was expected with --map"
    if last >= len(roads):
        raise MapError(
            f"{where}: it names edge {last:,}, and the map has {len(roads):,} edges; {expected}"
        )
    on = points.filter(pc.and_(pc.is_valid(points["edge_id"]), pc.is_valid(points["abscissa_m"])))
    on = on.filter(pc.is_valid(on["matched_lat"])) if on.num_rows else on
    if not on.num_rows:
        return
    some = np.unique(np.linspace(0, on.num_rows - 1, _COMPARED).round().astype(int))
    edge, along, lat, lon = (
        on[name].to_numpy()[some]
        for name in ("edge_id", "abscissa_m", "matched_lat", "matched_lon")
    )
    here = [roads.at(int(e), float(s))[:2] for e, s in zip(edge, along, strict=True)]
    own_lat, own_lon = roads.plane.to_geodetic(*np.array(here).T)
    away = METRES_PER_DEGREE * np.hypot(
        lat - own_lat, (lon - own_lon) * np.cos(radians(np.asarray(own_lat)))
    )
    if np.median(away) > _ELSEWHERE:
        raise MapError(
            f"{where}: its roads lie {_distance(float(np.median(away)))} from the map's roads of "
            f"the same numbers; {expected}"
        )


def _distance(metres: float) -> str:
    return f"{metres / 1e3:,.1f} km" if metres >= 1e3 else f"{metres:.0f} m"


def read_path(path: str | Path) -> pa.Table:
    """The route that `match` wrote beside the points; without geometry.

    Raises:
        ReadError: It is no table of a path.
    """
    expected = "a path that `whichroad match --path-out` wrote was expected"
    return _written(path, pa.schema([PATH.field(n) for n in COLUMNS]), COLUMNS[1:-1], expected)


def _written(path: str | Path, schema: pa.Schema, needed: Sequence[str], expected: str) -> pa.Table:
    """A table that was written to a file, with the columns of its schema.

    Args:
        path: The file.
        schema: Its columns; those that the file does not have are null.
        needed: Names of those that it must have.
        expected: What to say where it is no such table.

    Raises:
        ReadError: It is none.
    """
    table = _arrow(read_table(Path(path)))
    missing = [name for name in needed if name not in table.column_names]
    if missing:
        seen = ", ".join(table.column_names[:30])
        raise ReadError(f"{path}: no column {missing[0]!r} among {seen}; {expected}")
    try:
        return pa.table({f.name: _column(table, f) for f in schema}, schema=schema)
    except (pa.ArrowException, ValueError, KeyError, TypeError) as error:
        raise ReadError(f"{path}: {str(error)[:200]}; {expected}") from error


def _arrow(table: Any) -> pa.Table:
    """Arrow of whatever the reader gave."""
    if isinstance(table, pa.Table):
        return table
    return pa.Table.from_pandas(
        table.drop(columns="geometry", errors="ignore"), preserve_index=False
    )


def _column(table: pa.Table, field: pa.Field) -> pa.ChunkedArray | pa.Array:
    """A column of the points' type, nulls where the file has none of that name."""
    if field.name not in table.column_names:
        if field.name == "drive_id":
            return pa.array(["drive"] * table.num_rows)
        return pa.nulls(table.num_rows, field.type)
    column = table[field.name]
    if field.type == TIME:
        return _times(column)
    if pa.types.is_list(field.type) and pa.types.is_string(column.type):
        rows = [json.loads(text) if text else None for text in column.to_pylist()]
        return pa.array(rows, field.type)
    return column.cast(field.type)


def _times(column: pa.ChunkedArray) -> pa.ChunkedArray:
    if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
        plain = pc.replace_substring_regex(column, r"(Z|\+00:00)$", "")
        return plain.cast(pa.timestamp("us")).cast(TIME)
    if not pa.types.is_timestamp(column.type):
        raise ValueError(f"time is {column.type}; times were expected")
    if column.type.tz is None:
        column = column.cast(pa.timestamp("us"))
        return pc.assume_timezone(column, "UTC")
    return column.cast(TIME)
