"""The spatial index: a grid of cells that hold the segments touching them.

A cell is known by one key, made of its column and row; only cells that hold something
exist, sorted by key, each with its segments (CSR).  A segment stands in every cell it
passes through.
"""

import math

from ._jit import Ints, Vector, entry, kernel
from .network import Roads

_HALF = 2**31  # columns and rows count from -2³¹
_SLACK = 1e-6  # m, more than rounding moves a point across the border of a cell


@kernel
def cell_key(column: int, row: int) -> int:
    """Key of a cell; grows with the column, then with the row."""
    return (column + _HALF) * (2 * _HALF) + (row + _HALF)


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


@kernel
def vertex_at(roads: Roads, edge: int, s: float) -> int:
    """First vertex of the segment of an edge that holds an abscissa (outside: an end one)."""
    low: int = roads.first[edge]
    high: int = roads.first[edge + 1] - 2
    while low < high:
        middle = (low + high + 1) // 2
        if roads.s[middle] <= s:
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
    dx = roads.x[v + 1] - roads.x[v]
    dy = roads.y[v + 1] - roads.y[v]
    px = x - roads.x[v]
    py = y - roads.y[v]
    along = px * dx + py * dy
    square = dx * dx + dy * dy
    if along <= 0.0:
        return px * px + py * py, roads.s[v]
    if along >= square:
        px = x - roads.x[v + 1]
        py = y - roads.y[v + 1]
        return px * px + py * py, roads.s[v + 1]
    across = dx * py - dy * px
    return across * across / square, roads.s[v] + along / square * (roads.s[v + 1] - roads.s[v])


@kernel
def _is_within(roads: Roads, v: int, x: float, y: float, limit: float) -> bool:
    """Whether the squared distance of a segment, as `foot` has it, is within the limit."""
    dx = roads.x[v + 1] - roads.x[v]
    dy = roads.y[v + 1] - roads.y[v]
    px = x - roads.x[v]
    py = y - roads.y[v]
    along = px * dx + py * dy
    square = dx * dx + dy * dy
    if along <= 0.0:
        return bool(px * px + py * py <= limit)
    if along >= square:
        px = x - roads.x[v + 1]
        py = y - roads.y[v + 1]
        return bool(px * px + py * py <= limit)
    across = dx * py - dy * px
    return bool(across * across / square <= limit)


@kernel
def right_of(roads: Roads, edge: int, s: float, x: float, y: float) -> bool:
    """Whether a point lies right of an edge, seen from its closest point at abscissa s.

    At a vertex between two segments the side is taken against the mean of their directions.
    """
    v = vertex_at(roads, edge, s)
    dx = roads.x[v + 1] - roads.x[v]
    dy = roads.y[v + 1] - roads.y[v]
    if s == roads.s[v] and v > roads.first[edge]:
        ux = roads.x[v] - roads.x[v - 1]
        uy = roads.y[v] - roads.y[v - 1]
        before = math.hypot(ux, uy)
        after = math.hypot(dx, dy)
        dx = ux / before + dx / after
        dy = uy / before + dy / after
    across: float = dx * (y - roads.y[v]) - dy * (x - roads.x[v])
    return across <= 0.0


@kernel
def _farthest(square: Vector, edge: Ints, n: int) -> int:
    """Place of the largest (distance, edge) among the first n."""
    worst = 0
    for i in range(1, n):
        if square[i] > square[worst] or (square[i] == square[worst] and edge[i] > edge[worst]):
            worst = i
    return worst


@kernel
def _keep(
    n: int, edge: int, square: float, s: float, out_edge: Ints, out_s: Vector, out_square: Vector
) -> int:
    """Note a foot: once per edge, and the closest edges only when there is no more room."""
    for i in range(n - 1, -1, -1):
        if out_edge[i] == edge:
            if square < out_square[i] or (square == out_square[i] and s < out_s[i]):
                out_s[i] = s
                out_square[i] = square
            return n
    place = n
    if n == len(out_edge):
        place = _farthest(out_square, out_edge, n)
        if square > out_square[place] or (square == out_square[place] and edge > out_edge[place]):
            return n
    out_edge[place] = edge
    out_s[place] = s
    out_square[place] = square
    return max(n, place + 1)


