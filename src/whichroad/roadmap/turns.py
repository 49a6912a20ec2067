"""Which edge follows which, by what turn, how probably, and what rule that breaks."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.network import AGAINST_ONE_WAY, NO_ACCESS, TURN_BANNED, U_TURN
from ..records import Array
from .streets import Bytes, Column, Ints, Restriction, Texts

Ints32 = NDArray[np.int32]
Floats32 = NDArray[np.float32]

# turn priors before they are normalised (docs/model.md, section 7)
_STRAIGHT = np.radians(34.0)
_SHARP = np.radians(120.0)
_BEND, _HAIRPIN, _TURN_ROUND = 0.5, 0.1, 0.01
_INTO_SERVICE = 0.3
WRONG_WAY = 2e-4


class Turns(NamedTuple):
    """Successors and predecessors of every edge, as in `Roads`."""

    first: Ints32
    edge: Ints32
    prior: Floats32
    angle: Floats32
    rule: Bytes
    pred_first: Ints32
    pred: Ints32
    dropped: dict[str, int]


class _Graph(NamedTuple):
    """What turns are made of: (E,) columns of the edges."""

    from_node: Ints32
    to_node: Ints32
    opposite: Ints32
    first_way: Ints32  # street of the first half
    last_way: Ints32


def successors(
    from_node: Ints32, to_node: Ints32, opposite: Ints32, heading_out: Array, heading_in: Array,
    service: Bytes, rule: Bytes, restrictions: list[Restriction], node_id: Column,
    source_id: Column, first_way: Ints32, last_way: Ints32,
) -> Turns:  # fmt: skip
    """All turns from each edge into those that leave its end.

    Args:
        from_node: (E,) junction.
        to_node: (E,).
        opposite: (E,) edge of the other direction.
        heading_out: (E,) rad, away from the start.
        heading_in: (E,) rad, into the end.
        service: (E,) 1 for service roads.
        rule: (E,) bits.
        restrictions: Turn restrictions by source ids.
        node_id: (J,) source ids of the junctions, ascending where there are restrictions.
        source_id: (W,) source ids of the streets.
        first_way: (E,) street on which the edge begins.
        last_way: (E,) street on which it ends.

    Returns:
        The turns.
    """
    leaving = np.argsort(from_node, kind="stable").astype(np.int32)
    node_first = np.searchsorted(from_node[leaving], np.arange(len(node_id) + 1))
    count = (node_first[1:] - node_first[:-1])[to_node]
    first = np.concatenate([[0], np.cumsum(count)])
    origin = np.repeat(np.arange(len(to_node), dtype=np.int32), count)
    place = np.arange(first[-1]) - np.repeat(first[:-1] - node_first[to_node], count)
    edge = leaving[place]

    u_turn = edge == opposite[origin]
    angle = _wrapped(heading_out[edge] - heading_in[origin])
    angle[u_turn] = np.pi
    broken = rule[edge] | np.where(u_turn, U_TURN, 0).astype(np.uint8)
    graph = _Graph(from_node, to_node, opposite, first_way, last_way)
    banned, dropped = _banned(restrictions, graph, node_id, source_id, first, edge)
    broken[banned] |= TURN_BANNED
    prior = _priors(first, origin, edge, angle, broken, service, rule)
    back = np.argsort(edge, kind="stable")
    pred_first = np.searchsorted(edge[back], np.arange(len(to_node) + 1))
    return Turns(
        first.astype(np.int32), edge, prior.astype(np.float32), angle.astype(np.float32), broken,
        pred_first.astype(np.int32), origin[back], dropped,
    )  # fmt: skip


def _wrapped(angle: Array) -> Array:
    """Angles in (-π, π]."""
    wrapped: Array = np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
    return wrapped


def _priors(
    first: Ints, origin: Ints32, edge: Ints32, angle: Array, broken: Bytes, service: Bytes,
    rule: Bytes,
) -> Array:  # fmt: skip
    """Probability of each turn; those of one edge sum to one."""
    size = np.abs(angle)
    weight = np.where(size < _STRAIGHT, 1.0, np.where(size < _SHARP, _BEND, _HAIRPIN))
    weight[(broken & U_TURN) > 0] = _TURN_ROUND
    weight[(service[edge] > 0) & (service[origin] == 0)] *= _INTO_SERVICE
    # who is on a closed road already does not break the rule again at each junction
    entering = (rule[edge] & NO_ACCESS > 0) & (rule[origin] & NO_ACCESS == 0)
    weight[(broken & (TURN_BANNED | AGAINST_ONE_WAY) > 0) | entering] *= WRONG_WAY
    return weight / np.add.reduceat(weight, first[:-1])[origin]


def _banned(
    restrictions: list[Restriction], graph: _Graph, node_id: Column, source_id: Column,
    first: Ints, edge: Ints32,
) -> tuple[NDArray[np.int64], dict[str, int]]:  # fmt: skip
    """Places in the list of turns that a restriction bans."""
    if not restrictions or isinstance(source_id, Texts) or isinstance(node_id, Texts):
        return np.empty(0, np.int64), {}
    arriving = np.argsort(graph.to_node, kind="stable")
    in_first = np.searchsorted(graph.to_node[arriving], np.arange(len(node_id) + 1))
    found: list[int] = []
    unused = 0
    for r in restrictions:
        node = int(np.searchsorted(node_id, r.via))
        if node == len(node_id) or node_id[node] != r.via:
            unused += 1
            continue
        before = len(found)
        for e in arriving[in_first[node] : in_first[node + 1]]:
            if source_id[graph.last_way[e]] not in r.origin:
                continue
            turns = np.arange(first[e], first[e + 1])
            into = edge[turns]
            named = np.isin(source_id[graph.first_way[into]], r.target)
            if r.u_turn and set(r.origin) == set(r.target):
                named &= into == graph.opposite[e]
            if r.only and named.any():
                named = ~named
            elif r.only:
                named[:] = False
            found.extend(turns[named].tolist())
        unused += len(found) == before
    return np.array(found, dtype=np.int64), (
        {"restrictions that touch no turn of this map": unused} if unused else {}
    )
