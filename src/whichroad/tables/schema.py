"""The tables that come out, their columns, and their geometry as well-known binary.

Two tables describe a drive: the points hold where the vehicle was at every epoch,
the path holds the edges it drove along.  Absence is null, never NaN.  Times are UTC,
angles are degrees clockwise from north, positions are WGS 84.
"""

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.feather as feather
from numpy.typing import NDArray

from ..errors import comes_with

TIME = pa.timestamp("us", tz="UTC")
RECORDING = {b"whichroad": b"recording"}
"""Marks Arrow streams that grow while a vehicle drives: their last batch may be torn."""

GEOMETRY = pa.field(
    "geometry",
    pa.binary(),
    metadata={
        "ARROW:extension:name": "geoarrow.wkb",
        "ARROW:extension:metadata": '{"crs":"EPSG:4326"}',
    },
)
"""WKB LineString, driving direction, lon before lat; marked so that geopandas takes it as such."""

POINTS = pa.schema(
    [
        ("drive_id", pa.string()),
        ("time", TIME),
        ("lat", pa.float64()),
        ("lon", pa.float64()),
        ("bearing_deg", pa.float64()),
        ("speed_mps", pa.float64()),
        ("cov_ee_m2", pa.float64()),
        ("cov_en_m2", pa.float64()),
        ("cov_nn_m2", pa.float64()),
        ("sigma_bearing_deg", pa.float64()),
        ("ellipse_major_m", pa.float64()),  # 1 sigma
        ("ellipse_minor_m", pa.float64()),
        ("ellipse_bearing_deg", pa.float64()),
        ("edge_id", pa.int64()),
        ("source_id", pa.string()),
        ("forward", pa.bool_()),
        ("abscissa_m", pa.float64()),
        ("lateral_m", pa.float64()),
        ("matched_lat", pa.float64()),
        ("matched_lon", pa.float64()),
        ("map_lat", pa.float64()),
        ("map_lon", pa.float64()),
        ("p_road", pa.float64()),
        ("p_way", pa.float64()),
        ("p_off_road", pa.float64()),
        ("status", pa.string()),
        ("reason", pa.string()),
        ("alternatives", pa.list_(pa.struct([("edge_id", pa.int64()), ("p", pa.float64())]))),
        ("protection_level_m", pa.float64()),
        ("level_along_m", pa.float64()),
        ("level_across_m", pa.float64()),
        ("gnss_scale", pa.float64()),
        ("map_scale", pa.float64()),
        ("source_m", pa.float64()),  # from the start of the source's road, as it was drawn
        ("source_share", pa.float64()),  # of its length
    ]
)
"""One row per epoch."""

SLIM = pa.schema(
    [
        POINTS.field(name)
        for name in ("drive_id", "time", "edge_id", "source_id", "forward", "abscissa_m", "p_road",
                     "p_off_road", "status")
    ]
)  # fmt: skip
"""Points without poses."""

PATH = pa.schema(
    [
        ("drive_id", pa.string()),
        ("seq", pa.int64()),
        ("edge_id", pa.int64()),
        ("source_id", pa.string()),
        ("from_node", pa.int64()),
        ("to_node", pa.int64()),
        ("forward", pa.bool_()),
        ("enter_time", TIME),
        ("exit_time", TIME),
        ("enter_m", pa.float64()),
        ("exit_m", pa.float64()),
        ("duration_s", pa.float64()),
        ("mean_speed_mps", pa.float64()),  # null where no time passed
        ("p", pa.float64()),
        ("p_route", pa.float64()),
        ("broken_rule", pa.string()),
        ("source_enter_m", pa.float64()),
        ("source_exit_m", pa.float64()),
        ("source_enter_share", pa.float64()),
        ("source_exit_share", pa.float64()),
        GEOMETRY,
    ]
)
"""One row per traversed edge; consecutive rows share a node unless the rule broken is `gap`."""

