"""The cheapest routes from one edge, by Dijkstra's method on all edges, slow and plain."""

import heapq
import math

import numpy as np

from whichroad.graph.network import Roads


def cheapest(roads: Roads, edge: int, s: float, per_metre: float) -> dict[int, tuple[float, float]]:
    """Cost (nats) and length (m) from abscissa s to the start of every edge beyond the first."""
    edges, turns = roads.edges, roads.turns
    begin, end = edges.first_turn.tolist(), edges.end_turn.tolist()
    onto, priors, lengths = turns.edge.tolist(), turns.prior.tolist(), edges.length.tolist()
    left = lengths[edge] - s
    slowness = 12.0 / edges.speed.astype(float)  # over that of a usual street
    price = (per_metre * np.clip(0.4 + 0.6 * slowness, 0.75, 2.0)).tolist()
    found: dict[int, tuple[float, float]] = {}
    waiting: list[tuple[float, float, int]] = []

    def follow(at: int, cost: float, length: float) -> None:
        ways = range(begin[at], end[at])
        best = max(priors[way] for way in ways)
        for way in ways:
            heapq.heappush(waiting, (cost + math.log(best / priors[way]), length, onto[way]))

    follow(edge, price[edge] * left, left)
    while waiting:
        cost, length, at = heapq.heappop(waiting)
        if at not in found:
            found[at] = (cost, length)
            follow(at, cost + price[at] * lengths[at], length + lengths[at])
    return found
