"""Routes out of the graph of merged hypotheses: the best one, and those that compete."""

import heapq
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .core.belief import OFF_ROAD, Belief, Route, new_route
from .core.memory import Memory
from .core.network import Roads
from .core.ways import best_way, edge_probability
from .records import Array

_OFF = 0.5  # what an epoch off the roads counts for the route, which is to be of roads
_CLOSE = 2.0  # s between two steps, in which an edge is entered at the second
_HOPS = 256  # edges between two steps, at most
_DETOUR = 3.0  # times the distance between two edges that no hypothesis joins, and
_DETOUR_MORE = 300.0  # m
_SURE = 0.999  # P(edge) from which on an edge is passed by every way
_BEAM = 200  # ways that are followed at once between two such edges
_LEAST = 1e-4  # P of a way that is not worth it


class Chain(NamedTuple):
    """Edges in driving order, OFF_ROAD between, and when and where each was entered."""

    edge: NDArray[np.int32]
    time: Array  # s
    abscissa: Array  # m


def tidied(route: Route, *users: NDArray[np.int64]) -> Route:
    """The tree of edges with room for more, and only the nodes that its users descend from.

    Args:
        route: The tree.
        users: Numbers of nodes, renumbered in place; negative: none.

    Returns:
        The tree to go on with.
    """
    used = int(route.size[0])
    keep = np.zeros(used, bool)
    for nodes in users:
        for node in np.unique(nodes).tolist():
            while node >= 0 and not keep[node]:
                keep[node] = True
                node = int(route.parent[node])
    kept = np.flatnonzero(keep)
    number = np.full(used + 1, -1, np.int64)
    number[kept] = np.arange(len(kept))
    larger = new_route(max(len(route.edge), 4 * len(kept) + (1 << 14)))
    larger.edge[: len(kept)] = route.edge[kept]
    larger.parent[: len(kept)] = number[route.parent[kept]]
    larger.time[: len(kept)] = route.time[kept]
    larger.abscissa[: len(kept)] = route.abscissa[kept]
    larger.size[0] = len(kept)
    for nodes in users:
        nodes[:] = number[nodes]
    return larger


def heaviest_chain(route: Route, belief: Belief) -> "Chain":
    """The edges that the most probable hypothesis has come by.

    Args:
        route: The tree of edges entered.
        belief: The filter's.

    Returns:
        The edges.
    """
    n = int(belief.size[0])
    if n == 0:
        return Chain(np.zeros(0, np.int32), np.zeros(0), np.zeros(0))
    node = int(belief.node[int(np.argmax(belief.log_weight[:n]))])
    chain = []
    while node >= 0:
        chain.append(node)
        node = int(route.parent[node])
    at = np.array(chain[::-1], int)
    return Chain(route.edge[at], route.time[at], route.abscissa[at])


@dataclass(frozen=True, slots=True)
class Way:
    """One way to drive, of several."""

    p: float
    edges: tuple[int, ...]  # in driving order; those off the roads are left out


@dataclass(frozen=True, slots=True)
class Alternative:
    """A part of the drive where the route is not sure, between two edges that are."""

    start: float  # s, when the last sure edge before was still driven
    end: float  # s, when the first sure edge after it was
    ways: tuple[Way, ...]  # the most probable first; from the one edge to the other


def best_chain(memory: Memory, route: Route, roads: Roads, *, viterbi: bool = False) -> Chain:
    """The route on which most of the drive is right, by the smoothed probabilities.

    Args:
        memory: The graph, looked back over.
        route: The tree of edges entered.
        roads: The network.
        viterbi: Rather the most probable chain of hypotheses.

    Returns:
        The edges.
    """
    steps, nodes, _ = memory.size.tolist()
    p, score = np.zeros((2, nodes))
    back, way = np.zeros(nodes, np.int64), np.zeros(steps, np.int64)
    edge_probability(memory, p)
    p[memory.edge[:nodes] == OFF_ROAD] *= _OFF
    weight = np.diff(memory.time[:steps], append=memory.time[steps - 1]) + 0.1
    best_way(memory, weight, p, viterbi, score, back, way)
    return _told(memory, route, roads, way)


