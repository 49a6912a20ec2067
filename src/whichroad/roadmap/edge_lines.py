"""Parts of edges as polylines, many at once."""

import numpy as np

from ..graph.network import Roads
from ..observations import Array
from ..ragged import row_and_place
from .streets import Ints


def edge_lines(arrays: Roads, edge: Ints, start: Array, end: Array) -> tuple[Array, Array, Ints]:
    """See `RoadMap.edge_lines`."""
    vertices, edges = arrays.vertices.view(np.ndarray), arrays.edges.view(np.ndarray)
    low = edges["first_vertex"][edge]
    count = edges["last_vertex"][edge] - low + 1
    line, place = row_and_place(count)
    vertex = low[line] + place
    x, y, s = (vertices[name] for name in ("x", "y", "s"))
    length = edges["length"][edge]
    start = np.clip(start, 0.0, length)
    end = np.clip(end, start, length)
    first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int64)
    ends = []
    for at in (start, end):  # the segment that holds the cut; its vertices stay where outside
        before = s[vertex] <= at[line]
        k = low + np.clip(np.add.reduceat(before, first) - 1, 0, count - 2) if len(edge) else low
        share = (at - s[k]) / (s[k + 1] - s[k])
        ends.append([v[k] + share * (v[k + 1] - v[k]) for v in (x, y)])
    inside = np.flatnonzero((s[vertex] > start[line]) & (s[vertex] < end[line]))
    inner = line[inside]
    parts = np.zeros(len(edge) + 1, np.int64)
    np.cumsum(np.bincount(inner, minlength=len(edge)) + 2, out=parts[1:])
    lines = np.empty((2, parts[-1]))
    for whole, v, begin, stop in zip(lines, (x, y), *ends, strict=True):
        whole[parts[:-1]], whole[parts[1:] - 1] = begin, stop
        whole[np.arange(len(inner)) + 2 * inner + 1] = v[vertex[inside]]
    return *lines, parts
