"""Tables of a map: its edges, and a path on it by the roads of the source."""

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import MapError, comes_with
from ..graph.network import AGAINST_ONE_WAY, NO_ACCESS
from ..observations import Array
from ..ragged import row_and_place
from .shelf import release
from .source_places import SourcePlace, on_source
from .streets import Ints, Texts

if TYPE_CHECKING:
    import geopandas

    from .roadmap import RoadMap

IDS = ("source_id", "back_id", "paired")  # columns of ways that name them
_NEEDED = ("edge_id", "enter_time", "exit_time", "enter_m", "exit_m")
_AT_ONCE = 1 << 16  # vertices
_OF_EDGES = ("from_node", "to_node")  # a road of the source need not end at a junction


def info(roads: "RoadMap") -> dict[str, Any]:
    """What a map holds, in numbers."""
    edges = roads.arrays.edges
    legal = edges.rule == 0
    once = legal & ((edges.opposite > np.arange(len(roads))) | ~legal[edges.opposite])
    lat, lon = _bounds(roads)
    words = [word or "unknown" for word in roads.column("highway")]
    highways, counts = np.unique(np.array(words), return_counts=True)
    return {
        "nodes": len(roads.node_id),
        "edges": len(roads),
        "legal_edges": int(legal.sum()),
        "against_one_way": int((edges.rule & AGAINST_ONE_WAY > 0).sum()),
        "no_access": int((edges.rule & NO_ACCESS > 0).sum()),
        "turns": len(roads.arrays.turns),
        "streets": len(roads.ways["source_id"]),
        "km": round(float(edges.length[once].sum()) / 1e3, 3),
        "lat": [round(lat[0], 6), round(lat[1], 6)],
        "lon": [round(lon[0], 6), round(lon[1], 6)],
        "highway": dict(zip(highways.tolist(), counts.tolist(), strict=True)),
    }


def _bounds(roads: "RoadMap") -> tuple[tuple[float, float], tuple[float, float]]:
    """Least and largest latitude and longitude of a map, degrees."""
    vertices = roads.arrays.vertices
    found = []
    for low in range(0, len(vertices), _AT_ONCE):
        some = vertices[low : low + _AT_ONCE]
        lat, lon = roads.plane.to_geodetic(some.x, some.y)
        found.append((lat.min(), -lat.max(), lon.min(), -lon.max()))
        release(vertices)
    south, north, west, east = (float(v) for v in np.min(found, axis=0))
    return (south, -north), (west, -east)


def edges_table(roads: "RoadMap") -> "geopandas.GeoDataFrame":
    """See `RoadMap.edges_table`."""
    with comes_with("geo", "edges_table"):
        import geopandas
    import shapely

    vertices, edges = roads.arrays.vertices, roads.arrays.edges
    lat, lon = roads.plane.to_geodetic(vertices.x, vertices.y)
    count = edges.last_vertex - edges.first_vertex + 1
    lines = shapely.linestrings(
        np.column_stack([lon, lat]), indices=np.repeat(np.arange(len(roads)), count)
    )
    ids, forward = roads.sources(np.arange(len(roads)), edges.length / 2.0)
    data = {
        "edge_id": np.arange(len(roads)),
        "source_id": ids,
        "forward": forward,
        "from_node": roads.node_ids(edges.from_node),
        "to_node": roads.node_ids(edges.to_node),
        "from_number": edges.from_node.astype(np.int64),
        "to_number": edges.to_node.astype(np.int64),
        "opposite": edges.opposite,
        "length_m": edges.length,
        "speed_mps": edges.speed,
        "against_one_way": edges.rule & AGAINST_ONE_WAY > 0,
        "no_access": edges.rule & NO_ACCESS > 0,
        **{name: roads.column(name) for name in roads.ways if name not in IDS},
    }
    return geopandas.GeoDataFrame(data, geometry=lines, crs="EPSG:4326")


def node_ids(roads: "RoadMap", node: ArrayLike) -> list[int | str]:
    """See `RoadMap.node_ids`."""
    number, count = np.asarray(node), len(roads.node_id)
    known = number.dtype.kind in "iu" and bool(np.all((number >= 0) & (number < count)))
    if number.size and not known:
        few = ", ".join(map(str, number.ravel()[:3]))
        raise MapError(
            f"node_ids: numbers of junctions such as {few}; 0 to {count - 1} were expected, as the "
            "from_node of a path has them; that of edges_table has the source's ids already"
        )
    number = number.astype(np.int64)
    if isinstance(roads.node_id, Texts):
        return list(roads.node_id.words(number))
    return cast(list[int | str], roads.node_id[number].tolist())


