"""The road network as the kernels see it: flat arrays and nothing else."""

import math
from typing import NamedTuple

from ._jit import Bytes, Floats32, Ints, Ints32, Matrix32, Vector, kernel

AGAINST_ONE_WAY = 1  # bit of `rule` and `succ_rule`
TURN_BANNED = 2
NO_ACCESS = 4
U_TURN = 8


class Roads(NamedTuple):
    """Directed edges between junctions, their shape, their successors, and a grid.

    Coordinates are metres in the map's plane, a conformal projection whose local
    scale is `1 + curvature (x² + y²)`; abscissae and lengths are true metres on the
    ground.  Every edge lists its own vertices in driving direction, so the two
    directions of a street hold the same points in opposite order.

    Shapes: V vertices, E directed edges, S turns, C grid cells, G segments in cells.
    """

    x: Vector  # (V,) m, plane
    y: Vector  # (V,) m, plane
    s: Vector  # (V,) abscissa of the vertex from the start of its edge, true m
    first: Ints32  # (E+1,) first vertex of each edge
    length: Vector  # (E,) true m, > 0
    from_node: Ints32  # (E,)
    to_node: Ints32  # (E,)
    opposite: Ints32  # (E,) the edge of the other direction, -1 when there is none
    lane: Floats32  # (E,) usual offset right of the centre line when driving on the right, m
    lane_spread: Floats32  # (E,) sigma of the lane driven in, m; 0 where there is but one
    speed: Floats32  # (E,) usual speed, m/s
    service: Bytes  # (E,) 1 for service roads
    rule: Bytes  # (E,) bits: AGAINST_ONE_WAY, NO_ACCESS; 0 when driving here is legal
    succ_first: Ints32  # (E+1,)
    succ: Ints32  # (S,) the edge that follows
    succ_prior: Floats32  # (S,) probability of the turn, sums to one per edge
    succ_turn: Floats32  # (S,) turn at the node, rad, counter-clockwise
    succ_rule: Bytes  # (S,) bits of the rules broken by the turn
    pred_first: Ints32  # (E+1,)
    pred: Ints32  # (S,) the edges that precede
    cell_size: float  # plane m
    cell_key: Ints  # (C,) sorted keys of the cells that hold segments, see core.grid
    cell_first: Ints32  # (C+1,)
    cell_edge: Ints32  # (G,) edge of the segment
    cell_vertex: Ints32  # (G,) first vertex of the segment
    curvature: float  # 1 / (4 R²), 1/m²
    hop: Matrix32  # (E, 5) end, length, price and time of an edge, see core.hops
    succ_cost: Floats32  # (S,) nats that a turn costs, 0 for the likeliest


@kernel
def lane_sigma_of(roads: Roads, edge: int, lane_sigma: float) -> float:
    """Sigma of the offset from the usual lane on an edge, m: the driver's and the lanes'."""
    spread = float(roads.lane_spread[edge])
    return math.sqrt(lane_sigma * lane_sigma + spread * spread)
