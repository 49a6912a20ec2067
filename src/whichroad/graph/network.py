"""The road network as the kernels see it: tables of vertices, edges and turns, and a grid.

Coordinates are metres in the map's plane, a conformal projection whose local scale is
`1 + curvature (x² + y²)`.  Abscissae and lengths are true metres on the ground.  Every edge
lists its own vertices in driving direction, so the two directions of a street hold the same
points in opposite order.
"""

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Array, Ints, Ints32, Records, kernel

AGAINST_ONE_WAY = 1  # bit of `rule`
TURN_BANNED = 2
NO_ACCESS = 4
U_TURN = 8
STRAIGHT_ON = 0.1  # rad; a node that bends a road less is none to its driver

VERTEX = np.dtype(
    [
        ("x", "f8"),  # m, plane
        ("y", "f8"),  # m, plane
        ("s", "f8"),  # abscissa from the start of its edge, true m
    ],
    align=True,
)

EDGE = np.dtype(
    [
        ("length", "f8"),  # true m, > 0
        ("first_vertex", "i4"),
        ("last_vertex", "i4"),
        ("first_turn", "i4"),  # turns onto successors: first_turn ... end_turn - 1
        ("end_turn", "i4"),
        ("first_predecessor", "i4"),
        ("end_predecessor", "i4"),
        ("from_node", "i4"),
        ("to_node", "i4"),
        ("opposite", "i4"),  # the edge of the other direction, -1 when there is none
        ("lane", "f4"),  # usual offset right of the centre line when driving on the right, m
        ("lane_sigma", "f4"),  # sigma of the lane driven in, m; 0 where there is but one
        ("speed", "f4"),  # usual speed, m/s
        ("end_x", "f4"),  # of the last vertex, m, plane, for the route search
        ("end_y", "f4"),
        ("route_length", "f4"),  # length as the route search adds it up, m
        ("cost", "f4"),  # of driving the edge, metres of a street of usual speed
        ("time", "f4"),  # at the usual speed, s
        ("rule", "u1"),  # bits: AGAINST_ONE_WAY, NO_ACCESS; 0 when driving here is legal
        ("service", "u1"),  # 1 for service roads
    ],
    align=True,
)

TURN = np.dtype(
    [
        ("edge", "i4"),  # the successor
        ("prior", "f4"),  # probability of the turn, sums to one per edge
        ("angle", "f4"),  # turn at the node, rad, counter-clockwise
        ("cost", "f4"),  # nats, 0 for the likeliest turn there
        ("rule", "u1"),  # bits of the rules broken by the turn
    ],
    align=True,
)

SEGMENT = np.dtype(
    [
        ("edge", "i4"),
        ("vertex", "i4"),  # its first
    ],
    align=True,
)

PLANE = np.dtype(
    [
        ("cell_size", "f8"),  # of the grid, plane m
        ("curvature", "f8"),  # 1 / (4 R²), 1/m²
    ],
    align=True,
)


class Roads(NamedTuple):
    """Directed edges between junctions, their shape, their successors, and a grid.

    Shapes: V vertices, E directed edges, S turns, C grid cells, G segments in cells.
    """

    vertices: Annotated[Records, Array(VERTEX, 1)]  # (V,)
    edges: Annotated[Records, Array(EDGE, 1)]  # (E,)
    turns: Annotated[Records, Array(TURN, 1)]  # (S,), those out of one edge side by side
    predecessors: Ints32  # (S,) edges, those into one edge side by side
    cell_key: Ints  # (C,) sorted keys of the cells that hold segments, see `graph.index`
    cell_first: Ints32  # (C+1,) first segment of each cell
    segments: Annotated[Records, Array(SEGMENT, 1)]  # (G,)
    plane: Annotated[Records, Array(PLANE, 1)]  # (1,)


def records(n: int, dtype: np.dtype[Any]) -> Records:
    """Cleared records of which fields are attributes: `a[i].x`, and the column `a.x`."""
    return np.zeros(n, dtype).view(np.recarray)


def bytes_of(table: NDArray[Any]) -> memoryview:
    """The bytes of records, read and written in place: field by field takes a hundred times longer.

    Args:
        table: In C order.
    """
    buffer: Any = table.view(np.ndarray).reshape(-1).view(np.uint8)
    return memoryview(buffer)


def clear(table: NDArray[Any]) -> None:
    """Set all fields of records to zero."""
    np.asarray(bytes_of(table)).fill(0)


def copied(table: NDArray[Any]) -> Records:
    """Records of one's own."""
    return np.frombuffer(bytearray(bytes_of(table)), table.dtype).view(np.recarray)


@kernel
def plane_scale(roads: Roads, x: float, y: float) -> float:
    """Local scale of the plane: plane metres per true metre at a point."""
    return float(1.0 + roads.plane[0].curvature * (x * x + y * y))


@kernel
def lane_sigma_of(roads: Roads, edge: int, lane_sigma: float) -> float:
    """Sigma of the offset from the usual lane on an edge, m: the driver's and the lanes'."""
    own = float(roads.edges[edge].lane_sigma)
    return math.sqrt(lane_sigma * lane_sigma + own * own)


@kernel
def parts(roads: Roads, edge: int) -> bool:
    """Whether more than one road goes on at the end of an edge, other than back."""
    road = roads.edges[edge]
    number = 0
    for t in range(road.first_turn, road.end_turn):
        if roads.turns[t].edge != road.opposite:
            number += 1
    return number > 1


@kernel
def onwards(roads: Roads, edge: int) -> int:
    """Where a road just runs on at the end of an edge, hardly bent, and no other ends; or -1."""
    road = roads.edges[edge]
    after = -1
    for t in range(road.first_turn, road.end_turn):
        turn = roads.turns[t]
        if turn.edge == road.opposite:
            continue
        if after >= 0 or abs(turn.angle) > STRAIGHT_ON:
            return -1
        after = int(turn.edge)
    if after < 0:
        return -1
    others = 0
    for t in range(roads.edges[after].first_predecessor, roads.edges[after].end_predecessor):
        if roads.predecessors[t] != roads.edges[after].opposite:
            others += 1
    return after if others == 1 else -1


@kernel
def backwards(roads: Roads, edge: int) -> int:
    """The edge whose road just runs on along this one (`onwards`), or -1."""
    road = roads.edges[edge]
    before = -1
    for t in range(road.first_predecessor, road.end_predecessor):
        if roads.predecessors[t] != road.opposite:
            if before >= 0:
                return -1
            before = int(roads.predecessors[t])
    return before if before >= 0 and onwards(roads, before) >= 0 else -1


@kernel
def is_at_node(roads: Roads, edge: int, s: float, radius: float) -> bool:
    """Whether an abscissa (m) is within a radius of a node that is more than a straight line's."""
    if roads.edges[edge].length - s < radius and onwards(roads, edge) < 0:
        return True
    return bool(s < radius and backwards(roads, edge) < 0)
