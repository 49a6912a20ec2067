"""What is wrong with a road map, each with its place: ends that do not meet, islands, traps.

A defect costs a drive its road.  Nothing is changed: the table says where to look.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError
from .reached import reached
from .streets import Ints

if TYPE_CHECKING:
    import pyarrow as pa

    from .roadmap import RoadMap

_NEAR = 1.0  # m, within which an end that meets nothing seems to have missed a road
_SHORT = 0.5  # m, shorter edges have no direction
_OVER = 0.5  # m, within which two roads lie over each other
_PARALLEL = 0.1  # rad
_FAR = 10.0  # degrees, wider maps have points in another reference system
_NULL_ISLAND = 1.0  # degrees about 0, 0
_SEEDS = 5  # nodes from which the whole network is looked for
KINDS = {
    "dangling": "an end within a metre of a road that it does not meet",
    "short": "an edge shorter than half a metre",
    "overlap": "a road drawn over another one",
    "island": "roads that hang together with no others",
    "no exit": "it can be entered, but not left without breaking a rule",
    "no entry": "it can be left, but not entered without breaking a rule",
    "place": "places that no road map has: is the reference system right?",
}


class _Defect(NamedTuple):
    kind: str
    edge: int
    s: float  # m
    detail: str


def defects(roads: "RoadMap", path: Any = None) -> "pa.Table":
    """The defects of a map, a row each.

    Args:
        roads: The map.
        path: Of drives on this map (Arrow); None: none is looked at.

    Returns:
        `kind`, `what`, `lat`, `lon`, `edge_id`, `source_id`, `detail`, and with a path
        `stumbled`: how many of its rows on the edge broke a rule or followed a gap.

    Raises:
        MapError: The path is none, or of another map.
    """
    import pyarrow as pa

    found = [*_places(roads), *_ends(roads), *_edges(roads), *_parts(roads)]
    edge = np.array([one.edge for one in found], np.int64)
    s = np.array([one.s for one in found], np.float64)
    xy = np.array([roads.at(int(e), float(m))[:2] for e, m in zip(edge, s, strict=True)])
    lat, lon = roads.plane.to_geodetic(*xy.reshape(-1, 2).T)
    ids = roads.sources(edge, s)[0] if len(found) else []
    columns: dict[str, Any] = {
        "kind": pa.array([one.kind for one in found], pa.string()),
        "what": pa.array([KINDS[one.kind] for one in found], pa.string()),
        "lat": pa.array(lat),
        "lon": pa.array(lon),
        "edge_id": pa.array(edge),
        "source_id": pa.array([str(one) for one in ids], pa.string()),
        "detail": pa.array([one.detail for one in found], pa.string()),
    }
    if path is not None:
        columns["stumbled"] = pa.array(_stumbled(roads, path)[edge])
    return pa.table(columns)


def _stumbled(roads: "RoadMap", path: Any) -> Ints:
    """Rows of a path that broke a rule or followed a gap, on each edge in any direction, (E,)."""
    if not {"edge_id", "broken_rule"} <= set(path.column_names):
        raise MapError(
            f"path: columns {', '.join(path.column_names[:12])}; the path table of match or "
            "match_many, with edge_id and broken_rule, was expected"
        )
    rows = path.filter(path["broken_rule"].is_valid())
    edge = np.asarray(rows["edge_id"], np.int64)
    if len(edge) and edge.max() >= len(roads):
        raise MapError(
            f"path: edges beyond the {len(roads):,} of this map; the map that it was matched to "
            "was expected"
        )
    count = np.bincount(edge, minlength=len(roads))
    other = roads.arrays.edges.opposite
    return np.asarray(count + np.where(other >= 0, count[other], 0))


def _places(roads: "RoadMap") -> Iterator[_Defect]:
    """Whether the map lies where maps lie."""
    v = roads.arrays.vertices
    lat, lon = roads.plane.to_geodetic(v.x, v.y)
    height, width = float(np.ptp(lat)), float(np.ptp(lon))
    if max(height, width) > _FAR:
        yield _Defect("place", 0, 0.0, f"the map is {height:.1f} by {width:.1f} degrees")
    if np.any((np.abs(lat) < _NULL_ISLAND) & (np.abs(lon) < _NULL_ISLAND)):
        yield _Defect("place", 0, 0.0, "some of it lies at 0, 0")


def _ends(roads: "RoadMap") -> Iterator[_Defect]:
    """Dead ends beside roads that they do not meet."""
    edges = roads.arrays.edges
    degree = np.bincount(edges.from_node, minlength=len(roads.node_id))
    level = _levels(roads)
    dead = (degree[edges.to_node] == 1) & (edges.length > _NEAR)
    for e in np.flatnonzero(dead).tolist():
        x, y, _ = roads.at(e, float(edges.length[e]))
        near = roads.near(x, y, _NEAR * 1.01)
        node = edges.to_node[e]
        for other, distance in zip(near.edge.tolist(), near.distance.tolist(), strict=True):
            meets = node in (edges.from_node[other], edges.to_node[other])
            if not meets and other != e and distance <= _NEAR and level[other] == level[e]:
                name, _ = roads.source(other, 0.5 * float(edges.length[other]))
                detail = f"{distance:.2f} m from {name} (edge {other})"
                yield _Defect("dangling", e, float(edges.length[e]), detail)
                break


def _levels(roads: "RoadMap") -> Ints:
    """A number of each edge's level; roads of different ones may cross."""
    level = np.zeros(len(roads), np.int64)
    for name in ("layer", "bridge", "tunnel"):
        values = np.array([int(value or 0) for value in roads.column(name)], np.int64)
        level = level * 1000 + values
    return level


