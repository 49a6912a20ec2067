"""The roads of a compiled map as vector tiles, and single edges with their names.

Coordinates of tiles are the usual web Mercator: x right and y down, the world from 0 to 1.
"""

import hashlib
import threading
from collections import OrderedDict
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from ..geodesy.mercator import latitude_of, longitude_of, to_square
from ..graph.network import AGAINST_ONE_WAY
from ..observations import Array
from ..ragged import row_and_place
from ..roadmap import RoadMap
from ..roadmap.drawing import attribution, streets
from .vectortile import EXTENT, Line, encode_layer

MAX_ZOOM = 16  # deeper tiles are magnified by the page

_BUFFER = 96  # tile units beyond the tile's edge, so that wide lines meet
_PIXEL = EXTENT / 512.0  # tile units per pixel on the screen
_CACHED = 512  # tiles
_CROWD = 3000  # streets in a tile from which on small ones are left out
_NAMED_FROM = 13  # zoom from which on names are sent

_RANK = {
    "motorway": 0, "trunk": 0, "primary": 1, "secondary": 1, "tertiary": 2,
    "residential": 3, "unclassified": 3, "living_street": 3, "road": 3,
}  # fmt: skip
_SMALL = 4  # rank of everything else
_MAIN = 1  # ranks of the main roads, drawn for orientation


class RoadLayer:
    """Draws every street once, however many directions it has.

    Args:
        roads: The map.
    """

    def __init__(self, roads: RoadMap) -> None:
        self.roads = roads
        edges, vertices = roads.arrays.edges, roads.arrays.vertices
        opposite = edges.opposite
        self._edge = streets(roads)
        x, y = to_square(*roads.plane.to_geodetic(vertices.x, vertices.y))
        first = edges.first_vertex[self._edge]
        row, place = row_and_place(edges.last_vertex[self._edge] - first + 1)
        vertex = first[row] + place
        self._lines = shapely.linestrings(np.column_stack([x, y])[vertex], indices=row)
        self._tree = shapely.STRtree(self._lines)
        self._rank = _ranks(roads, self._edge)
        one_way = edges.rule & AGAINST_ONE_WAY
        back = np.where(opposite < 0, 0, one_way[opposite])[self._edge] > 0
        self._one_way = np.where(back, 1, np.where(one_way[self._edge] > 0, -1, 0))
        self._tunnel = _flag(roads, "tunnel")[self._edge]
        box = shapely.total_bounds(self._lines)
        (south, north), (west, east) = latitude_of(box[[1, 3]])[::-1], longitude_of(box[[0, 2]])
        self.bounds = [float(west), float(south), float(east), float(north)]
        inner = shapely.get_coordinates(self._lines)
        low, high = np.quantile(inner, (0.05, 0.95), axis=0)
        (north, south), (west, east) = (
            latitude_of(np.array([low[1], high[1]])),
            longitude_of(np.array([low[0], high[0]])),
        )
        self.view = [float(west), float(south), float(east), float(north)]
        self.attribution = attribution(roads)
        self.version = _digest(roads)
        self._tiles: OrderedDict[tuple[int, int, int], bytes] = OrderedDict()
        self._lock = threading.Lock()

    def about(self) -> dict[str, Any]:
        """What a page needs to know to ask for tiles."""
        return {
            "bounds": self.bounds,
            "view": [float(v) for v in self.view],
            "attribution": self.attribution,
            "tiles": f"roads/{self.version}/{{z}}/{{x}}/{{y}}.mvt",
            "maxzoom": MAX_ZOOM,
            "edges": len(self.roads),
        }

    def tile(self, z: int, x: int, y: int) -> bytes:
        """The vector tile of that address, empty where there is no road.

        Args:
            z: Zoom, 0 to `MAX_ZOOM`.
            x: Column.
            y: Row, counted from the north.

        Raises:
            ValueError: There is no such tile.
        """
        if not (0 <= z <= MAX_ZOOM and 0 <= x < 1 << z and 0 <= y < 1 << z):
            raise ValueError(f"there is no tile {z}/{x}/{y}")
        key = z, x, y
        with self._lock:
            if key in self._tiles:
                self._tiles.move_to_end(key)
                return self._tiles[key]
        made = self._make(z, x, y)
        with self._lock:
            self._tiles[key] = made
            while len(self._tiles) > _CACHED:
                self._tiles.popitem(last=False)
        return made

    def near(self, lat: float, lon: float) -> int:
        """The edge of the street nearest to a place, one direction of it."""
        x, y = to_square(np.array([lat]), np.array([lon]))
        return int(self._edge[self._tree.nearest(shapely.Point(x[0], y[0]))])

    def _make(self, z: int, x: int, y: int) -> bytes:
        margin = _BUFFER / EXTENT
        box = np.array([x - margin, y - margin, x + 1 + margin, y + 1 + margin]) / (1 << z)
        found = np.sort(self._tree.query(shapely.box(*box)))
        for rank in range(_SMALL, 0, -1):
            if len(found) <= _CROWD:
                break
            kept = found[self._rank[found] < rank]
            found = kept if len(kept) else found
        if not len(found):
            return b""
        lines = shapely.simplify(
            self._lines[found], 0.5 * _PIXEL / EXTENT / (1 << z), preserve_topology=False
        )
        lines = shapely.clip_by_rect(lines, *box)
        left = ~shapely.is_empty(lines)
        found, lines = found[left], lines[left]
        made = encode_layer("road", self._streets(found, lines, (z, x, y)))
        if z >= _NAMED_FROM:
            made += encode_layer("name", self._names(found, lines, (z, x, y)))
        return made

    def _streets(
        self, found: NDArray[Any], lines: NDArray[Any], at: tuple[int, int, int]
    ) -> list[Line]:
        """Streets of one style as one feature each, so that a tile stays small."""
        style = 100 * self._rank[found].astype(np.int64)
        style += 10 * self._tunnel[found] + self._one_way[found] + 1
        drawn = []
        for key in np.unique(style).tolist():
            rank, rest = divmod(key, 100)
            tunnel, direction = divmod(rest, 10)
            properties: dict[str, str | int] = {"rank": rank}
            if tunnel:
                properties["tunnel"] = 1
            if direction != 1:
                properties["oneway"] = 1
            of_style = lines[style == key]
            if direction == 0:  # drawn against its only direction
                of_style = shapely.reverse(of_style)
            drawn.append(Line(_parts(of_style, at), properties))
        return drawn[::-1]

    def _names(
        self, found: NDArray[Any], lines: NDArray[Any], at: tuple[int, int, int]
    ) -> list[Line]:
        """Streets of one name joined, so that a name fits on them."""
        names = np.array(_names_of(self.roads, self._edge[found]), dtype=object)
        drawn = []
        for name in sorted(set(names.tolist()) - {""}):
            rows = names == name
            joined = shapely.line_merge(
                shapely.multilinestrings(shapely.get_parts(lines[rows]))
            )  # fmt: skip
            rank = int(self._rank[found[rows]].min())
            drawn.append(Line(_parts(np.array([joined]), at), {"name": name, "rank": rank}))
        return sorted(drawn, key=lambda line: int(line.properties["rank"]))


