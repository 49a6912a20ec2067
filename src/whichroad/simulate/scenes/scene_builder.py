"""Scene builder: small maps of streets in metres, compiled, with routes to drive."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..._compile import Ints32
from ...errors import comes_with
from ...geodesy.plane import Plane
from ...geodesy.units import mps_of_kmh
from ...observations import Array
from ...roadmap.tags import CLASS_SPEED_KMH, lane_offset
from ..lateral_profile import smooth
from ..vectorised import Line

if TYPE_CHECKING:
    from ...roadmap import RoadMap

_ORIGIN = Plane(49.41, 2.82)
_ROUNDING = 4.0  # m, sigma over which corners are cut
_STOP_BEFORE = 4.0  # m, between stop and junction
_FIRST, _LAST = 0.1, 0.15  # shares of the first and the last street not driven


class Route(NamedTuple):
    """A line to drive, and where along it the decision lies, m."""

    line: Line
    decision: float  # the branch point
    evaluated_to: float  # end of the stretch that is evaluated


class Scene(NamedTuple):
    """A map and the routes through it."""

    roads: "RoadMap"
    road_of: Ints32  # (E,) road of each edge
    names: tuple[str, ...]  # of the roads, by number // 2
    routes: tuple[Route, ...]


@dataclass
class Street:
    """One street as drawn: points in m, and its attributes in the map."""

    points: Array  # (k, 2)
    highway: str = "secondary"
    one_way: bool = False
    ring: bool = False
    mapped: bool = True
    masked: bool = False
    kmh: float = 0.0  # driven; 0: as usual for the class

    def speed(self) -> float:
        """Usual speed, m/s."""
        return mps_of_kmh(self.kmh or CLASS_SPEED_KMH[self.highway])

    def lane(self) -> float:
        """Usual offset right of the centre line, m."""
        both_ways = not self.one_way
        return lane_offset(self.highway, both_ways, 1.0, 0.0, self.ring)


@dataclass
class SceneBuilder:
    """Streets by name, drawn from shared end points; routes as lists of names."""

    streets: dict[str, Street] = field(default_factory=dict)
    routes: list[tuple[list[str], int, float]] = field(default_factory=list)
    mask: tuple[float, float] | None = None  # m along any route without GNSS

    def add(self, name: str, points: Array, **tags: Any) -> Array:
        """Draw a street; returns its last point."""
        self.streets[name] = Street(np.asarray(points, float), **tags)
        last: Array = self.streets[name].points[-1]
        return last

    def route(self, names: Sequence[str], decision: int, evaluated_to: float = 1e9) -> None:
        """A route by streets (`-name`: against its drawing), decided before number `decision`.

        `evaluated_to` is the evaluated length behind the decision, m.
        """
        self.routes.append((list(names), decision, evaluated_to))


def build_scene(builder: SceneBuilder, turn: float) -> Scene:
    """Compile the map, turned by an angle, and prepare the routes."""
    roads = _map(builder, turn)
    names = tuple(dict.fromkeys(name.partition("/")[0] for name in builder.streets))
    forward = roads.sources(np.arange(len(roads)), 0.5 * roads.arrays.edges.length)[1]
    number = {name: k for k, name in enumerate(names)}
    road_of = np.array(
        [2 * number[n] + (not f) for n, f in zip(roads.column("name"), forward, strict=True)],
        np.int32,
    )
    routes = tuple(_route(builder, roads, number, turn, *route) for route in builder.routes)
    return Scene(roads, road_of, names, routes)


def _placed(points: Array, turn: float) -> tuple[Array, Array]:
    """Latitude and longitude of drawn points."""
    c, s = np.cos(turn), np.sin(turn)
    x, y = points @ [c, -s], points @ [s, c]
    lat, lon = _ORIGIN.to_geodetic(x, y)
    return np.asarray(lat), np.asarray(lon)


def _map(builder: SceneBuilder, turn: float) -> "RoadMap":
    with comes_with("geo", "a drawn scene"):
        import geopandas as gpd
    import shapely

    from ...roadmap import RoadMap

    ends: dict[tuple[float, float], int] = {}
    rows: dict[str, list[Any]] = {}
    lines = []
    for name, street in builder.streets.items():
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
    builder: SceneBuilder, roads: "RoadMap", number: dict[str, int], turn: float, names: list[str],
    decision: int, evaluated_to: float,
) -> Route:  # fmt: skip
    """The centre line of a route on a grid of about a metre, corners rounded."""
    streets = [builder.streets[n.lstrip("-")] for n in names]
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
    if builder.mask is not None:
        masked[(along > builder.mask[0]) & (along < builder.mask[1])] = 1
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
    return Route(line, at, min(at + evaluated_to, float(end)))
