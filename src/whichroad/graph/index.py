"""The spatial index: a grid of cells that hold the segments touching them.

A cell is known by one key, made of its column and row; only cells that hold something
exist, sorted by key, each with its segments (CSR).  A segment stands in every cell it
passes through.
"""

import math
from typing import Annotated

import numpy as np

from .._compile import Array, Ints, Records, entry, kernel
from ._ahead import prefetch
from .network import Roads, plane_scale

CANDIDATE = np.dtype(
    [
        ("edge", "i8"),
        ("s", "f8"),  # abscissa of its closest point, true m
        ("lateral", "f8"),  # distance, positive where the point is right of the edge, true m
        ("distance", "f8"),  # true m
        ("mass", "f8"),  # of a place along it, for who weighs them
    ],
    align=True,
)

Candidates = Annotated[Records, Array(CANDIDATE, 1)]

_HALF = 2**31  # rows count from -2³¹; columns of either sign fit into what is left of 64 bits
_SLACK = 1e-6  # m, more than rounding moves a point across the border of a cell
_AHEAD = 4  # segments that are asked for before they are looked at
_ROUNDING = 1.0 + 1e-6  # times a squared distance, more than rounding adds to it


@kernel
def cell_key(column: int, row: int) -> int:
    """Key of a cell; grows with the column, then with the row."""
    return column * (2 * _HALF) + (row + _HALF)


@kernel
def find(keys: Ints, key: int) -> int:
    """First place whose key is not less."""
    low = 0
    high = len(keys)
    while low < high:
        middle = (low + high) // 2
        if keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low


@entry
def vertex_at(roads: Roads, edge: int, s: float) -> int:
    """First vertex of the segment of an edge that holds an abscissa (outside: an end one)."""
    low: int = roads.edges[edge].first_vertex
    high: int = roads.edges[edge].last_vertex - 1
    while low < high:
        middle = (low + high + 1) // 2
        if roads.vertices[middle].s <= s:
            low = middle
        else:
            high = middle - 1
    return low


@kernel
def foot(roads: Roads, v: int, x: float, y: float) -> tuple[float, float]:
    """Closest point of the segment from vertex v to v + 1 (the paper's Figure 3).

    Where the perpendicular misses the segment the closer end is taken.

    Args:
        roads: The network.
        v: First vertex of the segment.
        x: m, plane.
        y: m.

    Returns:
        Squared distance (plane m²) and abscissa on the edge (true m).
    """
    a = roads.vertices[v]
    b = roads.vertices[v + 1]
    dx = b.x - a.x
    dy = b.y - a.y
    px = x - a.x
    py = y - a.y
    along = px * dx + py * dy
    square = dx * dx + dy * dy
    if along <= 0.0:
        return px * px + py * py, a.s
    if along >= square:
        px = x - b.x
        py = y - b.y
        return px * px + py * py, b.s
    across = dx * py - dy * px
    return across * across / square, a.s + along / square * (b.s - a.s)


@kernel
def _may_be_within(roads: Roads, v: int, x: float, y: float, limit: float) -> bool:
    """Whether `foot` has to tell if a segment's squared distance is within the limit.

    It does not divide: where it says no, the segment is farther by more than rounding.
    """
    a = roads.vertices[v]
    b = roads.vertices[v + 1]
    dx = b.x - a.x
    dy = b.y - a.y
    px = x - a.x
    py = y - a.y
    across = dx * py - dy * px
    square = dx * dx + dy * dy
    if across * across > limit * square * _ROUNDING:
        return False
    along = px * dx + py * dy
    if along <= 0.0:
        return bool(px * px + py * py <= limit)
    if along >= square:
        px = x - b.x
        py = y - b.y
        return bool(px * px + py * py <= limit)
    return True