@kernel
def _search_cell(
    roads: Roads, cell: int, x: float, y: float, limit: float, n: int,
    out_edge: Ints, out_s: Vector, out_square: Vector,
) -> int:  # fmt: skip
    """Note the feet within the squared distance `limit` on the segments of one cell."""
    for i in range(roads.cell_first[cell], roads.cell_first[cell + 1]):
        v = roads.cell_vertex[i]
        if _is_within(roads, v, x, y, limit):  # most are not: their abscissae are left alone
            square, s = foot(roads, v, x, y)
            n = _keep(n, roads.cell_edge[i], square, s, out_edge, out_s, out_square)
    return n


@kernel
def _sort(n: int, edge: Ints, s: Vector, square: Vector) -> None:
    """Order by distance, then by edge."""
    for i in range(1, n):
        e, a, d = edge[i], s[i], square[i]
        j = i
        while j > 0 and (square[j - 1] > d or (square[j - 1] == d and edge[j - 1] > e)):
            edge[j], s[j], square[j] = edge[j - 1], s[j - 1], square[j - 1]
            j -= 1
        edge[j], s[j], square[j] = e, a, d


@kernel
def closest(
    roads: Roads, x: float, y: float, radius: float,
    out_edge: Ints, out_s: Vector, out_distance: Vector,
) -> int:  # fmt: skip
    """`near`, which see, without the sides."""
    if len(out_edge) == 0 or not radius >= 0.0:
        return 0
    scale = 1.0 + roads.curvature * (x * x + y * y)
    reach = radius * scale
    limit = reach * reach
    reach += _SLACK
    size = roads.cell_size
    # clamped far outside of every map, so that columns stay integers
    left = math.floor(min(max((x - reach) / size, -1e9), 1e9))
    right = math.floor(min(max((x + reach) / size, -1e9), 1e9))
    low = math.floor(min(max((y - reach) / size, -1e9), 1e9))
    high = math.floor(min(max((y + reach) / size, -1e9), 1e9))
    n = 0
    if (right - left + 1.0) * (high - low + 1.0) > len(roads.cell_key):
        for cell in range(len(roads.cell_key)):
            n = _search_cell(roads, cell, x, y, limit, n, out_edge, out_s, out_distance)
    else:
        for column in range(left, right + 1):
            cell = find(roads.cell_key, cell_key(column, low))
            last = cell_key(column, high)
            while cell < len(roads.cell_key) and roads.cell_key[cell] <= last:
                n = _search_cell(roads, cell, x, y, limit, n, out_edge, out_s, out_distance)
                cell += 1
    _sort(n, out_edge, out_s, out_distance)
    for i in range(n):
        out_distance[i] = math.sqrt(out_distance[i]) / scale
    return n


@entry
def near(
    roads: Roads, x: float, y: float, radius: float,
    out_edge: Ints, out_s: Vector, out_lateral: Vector, out_distance: Vector,
) -> int:  # fmt: skip
    """Directed edges within a radius of a point, each once with its closest point.

    Args:
        roads: The network.
        x: m, plane.
        y: m.
        radius: True m; an edge at exactly this distance is found.
        out_edge: (n,) out; where more edges are near, the closest n are kept.
        out_s: (n,) out, abscissa of the closest point, true m.
        out_lateral: (n,) out, the distance, positive where the point is right of the edge,
            true m; beyond an end of the edge it is the distance from that end.
        out_distance: (n,) out, true m.

    Returns:
        How many were found; they are in order of distance, then of edge.
    """
    n = closest(roads, x, y, radius, out_edge, out_s, out_distance)
    for i in range(n):
        right_side = right_of(roads, out_edge[i], out_s[i], x, y)
        out_lateral[i] = out_distance[i] if right_side else -out_distance[i]
    return n
