"""Routes between fixes that lie far apart: a bounded search over the road graph."""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Bytes, Ints, Ints32, Vector, kernel, part
from .network import Roads

_SLOTS = 1 << 15  # of the table that knows an edge's label
_GOALS = 1 << 9  # of the one that knows the goals
LABELS = 1 << 14  # of all searches of one step


class Search(NamedTuple):
    """Scratch of the route search; labels stay valid until the next step.

    A label says the cheapest known way to the start of an edge.
    """

    slot: Ints32  # (_SLOTS,) label of the edge that hashes here
    stamp: Ints  # (_SLOTS,) search that wrote it
    goal: Ints32  # (_GOALS,) number of the goal
    goal_stamp: Ints  # (_GOALS,)
    counts: Ints  # (4,) searches, steps, labels used, goals hit by the last search
    edge: Ints32  # (LABELS,)
    parent: Ints32  # (LABELS,) label that it was reached from, -1: the origin
    cost: Vector  # (LABELS,) nats
    length: Vector  # (LABELS,) from the origin to the start of the edge, m
    time: Vector  # (LABELS,) at the usual speeds, s
    turn: Vector  # (LABELS,) sum of turns, rad
    done: Bytes  # (LABELS,)
    heap: Ints32  # (LABELS,) labels
    key: Vector  # (LABELS,) what the heap is ordered by
    hit: Ints32  # (256,) labels of goals
    pair_source: Ints32  # (256,) hypothesis
    pair_label: Ints32  # (256,)
    pair_goal: Ints32  # (256,)
    pair_score: Vector  # (256,) nats
    pair_cost: Vector  # (256,) nats


def new_search() -> Search:
    """Scratch space for one thread."""
    return Search(
        np.zeros(_SLOTS, np.int32), np.zeros(_SLOTS, np.int64), np.zeros(_GOALS, np.int32),
        np.zeros(_GOALS, np.int64), np.zeros(4, np.int64), np.zeros(LABELS, np.int32),
        np.zeros(LABELS, np.int32), np.zeros(LABELS), np.zeros(LABELS), np.zeros(LABELS),
        np.zeros(LABELS), np.zeros(LABELS, np.uint8), np.zeros(LABELS, np.int32),
        np.zeros(LABELS), np.zeros(256, np.int32), np.zeros(256, np.int32),
        np.zeros(256, np.int32), np.zeros(256, np.int32), np.zeros(256), np.zeros(256),
    )  # fmt: skip


@kernel
def _place(edge: int, slots: int) -> int:
    """Where the table is looked into first."""
    return (edge * 2654435761 >> 7) & (slots - 1)


@kernel
def set_goals(search: Search, edges: Ints, n: int) -> None:
    """Begin a step: forget all labels, and note the edges that are looked for."""
    search.counts[1] += 1
    search.counts[2] = 0
    step = search.counts[1]
    for c in range(n):
        place = _place(edges[c], _GOALS)
        while search.goal_stamp[place] == step:
            place = (place + 1) & (_GOALS - 1)
        search.goal_stamp[place] = step
        search.goal[place] = c


@kernel
def goal_of(search: Search, edges: Ints, edge: int) -> int:
    """Number of the goal that an edge is, or -1."""
    step = search.counts[1]
    place = _place(edge, _GOALS)
    while search.goal_stamp[place] == step:
        if edges[search.goal[place]] == edge:
            return int(search.goal[place])
        place = (place + 1) & (_GOALS - 1)
    return -1


@kernel
def _slot_of(search: Search, edge: int) -> int:
    """The edge's slot in this search's table, or the free one where it belongs."""
    now = search.counts[0]
    place = _place(edge, _SLOTS)
    while search.stamp[place] == now and search.edge[search.slot[place]] != edge:
        place = (place + 1) & (_SLOTS - 1)
    return place


@kernel
def _push(search: Search, n: int, label: int, key: float) -> int:
    """Put a label on the heap of n; returns the new n."""
    i = n
    while i > 0:
        up = (i - 1) >> 1
        if search.key[up] <= key:
            break
        search.key[i] = search.key[up]
        search.heap[i] = search.heap[up]
        i = up
    search.key[i] = key
    search.heap[i] = label
    return n + 1


@kernel
def _pop(search: Search, n: int) -> int:
    """Take the first label off the heap of n, which then has n - 1; it goes to place n - 1."""
    first = search.heap[0]
    first_key = search.key[0]
    n -= 1
    label = search.heap[n]
    key = search.key[n]
    i = 0
    while True:
        down = 2 * i + 1
        if down >= n:
            break
        if down + 1 < n and search.key[down + 1] < search.key[down]:
            down += 1
        if search.key[down] >= key:
            break
        search.key[i] = search.key[down]
        search.heap[i] = search.heap[down]
        i = down
    search.key[i] = key
    search.heap[i] = label
    search.heap[n] = first
    search.key[n] = first_key
    return n


