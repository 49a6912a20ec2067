"""Towns drawn at random, with streets side by side, in SUMO's plain node and edge files."""

from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

_KINDS = ("street", "wide", "one-way", "dual", "frontage")
_SHARES = (0.45, 0.1, 0.1, 0.15, 0.2)

Road = tuple[Any, dict[str, Any]]  # shapely's line, and what SUMO is told of it


def draw_town(side: float, random: np.random.Generator) -> tuple[list[str], list[str]]:
    """Wavy streets in two families, dual carriageways, frontage roads, roundabouts, gaps.

    Args:
        side: m, of the square.
        random: Of this town.

    Returns:
        Lines of SUMO's node file and of its edge file.
    """
    roads: list[Road] = []
    for turn in (0.0, float(random.uniform(1.2, 1.9))):
        at = -0.42 * side
        while at < 0.42 * side:
            roads += _lines(at, turn, side, random)
            at += float(random.uniform(130.0, 480.0))
    return _noded(_with_rings(roads, random), random)


def _lines(at: float, turn: float, side: float, random: np.random.Generator) -> list[Road]:
    """One road across the town, with what runs beside it."""
    from shapely import LineString, affinity

    u = np.arange(-0.5 * side, 0.5 * side, 20.0)
    wave, length, phase = random.uniform(0, 60), random.uniform(600, 2500), random.uniform(0, 7)
    line = LineString(np.column_stack([u, at + wave * np.sin(2 * np.pi * u / length + phase)]))
    line = affinity.rotate(line, turn, origin=(0, 0), use_radians=True)
    kind = str(random.choice(_KINDS, p=_SHARES))
    gap = float(random.uniform(8.0, 25.0))
    lanes = int(random.integers(1, 4))
    fast = float(random.choice([8.3, 13.9, 13.9, 19.4]))
    main = {"lanes": 1, "oneway": False, "highway": "residential", "speed": fast, "ring": False}
    if kind == "wide":
        main |= {"lanes": 2, "highway": "secondary", "speed": 13.9}
    if kind == "one-way":
        main |= {"lanes": lanes, "oneway": True, "highway": "tertiary"}
        return [(line if random.random() < 0.5 else line.reverse(), main)]
    if kind == "dual":
        main |= {"lanes": lanes, "oneway": True, "highway": "primary", "speed": 19.4}
        right, left = line.offset_curve(-0.5 * gap), line.offset_curve(0.5 * gap)
        return [(right, main), (left.reverse(), main)]
    if kind == "frontage":
        main |= {"lanes": min(lanes, 2), "highway": "secondary", "speed": 19.4}
        side = main | {"lanes": 1, "highway": "service", "speed": 8.3}
        beside = line.offset_curve(gap if random.random() < 0.5 else -gap)
        found = [(line, main), (beside, side)]
        s = float(random.uniform(100, 400))
        while s < line.length - 200:
            slant = float(random.uniform(10, 60))
            ends = [
                line.interpolate(s),
                beside.interpolate(beside.project(line.interpolate(s)) + slant),
            ]
            found.append((LineString(ends), side))
            s += float(random.uniform(250, 700))
        return found
    return [(line, main)]


def _with_rings(roads: list[Road], random: np.random.Generator) -> list[Road]:
    """Roundabouts at some of the crossings of the first lines."""
    from shapely import LineString, Point
    from shapely.ops import unary_union

    rings, discs = [], []
    for i, (a, what) in enumerate(roads):
        for b, other in roads[i + 1 :]:
            crossing = a.intersection(b)
            plain = what["highway"] != "service" != other["highway"]
            if crossing.geom_type != "Point" or not plain or random.random() > 0.12:
                continue
            radius = float(random.uniform(12.0, 30.0))
            if any(crossing.distance(Point(d.centroid)) < 100.0 for d in discs):
                continue
            angle = np.linspace(0.0, 2.0 * np.pi, 25)
            points = np.column_stack(
                [crossing.x + radius * np.cos(angle), crossing.y + radius * np.sin(angle)]
            )
            points[-1] = points[0]
            discs.append(crossing.buffer(radius * 0.999, 64))
            ring = {"lanes": 1, "oneway": True, "highway": "tertiary", "speed": 8.3, "ring": True}
            rings.append((LineString(points), ring))
    if not discs:
        return roads
    hole = unary_union(discs)
    out = []
    for line, what in roads:
        rest = line.difference(hole)
        parts = getattr(rest, "geoms", [rest])
        # what was cut is prolonged a little, so that it crosses the ring
        out += [(_longer(p), what) for p in parts if p.length > 15.0]
    return out + rings


def _longer(line: Any) -> Any:
    from shapely import LineString

    p = np.array(line.coords)
    a, b = p[0] - p[1], p[-1] - p[-2]
    p[0] += 1.0 * a / np.hypot(*a)
    p[-1] += 1.0 * b / np.hypot(*b)
    return LineString(p)


def _noded(roads: list[Road], random: np.random.Generator) -> tuple[list[str], list[str]]:
    """Lines of the node and edge files: roads cut where they cross, some pieces left out."""
    import shapely
    from shapely.ops import substring

    lines = np.array([line for line, _ in roads], dtype=object)
    tree = shapely.STRtree(lines)
    names: dict[tuple[int, int], str] = {}
    nodes, edges = [], []

    def node(p: Any) -> str:
        key = round(p[0] / 2.0), round(p[1] / 2.0)
        for near in ((key[0] + i, key[1] + j) for i in (0, -1, 1) for j in (0, -1, 1)):
            if near in names:
                return names[near]
        names[key] = f"n{len(names)}"
        nodes.append(f'<node id="{names[key]}" x="{p[0]:.2f}" y="{p[1]:.2f}"/>')
        return names[key]

    for i, (line, what) in enumerate(roads):
        cuts = {0.0, line.length}
        for j in tree.query(line, predicate="intersects"):
            if j != i:
                met = shapely.get_coordinates(line.intersection(lines[j]))
                cuts |= {float(line.project(shapely.Point(p))) for p in met}
        at = np.array(sorted(cuts))
        at = at[np.concatenate([[True], np.diff(at) > 4.0])]
        at[-1] = line.length
        for k in range(len(at) - 1):
            piece = np.array(substring(line, at[k], at[k + 1]).coords)
            if not what["ring"] and random.random() < 0.07:
                continue
            if not what["ring"] and at[k + 1] - at[k] < 12.0 and k in (0, len(at) - 2):
                continue
            ends = node(piece[0]), node(piece[-1])
            if ends[0] == ends[1]:
                continue
            edges += _edge(f"e{i}_{k}", ends, piece, what)
    return nodes, edges


def _edge(name: str, ends: tuple[str, str], p: np.ndarray, what: dict[str, Any]) -> list[str]:
    out = []
    for back in (False,) if what["oneway"] else (False, True):
        a, b = ends[::-1] if back else ends
        shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in (p[::-1] if back else p))
        inner = f" shape={quoteattr(shape)}" if len(p) > 2 else ""
        spread = ' spreadType="center"' if what["oneway"] else ""
        out.append(
            f'<edge id="{"-" if back else ""}{name}" from="{a}" to="{b}" '
            f'numLanes="{what["lanes"]}" speed="{what["speed"]}" '
            f'type="highway.{what["highway"]}"{inner}{spread}/>'
        )
    return out
