"""A trace through the filter: where each of its points lies on the path, and how sure that is."""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..errors import DriveError
from ..lookback.path import Alternative
from ..lookback.smoothing import FULL, Lag
from ..lookback.traversals import Traversals, traversals
from ..matching import timeline_of
from ..observations import Array, Drive
from ..readers.reported_fixes import Reported, make_fixes
from ..readers.without_times import invented_times
from ..recorded import localize_recorded
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle

_SAME = 1e-4  # s, distance below which times are one epoch
_BESIDE = (0, -1, 1, -2, 2)  # traversals that are looked at for the edge of a point
_COLUMNS = ("edge", "enter_m", "exit_m")
_SHARE = 0.05  # P from which on another road counts as an alternative


@dataclass(frozen=True, slots=True)
class Trace:
    """Points of a vehicle in the order of driving, shape (n,) each.

    Attributes:
        lat: Degrees.
        lon: Degrees.
        time: s since 1970 UTC, not decreasing; None: there are none.
        sigma: m, per axis; NaN: not told.
        untimed: Why times that were given are not used; empty: they are, or none were.
    """

    lat: Array
    lon: Array
    time: Array | None
    sigma: Array
    untimed: str = ""

    def __len__(self) -> int:
        return len(self.lat)


class Piece(NamedTuple):
    """A part of the path on one edge."""

    at: int  # row of the traversals
    edge: int
    start: float  # true m along the edge
    end: float


class Run(NamedTuple):
    """A part of the path without a gap."""

    points: list[int]  # rows of the trace that lie on it, in order
    confidence: float  # P of its edges, given the trace


@dataclass(frozen=True)
class Matched:
    """A trace on the map.

    Attributes:
        roads: The map.
        trace: What was matched.
        rows: (n,) estimates, one a point.
        on: (n,) whether the point lies on the path.
        at: (n,) its row of `driven`.
        along: (n,) its place on that edge, true m.
        lat: (n,) the place on the path, degrees.
        lon: (n,) likewise.
        away: (n,) true m from the point to it.
        driven: (r,) the path.
        runs: Parts without a gap, of at least two points.
        driving_side: `right` or `left`.
    """

    roads: RoadMap
    trace: Trace
    rows: Records
    on: NDArray[np.bool_]
    at: NDArray[np.int64]
    along: Array
    lat: Array
    lon: Array
    away: Array
    driven: Traversals
    runs: list[Run]
    driving_side: str

    def pieces(self, first: int, last: int) -> list[Piece]:
        """The path between two points of a run: one piece of each edge, at least one."""
        at, along, all_edges, enter, leave = self._lists
        a, b = at[first], at[last]
        edges, starts, ends = all_edges[a : b + 1], enter[a : b + 1], leave[a : b + 1]
        starts[0], ends[-1] = along[first], along[last]
        found = [
            Piece(a + k, edge, start, max(start, end))
            for k, (edge, start, end) in enumerate(zip(edges, starts, ends, strict=True))
        ]
        while len(found) > 1 and found[0].end - found[0].start < 1e-3:
            found.pop(0)
        while len(found) > 1 and found[-1].end - found[-1].start < 1e-3:
            found.pop()
        return found

    @cached_property
    def _lists(self) -> tuple[list[int], list[float], list[int], list[float], list[float]]:
        """Columns as lists, which single values are taken from faster."""
        columns = (self.at, self.along, *(self.driven[name] for name in _COLUMNS))
        return tuple(column.tolist() for column in columns)

    def competitors(self) -> NDArray[np.int64]:
        """(n,) how many other roads are probable at each point."""
        others: NDArray[np.int64] = (self.rows.alt_p >= _SHARE).sum(axis=1) - 1
        return np.maximum(others, 0)


