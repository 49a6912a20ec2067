"""Routes between fixes that lie far apart: a bounded search over the road graph."""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Bytes, Ints, Ints32, Vector, kernel, part
from .heap import BITS, LAST, pop, push
from .hops import CHEAPEST, HOP_LENGTH, HOP_PRICE, HOP_TIME, HOP_X, HOP_Y
from .network import Roads

_ROUNDING = 0.1  # m, of the ends of edges
_SLOTS = 1 << 15  # of the table that knows an edge's label
_GOALS = 1 << 9  # of the one that knows the goals
_WAYS = 1 << 10  # of the one that knows the way that all goals lie behind
_OPEN, _SETTLED, _TAKEN = range(3)  # of a label: taken over, all that follows it is known
LABELS = 1 << BITS  # of all searches of one step


class Search(NamedTuple):
    """Scratch of the route search; labels stay valid until the next step.

    A label says the cheapest known way to the start of an edge.
    """

    slot: Ints  # (_SLOTS,) search that wrote it, times LABELS, plus the edge's label
    goal: Ints32  # (_GOALS,) number of the goal
    goal_stamp: Ints  # (_GOALS,)
    way: Ints  # (_WAYS,) step that wrote it, times LABELS, plus the label
    way_hit: Ints32  # (256,) labels of the goals behind that way
    counts: Ints  # (6,) searches, steps, labels used, goals, goals behind the way, its step
    edge: Ints32  # (LABELS,)
    parent: Ints32  # (LABELS,) label that it was reached from, -1: the origin
    cost: Vector  # (LABELS,) nats
    length: Vector  # (LABELS,) from the origin to the start of the edge, m
    time: Vector  # (LABELS,) at the usual speeds, s
    turn: Vector  # (LABELS,) sum of turns, rad
    done: Bytes  # (LABELS,)
    key: Vector  # (LABELS,) cost, with what is to come at least, nats
    heap: Ints  # (LABELS,) key and label as one number
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
        np.zeros(_GOALS, np.int64), np.zeros(_WAYS, np.int64), np.zeros(256, np.int32),
        np.zeros(6, np.int64), np.zeros(LABELS, np.int32), np.zeros(LABELS, np.int32),
        np.zeros(LABELS), np.zeros(LABELS), np.zeros(LABELS), np.zeros(LABELS),
        np.zeros(LABELS, np.uint8), np.zeros(LABELS),
        np.full(LABELS, LAST), np.zeros(256, np.int32), np.zeros(256, np.int32),
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


@part
def _label(
    search: Search, n: int, edge: int, parent: int, cost: float, length: float,
    time: float, turn: float, ahead: float,
) -> int:  # fmt: skip
    """Label an edge if this way is new or cheaper; returns the heap's n.

    At least `ahead` nats more are to come.
    """
    place, label = _slot_of(search, edge)
    if n >= LABELS - 1:
        return n
    if label < 0:
        label = search.counts[2]
        if label >= LABELS:
            return n
        search.counts[2] = label + 1
        search.slot[place] = search.counts[0] * LABELS + label
    elif search.done[label] == _SETTLED or search.cost[label] <= cost:
        return n
    search.edge[label] = edge
    search.parent[label] = parent
    search.cost[label] = cost
    search.key[label] = cost + ahead
    search.length[label] = length
    search.time[label] = time
    search.turn[label] = turn
    search.done[label] = _OPEN
    return push(search.heap, n, label, cost + ahead)


@part
def _follow(
    roads: Roads, search: Search, n: int, current: int, label: int, cost: float, length: float,
    time: float, turn: float, x: float, y: float, radius: float, per_metre: float,
    longest: float, limit: float,
) -> int:  # fmt: skip
    """Label what follows an edge, with what it costs to its end; returns the heap's n."""
    dx = roads.hop[current, HOP_X] - x
    dy = roads.hop[current, HOP_Y] - y
    away = max(math.sqrt(dx * dx + dy * dy) - radius, 0.0)
    ahead = CHEAPEST * per_metre * away
    if cost + ahead > limit or length + away > longest:
        return n
    for t in range(roads.succ_first[current], roads.succ_first[current + 1]):
        then = cost + roads.succ_cost[t]
        if then + ahead <= limit:
            n = _label(
                search, n, roads.succ[t], label, then, length, time, turn + roads.succ_turn[t],
                ahead,
            )  # fmt: skip
    return n


@kernel
def _way_of(search: Search, edge: int) -> int:
    """Label of an edge on the way that all goals lie behind, or -1."""
    step = search.counts[1] * LABELS
    place = edge & (_WAYS - 1)
    while search.way[place] >= step:
        label = search.way[place] - step
        if search.edge[label] == edge:
            return int(label)
        place = (place + 1) & (_WAYS - 1)
    return -1


@kernel
def _set_way(search: Search, label: int) -> None:
    """Enter a label into the table of the way that all goals lie behind."""
    step = search.counts[1] * LABELS
    place = search.edge[label] & (_WAYS - 1)
    while search.way[place] >= step:
        place = (place + 1) & (_WAYS - 1)
    search.way[place] = step + label