@kernel
def right_of(roads: Roads, edge: int, s: float, x: float, y: float) -> bool:
    """Whether a point lies right of an edge, seen from its closest point at abscissa s.

    At a vertex between two segments the side is taken against the mean of their directions.
    """
    v = vertex_at(roads, edge, s)
    dx = roads.vertices[v + 1].x - roads.vertices[v].x
    dy = roads.vertices[v + 1].y - roads.vertices[v].y
    if s == roads.vertices[v].s and v > roads.edges[edge].first_vertex:
        ux = roads.vertices[v].x - roads.vertices[v - 1].x
        uy = roads.vertices[v].y - roads.vertices[v - 1].y
        before = math.hypot(ux, uy)
        after = math.hypot(dx, dy)
        dx = ux / before + dx / after
        dy = uy / before + dy / after
    across: float = dx * (y - roads.vertices[v].y) - dy * (x - roads.vertices[v].x)
    return across <= 0.0


@kernel
def _farthest(found: Candidates, n: int) -> int:
    """Place of the largest (distance, edge) among the first n."""
    worst = 0
    for i in range(1, n):
        far = found[worst].distance
        here = found[i].distance
        if here > far or (here == far and found[i].edge > found[worst].edge):
            worst = i
    return worst


@kernel
def _keep(n: int, edge: int, square: float, s: float, found: Candidates) -> int:
    """Note a foot: once per edge, and the closest edges only when the table is full."""
    for i in range(n - 1, -1, -1):
        known = found[i]
        if known.edge == edge:
            if square < known.distance or (square == known.distance and s < known.s):
                known.s = s
                known.distance = square
            return n
    place = n
    if n == len(found):
        place = _farthest(found, n)
        far = found[place].distance
        if square > far or (square == far and edge > found[place].edge):
            return n
    new = found[place]
    new.edge = edge
    new.s = s
    new.distance = square
    return max(n, place + 1)


@kernel
def _search_cell(
    roads: Roads, cell: int, x: float, y: float, limit: float, n: int, found: Candidates
) -> int:
    """Note the feet within the squared distance `limit` on the segments of one cell."""
    last = roads.cell_first[cell + 1] - 1
    for i in range(roads.cell_first[cell], last + 1):
        prefetch(roads.vertices[roads.segments[min(i + _AHEAD, last)].vertex])
        v = roads.segments[i].vertex
        if _may_be_within(roads, v, x, y, limit):  # most are not: their abscissae are left alone
            square, s = foot(roads, v, x, y)
            if square <= limit:
                n = _keep(n, roads.segments[i].edge, square, s, found)
    return n


@kernel
def _sort(n: int, found: Candidates) -> None:
    """Order by distance, then by edge."""
    for i in range(1, n):
        e, a, d = found[i].edge, found[i].s, found[i].distance
        j = i
        while j > 0 and (
            found[j - 1].distance > d or (found[j - 1].distance == d and found[j - 1].edge > e)
        ):
            found[j].edge = found[j - 1].edge
            found[j].s = found[j - 1].s
            found[j].distance = found[j - 1].distance
            j -= 1
        found[j].edge = e
        found[j].s = a
        found[j].distance = d


@kernel
def closest(roads: Roads, x: float, y: float, radius: float, found: Candidates) -> int:
    """`near`, which see, without the sides."""
    if len(found) == 0 or not radius >= 0.0:
        return 0
    scale = plane_scale(roads, x, y)
    reach = radius * scale
    limit = reach * reach
    reach += _SLACK
    size = roads.plane[0].cell_size
    # clamped far outside of every map, so that columns stay integers
    left = math.floor(min(max((x - reach) / size, -1e9), 1e9))
    right = math.floor(min(max((x + reach) / size, -1e9), 1e9))
    low = math.floor(min(max((y - reach) / size, -1e9), 1e9))
    high = math.floor(min(max((y + reach) / size, -1e9), 1e9))
    n = 0
    if (right - left + 1.0) * (high - low + 1.0) > len(roads.cell_key):
        for cell in range(len(roads.cell_key)):
            n = _search_cell(roads, cell, x, y, limit, n, found)
    else:
        for column in range(left, right + 1):
            cell = find(roads.cell_key, cell_key(column, low))
            last = cell_key(column, high)
            while cell < len(roads.cell_key) and roads.cell_key[cell] <= last:
                n = _search_cell(roads, cell, x, y, limit, n, found)
                cell += 1
    _sort(n, found)
    for i in range(n):
        found[i].distance = math.sqrt(found[i].distance) / scale
    return n


