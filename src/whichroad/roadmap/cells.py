"""The grid of a map: which segments touch which cell, as `graph.index` searches it.

All is NumPy's: building a map compiles nothing.
"""

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..graph.network import SEGMENT
from ..observations import Array
from .shelf import release, stored, table
from .streets import Ints

Ints32 = NDArray[np.int32]

_HALF = 2**31  # rows count from -2³¹, as in `graph.index.cell_key`
_AT_ONCE = 1 << 14  # segments; what they need while they are cut is a small part of the map
_SORTED = 1 << 19  # entries that are sorted at once
_EVERY = 256  # entries of which one is looked at to tell their keys
_LEAST, _MOST = -(2**63), 2**63 - 1  # of keys
_ENTRY = np.dtype([("key", "i8"), ("edge", "i4"), ("vertex", "i4")])
_SLACK = 1e-6  # m, bound of rounding errors at the border of a cell


class Grid:
    """The grid of edges that come some at a time.

    Args:
        size: Side of a cell, plane m.
    """

    def __init__(self, size: float) -> None:
        self._size = size
        self._parts: list[NDArray[Any]] = []

    def add(self, x: Array, y: Array, first: Ints32, edge: int, vertex: int) -> None:
        """Further edges, and the vertices of each.

        Args:
            x: (V,) m, plane.
            y: (V,) m.
            first: (E+1,) first vertex of each edge, counted from 0.
            edge: Number of the first of them.
            vertex: Number of its first vertex.
        """
        begins = np.ones(len(x), bool)
        begins[first[1:] - 1] = False
        own = np.flatnonzero(begins).astype(np.int32)
        edges = np.repeat(np.arange(len(first) - 1, dtype=np.int32), np.diff(first) - 1)
        parts, keys = [], []
        for low in range(0, len(own), _AT_ONCE):
            v = own[low : low + _AT_ONCE]
            part, found = _entries(x[v], y[v], x[v + 1], y[v + 1], self._size)
            parts.append(part + np.int32(low))
            keys.append(found)
        segment = np.concatenate(parts)
        entries = stored(len(segment), _ENTRY)
        entries["key"] = np.concatenate(keys)
        entries["edge"], entries["vertex"] = edges[segment] + edge, own[segment] + vertex
        release(entries)
        self._parts.append(entries)

    def done(self) -> tuple[Ints, Ints32, Records]:
        """cell_key, cell_first, segments as in `Roads`."""
        total = sum(map(len, self._parts))
        segments = table(total, SEGMENT)
        keys: list[Ints] = []
        firsts: list[Ints] = []
        at = 0
        for low, high in self._ranges(total):
            own = self._between(low, high)
            if not len(own):
                continue
            own = own[np.argsort(own["key"], kind="stable")]
            key = own["key"]
            new = np.flatnonzero(np.append(True, key[1:] != key[:-1]))
            keys.append(key[new])
            firsts.append(new + at)
            segments.edge[at : at + len(own)] = own["edge"]
            segments.vertex[at : at + len(own)] = own["vertex"]
            at += len(own)
            release(segments)
        cell_first = np.append(np.concatenate(firsts), total).astype(np.int32)
        return np.concatenate(keys), cell_first, segments

    def _ranges(self, total: int) -> list[tuple[int, int]]:
        """Ranges of keys that hold about `_SORTED` entries each."""
        sample = np.sort(np.concatenate([part["key"][::_EVERY] for part in self._parts]))
        release(*self._parts)
        ends = sample[:: max(_SORTED // _EVERY, 1)][1:] if total > _SORTED else sample[:0]
        bounds = [int(_LEAST), *np.unique(ends).tolist(), int(_MOST)]
        return list(pairwise(bounds))

    def _between(self, low: int, high: int) -> NDArray[Any]:
        """The entries with keys from one on and below another, in the order of edges."""
        found = []
        for part in self._parts:
            key = part["key"]
            found.append(part[(key >= low) & (key < high)])
            release(part)
        return np.concatenate(found)


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
    grid = Grid(size)
    grid.add(x, y, first, 0, 0)
    return grid.done()


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