@part
def _remember_way(
    roads: Roads, search: Search, hits: int, edge: int, s: float, per_metre: float
) -> None:
    """Note the way that a search's routes to all goals have in common, for the next searches.

    Whoever comes upon it goes on as this search did, which found the best from there on.
    """
    end = search.hit[0]
    up = end
    while up >= 0:
        search.done[up] = _TAKEN  # marks the first route
        top = up
        up = search.parent[up]
    turned = search.length[top] <= 0.0  # at once
    for h in range(hits):
        label = search.hit[h]
        search.way_hit[h] = label
        while label >= 0 and search.done[label] != _TAKEN:
            top = label
            label = search.parent[label]
        if label < 0:
            turned = turned or search.length[top] <= 0.0
            end = -1
        elif end >= 0 and search.cost[label] < search.cost[end]:
            end = label
    search.counts[4] = hits
    search.counts[5] = search.counts[1]
    most = _WAYS // 2
    while end >= 0 and most > 0:
        _set_way(search, end)
        end = search.parent[end]
        most -= 1
    label = search.counts[2]
    if not turned and label < LABELS:
        search.counts[2] = label + 1
        done = s / roads.length[edge]
        search.edge[label] = edge
        search.parent[label] = -1
        search.cost[label] = -per_metre * done * roads.hop[edge, HOP_PRICE]
        search.length[label] = -s
        search.time[label] = -done * roads.hop[edge, HOP_TIME]
        search.turn[label] = 0.0
        _set_way(search, label)


@part
def _take_over(
    roads: Roads, search: Search, n: int, way: int, origin: int, cost: float, length: float,
    time: float, turn: float, per_metre: float, longest: float, limit: float,
) -> int:  # fmt: skip
    """Label what an earlier search found behind an edge of its way; returns the heap's n.

    The label `origin` is this search's own of that edge; cost, length and time are at its end.
    """
    edge = search.edge[way]
    cost -= search.cost[way] + per_metre * roads.hop[edge, HOP_PRICE]
    length -= search.length[way] + roads.hop[edge, HOP_LENGTH]
    time -= search.time[way] + roads.hop[edge, HOP_TIME]
    turn -= search.turn[way]
    for h in range(search.counts[4]):
        found = search.way_hit[h]
        ahead = search.key[found] - search.cost[found]
        away = ahead / (CHEAPEST * per_metre)
        if search.key[found] + cost > limit or search.length[found] + length + away > longest:
            continue
        below = -1
        while found != way and found >= 0:
            then = search.cost[found] + cost
            place, label = _slot_of(search, search.edge[found])
            if label < 0:
                label = search.counts[2]
                if label >= LABELS or n >= LABELS - 1:
                    return n
                search.counts[2] = label + 1
                search.slot[place] = search.counts[0] * LABELS + label
            elif search.done[label] == _SETTLED or search.cost[label] <= then:
                if below >= 0:
                    search.parent[below] = label
                below = -1
                break
            search.edge[label] = search.edge[found]
            search.cost[label] = then
            search.key[label] = then + ahead
            search.length[label] = search.length[found] + length
            search.time[label] = search.time[found] + time
            search.turn[label] = search.turn[found] + turn
            search.done[label] = _TAKEN
            if below >= 0:
                search.parent[below] = label
            else:
                n = push(search.heap, n, label, then + ahead)
            below = label
            found = search.parent[found]
        if below >= 0:
            search.parent[below] = origin
    return n


@kernel
def find_routes(
    roads: Roads, search: Search, goals: Ints, edge: int, s: float, x: float, y: float,
    radius: float, per_metre: float, u_turn: float, longest: float, limit: float, slack: float,
    most: int,
) -> int:  # fmt: skip
    """The cheapest routes from abscissa s of an edge to the goals around a point.

    A route costs `per_metre` for its length, more of it on slow roads, and each turn
    -log(prior / the largest prior there).  A* with the straight distance to the goals' circle.
    Where a later search of the same step comes upon the way that all routes of the first one
    share, it takes over what that one found behind it.

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
    shared = search.counts[5] == search.counts[1]
    whole = False  # whether all goals within the slack are found
    taken = False
    left = max(roads.length[edge] - s, 0.0)
    share = left / roads.length[edge]
    radius += _ROUNDING
    other = roads.opposite[edge]
    if other >= 0 and u_turn < limit:
        v = roads.first[other]
        away = max(math.hypot(roads.x[v] - x, roads.y[v] - y) - radius, 0.0)
        ahead = CHEAPEST * per_metre * away
        if away <= longest + left and u_turn + ahead <= limit:
            n = _label(search, n, other, -1, u_turn, -left, 0.0, math.pi, ahead)
    label = -1
    current = edge
    cost = per_metre * share * roads.hop[edge, HOP_PRICE]
    length = roads.length[edge] - s
    time = share * roads.hop[edge, HOP_TIME]
    turn = 0.0
    while True:
        way = _way_of(search, current) if shared and not taken else -1
        if label < 0 and way >= 0 and way == search.way_hit[0]:
            way = -1  # from a goal: the next one decides how far to look, which was not known
        if way >= 0:
            n = _take_over(
                roads, search, n, way, label, cost, length, time, turn, per_metre, longest, limit
            )
        elif not taken:
            n = _follow(
                roads, search, n, current, label, cost, length, time, turn, x, y, radius,
                per_metre, longest, limit,
            )  # fmt: skip
        label = -1
        while n > 0:
            label = pop(search.heap, n)
            n -= 1
            if search.done[label] != _SETTLED:
                break
            label = -1
        if search.counts[2] - first_label >= most:
            return hits
        if label < 0 or search.key[label] > limit:
            break
        taken = search.done[label] == _TAKEN
        search.done[label] = _SETTLED
        current = search.edge[label]
        if hits < len(search.hit) and goal_of(search, goals, current) >= 0:
            if hits == 0:
                whole = search.key[label] + slack <= limit
                limit = min(limit, search.key[label] + slack)
            search.hit[hits] = label
            hits += 1
            if hits == search.counts[3]:
                break
        cost = search.cost[label] + per_metre * roads.hop[current, HOP_PRICE]
        length = search.length[label] + roads.hop[current, HOP_LENGTH]
        time = search.time[label] + roads.hop[current, HOP_TIME]
        turn = search.turn[label]
    if whole and not shared:
        _remember_way(roads, search, hits, edge, s, per_metre)
    return hits
