"""The filter's map: the true streets with the errors of a map.

A sound map is about 1.5 m off as a whole and 1 m locally, drawn with vertices up to 0.7 m beside
the line; six in ten streets tell their lanes, one in two its speed limit.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

import whichroad

from .faults import Event, has
from .nets import Net

INVENTED = 1_000_000  # ids of invented streets begin here
_KNOWN = frozenset(
    {"motorway", "motorway_link", "trunk", "trunk_link", "primary", "primary_link", "secondary",
     "secondary_link", "tertiary", "tertiary_link", "residential", "unclassified", "service",
     "living_street"}
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Chart:
    """A map as the filter has it, and what its roads are in truth.

    A road is a chain of the map's edges without a decision in it.
    """

    roads: Any  # whichroad.RoadMap
    road_of_edge: np.ndarray  # (E,) road of each edge
    road_of_code: np.ndarray  # (codes,) road that holds a true directed road; -1: not mapped
    degree: dict[str, int]  # streets at each node, true and invented
    lines: np.ndarray  # of all streets, true and invented, as shapely has them
    tree: Any  # shapely's, over the lines
    lanes: list[int]  # of each of them, as the map says; 0: it does not
    false_nodes: frozenset[str]  # where invented streets begin and end
    plane: "Plane"


class Plane:
    """Metres about a place, and degrees."""

    def __init__(self, lat_deg: float, lon_deg: float) -> None:
        from pyproj import Proj

        self._proj = Proj(proj="aeqd", lat_0=lat_deg, lon_0=lon_deg, ellps="WGS84")

    def degrees(self, xy: np.ndarray) -> np.ndarray:
        """Longitude and latitude of (n, 2) metres."""
        return np.column_stack(self._proj(xy[:, 0], xy[:, 1], inverse=True))

    def metres(self, lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
        """(n, 2) metres east and north."""
        return np.column_stack(self._proj(lon, lat))


def draw_map(
    net: Net, faults: list[Event], random: np.random.Generator, offset: float | None = None,
    relative: float = 1.0,
) -> Chart:  # fmt: skip
    """A map of a net.

    Args:
        net: The truth.
        faults: Of the map.
        random: Of this world.
        offset: m, by which the whole map is off; None: 1.5 m of each axis, drawn.
        relative: m, of each axis, by which it is off locally.
    """
    import shapely

    rows = [_row(k, net, faults, random) for k in range(len(net.streets))]
    if has(faults, "missing"):
        gone = random.random(len(rows)) < 0.05
        rows = [r for r, g in zip(rows, gone, strict=True) if not g]
    invented = _invented(net, random) if has(faults, "invented") else []
    move = _field(faults, random, offset, relative)
    tolerance = 8.0 if has(faults, "chords") else min(0.7, 0.7 * relative)
    plane = Plane(net.lat_deg, net.lon_deg)
    roads = _compiled([*rows, *invented], move, tolerance, plane)
    road_of_edge = chain_roads(roads.arrays.edges)
    degree: dict[str, int] = {}
    for ends in [s.nodes for s in net.streets] + [(r["from"], r["to"]) for r in invented]:
        for node in ends:
            degree[node] = degree.get(node, 0) + 1
    true = [s.line for s in net.streets] + [r["line"] for r in invented]
    lines = np.array([shapely.LineString(p) for p in true], dtype=object)
    known = {r["id"]: r["lanes"] or 0 for r in [*rows, *invented]}
    return Chart(
        roads, road_of_edge, roads_of_codes(roads, road_of_edge, 2 * len(net.streets)), degree,
        lines, shapely.STRtree(lines),
        [known.get(k, 0) for k in range(len(net.streets))] + [r["lanes"] or 0 for r in invented],
        frozenset(n for r in invented for n in (r["from"], r["to"])), plane,
    )  # fmt: skip


def _row(k: int, net: Net, faults: list[Event], random: np.random.Generator) -> dict[str, Any]:
    """A street as the map's table has it."""
    s = net.streets[k]
    a, b, c, d = random.random(4)
    lanes = s.lanes if a < 0.6 else None
    if has(faults, "lanes_wrong") and b < 0.5:
        lanes = int(random.integers(1, 5))
    if has(faults, "lanes_absent"):
        lanes = None
    oneway = 1 if s.oneway else 0
    if has(faults, "oneway") and c < 0.05:
        oneway = -1 if s.oneway else int(random.choice([-1, 1]))
    return {
        "id": k, "from": s.nodes[0], "to": s.nodes[1], "line": s.line, "oneway": oneway,
        "highway": s.highway if s.highway in _KNOWN else "road", "lanes": lanes,
        "maxspeed": round(3.6 * s.speed / 10.0) * 10.0 if d < 0.5 else None,
        "junction": "roundabout" if s.ring else "",
    }  # fmt: skip


