"""Which edge follows which, by what turn, how probably, and what rule that breaks."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..geodesy.angles import radians
from ..graph.network import AGAINST_ONE_WAY, NO_ACCESS, TURN, TURN_BANNED, U_TURN
from ..observations import Array
from .bans import Bans
from .shelf import release, table
from .streets import Bytes, Column, Ints, Streets

Ints32 = NDArray[np.int32]

# turn priors before they are normalised (docs/model/hypotheses.md)
_STRAIGHT = radians(34.0)
_SHARP = radians(120.0)
_BEND, _HAIRPIN, _TURN_ROUND = 0.5, 0.1, 0.01
_U_TURN_MID_ROAD = 1e-4  # of a U-turn where there is no junction; a stub hardly is one
_SERVED = 500.0  # m, length from which on a dead end attracts full traffic
_INTO_SERVICE = 0.3
WRONG_WAY = 2e-4
_AT_ONCE = 1 << 18  # turns


class Turns(NamedTuple):
    """Successors and predecessors of every edge, as in `Roads`."""

    first: Ints32  # (E+1,) first turn out of each edge
    table: Records  # (S,) TURN, without costs
    first_predecessor: Ints32  # (E+1,)
    predecessors: Ints32  # (S,)
    dropped: dict[str, int]


class Graph(NamedTuple):
    """What turns are made of: (E,) columns of the edges."""

    from_node: Ints32
    to_node: Ints32
    opposite: Ints32
    heading_out: Array  # rad, away from the start
    heading_in: Array  # rad, into the end
    service: Bytes
    rule: Bytes
    length: Array  # m
    first_way: Ints32  # street on which the edge begins
    last_way: Ints32  # street on which it ends
    first_forward: Bytes  # 1 where it begins as that street was drawn
    last_forward: Bytes


def successors(graph: Graph, streets: Streets, node_id: Column) -> Turns:
    """All turns from each edge into those that leave its end.

    Args:
        graph: The edges.
        streets: Where they come from, for turn restrictions and blocked nodes.
        node_id: (J,) source ids of the junctions, ascending where there are restrictions.

    Returns:
        The turns.
    """
    leaving = np.argsort(graph.from_node, kind="stable").astype(np.int32)
    node_first = np.searchsorted(graph.from_node[leaving], np.arange(len(node_id) + 1))
    count = (node_first[1:] - node_first[:-1])[graph.to_node]
    first = np.concatenate([[0], np.cumsum(count)])
    origin = np.repeat(np.arange(len(count), dtype=np.int32), count)
    place = np.arange(first[-1])
    place -= np.repeat(first[:-1] - node_first[graph.to_node], count)
    edge = leaving[place]
    del place

    u_turn = edge == graph.opposite[origin]
    broken = graph.rule[edge] | np.where(u_turn, U_TURN, 0).astype(np.uint8)
    source_id, dropped = streets.columns["source_id"], dict[str, int]()
    if streets.restrictions:
        bans = Bans(graph, source_id, node_id, first, edge, broken)
        banned, dropped = bans.places(streets.restrictions)
        broken[banned] |= TURN_BANNED
    blocked = np.zeros(len(edge), bool)
    if isinstance(node_id, np.ndarray):
        blocked = np.isin(node_id, streets.blocked)[graph.from_node[edge]] & ~u_turn
        broken[blocked] |= NO_ACCESS
    dead_end = (count == 1) & (graph.opposite >= 0)  # all that one can do is turn round
    turns = table(len(edge), TURN)
    turns.edge, turns.rule = edge, broken
    for low, high in _blocks(first):
        own = slice(int(first[low]), int(first[high]))
        angle = _angles(graph, origin[own], edge[own], u_turn[own])
        bounds = first[low : high + 1] - first[low]
        turns.angle[own] = angle
        turns.prior[own] = _priors(
            graph, bounds, origin[own], edge[own], angle, broken[own], blocked[own],
            dead_end[edge[own]], low,
        )  # fmt: skip
        release(turns)
    return Turns(first.astype(np.int32), turns, *_predecessors(origin, edge, count), dropped)


def _blocks(first: Ints) -> list[tuple[int, int]]:
    """Consecutive edges with some turns each: the first, and that behind."""
    bounds = np.searchsorted(first, np.arange(0, first[-1], _AT_ONCE))
    bounds = np.unique(np.append(bounds, len(first) - 1))
    return list(pairwise(bounds.tolist()))


def _angles(graph: Graph, origin: Ints32, edge: Ints32, u_turn: NDArray[np.bool_]) -> Array:
    """Of turns, rad, counter-clockwise."""
    angle = _wrapped(graph.heading_out[edge] - graph.heading_in[origin])
    angle[u_turn] = np.pi
    return angle


def _predecessors(origin: Ints32, edge: Ints32, count: Ints) -> tuple[Ints32, Ints32]:
    """First predecessor of each edge, and the predecessors."""
    back = np.argsort(edge, kind="stable")
    into = np.bincount(edge, minlength=len(count))
    first = np.concatenate([[0], np.cumsum(into)]).astype(np.int32)
    return first, origin[back]


def _wrapped(angle: Array) -> Array:
    """Angles in (-π, π]."""
    wrapped: Array = np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
    return wrapped


def _priors(
    graph: Graph, first: Ints, origin: Ints32, edge: Ints32, angle: Array, broken: Bytes,
    blocked: NDArray[np.bool_], dead: NDArray[np.bool_], low: int,
) -> Array:  # fmt: skip
    """Probability of each turn from edges `low` on; those of one edge sum to one.

    `dead`: it leads into a dead end.
    """
    own = origin - low
    size = np.abs(angle)
    weight = np.where(size < _STRAIGHT, 1.0, np.where(size < _SHARP, _BEND, _HAIRPIN))
    ways = np.diff(first)[own]
    weight *= np.where(dead, np.minimum(graph.length[edge] / _SERVED, 1.0), 1.0)
    weight[(graph.service[edge] > 0) & (graph.service[origin] == 0)] *= _INTO_SERVICE
    back = (broken & U_TURN) > 0
    weight[back] = 0.0
    rest = np.add.reduceat(weight, first[:-1]) - np.maximum.reduceat(weight, first[:-1])
    share = np.minimum(rest / _BEND, 1.0)[own[back]]
    weight[back] = np.where(
        ways[back] == 1, _TURN_ROUND, np.maximum(share * _TURN_ROUND, _U_TURN_MID_ROAD)
    )
    # who is on a closed road already does not break the rule again at each junction
    closed = graph.rule & NO_ACCESS > 0
    wrong = (broken & (TURN_BANNED | AGAINST_ONE_WAY) > 0) | blocked
    weight[wrong | (closed[edge] & ~closed[origin])] *= WRONG_WAY
    shares: Array = weight / np.add.reduceat(weight, first[:-1])[own]
    return shares