def _told(memory: Memory, route: Route, roads: Roads, way: NDArray[np.int64]) -> Chain:
    """The edges that a chain of nodes, one a step, has driven."""
    edge = memory.edge[way]
    at = np.flatnonzero(np.diff(edge, prepend=-9))
    rows: list[tuple[int, float, float]] = []
    for k in at.tolist():
        now, node = float(memory.time[k]), int(memory.tree[way[k]])
        before = float(memory.time[k - 1]) if k else now
        between = _between(route, roads, memory, int(way[k - 1]), int(way[k])) if k else []
        rows += [(e, min(max(t, before), now), 0.0) for e, t in between]
        where, when = 0.0, now
        if node >= 0 and route.edge[node] == edge[k]:
            where = float(route.abscissa[node])
            when = float(route.time[node]) if now - before > _CLOSE else now
        rows.append((int(edge[k]), min(max(when, before), now), where))
    edges, times, abscissae = zip(*rows, strict=True)
    return Chain(np.array(edges, np.int32), np.array(times), np.array(abscissae))


def _between(route: Route, roads: Roads, memory: Memory, i: int, j: int) -> list[tuple[int, float]]:
    """Edges driven between those of two linked nodes, and when each was entered."""
    then, edge = int(memory.edge[i]), int(memory.edge[j])
    if OFF_ROAD in (then, edge) or roads.opposite[edge] == then or joins(roads, then, edge):
        return []
    found: list[tuple[int, float]] = []
    node, stop = int(memory.tree[j]), int(memory.tree[i])
    while (node := int(route.parent[node])) >= 0 and node != stop:
        at = int(route.edge[node])
        if at in (OFF_ROAD, then) or len(found) == _HOPS:
            break
        found.append((at, float(route.time[node])))
    if node >= 0 and (node == stop or route.edge[node] == then):
        return found[::-1]
    step = int(np.searchsorted(memory.first_node[: memory.size[0]], j, side="right")) - 1
    return [(e, float(memory.time[step])) for e in shortest(roads, then, edge) or []]


def joins(roads: Roads, a: int, b: int) -> bool:
    """Whether edge b follows on edge a."""
    return b in roads.succ[roads.succ_first[a] : roads.succ_first[a + 1]].tolist()


def shortest(roads: Roads, a: int, b: int) -> list[int] | None:
    """Edges between the end of edge a and the start of edge b, none where there is no near way."""
    end, start = roads.first[a + 1] - 1, roads.first[b]
    away = float(np.hypot(roads.x[end] - roads.x[start], roads.y[end] - roads.y[start]))
    reach = _DETOUR * away + _DETOUR_MORE
    queue: list[tuple[float, int, int]] = [(0.0, a, -1)]
    came: dict[int, int] = {}
    while queue:
        so_far, edge, before = heapq.heappop(queue)
        if edge in came:
            continue
        came[edge] = before
        if edge == b:
            found = []
            while (edge := came[edge]) != a:
                found.append(edge)
            return found[::-1]
        for t in range(roads.succ_first[edge], roads.succ_first[edge + 1]):
            f = int(roads.succ[t])
            cost = so_far + (float(roads.length[f]) if f != b else 0.0)
            cost += 500.0 if roads.succ_rule[t] else 0.0
            if f not in came and cost <= reach:
                heapq.heappush(queue, (cost, f, edge))
    return None


def alternatives(memory: Memory, route: Route, roads: Roads) -> list[Alternative]:
    """The drive in parts between sure edges, each with its ways and their probabilities.

    The parts follow each other, the last edge of one being the first of the next; nearly all
    have one way.

    Args:
        memory: The graph, looked back over.
        route: The tree of edges entered.
        roads: The network.

    Returns:
        The parts in driving order.
    """
    steps, nodes, _ = memory.size.tolist()
    p = np.zeros(nodes)
    edge_probability(memory, p)
    top = np.maximum.reduceat(p, memory.first_node[:steps]) if steps else np.zeros(0)
    sure = np.flatnonzero(top >= _SURE).tolist()
    if not sure or sure[0] != 0:
        sure.insert(0, 0)
    if sure[-1] != steps - 1:
        sure.append(steps - 1)
    best = [_best_edge(memory, p, t) for t in sure]
    parts: list[Alternative] = []
    for k in range(len(sure) - 1):
        a, b = sure[k], sure[k + 1]
        if b == a + 1 and best[k] == best[k + 1]:
            continue
        ways = _ways(memory, route, roads, a, b)
        parts.append(Alternative(float(memory.time[a]), float(memory.time[b]), ways))
    if not parts and steps:
        alone = Way(1.0, (best[0],) if best[0] != OFF_ROAD else ())
        parts.append(Alternative(float(memory.time[0]), float(memory.time[steps - 1]), (alone,)))
    return parts


