"""The cheapest routes from one edge, by Dijkstra's method on all edges, slow and plain."""

import heapq
import math

import numpy as np

from whichroad.core.network import Roads


def cheapest(roads: Roads, edge: int, s: float, per_metre: float) -> dict[int, tuple[float, float]]:
    """Cost (nats) and length (m) from abscissa s to the start of every edge beyond the first."""
    left = float(roads.length[edge]) - s
    slowness = 12.0 / roads.speed.astype(float)  # over that of a usual street
    price = per_metre * np.clip(0.4 + 0.6 * slowness, 0.75, 2.0)
    found: dict[int, tuple[float, float]] = {}
    waiting: list[tuple[float, float, int]] = []

    def follow(at: int, cost: float, length: float) -> None:
        turns = range(roads.succ_first[at], roads.succ_first[at + 1])
        best = max(float(roads.succ_prior[t]) for t in turns)
        for t in turns:
            more = math.log(best / float(roads.succ_prior[t]))
            heapq.heappush(waiting, (cost + more, length, int(roads.succ[t])))

    follow(edge, price[edge] * left, left)
    while waiting:
        cost, length, at = heapq.heappop(waiting)
        if at not in found:
            found[at] = (cost, length)
            step = float(roads.length[at])
            follow(at, cost + price[at] * step, length + step)
    return found
