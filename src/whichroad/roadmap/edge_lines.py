"""Parts of edges as polylines, many at once."""

import numpy as np

from ..graph.network import Roads
from ..observations import Array
from ..ragged import row_and_place
from .streets import Ints


def edge_lines(arrays: Roads, edge: Ints, start: Array, end: Array) -> tuple[Array, Array, Ints]:
    """See `RoadMap.edge_lines`."""
    vertices, edges = arrays.vertices, arrays.edges
    low = edges.first_vertex[edge]
    count = edges.last_vertex[edge] - low + 1
    line, place = row_and_place(count)
    vertex = low[line] + place
    x, y, s = vertices.x, vertices.y, vertices.s
    length = edges.length[edge]
    start = np.clip(start, 0.0, length)
    end = np.clip(end, start, length)
    first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int64)
    ends = []
    for at in (start, end):  # the segment that holds the cut; its vertices stay where outside
        before = s[vertex] <= at[line]
        k = low + np.clip(np.add.reduceat(before, first) - 1, 0, count - 2) if len(edge) else low
        share = (at - s[k]) / (s[k + 1] - s[k])
        ends.append([v[k] + share * (v[k + 1] - v[k]) for v in (x, y)])
    inside = (s[vertex] > start[line]) & (s[vertex] < end[line])
    order = np.argsort(
        np.concatenate([np.arange(len(edge)), line[inside], np.arange(len(edge))]),
        kind="stable",
    )
    x, y = (
        np.concatenate([ends[0][i], v[vertex[inside]], ends[1][i]])[order]
        for i, v in enumerate((x, y))
    )
    parts = np.bincount(line[inside], minlength=len(edge)) + 2
    return x, y, np.concatenate([[0], np.cumsum(parts)]).astype(np.int64)
