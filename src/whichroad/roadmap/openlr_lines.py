"""OpenLR line locations: routes as references that other maps can follow.

The shortest way between two reference points must be the route, so a point is set wherever the
shortest way would leave it.  Bytes are the package `openlr`'s.
"""

import heapq
import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import MapError
from ..observations import Array
from .streets import Ints

if TYPE_CHECKING:
    from .roadmap import RoadMap

_CLASSES = ("motorway", "trunk", "primary", "secondary", "tertiary", "unclassified")
_LOWER = {"road": 5, "residential": 6}  # functional road classes below these
_LOWEST = 7
_MOTORWAY, _SINGLE, _ROUNDABOUT, _SLIP = 1, 3, 4, 6  # forms of way
_FARTHEST = 14_900.0  # m between two reference points
_BEARING = 20.0  # m along a line over which its bearing is taken
_SECTOR, _SECTORS = 11.25, 32  # step of bearings (degrees), and how many there are
_TIE = 0.5  # m, by which another way must be longer than the route
_WHOLE = 1.0  # m, offsets below which are none
_LEG = 150.0  # m, least length of the first and the last leg; an offset is told to 1/256 of it
_KNOWN = 40.0  # m, length of an edge that decoders know by its bearing


class _Point(NamedTuple):
    """A reference point, before it has bytes."""

    edge: int  # that it names
    at_end: bool  # the last point is at the end of its edge, others at the start
    lowest: int  # class of road to the next one
    distance: float  # m to the next one


class LineEncoder:
    """Makes references of routes on a map.

    Args:
        roads: The map.

    Raises:
        MapError: The package openlr is missing.
    """

    def __init__(self, roads: "RoadMap") -> None:
        try:
            import openlr
        except ImportError:
            raise MapError(
                "openlr: the package is not installed; it was expected for line references; "
                'pip install "whichroad[openlr]"'
            ) from None
        self._openlr, self._roads = openlr, roads
        edges = roads.arrays.edges
        legal = np.flatnonzero(edges.rule == 0)
        order = legal[np.argsort(edges.from_node[legal], kind="stable")]
        self._legal = edges.rule == 0
        self._leaving = order
        self._first = np.searchsorted(edges.from_node[order], np.arange(len(roads.node_id) + 1))
        self._from, self._to = edges.from_node.tolist(), edges.to_node.tolist()
        self._length: list[float] = edges.length.tolist()
        words = [str(word or "") for word in roads.column("highway")]
        rings = roads.column("roundabout")
        self._frc = [functional_class(word) for word in words]
        self._fow = [form_of_way(w, bool(r)) for w, r in zip(words, rings, strict=True)]

    def encode(self, route: list[int], enter: float, leave: float) -> str | None:
        """The reference of a route, in Base64.

        Args:
            route: Edges that follow each other.
            enter: Along-track position on the first, m.
            leave: Along-track position on the last, m.

        Returns:
            None: it is driven against a rule, does not hang together, or an edge is too long.
        """
        if not route or not self._legal[route].all() or max(self._of(route)) > _FARTHEST:
            return None
        if any(self._to[a] != self._from[b] for a, b in pairwise(route)):
            return None
        if len(route) == 1 and leave - enter < _WHOLE:
            return None
        before = enter if enter >= _WHOLE else 0.0
        behind = self._length[route[-1]] - leave
        behind = behind if behind >= _WHOLE else 0.0
        points = self._points(route, before > 0.0, behind > 0.0)
        o = self._openlr
        reference = o.LineLocationReference(
            [self._as_lrp(point) for point in points],
            _share(before, points[0].distance),
            _share(behind, points[-2].distance),
        )
        return str(o.binary_encode(reference))

    def _of(self, route: list[int]) -> list[float]:
        return [self._length[e] for e in route]

    def _points(self, route: list[int], begins_within: bool, ends_within: bool) -> list[_Point]:
        """Reference points of a route: as far apart as may be, but near the ends.

        Offsets are shares of the first and the last leg, so these are short where there is one.
        """
        points, k, n = [], 0, len(route)
        lengths = np.array(self._of(route))
        behind = np.cumsum(lengths[::-1])[::-1]  # m from the start of each edge to the end
        final = max(int(np.searchsorted(-behind, -_LEG, side="right")) - 1, 0)
        final = final if ends_within else n
        while k < n:
            after = self._reach(route, k)
            if k == 0 and begins_within:
                far = np.cumsum(lengths)
                after = min(after, int(np.searchsorted(far, _LEG)) + 1)
            if k < final < after:
                after = final
            after = self._known_place(route, k, after)
            leg = route[k:after]
            lowest = max(self._frc[e] for e in leg)
            points.append(_Point(route[k], False, lowest, sum(self._of(leg))))
            k = after
        return [*points, _Point(route[-1], True, self._frc[route[-1]], 0.0)]

    def _known_place(self, route: list[int], k: int, after: int) -> int:
        """The last place behind k, up to `after`, of an edge of known bearing, else the longest."""
        if after >= len(route):
            return after
        places = range(after, k, -1)
        long = (p for p in places if self._length[route[p]] >= _KNOWN)
        return next(long, max(places, key=lambda p: self._length[route[p]]))

    def _reach(self, route: list[int], k: int) -> int:
        """The last place on a route before which its shortest way from place k does not leave it.

        The next point names the edge at that place; the end of the route names its last edge.
        """
        target: dict[int, float] = {}
        total, far, best = self._length[route[k]], 0.0, k + 1
        for e in route[k + 1 :]:
            if total + self._length[e] > _FARTHEST or self._from[e] in target:
                break
            target[self._from[e]] = far
            far += self._length[e]
            total += self._length[e]
        found = self._distances(self._to[route[k]], far, route[k + 1 : k + 1 + len(target)])
        for place, e in enumerate(route[k + 1 : k + 1 + len(target)], k + 1):
            if not found.get(self._from[e], False):
                break
            best = place if place < len(route) - 1 else len(route)
        return best

    def _distances(self, start: int, most: float, route: list[int]) -> dict[int, bool]:
        """Nodes of a route to which the route itself is the shortest way, by far enough."""
        along = {start: 0.0}
        for e in route:
            along[self._to[e]] = along.get(self._to[e], along[self._from[e]] + self._length[e])
        ours = set(route)
        shortest: dict[int, float] = {}  # over at least one edge that is not of the route
        known: dict[tuple[int, bool], float] = {(start, True): 0.0}
        queue = [(0.0, start, True)]
        while queue:
            far, node, same = heapq.heappop(queue)
            if far > known[node, same] or far > most + _TIE:
                continue
            if not same:
                shortest.setdefault(node, far)
            for e in self._leaving[self._first[node] : self._first[node + 1]].tolist():
                after, on = far + self._length[e], same and e in ours
                key = (self._to[e], on)
                if after < known.get(key, np.inf):
                    known[key] = after
                    heapq.heappush(queue, (after, *key))
        return {
            node: shortest.get(node, np.inf) > far + _TIE
            and known.get((node, True), np.inf) >= far - 1e-6
            for node, far in along.items()
        }

    def _as_lrp(self, point: _Point) -> Any:
        """As the package has it."""
        o, roads, e = self._openlr, self._roads, point.edge
        length = self._length[e]
        there = length if point.at_end else 0.0
        ahead = min(_BEARING, length)
        x, y, _ = roads.at(e, there)
        to_x, to_y, _ = roads.at(e, length - ahead if point.at_end else ahead)
        lat, lon, bearing = roads.plane.pose(x, y, math.atan2(to_y - y, to_x - x))
        return o.LocationReferencePoint(
            lon, lat, o.FRC(self._frc[e]), o.FOW(self._fow[e]),
            (int(bearing / _SECTOR) % _SECTORS + 0.5) * _SECTOR, o.FRC(point.lowest),
            round(point.distance),
        )  # fmt: skip


