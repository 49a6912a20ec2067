"""Small maps with one thing to decide on each, and the routes through them.

Every scene is drawn in metres, compiled by the same code as any map, and comes with lines
for `swarm`.  A *road* is all edges between two branch points in one driving direction:
its number is 2 k + (0 as it was drawn, 1 against that), k being the name's place; streets
`a/1` and `a/2` are parts of one road `a`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core._jit import Ints32
from ..frames import Plane
from ..records import Array
from ..roadmap.tags import CLASS_SPEED_KMH, lane_offset
from .course import smooth
from .swarm import Line

if TYPE_CHECKING:
    from ..roadmap import RoadMap

Random = np.random.Generator
_ORIGIN = Plane(49.41, 2.82)
_ROUNDING = 4.0  # m, sigma over which corners are cut
_VERTICES = 18.0  # m between the vertices of drawn curves
_STOP_BEFORE = 4.0  # m
_FIRST, _LAST = 0.1, 0.15  # of the first and the last street, that are not driven


class Route(NamedTuple):
    """A line to drive, and where along it things are decided, m."""

    line: Line
    decision: float  # the branch point
    watch: float  # decisions are looked for up to here


class Scene(NamedTuple):
    """A map and the routes through it."""

    roads: "RoadMap"
    road_of: Ints32  # (E,) road of each edge
    names: tuple[str, ...]  # of the roads, by number // 2
    routes: tuple[Route, ...]


@dataclass
class Street:
    """One street as drawn: points in m, and what the map says of it."""

    points: Array  # (k, 2)
    highway: str = "secondary"
    one_way: bool = False
    ring: bool = False
    mapped: bool = True
    masked: bool = False
    kmh: float = 0.0  # driven; 0: as usual for the class

    def speed(self) -> float:
        """Usual speed, m/s."""
        return (self.kmh or CLASS_SPEED_KMH[self.highway]) / 3.6

    def lane(self) -> float:
        """Usual offset right of the centre line, m."""
        both_ways = not self.one_way
        return lane_offset(self.highway, both_ways, 1.0, 0.0, self.ring)


@dataclass
class Sketch:
    """Streets by name, drawn from shared end points; routes as lists of names."""

    streets: dict[str, Street] = field(default_factory=dict)
    routes: list[tuple[list[str], int, float]] = field(default_factory=list)
    mask: tuple[float, float] | None = None  # m along any route without GNSS

    def add(self, name: str, points: Array, **tags: Any) -> Array:
        """Draw a street; returns its last point."""
        self.streets[name] = Street(np.asarray(points, float), **tags)
        last: Array = self.streets[name].points[-1]
        return last

    def route(self, names: Sequence[str], decision: int, watch: float = 1e9) -> None:
        """A route by streets (`-name`: against its drawing), decided before number `decision`.

        `watch` is how far beyond that the decision is looked for, m.
        """
        self.routes.append((list(names), decision, watch))


def compile_scene(sketch: Sketch, turn: float) -> Scene:
    """Compile the map, turned by an angle, and prepare the routes."""
    roads = _map(sketch, turn)
    names = tuple(dict.fromkeys(name.partition("/")[0] for name in sketch.streets))
    forward = roads.sources(np.arange(len(roads)), 0.5 * roads.arrays.length)[1]
    number = {name: k for k, name in enumerate(names)}
    road_of = np.array(
        [2 * number[n] + (not f) for n, f in zip(roads.column("name"), forward, strict=True)],
        np.int32,
    )
    routes = tuple(_route(sketch, roads, number, turn, *route) for route in sketch.routes)
    return Scene(roads, road_of, names, routes)


def _placed(points: Array, turn: float) -> tuple[Array, Array]:
    """Latitude and longitude of drawn points."""
    c, s = np.cos(turn), np.sin(turn)
    x, y = points @ [c, -s], points @ [s, c]
    lat, lon = _ORIGIN.to_geodetic(x, y)
    return np.asarray(lat), np.asarray(lon)


def _map(sketch: Sketch, turn: float) -> "RoadMap":
    import geopandas as gpd
    import shapely

    from ..roadmap import RoadMap

    ends: dict[tuple[float, float], int] = {}
    rows: dict[str, list[Any]] = {}
    lines = []
    for name, street in sketch.streets.items():
        if not street.mapped:
            continue
        lat, lon = _placed(street.points, turn)
        lines.append(shapely.LineString(np.column_stack([lon, lat])))
        ids = [
            ends.setdefault((round(float(p[0]), 3), round(float(p[1]), 3)), len(ends) + 1)
            for p in street.points[[0, -1]]
        ]
        row = {
            "id": len(lines), "from": ids[0], "to": ids[1],
            "name": name.partition("/")[0],
            "highway": street.highway, "oneway": "yes" if street.one_way else "no",
            "lanes": 1 if street.one_way else 2,
            "junction": "roundabout" if street.ring else "",
        }  # fmt: skip
        for key, value in row.items():
            rows.setdefault(key, []).append(value)
    return RoadMap.from_edges(gpd.GeoDataFrame(rows, geometry=lines, crs=4326))


def _route(
    sketch: Sketch, roads: "RoadMap", number: dict[str, int], turn: float, names: list[str],
    decision: int, watch: float,
) -> Route:  # fmt: skip
    """The centre line of a route on a grid of about a metre, corners rounded."""
    streets = [sketch.streets[n.lstrip("-")] for n in names]
    parts = [
        s.points[::-1] if n.startswith("-") else s.points
        for s, n in zip(streets, names, strict=True)
    ]
    points = np.concatenate([parts[0], *(p[1:] for p in parts[1:])])
    lat, lon = _placed(points, turn)
    x, y = roads.plane.from_geodetic(lat, lon)
    s = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    ends = s[np.cumsum([len(p) - 1 for p in parts])]
    first, last = s[len(parts[0]) - 1], s[-1] - s[-len(parts[-1])]
    begin, end = _FIRST * first, s[-1] - _LAST * last
    along = np.linspace(begin, end, int(end - begin) + 2)
    on = np.minimum(np.searchsorted(ends, along, side="right"), len(names) - 1)

    def each(values: list[float], kind: type) -> Any:
        return np.array(values)[on].astype(kind)

    stop = np.zeros(len(along), np.uint8)
    stop[np.searchsorted(along, ends[:-1] - _STOP_BEFORE)] = 1
    masked = each([st.masked for st in streets], np.uint8)
    if sketch.mask is not None:
        masked[(along > sketch.mask[0]) & (along < sketch.mask[1])] = 1
    whole = np.linspace(0.0, s[-1], int(s[-1]) + 2)

    def rounded(values: Array) -> Array:
        return np.interp(along, whole, smooth(np.interp(whole, s, values), _ROUNDING))

    line = Line(
        along,
        rounded(x),
        rounded(y),
        each([st.lane() for st in streets], np.float64),
        each([st.speed() for st in streets], np.float64),
        each(
            [2 * number[n.lstrip("-").partition("/")[0]] + n.startswith("-") for n in names],
            np.int32,
        ),
        on.astype(np.int32),
        stop,
        masked,
        each([not st.mapped for st in streets], np.uint8),
    )
    at = float(ends[decision - 1])
    return Route(line, at, min(at + watch, float(end)))


def walk(
    start: Array, heading: float, pieces: Sequence[tuple[float, float]], step: float = _VERTICES
) -> tuple[Array, float]:
    """A curve of arcs (length in m, bend in 1/m): points each `step` m, heading at its end."""
    points = [np.asarray(start, float)]
    for length, bend in pieces:
        n = max(1, round(length / step))
        for _ in range(n):
            half = 0.5 * bend * length / n
            chord = length / n * np.sinc(half / np.pi)
            way = heading + half
            points.append(points[-1] + chord * np.array([np.cos(way), np.sin(way)]))
            heading += 2 * half
    return np.array(points), heading


def beside(points: Array, offset: Array) -> Array:
    """A curve moved to its left by `offset` (n,) m."""
    d = np.gradient(points, axis=0)
    d /= np.hypot(d[:, 0], d[:, 1])[:, None]
    moved: Array = points + offset[:, None] * np.column_stack([-d[:, 1], d[:, 0]])
    return moved


def _gentle(random: Random) -> float:
    """The bend of a road that is nearly straight, 1/m."""
    return float(random.normal(0.0, 1.0 / 1500.0))


def junction(random: Random, variant: int) -> Sketch:
    """A Y of 12 to 50 degrees, a Y with a straight on, a T or a cross."""
    sketch = Sketch()
    kind = variant % 4
    points, h = walk(np.zeros(2), 0.0, [(random.uniform(220, 320), _gentle(random))])
    node = sketch.add("approach", points)
    if kind == 0:
        angle = np.radians(random.uniform(12.0, 50.0))
        turns = [0.5 * angle, -0.5 * angle]
    elif kind == 1:
        turns = [0.0, np.radians(random.uniform(15.0, 60.0)) * random.choice([-1, 1])]
    elif kind == 2:
        skew = np.radians(random.uniform(-20.0, 20.0))
        turns = [np.pi / 2 + skew, -np.pi / 2 + skew]
    else:
        skew = np.radians(random.uniform(-20.0, 20.0))
        turns = [0.0, np.pi / 2 + skew, -np.pi / 2 + skew]
    for k, turn in enumerate(turns):
        line, _ = walk(node, h + turn, [(random.uniform(220, 300), _gentle(random))])
        sketch.add(f"branch {k}", line)
        sketch.route(["approach", f"branch {k}"], 1)
    return sketch


def parallel(gap: float) -> Callable[[Random, int], Sketch]:
    """A fork into two one-way roads that run `gap` m apart for 400 m."""

    def draw(random: Random, variant: int) -> Sketch:
        sketch = Sketch()
        before = random.uniform(200.0, 280.0)
        points, h = walk(np.zeros(2), 0.0, [(before, _gentle(random))])
        node = sketch.add("approach", points, one_way=True)
        base, _ = walk(node, h, [(random.uniform(380, 440), _gentle(random))], 6.0)
        part = random.uniform(30.0 + 2.0 * gap, 60.0 + 4.0 * gap)  # m, over which they part
        s = np.arange(len(base)) * 6.0
        share = 0.5 - 0.5 * np.cos(np.pi * np.minimum(s / part, 1.0))
        left = (0.5, 1.0, 0.0)[variant % 3] * gap  # both bend away, or one goes straight on
        for name, offset in (("left", left), ("right", left - gap)):
            sketch.add(name, beside(base, offset * share), one_way=True)
            sketch.route(["approach", name], 1)
        return sketch

    return draw


def roundabout(random: Random, variant: int) -> Sketch:
    """A ring of 12 to 25 m radius with four or five arms, entered from the first."""
    sketch = Sketch()
    radius, arms = random.uniform(12.0, 25.0), 4 + variant % 2
    angle = np.pi + 2 * np.pi * np.arange(arms) / arms + random.uniform(-0.2, 0.2, arms)
    for k in range(arms):
        low, high = angle[k], angle[(k + 1) % arms] + (2 * np.pi if k == arms - 1 else 0.0)
        a = np.linspace(low, high, 5)
        ring = radius * np.column_stack([np.cos(a), np.sin(a)])
        sketch.add(f"ring {k}", ring, one_way=True, ring=True, kmh=28.0)
    for k in range(arms):
        out = angle[k] + random.uniform(-0.15, 0.15)
        start = sketch.streets[f"ring {k}"].points[0]
        points, _ = walk(start, out, [(random.uniform(200, 260), _gentle(random))])
        sketch.add(f"arm {k}", points)
    sketch.streets[f"ring {arms - 1}"].points[-1] = sketch.streets["ring 0"].points[0]
    for k in range(arms - 1):  # ring k ends where ring k + 1 begins
        sketch.streets[f"ring {k}"].points[-1] = sketch.streets[f"ring {k + 1}"].points[0]
    for k in range(1, arms):
        rings = [f"ring {j}" for j in range(k)]
        sketch.route(["-arm 0", *rings, f"arm {k}"], 1 + k)
    return sketch


def grid(random: Random, variant: int) -> Sketch:
    """Narrow streets with blocks of 60 to 100 m; decided at the fourth crossing."""
    sketch, size = Sketch(), 5
    block = random.uniform(60.0, 100.0)
    node = np.array([[(c, r) for r in range(size)] for c in range(size)], float) * block
    node += random.uniform(-0.12 * block, 0.12 * block, node.shape)
    links: dict[tuple[int, int], list[tuple[str, tuple[int, int]]]] = {}
    for c in range(size):
        for r in range(size):
            for to in ((c + 1, r), (c, r + 1)):
                if max(to) < size:
                    name = f"{c}{r} {to[0]}{to[1]}"
                    sketch.add(name, np.array([node[c, r], node[to]]), highway="residential")
                    links.setdefault((c, r), []).append((name, to))
                    links.setdefault(to, []).append(("-" + name, (c, r)))
    for c in (0, size - 1):  # a stub at each corner, so that no corner is a mere bend
        for r in (0, size - 1):
            out = node[c, r] + 0.7 * block * np.sign([c - 1, r - 1])
            sketch.add(f"stub {c}{r}", np.array([node[c, r], out]), highway="residential")
    while len(sketch.routes) < 10:
        at = (int(random.integers(size)), int(random.integers(size)))
        names: list[str] = []
        while len(names) < 6:
            back = names[-1].lstrip("-") if names else ""
            ways = [w for w in links[at] if w[0].lstrip("-") != back]
            name, at = ways[random.integers(len(ways))]
            names.append(name)
        sketch.route(names, 4, block)
    return sketch


def ramp(random: Random, variant: int) -> Sketch:
    """An exit that leaves a motorway at 4 to 8 degrees and runs 12 to 25 m beside it."""
    sketch = Sketch()
    points, h = walk(np.zeros(2), 0.0, [(random.uniform(350, 450), _gentle(random) / 2)], 30.0)
    node = sketch.add("approach", points, highway="motorway", one_way=True)
    base, _ = walk(node, h, [(random.uniform(550, 650), _gentle(random) / 2)], 10.0)
    gap, slope = random.uniform(12.0, 25.0), np.tan(np.radians(random.uniform(4.0, 8.0)))
    s = np.arange(len(base)) * 10.0
    rest = np.maximum(gap - slope * s, 0.0)  # straight away, then rounded into the parallel
    share = gap - np.sqrt(rest**2 + 1.0) + np.sqrt(gap**2 + 1.0) - gap
    sketch.add("main", base, highway="motorway", one_way=True)
    sketch.add(
        "exit", beside(base, -np.maximum(share, 0.0)), highway="motorway_link", one_way=True,
        kmh=70.0,
    )  # fmt: skip
    sketch.route(["approach", "main"], 1)
    sketch.route(["approach", "exit"], 1)
    return sketch


def off_map(random: Random, variant: int) -> Sketch:
    """A street that the map lacks leads from one road to another; decided on coming back."""
    sketch = Sketch()
    between, cut = random.uniform(110.0, 220.0), random.uniform(220.0, 300.0)
    skew = random.uniform(-60.0, 60.0)
    far, west, east = cut + skew, -60.0, cut + 320.0
    along, across = np.array([1.0, 0.0]), np.array([0.0, 1.0])

    def straight(a: Array, b: Array) -> Array:
        n = max(2, round(float(np.hypot(*(b - a))) / 40.0) + 1)
        return a + np.linspace(0.0, 1.0, n)[:, None] * (b - a)

    top = between * across
    sketch.add("main/1", straight(west * along, cut * along))
    sketch.add("main/2", straight(cut * along, east * along))
    sketch.add("hidden", straight(cut * along, far * along + top), highway="residential",
               mapped=False)  # fmt: skip
    sketch.add("other/1", straight(west * along + top, far * along + top))
    sketch.add("other/2", straight(far * along + top, east * along + top))
    sketch.add("side west", straight(west * along, west * along + top), highway="residential")
    sketch.add("side east", straight(east * along, east * along + top), highway="residential")
    sketch.route(["main/1", "hidden", "other/2"], 2)
    sketch.route(["main/1", "hidden", "-other/1"], 2)
    return sketch


def tunnel(random: Random, variant: int) -> Sketch:
    """500 to 1,500 m without GNSS, with one fork or two in them; the last is decided."""
    sketch = Sketch()
    dark, before = random.uniform(500.0, 1500.0), 220.0
    bends = [(float(random.uniform(120, 260)), float(random.normal(0, 1 / 250))) for _ in range(12)]
    at = float(random.uniform(200.0, dark - 200.0))
    first = [(before, _gentle(random))]
    for piece in bends:
        if sum(p[0] for p in first) < before + at:
            first.append(piece)
    points, h = walk(np.zeros(2), 0.0, first)
    node = sketch.add("approach", points, kmh=60.0)
    angle = np.radians(random.uniform(5.0, 30.0))
    length = before + dark - sum(p[0] for p in first) + 250.0
    names = ["approach"]
    if variant % 2:
        for k, side in enumerate((0.5, -0.5)):
            line, _ = walk(node, h + side * angle, [(150.0, _gentle(random))])
            sketch.add(f"first {k}", line, kmh=60.0)
        names.append("first 0")
        node, h = line_end(sketch.streets["first 0"].points)
        angle = np.radians(random.uniform(5.0, 30.0))
    for k, side in enumerate((0.5, -0.5)):
        line, _ = walk(
            node, h + side * angle, [(max(length, 300.0), float(random.normal(0, 1 / 600)))]
        )
        sketch.add(f"last {k}", line, kmh=60.0)
        sketch.route([*names, f"last {k}"], len(names))
    sketch.mask = (before, before + dark)
    return sketch


def line_end(points: Array) -> tuple[Array, float]:
    """Last point and direction there."""
    d = points[-1] - points[-2]
    return points[-1], float(np.arctan2(d[1], d[0]))


SCENES: dict[str, Callable[[Random, int], Sketch]] = {
    "junction": junction,
    "parallel-8": parallel(8.0),
    "parallel-12": parallel(12.0),
    "parallel-18": parallel(18.0),
    "parallel-25": parallel(25.0),
    "roundabout": roundabout,
    "grid": grid,
    "ramp": ramp,
    "off-map": off_map,
    "tunnel": tunnel,
}


def draw_scene(kind: str, variant: int) -> Scene:
    """Draw and compile one of the scenes.

    Args:
        kind: A key of `SCENES`.
        variant: Which of its geometries: same number, same scene.
    """
    random = np.random.default_rng([list(SCENES).index(kind), variant])
    sketch = SCENES[kind](random, variant)
    return compile_scene(sketch, float(random.uniform(-np.pi, np.pi)))


__all__ = ["SCENES", "Route", "Scene", "compile_scene", "draw_scene"]
