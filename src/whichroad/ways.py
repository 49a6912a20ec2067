"""Routes out of the graph of merged hypotheses: the best one, and those that compete."""

import heapq
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .core.belief import OFF_ROAD, Route
from .core.memory import Memory
from .core.network import Roads
from .core.ways import best_way, edge_probability
from .records import Array

_DETOUR = 3.0  # times the distance between two edges that no hypothesis joins, and
_DETOUR_MORE = 300.0  # m


class Chain(NamedTuple):
    """Edges in driving order, OFF_ROAD between, and when and where each was entered."""

    edge: NDArray[np.int32]
    time: Array  # s
    abscissa: Array  # m


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
    weight = np.diff(memory.time[:steps], append=memory.time[steps - 1]) + 0.1
    best_way(memory, weight, p, viterbi, score, back, way)
    edge = memory.edge[way]
    at = np.flatnonzero(np.diff(edge, prepend=-9))
    edges: list[int] = []
    times: list[float] = []
    for k in at.tolist():
        between = _between(route, roads, memory, int(way[k - 1]), int(way[k])) if k else []
        edges += [*between, int(edge[k])]
        times += [float(memory.time[k])] * (len(between) + 1)
    return Chain(np.array(edges, np.int32), np.array(times), np.zeros(len(edges)))


def _between(route: Route, roads: Roads, memory: Memory, i: int, j: int) -> list[int]:
    """Edges driven between those of two linked nodes."""
    then, edge = int(memory.edge[i]), int(memory.edge[j])
    if OFF_ROAD in (then, edge) or roads.opposite[edge] == then or joins(roads, then, edge):
        return []
    found: list[int] = []
    node, stop = int(route.parent[memory.tree[j]]), int(memory.tree[i])
    while node >= 0 and len(found) < 300:
        at = int(route.edge[node])
        if node == stop or at == then:
            return found[::-1]
        if at == OFF_ROAD:
            break
        found.append(at)
        node = int(route.parent[node])
    return shortest(roads, then, edge) or []


def joins(roads: Roads, a: int, b: int) -> bool:
    """Whether edge b follows on edge a."""
    return bool((roads.succ[roads.succ_first[a] : roads.succ_first[a + 1]] == b).any())


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
