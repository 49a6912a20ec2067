"""Turn restrictions to turns from edge to edge that break a rule.

A restriction over ways bans a turn only for those who came by a certain edge.  Turns have no
memory, so it is used where the rest of its route is forced: where nobody else can come to the
turn, or where nobody can do anything else behind it.  Others are counted.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .streets import Bytes, Column, Ints, Restriction, Texts

if TYPE_CHECKING:
    from .turns import Graph

Ints32 = NDArray[np.int32]
_LONGEST = 40  # edges of a route over ways
_UNUSED = "restrictions that touch no turn of this map"
_REMEMBERED = "restrictions via ways that bind only who came by one street"


def keys(column: Column) -> Ints:
    """What restrictions name: ids, or the codes of words."""
    return column.code.astype(np.int64) if isinstance(column, Texts) else column


class Bans:
    """The turns of a map, for restrictions to ban.

    Args:
        graph: The edges.
        source_id: (W,) ids of the streets.
        node_id: (J,) ids of the junctions.
        first: (E+1,) first turn out of each edge.
        edge: (S,) edge into which each turn leads.
        broken: (S,) rules that the turns break anyway.
    """

    def __init__(
        self, graph: "Graph", source_id: Column, node_id: Column, first: Ints, edge: Ints32,
        broken: Bytes,
    ) -> None:  # fmt: skip
        ids = keys(source_id)
        self._graph, self._first, self._edge = graph, first, edge
        self._begins, self._ends = ids[graph.first_way], ids[graph.last_way]  # (E,) ways
        self._nodes = keys(node_id)
        self._origin = np.repeat(np.arange(len(first) - 1, dtype=np.int32), np.diff(first))
        self._legal = (broken == 0) & (graph.rule[self._origin] == 0)
        self._arriving = np.argsort(graph.to_node, kind="stable")
        self._in_first = np.searchsorted(graph.to_node[self._arriving], np.arange(len(node_id) + 1))
        self._back = np.argsort(edge, kind="stable")
        self._back_first = np.searchsorted(edge[self._back], np.arange(len(first)))

    def places(self, restrictions: Sequence[Restriction]) -> tuple[Ints, dict[str, int]]:
        """Places in the list of turns that are banned, and what was not used."""
        if not restrictions:
            return np.empty(0, np.int64), {}
        via = np.array([r.via for r in restrictions])
        near = np.flatnonzero(np.isin(self._nodes, via[via >= 0]))
        nodes = dict(zip(self._nodes[near].tolist(), near.tolist(), strict=True))
        ending = self._by_way([r for r in restrictions if r.over and r.via < 0])
        found: list[int] = []
        dropped: dict[str, int] = {}
        for r in restrictions:
            if r.via >= 0:
                node = nodes.get(r.via)
                edges = [] if node is None else self._into(node)
            else:
                edges = [e for way in r.origin for e in ending.get(way, ())]
            edges = [e for e in edges if self._is_origin(r, e)]
            bans, why = self._over(r, edges) if r.over else (self._at(r, edges), _UNUSED)
            if not bans:
                dropped[why] = dropped.get(why, 0) + 1
            found += bans
        return np.array(found, dtype=np.int64), dropped

    def _by_way(self, restrictions: Sequence[Restriction]) -> dict[int, list[int]]:
        """The edges that end on the ways from which restrictions come."""
        wanted = [way for r in restrictions for way in r.origin]
        ending: dict[int, list[int]] = {}
        for e in np.flatnonzero(np.isin(self._ends, wanted)).tolist():
            ending.setdefault(int(self._ends[e]), []).append(e)
        return ending

    def _into(self, node: int) -> list[int]:
        edges: list[int] = self._arriving[self._in_first[node] : self._in_first[node + 1]].tolist()
        return edges

    def _is_origin(self, r: Restriction, e: int) -> bool:
        forward = r.origin_forward
        return self._ends[e] in r.origin and forward in (-1, int(self._graph.last_forward[e]))

    def _is_target(self, r: Restriction, turns: Ints) -> NDArray[np.bool_]:
        edges = self._edge[turns]
        named: NDArray[np.bool_] = np.isin(self._begins[edges], r.target)
        if r.target_forward >= 0:
            named &= self._graph.first_forward[edges] == r.target_forward
        return named

    def _out(self, e: int) -> Ints:
        return np.arange(self._first[e], self._first[e + 1])

    def _at(self, r: Restriction, edges: Sequence[int]) -> list[int]:
        """The turns at one node that are banned."""
        found: list[int] = []
        for e in edges:
            turns = self._out(e)
            named = self._is_target(r, turns)
            if set(r.origin) == set(r.target):  # the street may run on beyond the node
                named &= (self._edge[turns] == self._graph.opposite[e]) == r.u_turn
            if r.only:
                named = ~named if named.any() else named
            found += turns[named].tolist()
        return found

    def _over(self, r: Restriction, edges: Sequence[int]) -> tuple[list[int], str]:
        """The turns on a way over others that are banned, and why there is none."""
        found: list[int] = []
        routes = 0
        for e in edges:
            for route in self._routes(r, [e], 0):
                routes += 1
                found += self._only(route) if r.only else self._no(route)
        return found, _REMEMBERED if routes else _UNUSED

    def _routes(self, r: Restriction, way: list[int], done: int) -> Iterator[list[int]]:
        """Turns of each route from an edge over the ways to the target.

        Args:
            r: The restriction.
            way: Edges so far.
            done: How many of `r.over` were entered.
        """
        e, turns = way[-1], self._out(way[-1])
        if len(way) > _LONGEST:
            return
        target = self._is_target(r, turns) if done == len(r.over) else np.zeros(len(turns), bool)
        for turn, hit in zip(turns.tolist(), target.tolist(), strict=True):
            x = int(self._edge[turn])
            if x == self._graph.opposite[e] or x in way:
                continue
            if hit:
                yield [*self._turns(way), turn]
                continue
            begins, ends = int(self._begins[x]), int(self._ends[x])
            ahead = [
                k for k in (done, done + 1) if 0 < k <= len(r.over) and r.over[k - 1] == begins
            ]
            if ahead and ends in r.over[ahead[0] - 1 :]:
                after = max(k for k, one in enumerate(r.over, 1) if one == ends)
                yield from self._routes(r, [*way, x], max(ahead[0], after))

    def _turns(self, way: Sequence[int]) -> list[int]:
        """The turns between edges that follow each other."""
        return [int(next(t for t in self._out(a) if self._edge[t] == b)) for a, b in pairwise(way)]

    def _alone_into(self, turn: int) -> bool:
        """Whether nobody comes legally to where a turn leads but by this turn."""
        e = self._edge[turn]
        into = self._back[self._back_first[e] : self._back_first[e + 1]]
        return into[self._legal[into]].tolist() in ([], [turn])

    def _alone_out(self, turn: int) -> bool:
        """Whether nobody goes on legally from where a turn begins but by this turn."""
        out = self._out(int(self._origin[turn]))
        return out[self._legal[out]].tolist() in ([], [turn])

    def _no(self, route: list[int]) -> list[int]:
        """The last turn of a route before which, and behind which, all is forced."""
        for k in reversed(range(len(route))):
            before = all(self._alone_into(turn) for turn in route[:k])
            if before and all(self._alone_out(turn) for turn in route[k + 1 :]):
                return [route[k]]
        return []

    def _only(self, route: list[int]) -> list[int]:
        """All turns that leave a route to which nobody else can come."""
        if not all(self._alone_into(turn) for turn in route[:-1]):
            return []
        others = [self._out(int(self._origin[turn])) for turn in route[1:]]
        return [int(t) for turns in others for t in turns if t not in route]
