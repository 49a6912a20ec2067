"""A map's streets for drawings: each once, the important ones first."""

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..errors import comes_with
from ..observations import Array
from ..svg import Frame, Strokes, figure
from .osm import SUFFIXES
from .streets import Ints, Texts
from .sumo import is_net
from .tags import CLASS_SPEED_KMH, DEFAULT_SPEED_KMH

if TYPE_CHECKING:
    from .roadmap import RoadMap

COLOR = "#b9bec6"
_MAIN, _MAIN_COLOR = 50.0, "#8b929c"  # km/h usually driven, from which on a street is a main one
_VERTICES = 20_000  # of a picture; of more streets the slowest are left out
_OUTLIERS = 0.01  # share of the edges that may lie outside of a picture, on each side
_TICKS = 5  # most of an axis
_PIXELS = 0.5  # by which a line may be simplified


def streets(
    roads: "RoadMap",
    low: tuple[float, float] | None = None,
    high: tuple[float, float] | None = None,
) -> Ints:
    """The edges of all streets, one direction of each, or of those that may touch a box.

    Args:
        roads: The map.
        low: Least x and y of the box, m in the plane; None: no box.
        high: Likewise the largest.
    """
    edges, vertices = roads.arrays.edges, roads.arrays.vertices
    chosen = (edges.opposite < 0) | (edges.opposite > np.arange(len(edges.opposite)))
    if low is not None and high is not None:
        begin = edges.first_vertex
        for axis, least, most in zip("xy", low, high, strict=True):
            values = np.ascontiguousarray(getattr(vertices, axis))
            chosen &= np.maximum.reduceat(values, begin) > least
            chosen &= np.minimum.reduceat(values, begin) < most
    return np.flatnonzero(chosen)


def attribution(roads: "RoadMap") -> str:
    """The map's attribution, where its source is known."""
    osm = str(roads.origin).lower().endswith(SUFFIXES) and not is_net(roads.origin)
    return "© OpenStreetMap contributors" if osm else ""


def map_html(roads: "RoadMap") -> str:
    """A map as a picture for a notebook."""
    vertices = roads.arrays.vertices
    begins = roads.arrays.edges.first_vertex
    x, y = (_most(v[begins], v.min(), v.max()) for v in (vertices.x, vertices.y))
    lat, lon = roads.plane.to_geodetic(*(v.ravel() for v in np.meshgrid(x, y)))
    frame = Frame.about(np.asarray(lat), np.asarray(lon))
    layers, drawn, every = strokes(roads, frame, streets(roads))
    text = f"{roads!r}, {_street_km(roads):,.0f} km of streets"
    if drawn < every:
        text += f"; {drawn:,} of {every:,} streets are drawn"
    return figure(layers, frame, " · ".join(filter(None, (text, attribution(roads)))))


def _most(begins: Array, least: float, most: float) -> Array:
    """From and to where along an axis most edges lie, without a few far away."""
    low, high = np.quantile(begins, (_OUTLIERS, 1.0 - _OUTLIERS))
    more = 0.2 * (high - low)
    return np.array([max(low - more, least), min(high + more, most)])


def strokes(roads: "RoadMap", frame: Frame, edges: Ints) -> tuple[list[Strokes], int, int]:
    """Streets as layers, and of how many how many are drawn.

    Args:
        roads: The map.
        frame: What is shown, which sets how exact lines are.
        edges: (n,) one of each street.
    """
    import shapely

    if not len(edges):
        return [], 0, 0
    speed = _usual_speeds(roads, edges)
    order = np.argsort(-speed, kind="stable")
    edges, speed = edges[order], speed[order]
    table = roads.arrays.edges
    count = table.last_vertex[edges] - table.first_vertex[edges] + 1
    edges = edges[np.cumsum(count) <= 10 * _VERTICES]  # that are simplified at all
    x, y, first = roads.edge_lines(edges, np.zeros(len(edges)), np.full(len(edges), np.inf))
    line = np.repeat(np.arange(len(edges)), np.diff(first))
    shapes = shapely.linestrings(np.column_stack([x, y]), indices=line)
    shapes = shapely.simplify(shapes, _PIXELS * frame.metres)
    count = shapely.get_num_coordinates(shapes)
    drawn = int((np.cumsum(count) <= _VERTICES).sum())
    xy = shapely.get_coordinates(shapes[:drawn])
    lat, lon = roads.plane.to_geodetic(xy[:, 0].copy(), xy[:, 1].copy())
    bounds = np.concatenate([[0], np.cumsum(count[:drawn])]).astype(np.int64)
    main = int((speed[:drawn] >= _MAIN).sum())
    middle = int(bounds[main])
    return (
        [
            Strokes(lat[middle:], lon[middle:], bounds[main:] - middle, COLOR, 1.0),
            Strokes(lat[:middle], lon[:middle], bounds[: main + 1], _MAIN_COLOR, 1.8),
        ],
        drawn,
        len(order),
    )


def plot_map(roads: "RoadMap", ax: Any, style: dict[str, Any]) -> Any:
    """See `RoadMap.plot`."""
    frame = roads.edges_table().iloc[streets(roads)]
    drawn = frame.plot(ax=ax, **({"color": _MAIN_COLOR, "linewidth": 0.8} | style))
    if ax is None:
        in_degrees(drawn)
    return drawn


def in_degrees(ax: Any) -> None:
    """Name the axes of a plot of places, and number them so that they can be read."""
    from matplotlib.ticker import MaxNLocator

    ax.set(xlabel="longitude (degrees)", ylabel="latitude (degrees)")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(_TICKS))
        axis.get_major_formatter().set_useOffset(False)


def explore_map(roads: "RoadMap", style: dict[str, Any]) -> Any:
    """See `RoadMap.explore`."""
    check_folium()
    frame = roads.edges_table().iloc[streets(roads)]
    return frame.explore(**({"color": _MAIN_COLOR} | style))


def check_folium() -> None:
    """See that geopandas can make pages.

    Raises:
        SettingError: A package is not installed.
    """
    with comes_with("explore", "explore"):
        import folium  # noqa: F401
        import mapclassify  # noqa: F401
        import matplotlib  # noqa: F401


def _usual_speeds(roads: "RoadMap", edges: Ints) -> Array:
    """km/h usually driven on edges of their class, (n,)."""
    words = cast(Texts, roads.ways["highway"]).words(roads.way[edges])
    return np.array([CLASS_SPEED_KMH.get(word, DEFAULT_SPEED_KMH) for word in words])


def _street_km(roads: "RoadMap") -> float:
    return float(roads.arrays.edges.length[streets(roads)].sum()) / 1e3
