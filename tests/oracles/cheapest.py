"""The cheapest routes from one edge, by Dijkstra's method on all edges, slow and plain."""

import heapq
import math

import numpy as np

from whichroad.graph.network import Roads


def cheapest(roads: Roads, edge: int, s: float, per_metre: float) -> dict[int, tuple[float, float]]:
    """Cost (nats) and length (m) from abscissa s to the start of every edge beyond the first."""
    left = float(roads.edges.length[edge]) - s
    slowness = 12.0 / roads.edges.speed.astype(float)  # over that of a usual street
    price = per_metre * np.clip(0.4 + 0.6 * slowness, 0.75, 2.0)
    found: dict[int, tuple[float, float]] = {}
    waiting: list[tuple[float, float, int]] = []

    def follow(at: int, cost: float, length: float) -> None:
        turns = roads.turns[roads.edges.first_turn[at] : roads.edges.end_turn[at]]
        best = float(turns.prior.max())
        for edge, prior in zip(turns.edge.tolist(), turns.prior.tolist(), strict=True):
            heapq.heappush(waiting, (cost + math.log(best / prior), length, edge))

    follow(edge, price[edge] * left, left)
    while waiting:
        cost, length, at = heapq.heappop(waiting)
        if at not in found:
            found[at] = (cost, length)
            step = float(roads.edges.length[at])
            follow(at, cost + price[at] * step, length + step)
    return found
