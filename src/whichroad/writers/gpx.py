"""GPX 1.1: every drive a track; points carry their time, and the answer as extensions."""

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import pyarrow as pa

from ..errors import WriteError
from ..tables.schema import with_iso_times

HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="whichroad" xmlns="http://www.topografix.com/GPX/1/1" \
xmlns:whichroad="urn:whichroad:points">
"""
EXTENSIONS = ("bearing_deg", "speed_mps", "edge_id", "source_id", "p_road", "p_off_road", "status")
ROWS_AT_A_TIME = 10_000
_SAME = 1e-8  # degrees between the end of an edge and the start of the next, a millimetre


def write(table: pa.Table, path: Path) -> None:
    """Write points (or the lines of a path) as tracks; a gap begins a new segment.

    Raises:
        WriteError: the table has neither `lat`, `lon` nor `geometry`.
    """
    is_path = "geometry" in table.column_names
    if not is_path and not {"lat", "lon"} <= set(table.column_names):
        raise WriteError(
            f"{path}: the table has no position; columns lat and lon, or geometry, were expected; "
            "write .csv or .parquet instead"
        )
    with open(path, "w", encoding="utf-8") as sink:
        sink.write(HEAD)
        rows = _rows(table)
        for drive_id, of_drive in groupby(rows, key=lambda row: row.get("drive_id")):
            name = "" if drive_id is None else f"<name>{escape(str(drive_id))}</name>"
            sink.write(f"<trk>{name}\n")
            segments = _lines if is_path else _segments
            sink.writelines(segments(of_drive))
            sink.write("</trk>\n")
        sink.write("</gpx>\n")


def _rows(table: pa.Table) -> Iterator[dict[str, Any]]:
    for start in range(0, table.num_rows, ROWS_AT_A_TIME):
        yield from with_iso_times(table.slice(start, ROWS_AT_A_TIME)).to_pylist()


def _segments(rows: Iterator[dict[str, Any]]) -> Iterator[str]:
    """Runs of rows that have a position, one segment each."""
    for present, run in groupby(rows, key=lambda row: None not in (row["lat"], row["lon"])):
        if present:
            yield "<trkseg>\n"
            yield from (_point(row) for row in run)
            yield "</trkseg>\n"


def _point(row: dict[str, Any]) -> str:
    time = "" if row.get("time") is None else f"<time>{row['time']}</time>"
    said = "".join(
        f"<whichroad:{name}>{escape(str(row[name]))}</whichroad:{name}>"
        for name in EXTENSIONS
        if row.get(name) is not None
    )
    inside = f"{time}<extensions>{said}</extensions>" if said else time
    return f'<trkpt lat="{row["lat"]:.9f}" lon="{row["lon"]:.9f}">{inside}</trkpt>\n'


def _lines(rows: Iterator[dict[str, Any]]) -> Iterator[str]:
    """Edges of a path that follow one another as one segment; the ends of edges have times."""
    import shapely

    before: tuple[float, float] | None = None  # where the edge before ended
    for row in rows:
        if row["geometry"] is None:
            continue
        points = shapely.from_wkb(row["geometry"]).coords[:]
        follows = (
            before is not None and shapely.Point(points[0]).distance(shapely.Point(before)) <= _SAME
        )
        if not follows:
            yield "</trkseg>\n<trkseg>\n" if before else "<trkseg>\n"
            yield _vertex(points[0], row.get("enter_time"))
        yield from (_vertex(point, None) for point in points[1:-1])
        yield _vertex(points[-1], row.get("exit_time"))
        before = points[-1]
    if before:
        yield "</trkseg>\n"


def _vertex(point: tuple[float, float], time: str | None) -> str:
    inside = "" if time is None else f"<time>{time}</time>"
    return f'<trkpt lat="{point[1]:.9f}" lon="{point[0]:.9f}">{inside}</trkpt>\n'