def _edges(roads: "RoadMap") -> Iterator[_Defect]:
    """Edges that are too short, or lie over others."""
    edges, level = roads.arrays.edges, _levels(roads)
    once = (edges.opposite < 0) | (edges.opposite > np.arange(len(edges)))
    for e in np.flatnonzero(once).tolist():
        length = float(edges.length[e])
        if length < _SHORT:
            yield _Defect("short", e, 0.5 * length, f"{length:.3f} m")
            continue
        x, y, heading = roads.at(e, 0.5 * length)
        near = roads.near(x, y, _OVER)
        for other, s in zip(near.edge.tolist(), near.s.tolist(), strict=True):
            if other in (e, edges.opposite[e]) or level[other] != level[e] or other < e:
                continue
            apart = roads.at(other, s)[2] - heading
            if abs(np.sin(apart)) < _PARALLEL and _SHORT < s < edges.length[other] - _SHORT:
                name, _ = roads.source(other, s)
                yield _Defect("overlap", e, 0.5 * length, f"over {name} (edge {other})")
                break


def _parts(roads: "RoadMap") -> Iterator[_Defect]:
    """Islands, and what cannot be left or entered by legal ways."""
    edges = roads.arrays.edges
    a, b = edges.from_node.astype(np.int64), edges.to_node.astype(np.int64)
    part = _components(a, b, len(roads.node_id))
    size = np.bincount(part[a], edges.length, part.max() + 1) / 2.0
    main = int(size.argmax())
    _, first = np.unique(part[a], return_index=True)
    for e in first.tolist():
        if part[a[e]] != main:
            detail = f"{size[part[a[e]]]:,.0f} m of roads"
            yield _Defect("island", e, 0.5 * float(edges.length[e]), detail)
    legal = np.flatnonzero((edges.rule == 0) & (part[a] == main))
    if not len(legal):
        return
    away, back = _network(a[legal], b[legal], len(roads.node_id))
    shared = away & back
    for kind, inside in (("no exit", away & ~back), ("no entry", back & ~away)):
        node = b if kind == "no exit" else a
        other = a if kind == "no exit" else b
        for e in legal[inside[node[legal]] & shared[other[legal]]].tolist():
            yield _Defect(kind, e, 0.5 * float(edges.length[e]), "by legal ways alone")


def _components(a: Ints, b: Ints, n: int) -> Ints:
    """A number of the part of each node, the same where edges join them."""
    label = np.arange(n)
    while True:
        low = label.copy()
        np.minimum.at(low, a, label[b])
        np.minimum.at(low, b, label[a])
        low = low[low]
        if np.array_equal(low, label):
            return np.unique(label, return_inverse=True)[1].astype(np.int64)
        label = low


def _network(a: Ints, b: Ints, n: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Nodes that can be reached from the main network, and nodes from which it can be."""
    degree = np.bincount(np.concatenate([a, b]), minlength=n)
    onward, backward = _links(a, b, n), _links(b, a, n)
    best: tuple[int, Any] = (-1, None)
    for seed in np.argsort(-degree, kind="stable")[:_SEEDS].tolist():
        away, back = reached(seed, *onward), reached(seed, *backward)
        both = int(np.count_nonzero(away & back))
        if both > best[0]:
            best = both, (away, back)
    found: tuple[NDArray[np.bool_], NDArray[np.bool_]] = best[1]
    return found


def _links(a: Ints, b: Ints, n: int) -> tuple[Ints, Ints]:
    """Edges from a to b by the node they leave: bounds of each node's, and where they lead."""
    order = np.argsort(a, kind="stable")
    return np.searchsorted(a[order], np.arange(n + 1)), b[order]
