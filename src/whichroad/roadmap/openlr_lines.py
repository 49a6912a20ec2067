"""OpenLR line locations: routes as references that other maps can follow.

The shortest way between two reference points must be the route, so a point is set wherever the
shortest way would leave it.  Where the first or the last edge is too short to be known, the
reference begins before it or ends behind it, by offsets.  Bytes are the package `openlr`'s.
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
_LEG = 100.0  # m, least length of the first and the last leg; an offset is told to 1/256 of it
_KNOWN = 40.0  # m, length of an edge that decoders know by its bearing
_STEPS = 256  # of an offset
_WITHIN = 1.0  # m from the end of an edge at which an offset is on it in spite of rounded places
_FURTHER = 4  # edges at most by which a reference is longer than the route, on either side


class _Point(NamedTuple):
    """A reference point, before it has bytes."""

    edge: int  # that it names
    along: float  # m from the start of that edge
    at_end: bool  # it names the edge on which it ends: the last point
    lowest: int  # class of road to the next one
    distance: float  # m to the next one


class _Legs(NamedTuple):
    """A route between reference points."""

    route: list[int]  # edges, those beyond its ends included
    starts: list[int]  # places on it at which legs begin
    begin: float  # m along the first edge at which the first point is
    end: float  # m along the last edge at which the last point is
    before: float  # m of the first leg that are not of the location
    behind: float  # m of the last one


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
        self._opposite = edges.opposite.tolist()
        self._leaving = order
        self._first = np.searchsorted(edges.from_node[order], np.arange(len(roads.node_id) + 1))
        self._coming = legal[np.argsort(edges.to_node[legal], kind="stable")]
        self._last = np.searchsorted(edges.to_node[self._coming], np.arange(len(roads.node_id) + 1))
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
        legs = self._legs_of(route, enter, self._length[route[-1]] - leave)
        points, o = self._points(legs), self._openlr
        first, last = self._length[route[0]], self._length[route[-1]]
        reference = o.LineLocationReference(
            [self._as_lrp(point) for point in points],
            _share(legs.before, legs.before - enter, first, points[0].distance),
            _share(legs.behind, legs.behind - last + leave, last, points[-2].distance),
        )
        return str(o.binary_encode(reference))

    def _of(self, route: list[int]) -> list[float]:
        return [self._length[e] for e in route]

    def _is_loop(self, edge: int) -> bool:
        return bool(self._from[edge] == self._to[edge])

    def _is_known(self, edge: int) -> bool:
        """Long enough to be told from others by a place and a bearing at one end."""
        return self._length[edge] >= _KNOWN and not self._is_loop(edge)

    def _beyond(self, route: list[int], before: bool) -> list[int]:
        """Edges in front of a route, or behind it, up to one that decoders know; none if they do.

        Without one the longest is taken, if it is longer than where the route ends itself.
        """
        found: list[int] = []
        used, end = set(route), route[0 if before else -1]
        if self._is_loop(end):
            return []
        order, first = (self._coming, self._last) if before else (self._leaving, self._first)
        lengths = [self._length[end]]
        while not self._is_known(end) and len(found) < _FURTHER:
            node = self._from[end] if before else self._to[end]
            there = [
                e for e in order[first[node] : first[node + 1]].tolist()
                if e not in used and self._opposite[e] != end and not self._is_loop(e)
                and self._length[e] <= _FARTHEST
            ]  # fmt: skip
            if not there:
                break
            known = [e for e in there if self._is_known(e)]
            end = (min if known else max)(known or there, key=self._length.__getitem__)
            used.add(end)
            found.append(end)
            lengths.append(self._length[end])
        found = found[: int(np.argmax(lengths))] if not self._is_known(end) else found
        return found[::-1] if before else found

    def _legs_of(self, route: list[int], before: float, behind: float) -> _Legs:
        """Legs of a route, which is longer than asked for where that makes its ends known.

        Args:
            route: What was driven.
            before: Of its first edge, m.
            behind: Of its last edge, m.
        """
        earlier, later = self._beyond(route, True), self._beyond(route, False)
        for more, further in ((earlier, later), (earlier, []), ([], later)):
            if more or further:
                legs = self._cut(more, route, further, before, behind)
                if legs is not None:
                    return legs
        found = self._cut([], route, [], before, behind)
        assert found is not None  # any route has legs, of one edge each at worst
        return found

    def _cut(
        self, earlier: list[int], route: list[int], later: list[int], before: float, behind: float
    ) -> _Legs | None:
        """A route in legs as long as may be, but short where an offset is a share of them.

        Returns:
            None: an offset would be longer than its leg.
        """
        first, last = len(earlier), len(earlier) + len(route) - 1
        route = [*earlier, *route, *later]
        n, lengths = len(route), np.array(self._of(route))
        before = sum(self._of(earlier)) + before if earlier or before >= _WHOLE else 0.0
        behind = sum(self._of(later)) + behind if later or behind >= _WHOLE else 0.0
        # points at the node of a loop might name either end of it
        begin = 0.5 * before if self._is_loop(route[0]) else 0.0
        end = 0.5 * behind if self._is_loop(route[-1]) else 0.0
        far, left = np.cumsum(lengths), np.cumsum(lengths[::-1])[::-1]  # m behind, m to go
        final = max(int(np.searchsorted(-left, -_LEG, side="right")) - 1, 0) if behind else n
        starts = [0]
        while True:
            k = starts[-1]
            after = self._reach(route, k)
            if k == 0 and before:
                after = min(after, max(int(np.searchsorted(far, _LEG)), first) + 1)
            if k < final < after:
                after = final
            if after >= n:
                break
            low = max(k, first) if k == 0 and earlier else k
            high = min(after, last) if later else after
            if high <= low:
                return None
            starts.append(self._known_place(route, low, high))
        if later and starts[-1] > last:
            return None
        return _Legs(route, starts, begin, float(lengths[-1]) - end, before - begin, behind - end)

    def _points(self, legs: _Legs) -> list[_Point]:
        """The reference points between legs."""
        route, starts = legs.route, legs.starts
        within = [
            0.5 * (legs.end if k == len(route) - 1 else self._length[route[k]])
            if self._is_loop(route[k]) else 0.0
            for k in starts
        ]  # fmt: skip
        within[0] = legs.begin
        points = []
        for (k, end), (at, then) in zip(
            pairwise([*starts, len(route)]), pairwise([*within, 0.0]), strict=True
        ):
            leg = route[k:end]
            lowest = max(self._frc[e] for e in leg)
            metres = sum(self._of(leg)) - at + then
            if end == len(route):
                metres -= self._length[route[-1]] - legs.end
            points.append(_Point(route[k], at, False, lowest, metres))
        return [*points, _Point(route[-1], legs.end, True, self._frc[route[-1]], 0.0)]

    def _known_place(self, route: list[int], low: int, high: int) -> int:
        """The last place from low + 1 to high of an edge of known bearing, else the longest."""
        places = range(high, low, -1)
        known = (p for p in places if self._is_known(route[p]))
        return next(known, max(places, key=lambda p: self._length[route[p]]))

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
        there, length = point.along, self._length[e]
        towards = max(there - _BEARING, 0.0) if point.at_end else min(there + _BEARING, length)
        x, y, _ = roads.at(e, there)
        to_x, to_y, _ = roads.at(e, towards)
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


def _share(offset: float, low: float, length: float, leg: float) -> float:
    """An offset as the share of its leg that the bytes hold: one of 256, on the edge it is of.

    Args:
        offset: m from the end of the leg; 0: none.
        low: m from the end of the leg to the edge on which the location begins or ends.
        length: Of that edge, m.
        leg: Its length, m.
    """
    if offset <= 0.0 or leg <= 0.0:
        return 0.0
    told = leg * (np.arange(_STEPS) + 0.5) / _STEPS  # m that decoders read
    edge = min(_WITHIN, length / 3.0)
    least = low + edge if low > 0.0 else 0.0
    within = np.flatnonzero((told > least) & (told < low + length - edge))
    near = within if len(within) else np.arange(_STEPS)
    return float((near[np.argmin(np.abs(told[near] - offset))] + 0.5) / _STEPS)


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