@kernel
def share_beyond(found: int, near: Candidates, sigma: float) -> float:
    """P that the vehicle is farther off than all roads near, where these are too many to follow.

    Args:
        found: So many are known.
        near: (n,), closest first.
        sigma: Of the place about which they are near, of each axis, m.
    """
    if found < len(near):
        return 0.0
    far = near[found - 1].distance / sigma
    return math.exp(-0.5 * far * far)


@kernel(inline=True)
def _limit_of(n: int, found: Candidates, beyond: float, limit: float) -> float:
    """Squared distance up to which `closest_few`, having found n feet, may take another one."""
    nearest = math.inf
    for i in range(n):
        nearest = min(nearest, found[i].distance)
    reach = math.sqrt(nearest) + beyond
    limit = min(limit, reach * reach * _ROUNDING)
    if n < len(found):
        return limit
    return float(min(limit, found[_farthest(found, n)].distance))


@kernel(inline=True)
def _gap(at: float, cell: int, size: float) -> float:
    """How far a coordinate is from a column or row of cells, less what rounding moves it."""
    low = cell * size
    return max(low - at, at - low - size, _SLACK) - _SLACK


@kernel(inline=True)
def _search_near(
    roads: Roads, x: float, y: float, radius: float, beyond: float, found: Candidates
) -> int:
    """Note the closest feet, its own cell first: squared, plane units; returns how many."""
    size = roads.plane[0].cell_size
    reach = radius + _SLACK
    left, right = math.floor((x - reach) / size), math.floor((x + reach) / size)
    low, high = math.floor((y - reach) / size), math.floor((y + reach) / size)
    limit = radius * radius
    key = cell_key(math.floor(x / size), math.floor(y / size))
    own = find(roads.cell_key, key)
    n = 0
    if own < len(roads.cell_key) and roads.cell_key[own] == key:
        n = _search_cell(roads, own, x, y, limit, n, found)
        limit = _limit_of(n, found, beyond, limit)
    else:
        own = -1
    for column in range(left, right + 1):
        aside = _gap(x, column, size)
        cell = find(roads.cell_key, cell_key(column, low))
        while cell < len(roads.cell_key) and roads.cell_key[cell] <= cell_key(column, high):
            away = _gap(y, roads.cell_key[cell] - cell_key(column, 0), size)
            if cell != own and aside * aside + away * away <= limit:
                n = _search_cell(roads, cell, x, y, limit, n, found)
                limit = _limit_of(n, found, beyond, limit)
            cell += 1
    return n


@kernel
def closest_few(
    roads: Roads, x: float, y: float, radius: float, farther: float, found: Candidates
) -> int:
    """The first of `closest`, as many as the table holds: it looks no farther than it has to.

    Args:
        roads: The network.
        x: m, plane.
        y: m.
        radius: True m.
        farther: True m; no edge is farther from the point than the closest one by more.
        found: (n,) CANDIDATE, out.

    Returns:
        How many.
    """
    scale = plane_scale(roads, x, y)
    n = _search_near(roads, x, y, radius * scale, farther * scale, found)
    _sort(n, found)
    for i in range(n):
        found[i].distance = math.sqrt(found[i].distance) / scale
    while n > 0 and found[n - 1].distance > found[0].distance + farther:
        n -= 1
    return n


@entry
def near(roads: Roads, x: float, y: float, radius: float, found: Candidates) -> int:
    """Directed edges within a radius of a point, each once with its closest point.

    Args:
        roads: The network.
        x: m, plane.
        y: m.
        radius: True m; an edge at exactly this distance is found.
        found: (n,) CANDIDATE, out; where more edges are near, the closest n are kept.
            `lateral` is positive where the point is right of the edge; beyond an end of the
            edge it is the distance from that end.

    Returns:
        How many were found; they are in order of distance, then of edge.
    """
    n = closest(roads, x, y, radius, found)
    for i in range(n):
        right_side = right_of(roads, found[i].edge, found[i].s, x, y)
        found[i].lateral = found[i].distance if right_side else -found[i].distance
    return n