ATTRIBUTES = pa.schema(
    [
        ("name", pa.string()),
        ("highway", pa.string()),
        ("speed_limit_kmh", pa.float64()),
        ("lanes", pa.int64()),
        ("layer", pa.int64()),
        ("bridge", pa.bool_()),
        ("tunnel", pa.bool_()),
    ]
)
"""Columns of points on the road, where asked for."""

DRIVES = pa.schema(
    [
        ("drive_id", pa.string()),
        ("answered", pa.bool_()),
        ("reason", pa.string()),  # why there is no answer
        ("epochs", pa.int64()),
        ("fixes", pa.int64()),
        ("epochs_without_answer", pa.int64()),
        ("fixes_outside_map", pa.int64()),  # farther than 1 km from every road
        ("duration_s", pa.float64()),
        ("path_m", pa.float64()),
        ("edges", pa.int64()),
        ("gaps", pa.int64()),
        ("mean_p_road", pa.float64()),
        ("mean_p_off_road", pa.float64()),
        ("skipped", pa.map_(pa.string(), pa.int64())),  # rows, by reason
        ("notes", pa.list_(pa.string())),
    ]
)
"""One row per trip of many, also where it has no answer."""

MAP = pa.field("map", pa.string())
"""The last column of all tables of trips on several maps: the file of the row's map."""

_WKB_POINT = np.dtype([("order", "u1"), ("type", "<u4"), ("lon", "<f8"), ("lat", "<f8")])
_WKB_HEAD = np.dtype([("order", "u1"), ("type", "<u4"), ("count", "<u4")])


def times(seconds: NDArray[np.float64]) -> pa.Array:
    """Turn seconds since 1970 UTC, shape (n,), into timestamps of microseconds."""
    return pa.array(np.round(seconds * 1e6).astype(np.int64)).view(TIME)


def seconds_of(column: pa.ChunkedArray) -> NDArray[np.float64]:
    """The reverse: timestamps without nulls as seconds since 1970 UTC, shape (n,)."""
    made: NDArray[np.float64] = column.cast(TIME).cast(pa.int64()).to_numpy() * 1e-6
    return made


def point_wkb(lon: pa.Array, lat: pa.Array) -> pa.Array:
    """Points as WKB, without a loop over rows.

    Args:
        lon: degrees, n values; null where there is no position.
        lat: degrees, n values.

    Returns:
        n binary values, null where either coordinate is.
    """
    present = pc.and_(pc.is_valid(lon), pc.is_valid(lat))
    cells = np.empty(int(pc.sum(present).as_py() or 0), dtype=_WKB_POINT)
    cells["order"], cells["type"] = 1, 1
    cells["lon"] = lon.filter(present).to_numpy(zero_copy_only=False)
    cells["lat"] = lat.filter(present).to_numpy(zero_copy_only=False)
    mask = present.to_numpy(zero_copy_only=False)
    ends = np.concatenate([[0], np.cumsum(mask)]) * _WKB_POINT.itemsize
    buffers = [
        pa.py_buffer(np.packbits(mask, bitorder="little").tobytes()),
        pa.py_buffer(ends.astype(np.int32).tobytes()),
        pa.py_buffer(cells.tobytes()),
    ]
    return pa.Array.from_buffers(pa.binary(), len(mask), buffers)


def line_wkb(
    lon: NDArray[np.float64], lat: NDArray[np.float64], first: NDArray[np.integer[Any]]
) -> pa.Array:
    """Lines as WKB.

    Args:
        lon: degrees, all vertices of all lines, shape (v,).
        lat: degrees, shape (v,).
        first: where each line's vertices begin, shape (n + 1,); at least two vertices each.

    Returns:
        n binary values.
    """
    count = np.diff(first)
    size = _WKB_HEAD.itemsize + 16 * count
    ends = np.concatenate([[0], np.cumsum(size)])
    heads = np.empty(len(count), _WKB_HEAD)
    heads["order"], heads["type"], heads["count"] = 1, 2, count
    is_head = np.zeros(ends[-1], bool)
    is_head[(ends[:-1, None] + np.arange(_WKB_HEAD.itemsize)).ravel()] = True
    cells = np.empty(ends[-1], np.uint8)
    cells[is_head] = heads.view(np.uint8)
    cells[~is_head] = np.column_stack([lon, lat]).astype("<f8").view(np.uint8).ravel()
    kind, width = (pa.binary(), np.int32) if ends[-1] < 1 << 31 else (pa.large_binary(), np.int64)
    buffers = [None, pa.py_buffer(ends.astype(width).tobytes()), pa.py_buffer(cells.tobytes())]
    return pa.Array.from_buffers(kind, len(count), buffers)


