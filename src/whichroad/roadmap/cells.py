"""The grid of a map: which segments touch which cell, as `graph.index` searches it.

All is NumPy's: building a map compiles nothing.
"""

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..graph.network import SEGMENT, records
from ..observations import Array
from .streets import Ints

Ints32 = NDArray[np.int32]

_HALF = 2**31  # rows count from -2³¹, as in `graph.index.cell_key`
_AT_ONCE = 1 << 14  # segments; what they need while they are cut is a small part of the map
_SLACK = 1e-6  # m, bound of rounding errors at the border of a cell


def build(x: Array, y: Array, first: Ints32, size: float) -> tuple[Ints, Ints32, Records]:
    """The grid of a network.

    Args:
        x: (V,) m, plane.
        y: (V,) m.
        first: (E+1,) first vertex of each edge.
        size: Side of a cell, plane m.

    Returns:
        cell_key, cell_first, segments as in `Roads`.
    """
    begins = np.ones(len(x), bool)
    begins[first[1:] - 1] = False
    vertex = np.flatnonzero(begins).astype(np.int32)
    edge = np.repeat(np.arange(len(first) - 1, dtype=np.int32), np.diff(first) - 1)
    parts, keys = [], []
    for low in range(0, len(vertex), _AT_ONCE):
        v = vertex[low : low + _AT_ONCE]
        part, found = _entries(x[v], y[v], x[v + 1], y[v + 1], size)
        parts.append(part + np.int32(low))
        keys.append(found)
    segment, key = np.concatenate(parts), np.concatenate(keys)
    order = np.argsort(key, kind="stable")
    key, segment = key[order], segment[order]
    new = np.flatnonzero(np.append(True, key[1:] != key[:-1]))
    cell_first = np.append(new, len(key)).astype(np.int32)
    segments = records(len(segment), SEGMENT)
    segments.edge, segments.vertex = edge[segment], vertex[segment]
    return key[new], cell_first, segments


def _entries(ax: Array, ay: Array, bx: Array, by: Array, size: float) -> tuple[Ints32, Ints]:
    """The cells of every segment from a to b, column by column: segments and keys."""
    west, east = np.minimum(ax, bx), np.maximum(ax, bx)
    left, right = _cell(west, size), _cell(east, size)
    segment, step = _counted(right - left + 1)
    column = left[segment] + step
    # the heights at which the segment enters and leaves the column
    wide = np.flatnonzero(right[segment] > left[segment])
    enter, leave = ay[segment], by[segment]
    leave[wide] = enter[wide]
    k, at = segment[wide], column[wide]
    for height, border in ((enter, at), (leave, at + 1)):
        # a share of the segment, not its slope, which has no bounds
        share = (np.clip(border * size, west[k], east[k]) - ax[k]) / (bx[k] - ax[k])
        height[wide] += share * (by[k] - ay[k])
    low = _cell(np.minimum(enter, leave) - _SLACK, size)
    part, step = _counted(_cell(np.maximum(enter, leave) + _SLACK, size) - low + 1)
    row = low[part] + step
    key = column[part].astype(np.int64) * (2 * _HALF) + (row.astype(np.int64) + _HALF)
    return segment[part], key


def _cell(at: Array, size: float) -> Ints32:
    """Column or row of the cells that hold some coordinates."""
    return np.floor(at / size).astype(np.int32)


def _counted(count: Ints32) -> tuple[Ints32, Ints32]:
    """Each number as often as its count, and which time it is, from 0."""
    number = np.repeat(np.arange(len(count), dtype=np.int32), count)
    begin = np.cumsum(count, dtype=np.int32) - count
    return number, np.arange(len(number), dtype=np.int32) - begin[number]
