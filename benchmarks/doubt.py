"""How long is a drive `ambiguous` where nobody would ask which road it is on?

Not counted is what is near a fork (50 m from a node with two legal successors that differ by
less than 30 degrees) or near a parallel road (within 20 m, within 30 degrees of it, either
direction, and neither of the street itself nor of its continuation).  The rest is doubt
that misleads.
"""

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import shapely

import whichroad
from whichroad.demo import run_demo

from . import Figure, Options
from .comma import load

FORK_M = 50.0
PARALLEL_M = 20.0
ALIKE = math.radians(30.0)


def turned(one: float, other: float) -> float:
    """Angle between two headings, rad."""
    return abs(math.remainder(one - other, math.tau))


def forks(roads: whichroad.RoadMap) -> Any:
    """Nodes at which two legal ways on lie within 30 degrees of each other, as one shape."""
    edges, turns, vertices = roads.arrays.edges, roads.arrays.turns, roads.arrays.vertices
    places = []
    for edge in edges:
        ways = turns[edge["first_turn"] : edge["end_turn"]]
        ways = ways[(ways["rule"] == 0) & (ways["edge"] != edge["opposite"])]
        angles = ways["angle"].tolist()
        if any(turned(a, b) < ALIKE for i, a in enumerate(angles) for b in angles[:i]):
            end = vertices[edge["last_vertex"]]
            places.append((end["x"], end["y"]))
    return shapely.multipoints(np.array(places).reshape(-1, 2))


def lines(roads: whichroad.RoadMap) -> np.ndarray:
    """The centre line of every directed edge, plane."""
    v = roads.arrays.vertices
    xy = np.column_stack([v["x"], v["y"]])
    return np.array(
        [
            shapely.linestrings(xy[e["first_vertex"] : e["last_vertex"] + 1])
            for e in roads.arrays.edges
        ]
    )


def has_parallel(roads: whichroad.RoadMap, tree: Any, shapes: Any, edge: int, s: float) -> bool:
    """Whether a road that is not this one's, nor joined to it, runs along it at a place."""
    x, y, heading = roads.at(edge, s)
    record = roads.arrays.edges[edge]
    nodes = {int(record["from_node"]), int(record["to_node"])}
    for other in tree.query(shapely.Point(x, y).buffer(PARALLEL_M)).tolist():
        row = roads.arrays.edges[other]
        if nodes & {int(row["from_node"]), int(row["to_node"])}:
            continue
        line = shapes[other]
        at = line.project(shapely.Point(x, y))
        if not 1.0 < at < line.length - 1.0 or line.distance(shapely.Point(x, y)) > PARALLEL_M:
            continue
        a, b = line.interpolate(at - 1.0), line.interpolate(at + 1.0)
        apart = turned(math.atan2(b.y - a.y, b.x - a.x), heading)
        if min(apart, math.pi - apart) < ALIKE:
            return True
    return False


def doubt(points: Any, roads: whichroad.RoadMap) -> tuple[float, float, float]:
    """Shares of the time: ambiguous, doubt that misleads, and the same with P(edge)."""
    shapes = lines(roads)
    tree, nodes = shapely.STRtree(shapes), forks(roads)
    time = points["time"].astype("datetime64[us, UTC]").astype("int64").to_numpy() / 1e6
    held = np.minimum(np.append(np.diff(time), 0.0), 10.0)
    x, y = roads.plane.from_geodetic(points["lat"].to_numpy(), points["lon"].to_numpy())
    edge = points["edge_id"].fillna(-1).astype(int).to_numpy()
    s = points["abscissa_m"].to_numpy()
    limit = whichroad.Settings().ambiguous_below
    ambiguous = (points["status"] == "ambiguous").to_numpy()
    # the status as it would be by P of the edge alone
    before = (
        ambiguous
        | (
            points["status"].isin(["on_road", "stopped", "outage"])
            & (points["p_road"] < limit)
            & (points["p_off_road"] <= 0.5)
        ).to_numpy()
    )
    clear = np.zeros(len(points), bool)
    for k in np.flatnonzero(before & (edge >= 0)):
        place = shapely.Point(x[k], y[k])
        clear[k] = shapely.distance(nodes, place) > FORK_M if len(nodes.geoms) else True
        clear[k] = clear[k] and not has_parallel(roads, tree, shapes, int(edge[k]), float(s[k]))
    total = held.sum()
    return (
        float(held[ambiguous].sum() / total),
        float(held[ambiguous & clear].sum() / total),
        float(held[before & clear].sum() / total),
    )


def run(options: Options) -> list[Figure]:
    """The demo's drive, and the kilometre of San Francisco with all its fixes."""
    with tempfile.TemporaryDirectory() as folder:
        run_demo(Path(folder) / "demo")
        import geopandas

        answers = [
            ("demo", geopandas.read_parquet(Path(folder) / "demo" / "points.parquet"),
             whichroad.RoadMap.from_osm(Path(folder) / "demo" / "map.osm"))
        ]  # fmt: skip
    roads = whichroad.RoadMap.from_edges(options.need("comma_sf", "comma_sf_osm_clip.geojson"))
    answers.append(("comma_sf", whichroad.match(load(options), roads).points, roads))
    figures = []
    for name, points, roads in answers:
        every, misleading, by_edge = doubt(points, roads)
        n = len(points)
        figures += [
            Figure(f"{name}: ambiguous where no road competes", 100 * misleading, "<= 1", "%", n),
            Figure(f"{name}: the same by P of the edge", 100 * by_edge, "", "%", n),
            Figure(f"{name}: ambiguous anywhere", 100 * every, "", "%", n),
        ]
    return figures
