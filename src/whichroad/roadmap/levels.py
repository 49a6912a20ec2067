"""How high roads are over the ground, by the levels of the map: bridges, dips, their ramps.

Maps tell no heights, but which roads are above others: `layer`, `bridge`, `tunnel`.  A level is
taken to be 6.5 m.  On the ground, within 120 m of a bridge along roads, the road is on a ramp that
leads to it; likewise where it dips below another one.  Of tunnels nothing is told: those in hills
have no ramp.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Ints32
from ..observations import Array
from ..ragged import row_and_place
from .attribute_names import LEVEL

if TYPE_CHECKING:
    from .roadmap import RoadMap

LEVEL_M = 6.5  # from level to level
RAMP_M = 120.0  # length of a ramp
STEP_M = 10.0  # of a ramp, for which one height is told
UNIT_M, ZERO = 0.1, 128  # a height is told as a whole number: UNIT_M (number - ZERO)


Numbers = NDArray[Any]  # numbers of edges or of pieces


class Profile(NamedTuple):
    """Pieces of edges, finer than those of the map, and heights on them.  Q pieces, E edges."""

    first: Ints32  # (E+1,) first piece of each edge
    start: Array  # (Q,) abscissa at which each begins, m
    piece: Ints32  # (Q,) the map's piece that it is a part of
    height: np.ndarray  # (Q,) u1, UNIT_M (height - ZERO) metres over the ground


def profile(roads: "RoadMap") -> Profile:
    """Heights of all roads over the ground."""
    level = np.array(roads.at_pieces(LEVEL), float).clip(-1.0, 1.9)
    level[np.array(roads.at_pieces("tunnel"), bool)] = 0.0  # hills have them, without a ramp
    first = np.asarray(roads.pieces.first, np.int64)
    count = np.diff(first)
    edge: Numbers = np.repeat(np.arange(len(count)), count)
    start = np.asarray(roads.pieces.start, float)
    end = np.append(start[1:], 0.0)
    last = first[1:] - 1
    length = np.asarray(roads.arrays.edges.length, float)
    end[last[count > 0]] = length[count > 0]
    ends = _ends(roads, level, edge, start, end)
    near = np.minimum(*(ends[0][getattr(roads.arrays.edges, n)] for n in ("from_node", "to_node")))
    fine = (near[edge] < RAMP_M) | np.isin(edge, edge[level != 0.0])
    parts = np.where(fine & (level == 0.0), np.ceil((end - start) / STEP_M), 1.0)
    parts = parts.astype(np.int64).clip(1)
    piece, k = row_and_place(parts)
    width = ((end - start) / parts)[piece]
    at = start[piece] + k * width
    height = LEVEL_M * level[piece]
    ramp = fine[piece] & (level[piece] == 0.0)
    height[ramp] = _on_ramps(
        roads, ends, level, (edge, start, end, first), piece[ramp], (at + 0.5 * width)[ramp]
    )
    told = np.round(height / UNIT_M + ZERO).clip(0, 255).astype(np.uint8)
    offset = np.concatenate([[0], np.cumsum(parts)])
    return Profile(offset[first].astype(np.int32), at, piece.astype(np.int32), told)


def _ends(
    roads: "RoadMap", level: Array, edge: Numbers, start: Array, end: Array
) -> tuple[Array, Array]:
    """For each node how far the nearest bridge or tunnel is along roads, m, and its level."""
    edges = roads.arrays.edges
    nodes = int(max(edges.from_node.max(), edges.to_node.max())) + 1 if len(edges) else 0
    far, of = np.full(nodes, np.inf), np.zeros(nodes)
    on = np.flatnonzero(level)
    for node, way in ((edges.from_node[edge[on]], start[on]),
                      (edges.to_node[edge[on]], edges.length[edge[on]] - end[on])):  # fmt: skip
        order = np.argsort(-way, kind="stable")  # the nearest is written last
        nearer = order[way[order] < far[node[order]]]
        far[node[nearer]], of[node[nearer]] = way[nearer], level[on][nearer]
    while True:  # along whole edges, until no node comes nearer within a ramp
        way = far[edges.from_node] + edges.length
        nearer = np.flatnonzero((way < far[edges.to_node] - 1e-9) & (way < RAMP_M))
        if not len(nearer):
            return far, of
        nearer = nearer[np.argsort(-way[nearer], kind="stable")]
        to, origin = edges.to_node[nearer], edges.from_node[nearer]
        far[to], of[to] = way[nearer], of[origin]


def _on_ramps(
    roads: "RoadMap", ends: tuple[Array, Array], level: Array,
    pieces: tuple[Numbers, Array, Array, Numbers], piece: Numbers, at: Array,
) -> Array:  # fmt: skip
    """Heights at places on pieces that are on the ground, by what is nearest along the road."""
    edge, start, end, first = pieces
    edges, (far, of) = roads.arrays.edges, ends
    here = edge[piece]
    away, found = far[edges.from_node[here]] + at, of[edges.from_node[here]]

    def closer(other: Array, its: Array) -> None:
        better = other < away
        away[better], found[better] = other[better], its[better]

    closer(far[edges.to_node[here]] + edges.length[here] - at, of[edges.to_node[here]])
    for side in (-1, 1):  # bridges on the same edge, beside the piece or farther on
        other = piece.copy()
        for _ in range(8):
            other = (other + side).clip(first[here], first[here + 1] - 1)
            gap = np.where(side < 0, at - end[other], start[other] - at)
            closer(np.where(level[other] != 0.0, np.maximum(gap, 0.0), np.inf), level[other])
    near = np.clip(1.0 - away / RAMP_M, 0.0, 1.0)
    return np.asarray(LEVEL_M * found * (0.5 - 0.5 * np.cos(np.pi * near)))
