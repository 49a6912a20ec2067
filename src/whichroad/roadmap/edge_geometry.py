"""Where the edges of a map lie: those near a point, points on them, and their lines."""

import math
from typing import NamedTuple

import numpy as np

from ..graph import index
from ..graph.network import Roads, records
from ..observations import Array
from .edge_lines import edge_lines
from .streets import Ints


class Near(NamedTuple):
    """Edges near a point, closest first: (n,) each."""

    edge: Ints
    s: Array  # along-track position of the closest point, true m
    lateral: Array  # signed distance, positive where the point is right of the edge, true m
    distance: Array  # true m


class EdgeGeometry:
    """The edges of a map as lines in its plane."""

    __slots__ = ("_reach", "arrays")

    arrays: Roads
    _reach: float | None

    def near(self, x: float, y: float, radius: float) -> Near:
        """Every directed edge near a point, closest first.

        Args:
            x: Plane m, east of the map's origin.
            y: Plane m, north of it.
            radius: True m.
        """
        capacity = 64
        while True:
            found = records(capacity, index.CANDIDATE)
            n = index.near(self.arrays, x, y, radius, found)
            if n < capacity:
                return Near(*(np.ascontiguousarray(found[name][:n]) for name in Near._fields))
            capacity *= 4

    def at(self, edge: int, s: float) -> tuple[float, float, float]:
        """Plane point (m) and heading (rad) at a place of an edge.

        Args:
            edge: The edge.
            s: True m from its start; beyond the ends the edge is prolonged.
        """
        v = int(index.vertex_at(self.arrays, edge, s))
        (x, y, begin), (next_x, next_y, end) = self.arrays.vertices[v : v + 2].tolist()
        dx, dy = next_x - x, next_y - y
        t = (s - begin) / (end - begin)
        return x + t * dx, y + t * dy, math.atan2(dy, dx)

    def edge_line(self, edge: int, start: float | None = None, end: float | None = None) -> Array:
        """Vertices of an edge in driving direction, (n, 2) plane m.

        Args:
            edge: Directed edge.
            start: Along-track position from which on; None: its beginning.
            end: Along-track position up to which, not less than start; None: its end.
        """
        row = self.arrays.edges[edge]
        vertices = self.arrays.vertices[row["first_vertex"] : row["last_vertex"] + 1]
        line = np.column_stack([vertices.x, vertices.y])
        if start is None and end is None:
            return line
        s = vertices.s
        start = 0.0 if start is None else min(max(start, 0.0), float(s[-1]))
        end = float(s[-1]) if end is None else min(max(end, start), float(s[-1]))
        inside = line[(s > start) & (s < end)]
        return np.vstack([self.at(edge, start)[:2], inside, self.at(edge, end)[:2]])

    def edge_lines(self, edge: Ints, start: Array, end: Array) -> tuple[Array, Array, Ints]:
        """Parts of edges in driving direction, all at once.

        Args:
            edge: (n,) directed edges.
            start: (n,) along-track positions from which on; 0 and less: the edge's beginning.
            end: (n,) along-track positions up to which, not less than `start`.

        Returns:
            x and y (m) of all vertices, and (n + 1,) where each line's begin.
        """
        return edge_lines(self.arrays, edge, start, end)

    @property
    def reach(self) -> float:
        """Plane metres from the origin to the farthest vertex."""
        if self._reach is None:
            self._reach = float(np.hypot(self.arrays.vertices.x, self.arrays.vertices.y).max())
        return self._reach