def _invented(net: Net, random: np.random.Generator) -> list[dict[str, Any]]:
    """Streets that do not exist: between nodes near each other, or beside a street."""
    ends = {n: np.array(p) for s in net.streets for n, p in zip(s.nodes, (s.line[0], s.line[-1]),
                                                               strict=True)}  # fmt: skip
    names = list(ends)
    points = np.array([ends[n] for n in names])
    joined = {frozenset(s.nodes) for s in net.streets}
    rows: list[dict[str, Any]] = []
    while len(rows) < 0.05 * len(net.streets):
        if random.random() < 0.5:
            a = int(random.integers(len(names)))
            away = np.hypot(*(points - points[a]).T)
            near = np.flatnonzero((away > 60.0) & (away < 250.0))
            if not len(near):
                continue
            b = int(random.choice(near))
            pair = names[a], names[b]
            if frozenset(pair) in joined:
                continue
            line = points[[a, b]]
        else:
            s = net.streets[int(random.integers(len(net.streets)))]
            long = float(np.hypot(*np.diff(s.line, axis=0).T).sum())
            if long < 80.0 or s.nodes[0] == s.nodes[1]:
                continue
            pair, line = s.nodes, beside(s.line, float(random.uniform(8.0, 18.0)))
        rows.append(
            {"id": INVENTED + len(rows), "from": pair[0], "to": pair[1], "line": line, "oneway": 0,
             "highway": "residential", "lanes": None, "maxspeed": None, "junction": ""}
        )  # fmt: skip
    return rows


def beside(line: np.ndarray, gap: float) -> np.ndarray:
    """A line that leaves another at its ends and runs `gap` m left of it between."""
    d = np.gradient(line, axis=0)
    left = np.column_stack([-d[:, 1], d[:, 0]]) / np.hypot(*d.T)[:, None]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.unique(np.concatenate([along, np.linspace(0.0, along[-1], 9)]))
    p = np.column_stack([np.interp(at, along, line[:, i]) for i in (0, 1)])
    q = np.column_stack([np.interp(at, along, left[:, i]) for i in (0, 1)])
    share = np.minimum(1.0, np.minimum(at, along[-1] - at) / 25.0)
    return np.asarray(p + gap * share[:, None] * q)


def _field(
    faults: list[Event], random: np.random.Generator, offset: float | None, relative: float
) -> Any:
    """How far each place of the map is off, as a function of (n, 2) metres."""
    shift = random.normal(0.0, 1.5, 2)
    if has(faults, "shift"):
        course, far = random.uniform(0, 2 * np.pi), random.uniform(10.0, 30.0)
        shift = far * np.array([np.cos(course), np.sin(course)])
    if offset is not None:
        course = random.uniform(0, 2 * np.pi)
        shift = offset * np.array([np.cos(course), np.sin(course)])
    sigma, waves = relative, random.uniform(150.0, 900.0, 24)
    if has(faults, "warp"):
        sigma, waves = float(random.uniform(5.0, 8.0)), random.uniform(250.0, 500.0, 24)
    course, phase = random.uniform(0, 2 * np.pi, 24), random.uniform(0, 2 * np.pi, (24, 2))
    wave = 2 * np.pi / waves * np.array([np.cos(course), np.sin(course)])

    def move(p: np.ndarray) -> np.ndarray:
        angle = p @ wave
        warp = [np.cos(angle + phase[:, i]).sum(1) for i in (0, 1)]
        return p + shift + sigma * np.sqrt(2.0 / 24) * np.column_stack(warp)

    return move


def _compiled(rows: list[dict[str, Any]], move: Any, tolerance: float, plane: Plane) -> Any:
    """The map that whichroad compiles of the rows."""
    import geopandas
    import shapely

    lines = []
    for r in rows:
        dense = shapely.segmentize(shapely.LineString(r["line"]), 25.0)
        moved = shapely.LineString(move(np.array(dense.coords)))
        lines.append(shapely.LineString(plane.degrees(np.array(moved.simplify(tolerance).coords))))
    columns = {n: [r[n] for r in rows] for n in rows[0] if n not in ("line", "oneway")}
    columns["oneway"] = [{1: "yes", 0: "no", -1: "-1"}[r["oneway"]] for r in rows]
    table = geopandas.GeoDataFrame(columns, geometry=lines, crs="EPSG:4326")
    return whichroad.RoadMap.from_edges(table, directed=False)


def chain_roads(edges: Any) -> np.ndarray:
    """Chains of edges without a decision: edges joined over nodes where two streets meet.

    Args:
        edges: (E,) with `from_node`, `to_node` and `opposite`.

    Returns:
        (E,) number of each edge's chain.
    """
    n = len(edges)
    root = np.arange(n)

    def find(k: int) -> int:
        while root[k] != k:
            root[k] = root[root[k]]
            k = int(root[k])
        return k

    leaving: dict[int, list[int]] = {}
    for e, node in enumerate(np.asarray(edges["from_node"]).tolist()):
        leaving.setdefault(node, []).append(e)
    to, opposite = np.asarray(edges["to_node"]).tolist(), np.asarray(edges["opposite"]).tolist()
    for e in range(n):
        on = [f for f in leaving.get(to[e], []) if f != opposite[e]]
        if len(leaving.get(to[e], [])) == 2 and len(on) == 1:
            root[find(e)] = find(on[0])
    return np.array([find(e) for e in range(n)])


def roads_of_codes(roads: Any, road_of_edge: np.ndarray, codes: int) -> np.ndarray:
    """The road of each true directed road, -1 where the map lacks it."""
    found = np.full(codes, -1)
    pieces = roads.pieces
    first = np.asarray(pieces.first)
    edge = np.repeat(np.arange(len(first) - 1), np.diff(first))
    ids, forward = roads.drawn_as(np.arange(len(edge)))
    street = np.array([int(i) for i in ids])
    true = street < INVENTED
    code = 2 * street[true] + ~np.asarray(forward)[true]
    found[code] = road_of_edge[edge[true]]
    return found