def by_source(roads: "RoadMap", path: Any) -> Any:
    """See `RoadMap.by_source`."""
    import pyarrow as pa

    if not isinstance(path, pa.Table):
        frame = by_source(roads, _arrow(path))
        return _geo_frame(frame)
    _check(path, roads)
    edge, enter, leave = (_numbers(path, name) for name in ("edge_id", "enter_m", "exit_m"))
    row, start, end = _parts(roads, edge.astype(np.int64), enter, leave)
    part = edge[row].astype(np.int64)
    piece = roads.piece(part, 0.5 * (start + end))
    names, forward = roads.drawn_as(piece)
    begin, finish = (_numbers(path, name) for name in ("enter_time", "exit_time"))  # µs
    length = np.maximum(leave - enter, 1e-9)[row]
    first, last = ((m - enter[row]) / length for m in (start, end))
    duration = (finish - begin)[row]
    times = [begin[row] + np.clip(share, 0.0, 1.0) * duration for share in (first, last)]
    seconds = (times[1] - times[0]) / 1e6
    moving = seconds > 0.0
    speed = np.divide(end - start, seconds, out=np.zeros(len(row)), where=moving)
    new = {
        "source_id": pa.array([str(name) for name in names]),
        "forward": pa.array(forward),
        "enter_time": _stamps(times[0], path.schema.field("enter_time").type),
        "exit_time": _stamps(times[1], path.schema.field("exit_time").type),
        "enter_m": pa.array(start),
        "exit_m": pa.array(end),
        "duration_s": pa.array(seconds),
        "mean_speed_mps": pa.array(speed, mask=~moving),
        **on_sources(roads, part, piece, start, end),
        "geometry": _lines(roads, part, start, end),
    }
    kept = path.select([n for n in path.column_names if n not in _OF_EDGES]).take(pa.array(row))
    more = [n for n in new if n.startswith("source_") and n not in kept.column_names]
    names = [*(n for n in kept.column_names if n != "geometry"), *more]
    names += ["geometry"] * ("geometry" in kept.column_names)
    table = pa.table({n: new[n] if n in new else kept[n] for n in names})
    # marks of fields, such as what geopandas knows a geometry by, stay
    marks = [None if n in more else path.schema.field(n).metadata for n in names]
    fields = [f.with_metadata(m) for f, m in zip(table.schema, marks, strict=True)]
    return table.cast(pa.schema(fields))


def on_sources(
    roads: "RoadMap", edge: Ints, piece: Ints, enter: Array, leave: Array
) -> dict[str, Any]:
    """Columns of a path that say where on the road of the source its rows begin and end.

    That road is the one in the middle; beyond it the place is its end.

    Args:
        roads: The map.
        edge: (n,) edges.
        piece: (n,) rows of `roads.pieces` in their middle.
        enter: (n,) along-track positions, m.
        leave: (n,) m.
    """
    import pyarrow as pa

    n = len(piece)
    edges, pieces = np.append(edge, edge), np.append(piece, piece)  # both ends at once
    place = on_source(roads, edges, pieces, np.append(enter, leave))
    return {
        f"source_{end}_{name}": pa.array(values[part])
        for name, values in zip(SourcePlace._fields, place, strict=True)
        for end, part in (("enter", slice(n)), ("exit", slice(n, None)))
    }


def _check(path: Any, roads: "RoadMap") -> None:
    absent = [name for name in _NEEDED if name not in path.column_names]
    if absent:
        raise MapError(
            f"path: no column {absent[0]!r} among {', '.join(path.column_names[:12])}; the path "
            "table of match or match_many was expected"
        )
    if path.num_rows and _numbers(path, "edge_id").max() >= len(roads):
        raise MapError(
            f"path: edges beyond the {len(roads):,} of this map; the map that it was matched to "
            "was expected"
        )


def _parts(
    roads: "RoadMap", edge: Ints, enter: Array, leave: Array
) -> tuple[NDArray[np.intp], Array, Array]:
    """Row of the path, and begin and end along the edge, m, of each source road's part."""
    pieces = roads.pieces
    count = (pieces.first[edge + 1] - pieces.first[edge]).astype(np.int64)
    row, place = row_and_place(count)
    piece = pieces.first[edge][row] + place
    final = place == count[row] - 1
    after = np.minimum(piece + 1, len(pieces.start) - 1)
    ends = np.where(final, np.inf, pieces.start[after])
    # the first piece begins, and the last ends, where the path does
    start = np.where(place == 0, enter[row], np.maximum(pieces.start[piece], enter[row]))
    end = np.minimum(ends, leave[row])
    one = roads.piece(edge, 0.5 * (enter + leave))  # of a row without length: where it is
    some = (end > start) | ((leave <= enter)[row] & (piece == one[row]))
    start, end = np.minimum(start, leave[row])[some], np.maximum(end, enter[row])[some]
    return row[some], start, end


def _numbers(table: Any, name: str) -> Array:
    """A column as floats, times as microseconds."""
    import pyarrow as pa

    column = table[name].combine_chunks()
    if pa.types.is_timestamp(column.type):
        column = column.cast(pa.timestamp("us", tz=column.type.tz), safe=False).cast(pa.int64())
    return np.asarray(column.to_numpy(zero_copy_only=False), np.float64)


def _stamps(micros: Array, kind: Any) -> Any:
    import pyarrow as pa

    whole = pa.array(np.round(micros).astype(np.int64), pa.timestamp("us", tz=kind.tz))
    return whole.cast(kind, safe=False)


def _lines(roads: "RoadMap", edge: Ints, start: Array, end: Array) -> Any:
    """WKB of the stretches, longitude before latitude."""
    import pyarrow as pa
    import shapely

    if not len(edge):
        return pa.array([], pa.binary())
    x, y, first = roads.edge_lines(edge, start, end)
    lat, lon = roads.plane.to_geodetic(x, y)
    line = np.repeat(np.arange(len(edge)), np.diff(first))
    lines = shapely.linestrings(np.column_stack([lon, lat]), indices=line)
    return pa.array(shapely.to_wkb(lines), pa.binary())


def _arrow(frame: Any) -> Any:
    """A path of pandas as Arrow, without its geometry, which is made anew."""
    import pyarrow as pa

    names = [n for n in frame.columns if n != "geometry"]
    table = pa.Table.from_pandas(frame[names], preserve_index=False)
    return table.append_column("geometry", pa.nulls(table.num_rows, pa.binary()))


def _geo_frame(table: Any) -> Any:
    with comes_with("geo", "a path as a frame (an Arrow table needs no extra)"):
        import geopandas
    import shapely

    frame = table.drop_columns("geometry").to_pandas()
    shapes = shapely.from_wkb(table["geometry"].to_numpy())
    return geopandas.GeoDataFrame(frame, geometry=shapes, crs="EPSG:4326")