def edge_of(roads: RoadMap, edge: int) -> dict[str, Any]:
    """One directed edge: its line (lon, lat in driving direction) and its street."""
    line = roads.edge_line(edge)
    lat, lon = roads.plane.to_geodetic(line[:, 0], line[:, 1])
    known = roads.attributes(edge)
    return {
        "edge": edge,
        "name": known.get("name"),
        "highway": known.get("highway"),
        "speed_limit_kmh": known.get("speed_limit_kmh"),
        "kind": next((kind for kind in ("tunnel", "bridge") if known.get(kind)), None),
        "length_m": round(float(roads.arrays.edges.length[edge]), 1),
        "line": np.round(np.column_stack([lon, lat]), 7).tolist(),
    }


def drawn_near(
    roads: RoadMap, lat: Array, lon: Array, margin: float
) -> list[tuple[int, str, list[list[float]]]]:
    """Streets near a track, and main roads about it, for a drawing: rank, name, (lon, lat) line.

    Args:
        roads: The map.
        lat: (n,) the track, degrees; at least one place.
        lon: (n,)
        margin: How near, m.
    """
    plane = roads.plane
    x, y = plane.from_geodetic(lat, lon)
    low, high = (x.min() - margin, y.min() - margin), (x.max() + margin, y.max() + margin)
    edges = streets(roads, low, high)
    ranks = _ranks(roads, edges)
    lines = np.array([shapely.LineString(roads.edge_line(edge)) for edge in edges.tolist()])
    track = shapely.LineString(np.column_stack([np.append(x, x[-1]), np.append(y, y[-1])]))
    track = shapely.simplify(track, 5.0)
    shapely.prepare(track)
    near = shapely.dwithin(track, lines, margin) | (ranks <= _MAIN)
    edges, ranks, lines = edges[near], ranks[near], shapely.simplify(lines[near], 0.5)
    names, drawn = _names_of(roads, edges), []
    for name, rank, line in zip(names, ranks.tolist(), lines, strict=True):
        points = shapely.get_coordinates(line)
        to_lat, to_lon = plane.to_geodetic(points[:, 0].copy(), points[:, 1].copy())
        drawn.append((rank, name, np.round(np.column_stack([to_lon, to_lat]), 6).tolist()))
    return drawn


def _ranks(roads: RoadMap, edges: NDArray[Any]) -> NDArray[np.int8]:
    words = roads.column("highway")
    known = [_RANK.get(str(words[e]).removesuffix("_link"), _SMALL) for e in edges.tolist()]
    return np.array(known, np.int8)


def _flag(roads: RoadMap, name: str) -> NDArray[np.int8]:
    if name not in roads.ways:
        return np.zeros(len(roads), np.int8)
    return np.array(roads.column(name), dtype=bool).astype(np.int8)


def _names_of(roads: RoadMap, edges: NDArray[Any]) -> list[str]:
    column = roads.ways.get("name")
    if column is None or isinstance(column, np.ndarray):
        return [""] * len(edges)
    return column.words(roads.way[edges])


def _parts(lines: NDArray[Any], at: tuple[int, int, int]) -> list[list[tuple[int, int]]]:
    """Polylines in the units of a tile."""
    z, x, y = at
    singles = shapely.get_parts(lines)
    points, row = shapely.get_coordinates(singles, return_index=True)
    units = np.rint((points * (1 << z) - (x, y)) * EXTENT).astype(np.int64)
    cuts = np.flatnonzero(np.diff(row)) + 1
    return [list(map(tuple, part.tolist())) for part in np.split(units, cuts)]


def _digest(roads: RoadMap) -> str:
    """A name for what is drawn, so that a browser never shows another map's tiles."""
    sums = (len(roads), roads.plane.lat0_deg, roads.plane.lon0_deg, roads.arrays.edges.length.sum())
    return hashlib.sha256(repr(sums).encode()).hexdigest()[:12]