def _best_edge(memory: Memory, p: Array, step: int) -> int:
    first, last = memory.first_node[step : step + 2].tolist()
    return int(memory.edge[first + int(np.argmax(p[first:last]))])


def _ways(memory: Memory, route: Route, roads: Roads, first: int, last: int) -> tuple[Way, ...]:
    """Ways from one step to a later one, backwards: P(way) = Σ γ(last) Π f over its chains.

    A way is kept as its last edges, each with what follows, so that ways share their ends.
    """
    tails: list[tuple[int, int]] = []  # edge, number of the tail that follows
    number: dict[tuple[int, int], int] = {}

    def put(edge: int, tail: int) -> int:
        key = (edge, tail)
        if key not in number:
            number[key] = len(tails)
            tails.append(key)
        return number[key]

    here: dict[tuple[int, int], float] = {}
    for j in range(*memory.first_node[last : last + 2].tolist()):
        here[j, put(int(memory.edge[j]), -1)] = float(memory.smoothed[j])
    for step in range(last, first, -1):
        then = int(memory.first_node[step - 1])
        before: dict[tuple[int, int], float] = {}
        for (j, tail), weight in here.items():
            for link in range(*memory.first_link[j : j + 2].tolist()):
                i, part = then + int(memory.origin[link]), weight * float(memory.share[link])
                if part < 0.1 * _LEAST:
                    continue
                longer = tail
                if memory.edge[i] != memory.edge[j]:
                    for edge, _ in reversed(_between(route, roads, memory, i, j)):
                        longer = put(edge, longer)
                    longer = put(int(memory.edge[i]), longer)
                before[i, longer] = before.get((i, longer), 0.0) + part
        if len(before) > _BEAM:
            before = dict(sorted(before.items(), key=lambda item: -item[1])[:_BEAM])
        if not before:  # a new beginning
            break
        here = before
    return _summed(here, tails)


def _summed(here: dict[tuple[int, int], float], tails: list[tuple[int, int]]) -> tuple[Way, ...]:
    """Ways of the same edges are one."""
    ways: dict[tuple[int, ...], float] = {}
    for (_, tail), weight in here.items():
        edges: list[int] = []
        while tail >= 0:
            edge, tail = tails[tail]
            if edge != OFF_ROAD and (not edges or edges[-1] != edge):
                edges.append(edge)
        ways[tuple(edges)] = ways.get(tuple(edges), 0.0) + weight
    total = math.fsum(ways.values())
    kept = sorted(((w / total, e) for e, w in ways.items() if w > _LEAST * total), reverse=True)
    return tuple(Way(p, edges) for p, edges in kept)


def best_ways(parts: list[Alternative], count: int) -> list[Way]:
    """The most probable whole routes: parts are independent, given the sure edges between.

    Args:
        parts: As `alternatives` gives them.
        count: How many at most.

    Returns:
        Ways from the first edge to the last, the most probable first.
    """
    open_parts = [k for k, part in enumerate(parts) if len(part.ways) > 1]
    start = (0,) * len(open_parts)

    def log_p(choice: tuple[int, ...]) -> float:
        return math.fsum(
            math.log(parts[k].ways[c].p) for k, c in zip(open_parts, choice, strict=True)
        )

    queue, seen = [(-log_p(start), start)], {start}
    found: list[Way] = []
    while queue and len(found) < count:
        cost, choice = heapq.heappop(queue)
        found.append(
            Way(math.exp(-cost), _joined(parts, dict(zip(open_parts, choice, strict=True))))
        )
        for at, c in enumerate(choice):
            if c + 1 < len(parts[open_parts[at]].ways):
                other = (*choice[:at], c + 1, *choice[at + 1 :])
                if other not in seen:
                    seen.add(other)
                    heapq.heappush(queue, (-log_p(other), other))
    return found


def _joined(parts: list[Alternative], choice: dict[int, int]) -> tuple[int, ...]:
    edges: list[int] = []
    for k, part in enumerate(parts):
        for edge in part.ways[choice.get(k, 0)].edges:
            if not edges or edges[-1] != edge:
                edges.append(edge)
    return tuple(edges)