def geometry(table: pa.Table) -> pa.Array | None:
    """The table's geometry as WKB: its `geometry` column, else its `lat`, `lon`, else None."""
    if "geometry" in table.column_names:
        return table["geometry"].combine_chunks()
    if {"lat", "lon"} <= set(table.column_names):
        return point_wkb(table["lon"].combine_chunks(), table["lat"].combine_chunks())
    return None


def geo_frame(table: pa.Table) -> Any:
    """The table as a GeoDataFrame in EPSG:4326; positions that are absent are None."""
    with comes_with("geo", "points and path as frames (to_arrow() and write() need no extra)"):
        import geopandas
    import shapely

    wkb = geometry(table)
    columns = [name for name in table.column_names if name != "geometry"]
    frame = table.select(columns).to_pandas()
    if wkb is None:
        return frame
    shapes = shapely.from_wkb(wkb.to_numpy(zero_copy_only=False))
    return geopandas.GeoDataFrame(frame, geometry=shapes, crs="EPSG:4326")


def with_iso_times(table: pa.Table) -> pa.Table:
    """The same table with every timestamp as ISO 8601 text in UTC, ending in Z."""
    for index, column in enumerate(table.schema):
        if pa.types.is_timestamp(column.type):
            text = table.column(index).cast(pa.timestamp("us", tz="UTC")).cast(pa.string())
            iso = pc.replace_substring(text, " ", "T")
            table = table.set_column(index, column.name, iso)
    return table


def thinned(points: pa.Table, every: float | None, *, whole: bool = False) -> pa.Table:
    """The first row of each `every` seconds of each drive, counted from the drive's start.

    Args:
        points: Or another table with `drive_id` and `time`, in order.
        every: s; None: all rows stay.
        whole: Whether all rows of that row's time are kept, where an epoch has several.
    """
    if not every or points.num_rows == 0:
        return points
    drive = points["drive_id"].combine_chunks()
    same = pc.equal(drive.slice(1), drive.slice(0, len(drive) - 1))
    new = np.append(True, ~same.to_numpy(zero_copy_only=False))
    micros = points["time"].cast(TIME).cast(pa.int64()).to_numpy()
    began = micros[np.maximum.accumulate(np.where(new, np.arange(len(new)), 0))]
    cell = (micros - began) // round(every * 1e6)
    first = new | np.append(True, np.diff(cell) != 0)
    if whole:
        first = micros == micros[np.flatnonzero(first)][np.cumsum(first) - 1]
    return points.filter(pa.array(first))


def read_arrow(data: bytes) -> tuple[pa.Table, bool]:
    """An Arrow file or stream, and whether it was whole; only a recording may be torn.

    Raises:
        pa.ArrowException: It is neither, or damaged.
    """
    if data[:6] in (b"ARROW1", b"FEA1\0\0") or data[:4] == b"FEA1":
        return feather.read_table(pa.BufferReader(data)), True
    reader = pa.ipc.open_stream(pa.BufferReader(data))
    batches, whole = [], True
    try:
        for batch in reader:
            batches.append(batch)
    except (pa.ArrowException, OSError):
        if RECORDING.items() - (reader.schema.metadata or {}).items():
            raise
        whole = False
    return pa.Table.from_batches(batches, reader.schema), whole