def functional_class(highway: str) -> int:
    """OpenLR's functional road class of a street, 0 to 7."""
    word = highway.removesuffix("_link")
    return _CLASSES.index(word) if word in _CLASSES else _LOWER.get(word, _LOWEST)


def form_of_way(highway: str, ring: bool) -> int:
    """OpenLR's form of way of a street."""
    if ring:
        return _ROUNDABOUT
    if highway.endswith("_link"):
        return _SLIP
    return _MOTORWAY if highway == "motorway" else _SINGLE


def _share(offset: float, leg: float) -> float:
    """An offset as a share of the leg on which it lies."""
    return min(offset / leg, 0.999) if leg > 0.0 else 0.0


def stretches(edge: Ints, enter: Array, leave: Array, gap: Any, drive: list[Any]) -> list[slice]:
    """Rows of a path that hang together.

    Args:
        edge: (n,) edges.
        enter: (n,) m.
        leave: (n,) m.
        gap: (n,) whether a row follows a gap.
        drive: (n,) names of drives.
    """
    begins = [
        k for k in range(len(edge))
        if k == 0 or drive[k] != drive[k - 1] or gap[k] or leave[k] < enter[k]
    ]  # fmt: skip
    return [slice(a, b) for a, b in zip(begins, [*begins[1:], len(edge)], strict=True)]


def references(roads: "RoadMap", path: Any, by: str) -> list[str | None]:
    """See `RoadMap.openlr`."""
    needed = ("edge_id", "enter_m", "exit_m")
    names = list(getattr(path, "column_names", getattr(path, "columns", ())))
    if by not in ("row", "stretch") or not set(needed) <= set(names):
        raise MapError(
            f"openlr: by is {by!r}, and the columns are {', '.join(map(str, names[:12]))}; 'row' "
            "or 'stretch', and the path of match or match_many, were expected"
        )
    enter, leave = (np.asarray(path[name], np.float64) for name in needed[1:])
    edge = np.asarray(path["edge_id"], np.int64)
    n = len(edge)
    if n and not (edge.min() >= 0 and edge.max() < len(roads)):
        raise MapError(
            f"openlr: edges beyond the {len(roads):,} of this map; the map that the path was "
            "matched to was expected"
        )
    encoder = LineEncoder(roads)
    rules = np.asarray(path["broken_rule"], object) if "broken_rule" in names else [None] * n
    drive = list(np.asarray(path["drive_id"], object)) if "drive_id" in names else [""] * n
    if by == "row":
        parts = [slice(k, k + 1) for k in range(n)]
    else:
        parts = stretches(edge, enter, leave, [rule == "gap" for rule in rules], drive)
    found: list[str | None] = []
    for part in parts:
        edges = edge[part]
        route = edges[np.flatnonzero(np.diff(edges, prepend=-1))].tolist()  # by source: once each
        reference = encoder.encode(route, float(enter[part][0]), float(leave[part][-1]))
        found += [reference] * (part.stop - part.start)
    return found