def match_trace(trace: Trace, roads: RoadMap, vehicle: Vehicle, settings: Settings) -> Matched:
    """Match a trace as a whole, each point by all others.

    Args:
        trace: At least two points.
        roads: The map.
        vehicle: The car.
        settings: The model's numbers.

    Raises:
        MapError: No point is near the map.
        DriveError: No point can be matched.
    """
    n = len(trace)
    time = trace.time
    if time is None:
        time = invented_times(trace.lat, trace.lon, [np.arange(n)], [])
    if np.ptp(time) <= _SAME:
        raise DriveError("trace: all points have one time; times that increase were expected")
    variance = trace.sigma**2
    reported = Reported(time, trace.lat, trace.lon, variance, np.zeros(n), variance.copy())
    drive = Drive("trace", make_fixes(reported, settings, Counter()))
    timeline, _ = timeline_of(drive, roads, vehicle)
    recorded = localize_recorded(
        roads, timeline, vehicle=vehicle, settings=settings, lag=Lag.of(FULL)
    )
    epochs = timeline.epochs
    driven = traversals(epochs, recorded.output, recorded.chain, roads.arrays)
    epoch = np.minimum(np.searchsorted(epochs.time, time - _SAME), len(epochs) - 1)
    rows = recorded.output.rows[epoch]
    if not len(driven) or recorded.past is None:
        raise DriveError("trace: no road fits its points")
    on, at, along = _places(rows, time, driven, roads)
    run = np.cumsum(driven.gap)[at]
    parts = recorded.past.alternatives(told=False)
    runs = []
    for number in np.unique(run[on]).tolist():
        points = np.flatnonzero(on & (run == number)).tolist()
        if len(points) < 2:
            on[points] = False
            continue
        edges = driven.edge[at[points[0]] : at[points[-1]] + 1].tolist()
        begin, end = float(time[points[0]]), float(time[points[-1]])
        runs.append(Run(points, _probability(edges, begin, end, parts)))
    edge = driven.edge[at].astype(np.int64)
    x, y, first = roads.edge_lines(edge, along, along)
    x, y = x[first[:-1]], y[first[:-1]]
    lat, lon = roads.plane.to_geodetic(x, y)
    own_x, own_y = roads.plane.from_geodetic(trace.lat, trace.lon)
    away = np.hypot(x - own_x, y - own_y)
    side = vehicle.driving_side
    return Matched(roads, trace, rows, on, at, along, lat, lon, away, driven, runs, side)


def _places(
    rows: Records, time: Array, driven: Traversals, roads: RoadMap
) -> tuple[NDArray[np.bool_], NDArray[np.int64], Array]:
    """Which points lie on the path, on which of its edges, and where on that; never backwards."""
    last = len(driven) - 1
    on = (rows.live > 0) & (rows.edge >= 0)
    then = np.clip(np.searchsorted(driven.enter_time, time, side="right") - 1, 0, last)
    at, along, found = then.copy(), np.zeros(len(time)), np.zeros(len(time), bool)
    for step in _BESIDE:
        beside = np.clip(then + step, 0, last)
        hit = on & ~found & (driven.edge[beside] == rows.edge)
        at[hit], along[hit] = beside[hit], rows.s[hit]
        found |= hit
    for i in np.flatnonzero(on & ~found).tolist():  # its most probable edge is not of the path
        along[i] = _projected(roads, int(driven.edge[at[i]]), float(rows.x[i]), float(rows.y[i]))
    along = np.clip(along, driven.enter_m[at], np.maximum(driven.enter_m, driven.exit_m)[at])
    row, place = 0, -np.inf
    for i in np.flatnonzero(on).tolist():
        if at[i] < row:
            at[i], along[i] = row, place
        elif at[i] == row:
            along[i] = max(along[i], place)
        row, place = int(at[i]), float(along[i])
    return on, at, along


def _projected(roads: RoadMap, edge: int, x: float, y: float) -> float:
    """The place on an edge that is closest to a point of the plane, true m."""
    row = roads.arrays.edges[edge]
    vertices = roads.arrays.vertices[row["first_vertex"] : row["last_vertex"] + 1]
    dx, dy = np.diff(vertices.x), np.diff(vertices.y)
    square = np.maximum(dx * dx + dy * dy, 1e-12)
    share = np.clip(((x - vertices.x[:-1]) * dx + (y - vertices.y[:-1]) * dy) / square, 0.0, 1.0)
    off = np.hypot(vertices.x[:-1] + share * dx - x, vertices.y[:-1] + share * dy - y)
    k = int(np.argmin(off))
    return float(vertices.s[k] + share[k] * (vertices.s[k + 1] - vertices.s[k]))


def _probability(edges: list[int], begin: float, end: float, parts: list[Alternative]) -> float:
    """P of the edges of a run: the product over the parts of the trace that it passes."""
    p = 1.0
    for part in parts:
        if part.end < begin or part.start > end or not part.routes:
            continue
        same = [route.p for route in part.routes if _within(list(route.edges), edges)]
        p *= max(same) if same else max(0.0, 1.0 - sum(route.p for route in part.routes))
    return min(max(p, 0.0), 1.0)


def _within(route: list[int], edges: list[int]) -> bool:
    """Whether the one is driven within the other, or the other within it, without a break."""
    if len(route) > len(edges):
        route, edges = edges, route
    n = len(route)
    return any(edges[k : k + n] == route for k in range(len(edges) - n + 1))
