"""Routes that compete with the one taken between two fixes, and edges that follow at once."""

import heapq
import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..filter.sparse.competitors import SHARPNESS
from ..filter.sparse.driver import likely_excess
from ..graph.network import Roads
from ..graph.route_costs import MIN_FACTOR
from ..ragged import row_and_place

_DETOUR = 3.0  # longest route between unlinked edges, over their distance
_MORE = 300.0  # m, added to that longest route
_RULE_COST = 500.0  # m, cost of a turn that breaks a rule
_WORTH = 4.0  # nats that a rival may cost more than the route taken


def follow(roads: Roads, before: NDArray[np.int32], after: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Whether edges follow at once from others: by a turn, or in the other direction.

    Args:
        roads: The network.
        before: (n,) edges or OFF_ROAD.
        after: (n,) likewise.

    Returns:
        (n,) false where one of the two is off the roads.
    """
    edges, turns = roads.edges.view(np.ndarray), roads.turns.view(np.ndarray)
    found = np.zeros(len(before), bool)
    rows = np.flatnonzero((before >= 0) & (after >= 0))
    then, now = before[rows], after[rows]
    found[rows] = edges["opposite"][now] == then
    first = edges["first_turn"][then]
    row, place = row_and_place(edges["end_turn"][then] - first)
    onto = turns["edge"][first[row] + place] == now[row]
    found[rows[row[onto]]] = True
    return found


def rules_of_turns(
    roads: Roads, before: NDArray[np.int64], after: NDArray[np.int64]
) -> NDArray[np.int64]:
    """The rules, as bits, that turns from edges, (n,), into others break; -1: there is no turn."""
    edges, turns = roads.edges.view(np.ndarray), roads.turns.view(np.ndarray)
    first = edges["first_turn"][before]
    row, place = row_and_place(edges["end_turn"][before] - first)
    turn = turns[first[row] + place]
    onto = turn["edge"] == after[row]
    rules = np.full(len(before), -1, np.int64)
    rules[row[onto]] = turn["rule"][onto]
    return rules


def shortest(roads: Roads, a: int, b: int) -> list[int] | None:
    """Edges between the end of edge a and the start of edge b; None: no route is short enough."""
    end = roads.vertices[roads.edges[a].last_vertex]
    start = roads.vertices[roads.edges[b].first_vertex]
    away = float(np.hypot(end.x - start.x, end.y - start.y))
    reach = _DETOUR * away + _MORE
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
        for turn in roads.turns[roads.edges[edge].first_turn : roads.edges[edge].end_turn]:
            f = int(turn.edge)
            cost = so_far + (float(roads.edges[f].length) if f != b else 0.0)
            cost += _RULE_COST if turn.rule else 0.0
            if f not in came and cost <= reach:
                heapq.heappush(queue, (cost, f, edge))
    return None


def cheapest(
    roads: Roads, a: int, b: int, per_metre: float, avoid: int, most: float
) -> tuple[float, tuple[int, ...]] | None:
    """The cheapest edges between the end of edge a and the start of edge b, by A*.

    Args:
        roads: The network.
        a: Edge.
        b: Edge.
        per_metre: Cost of a metre of a street of usual speed, nats.
        avoid: An edge that is not driven; -1: none.
        most: A dearer route is none, nats.

    Returns:
        The cost and the edges between; None: there are none.
    """
    edges, turns = roads.edges, roads.turns
    goal = roads.vertices[edges[b].first_vertex]
    gx, gy, least = float(goal.x), float(goal.y), 0.99 * MIN_FACTOR * per_metre
    queue: list[tuple[float, float, int, int]] = [(0.0, 0.0, a, -1)]
    came: dict[int, int] = {}
    while queue:
        _, so_far, edge, before = heapq.heappop(queue)
        if edge in came:
            continue
        came[edge] = before
        if edge == b:
            found: list[int] = []
            while (edge := came[edge]) != a:
                found.append(edge)
            return so_far, tuple(found[::-1])
        row = edges[edge]
        ways = turns[row.first_turn : row.end_turn]
        to, price = ways.edge, ways.cost
        metres = np.where(to == b, 0.0, edges.cost[to])
        ahead = np.hypot(edges.end_x[to] - gx, edges.end_y[to] - gy)
        costs = so_far + price + per_metre * metres
        bounds = costs + np.where(to == b, 0.0, least * ahead)
        for f, cost, bound in zip(to.tolist(), costs.tolist(), bounds.tolist(), strict=True):
            if f not in came and f != avoid and f != row.opposite and bound <= most:
                heapq.heappush(queue, (bound, cost, f, edge))
    return None


def price_of(roads: Roads, way: Sequence[int], per_metre: float) -> float:
    """What it costs to drive the edges between the first and the last of some edges, nats."""
    total = per_metre * float(roads.edges.cost[np.array(way[1:-1], int)].sum())
    for a, b in itertools.pairwise(way):
        row = roads.edges[a]
        ways = roads.turns[row.first_turn : row.end_turn]
        total += float(ways.cost[ways.edge == b].min(initial=math.inf))
    return total


def rivals(
    roads: Roads, way: Sequence[int], shares: Sequence[float], dt: float
) -> list[tuple[float, tuple[int, ...]]]:
    """Routes that avoid some of the edges between two fixes, by what they cost.

    The filter keeps one route between the same two edges, and the sum of what speaks for the
    others.  Here the others are sought again: for each group of edges that the same routes
    avoid, the cheapest way round it.

    Args:
        roads: The network.
        way: The route taken, from the edge of the one fix to the edge of the other.
        shares: Of the edges between, of all likely routes.
        dt: Between the two fixes, s.

    Returns:
        Parts of what is not the route taken, which sum to 1, and the edges between.
    """
    per_metre = 1.0 / likely_excess(dt)
    own = price_of(roads, way, per_metre)
    found: dict[tuple[int, ...], float] = {}
    asked: set[float] = set()
    for edge, share in zip(way[1:-1], shares, strict=True):
        if share in asked or share > 1.0 - 1e-6 or not math.isfinite(own):
            continue
        asked.add(share)
        other = cheapest(roads, way[0], way[-1], per_metre, edge, own + _WORTH)
        if other is not None:
            found[other[1]] = math.exp(-SHARPNESS * (other[0] - own))
    total = sum(found.values())
    return sorted(((w / total, edges) for edges, w in found.items()), reverse=True)
