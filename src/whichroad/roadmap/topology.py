"""Kernels that make a road graph of streets: ends that meet, streets drawn twice, pieces."""

import math

from .._compile import Bytes, Ints, Ints32, Vector, entry, kernel
from ..graph.index import cell_key, find


@kernel
def _root(label: Ints, i: int) -> int:
    """The first of the points that i was joined with."""
    while label[i] != i:
        label[i] = label[label[i]]
        i = label[i]
    return i


@entry
def point_cells(x: Vector, y: Vector, size: float, key: Ints) -> None:
    """Keys of the cells that hold (n,) points, into key."""
    for i in range(len(x)):
        key[i] = cell_key(math.floor(x[i] / size), math.floor(y[i] / size))


@entry
def join_close(x: Vector, y: Vector, key: Ints, order: Ints, radius: float, label: Ints) -> None:
    """Join points closer than a radius, and all that hang together by such pairs.

    Args:
        x: (n,) m.
        y: (n,) m.
        key: (n,) ascending keys of the cells of side `radius` that hold the points.
        order: (n,) the points in that order.
        radius: m, inclusive.
        label: (n,) out, the least number among the points joined with each.
    """
    for i in range(len(x)):
        label[i] = i
    for i in range(len(x)):
        column = math.floor(x[i] / radius)
        row = math.floor(y[i] / radius)
        for c in range(column - 1, column + 2):
            k = find(key, cell_key(c, row - 1))
            while k < len(key) and key[k] <= cell_key(c, row + 1):
                j = order[k]
                k += 1
                if j > i and math.hypot(x[j] - x[i], y[j] - y[i]) <= radius:
                    a = _root(label, i)
                    b = _root(label, j)
                    label[max(a, b)] = min(a, b)
    for i in range(len(x)):
        label[i] = _root(label, i)


@entry
def nearest_points(
    px: Vector, py: Vector, x: Vector, y: Vector, key: Ints, order: Ints, radius: float,
    nearest: Ints,
) -> None:  # fmt: skip
    """For each point p the nearest of some other points.

    Args:
        px: (m,) m.
        py: (m,) m.
        x: (n,) m.
        y: (n,) m.
        key: (n,) ascending keys of the cells of side `radius` that hold the points.
        order: (n,) the points in that order.
        radius: m, inclusive.
        nearest: (m,) out, number of the nearest point; -1 where none is in the radius.
    """
    for i in range(len(px)):
        nearest[i] = -1
        best = radius
        column = math.floor(px[i] / radius)
        row = math.floor(py[i] / radius)
        for c in range(column - 1, column + 2):
            k = find(key, cell_key(c, row - 1))
            while k < len(key) and key[k] <= cell_key(c, row + 1):
                j = order[k]
                k += 1
                distance = math.hypot(x[j] - px[i], y[j] - py[i])
                if distance < best or (distance == best and (nearest[i] < 0 or j < nearest[i])):
                    best = distance
                    nearest[i] = j


@kernel
def _same_line(
    a: int, b: int, back: bool, first: Ints, x: Vector, y: Vector, tolerance: float
) -> bool:
    """Whether two lines have the same vertices, b read backwards if `back`."""
    count = first[a + 1] - first[a]
    if first[b + 1] - first[b] != count:
        return False
    for i in range(count):
        v = first[a] + i
        w = first[b + 1] - 1 - i if back else first[b] + i
        if abs(x[v] - x[w]) > tolerance or abs(y[v] - y[w]) > tolerance:
            return False
    return True


@entry
def find_twins(
    order: Ints, low: Ints, high: Ints, begin: Ints, first: Ints, x: Vector, y: Vector,
    tolerance: float, leader: Ints, back: Bytes,
) -> None:  # fmt: skip
    """Rows that draw the same road again, in the same direction or the other.

    Args:
        order: (n,) rows sorted by (low, high), earlier rows first.
        low: (n,) the lesser end node of each row.
        high: (n,) the greater one.
        begin: (n,) node at which the row begins.
        first: (n+1,) first vertex of each row.
        x: (V,) m.
        y: (V,) m.
        tolerance: How far vertices of the same road may lie apart, m.
        leader: (n,) out, the first row that draws the same road: itself or an earlier one.
        back: (n,) out, 1 where the row runs against its leader.
    """
    for k in range(len(order)):
        row = order[k]
        leader[row] = row
        back[row] = 0
        m = k - 1
        while m >= 0 and low[order[m]] == low[row] and high[order[m]] == high[row]:
            other = order[m]
            m -= 1
            if leader[other] != other:
                continue
            for turned in range(2):
                ring = low[row] == high[row]
                if (ring or (begin[other] != begin[row]) == (turned == 1)) and _same_line(
                    other, row, turned == 1, first, x, y, tolerance
                ):
                    leader[row] = other
                    back[row] = turned
                    break


@entry
def find_pieces(first: Ints32, start: Vector, edge: Ints, s: Vector, found: Ints) -> None:
    """Which piece of its edge holds each abscissa; before the first it is the first.

    Args:
        first: (E+1,) first piece of each edge.
        start: (P,) abscissa at which each piece begins, m.
        edge: (n,) edges.
        s: (n,) abscissae, m.
        found: (n,) out, pieces.
    """
    for i in range(len(edge)):
        low = first[edge[i]]
        high = first[edge[i] + 1] - 1
        while low < high:
            middle = (low + high + 1) // 2
            if start[middle] <= s[i]:
                low = middle
            else:
                high = middle - 1
        found[i] = low
