"""Routes between fixes that lie far apart: a bounded search over the road graph."""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Bytes, Ints, Ints32, Vector, kernel, part
from .network import Roads

_SLOTS = 1 << 15  # of the table that knows an edge's label
_GOALS = 1 << 9  # of the one that knows the goals
LABELS = 1 << 14  # of all searches of one step
_USUAL = 12.0  # m/s
_BY_TIME = 0.6  # of the cost of a way is its time, the rest its length
_CHEAPEST, _DEAREST = 0.75, 2.0


class Search(NamedTuple):
    """Scratch of the route search; labels stay valid until the next step.

    A label says the cheapest known way to the start of an edge.
    """

    slot: Ints  # (_SLOTS,) search that wrote it, times LABELS, plus the edge's label
    goal: Ints32  # (_GOALS,) number of the goal
    goal_stamp: Ints  # (_GOALS,)
    counts: Ints  # (4,) searches, steps, labels used, goals
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
        np.zeros(_SLOTS, np.int64), np.zeros(_GOALS, np.int32),
        np.zeros(_GOALS, np.int64), np.zeros(4, np.int64), np.zeros(LABELS, np.int32),
        np.zeros(LABELS, np.int32), np.zeros(LABELS), np.zeros(LABELS), np.zeros(LABELS),
        np.zeros(LABELS), np.zeros(LABELS, np.uint8), np.zeros(LABELS, np.int32),
        np.zeros(LABELS), np.zeros(256, np.int32), np.zeros(256, np.int32),
        np.zeros(256, np.int32), np.zeros(256, np.int32), np.zeros(256), np.zeros(256),
    )  # fmt: skip


@kernel
def set_goals(search: Search, edges: Ints, n: int) -> None:
    """Begin a step: forget all labels, and note the edges that are looked for."""
    search.counts[1] += 1
    search.counts[2] = 0
    search.counts[3] = n
    step = search.counts[1]
    for c in range(n):
        place = edges[c] & (_GOALS - 1)
        while search.goal_stamp[place] == step:
            place = (place + 1) & (_GOALS - 1)
        search.goal_stamp[place] = step
        search.goal[place] = c


@kernel
def goal_of(search: Search, edges: Ints, edge: int) -> int:
    """Number of the goal that an edge is, or -1."""
    step = search.counts[1]
    place = edge & (_GOALS - 1)
    while search.goal_stamp[place] == step:
        if edges[search.goal[place]] == edge:
            return int(search.goal[place])
        place = (place + 1) & (_GOALS - 1)
    return -1


@kernel
def _slot_of(search: Search, edge: int) -> tuple[int, int]:
    """The edge's slot in this search's table and its label; -1: the slot is free.

    Edges that lie together mostly have numbers that do, and so have their slots.
    """
    now = search.counts[0] * LABELS
    place = edge & (_SLOTS - 1)
    while search.slot[place] >= now:
        label = search.slot[place] - now
        if search.edge[label] == edge:
            return place, label
        place = (place + 1) & (_SLOTS - 1)
    return place, -1


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


@part
def dearness(roads: Roads, edge: int) -> float:
    """What a metre of an edge costs, over one of a street of usual speed: drivers save time."""
    slower = _USUAL / max(float(roads.speed[edge]), 1.0)
    return min(max(1.0 + _BY_TIME * (slower - 1.0), _CHEAPEST), _DEAREST)


@part
def _label(
    search: Search, n: int, edge: int, parent: int, cost: float, ratio: float, length: float,
    time: float, turn: float, ahead: float, limit: float,
) -> int:  # fmt: skip
    """Label an edge if this way is new or cheaper, and goes anywhere; returns the heap's n.

    It costs log(ratio) more than `cost`, and at least `ahead` more are to come.
    """
    place, label = _slot_of(search, edge)
    if label >= 0 and (search.done[label] == 1 or search.cost[label] <= cost):
        return n
    if ratio > 1.0:
        cost += math.log(ratio)
    if cost + ahead > limit:
        return n
    if label < 0:
        label = search.counts[2]
        if label >= LABELS or n >= LABELS - 1:
            return n
        search.counts[2] = label + 1
        search.slot[place] = search.counts[0] * LABELS + label
    elif search.cost[label] <= cost:
        return n
    search.edge[label] = edge
    search.parent[label] = parent
    search.cost[label] = cost
    search.length[label] = length
    search.time[label] = time
    search.turn[label] = turn
    search.done[label] = 0
    return _push(search, n, label, cost + ahead)


@part
def _follow(
    roads: Roads, search: Search, n: int, current: int, label: int, cost: float, length: float,
    time: float, turn: float, x: float, y: float, radius: float, per_metre: float,
    longest: float, limit: float,
) -> int:  # fmt: skip
    """Label what follows an edge, with what it costs to its end; returns the heap's n."""
    v = roads.first[current + 1] - 1
    dx = roads.x[v] - x
    dy = roads.y[v] - y
    away = max(math.sqrt(dx * dx + dy * dy) - radius, 0.0)
    ahead = _CHEAPEST * per_metre * away
    if cost + ahead > limit or length + away > longest:
        return n
    first = roads.succ_first[current]
    last = roads.succ_first[current + 1]
    best = 1e-12
    for t in range(first, last):
        best = max(best, float(roads.succ_prior[t]))
    for t in range(first, last):
        ratio = best / max(float(roads.succ_prior[t]), 1e-12)
        n = _label(
            search, n, roads.succ[t], label, cost, ratio, length, time,
            turn + roads.succ_turn[t], ahead, limit,
        )  # fmt: skip
    return n


@part
def find_routes(
    roads: Roads, search: Search, goals: Ints, edge: int, s: float, x: float, y: float,
    radius: float, per_metre: float, u_turn: float, longest: float, limit: float, slack: float,
    most: int,
) -> int:  # fmt: skip
    """The cheapest routes from abscissa s of an edge to the goals around a point.

    A route costs `per_metre` for its length, more of it on slow roads, and each turn
    -log(prior / the largest prior there).  A* with the straight distance to the goals' circle.

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
        v = roads.first[other]
        away = max(math.hypot(roads.x[v] - x, roads.y[v] - y) - radius, 0.0)
        if away <= longest + max(left, 0.0):
            n = _label(
                search, n, other, -1, u_turn, 1.0, -max(left, 0.0), 0.0, math.pi,
                _CHEAPEST * per_metre * away, limit,
            )  # fmt: skip
    label = -1
    current = edge
    cost = per_metre * max(left, 0.0) * dearness(roads, edge)
    length = left
    time = left / max(float(roads.speed[edge]), 1.0)
    turn = 0.0
    while True:
        n = _follow(
            roads, search, n, current, label, cost, length, time, turn, x, y, radius, per_metre,
            longest, limit,
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
            if hits == search.counts[3]:
                return hits
        cost = search.cost[label] + per_metre * roads.length[current] * dearness(roads, current)
        length = search.length[label] + roads.length[current]
        time = search.time[label] + roads.length[current] / max(float(roads.speed[current]), 1.0)
        turn = search.turn[label]