@kernel
def _label(
    roads: Roads, search: Search, n: int, edge: int, parent: int, cost: float, length: float,
    time: float, turn: float, x: float, y: float, radius: float, per_metre: float,
    longest: float, limit: float,
) -> int:  # fmt: skip
    """Label an edge if this way is new or cheaper, and goes anywhere; returns the heap's n."""
    v = roads.first[edge]
    away = max(math.hypot(roads.x[v] - x, roads.y[v] - y) - radius, 0.0)
    key = cost + per_metre * away
    if key > limit or length + away > longest:
        return n
    place = _slot_of(search, edge)
    if search.stamp[place] == search.counts[0]:
        label = search.slot[place]
        if search.done[label] == 1 or search.cost[label] <= cost:
            return n
    else:
        label = search.counts[2]
        if label >= LABELS or n >= LABELS - 1:
            return n
        search.counts[2] = label + 1
        search.stamp[place] = search.counts[0]
        search.slot[place] = label
    search.edge[label] = edge
    search.parent[label] = parent
    search.cost[label] = cost
    search.length[label] = length
    search.time[label] = time
    search.turn[label] = turn
    search.done[label] = 0
    return _push(search, n, label, key)


@part
def find_routes(
    roads: Roads, search: Search, goals: Ints, edge: int, s: float, x: float, y: float,
    radius: float, per_metre: float, u_turn: float, longest: float, limit: float, slack: float,
    most: int,
) -> int:  # fmt: skip
    """The cheapest routes from abscissa s of an edge to the goals around a point.

    A route costs `per_metre` for its length, and each turn -log(prior / the largest prior
    there).  A* with the straight distance to the goals' circle.

    Args:
        roads: The network.
        search: `hit` is filled with the labels of goals, cheapest first; the origin itself
            has no label.
        goals: Edges looked for, as told to `set_goals`.
        edge: Where the search begins.
        s: Abscissa there, m.
        x: Middle of the goals, plane.
        y: Middle of the goals, plane.
        radius: Within which they lie, m.
        per_metre: nats/m.
        u_turn: Cost of turning round at once, nats; infinite: never.
        longest: Routes longer than this are not followed, m.
        limit: Routes that cost more are not followed, nats.
        slack: Goals that cost this much more than the cheapest one are not looked for, nats.
        most: Labels that may be used.

    Returns:
        How many goals were hit.
    """
    search.counts[0] += 1
    first_label = search.counts[2]
    hits = 0
    n = 0
    left = roads.length[edge] - s
    other = roads.opposite[edge]
    if other >= 0 and u_turn < 1e6:
        n = _label(
            roads, search, n, other, -1, u_turn, -max(left, 0.0), 0.0, math.pi, x, y, radius,
            per_metre, longest, limit,
        )  # fmt: skip
    label = -1
    current = edge
    cost = per_metre * max(left, 0.0)
    length = left
    time = left / max(float(roads.speed[edge]), 1.0)
    turn = 0.0
    while True:
        best = 1e-12
        for t in range(roads.succ_first[current], roads.succ_first[current + 1]):
            best = max(best, float(roads.succ_prior[t]))
        for t in range(roads.succ_first[current], roads.succ_first[current + 1]):
            p = max(float(roads.succ_prior[t]), 1e-12)
            turn_cost = 0.0 if p >= best else math.log(best / p)
            n = _label(
                roads, search, n, roads.succ[t], label, cost + turn_cost, length, time,
                turn + roads.succ_turn[t], x, y, radius, per_metre, longest, limit,
            )  # fmt: skip
        while True:
            if n == 0 or search.counts[2] - first_label >= most:
                return hits
            n = _pop(search, n)
            if search.key[n] > limit:
                return hits
            label = search.heap[n]
            if search.done[label] == 0:
                break
        search.done[label] = 1
        current = search.edge[label]
        if hits < len(search.hit) and goal_of(search, goals, current) >= 0:
            if hits == 0:
                limit = min(limit, search.key[n] + slack)
            search.hit[hits] = label
            hits += 1
        cost = search.cost[label] + per_metre * roads.length[current]
        length = search.length[label] + roads.length[current]
        time = search.time[label] + roads.length[current] / max(float(roads.speed[current]), 1.0)
        turn = search.turn[label]
