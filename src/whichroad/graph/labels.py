"""Records of the route search, and what its labels are asked: rivals, places on a route.

A *rival* is another way to an edge that has a label: it is dearer, and would be forgotten by
a search that keeps the cheapest.  Rivals are the beginnings of routes that avoid an edge.
"""

from typing import Annotated, NamedTuple

import numpy as np

from .._compile import Array, Ints, Ints32, Record, Records, Vector, kernel
from .network import records

LABEL_BITS = 14  # of a number in the queue; the others hold its key
LABELS = 1 << LABEL_BITS  # of all searches of one step
LAST = 2**63 - 1  # greater than every number in the queue

SLOTS = 1 << 15  # of the hash table from edges to labels
GOALS = 1 << 9  # of the hash table of goals
PREFIX = 1 << 10  # of the hash table of the common prefix
_WAYS = 512  # ways to one goal that are compared
_MOST = 256  # goals hit in one search; pairs of a hypothesis and a goal

LABEL = np.dtype(
    [
        ("cost", "f8"),  # to the start of the edge, nats
        ("length", "f8"),  # from the origin to the start of the edge, m
        ("time", "f8"),  # at the usual speeds, s
        ("turn", "f8"),  # sum of turns, rad
        ("key", "f8"),  # cost and a lower bound of what is to come, nats
        ("edge", "i4"),
        ("parent", "i4"),  # label that it was reached from, -1: the origin
        ("rival", "i4"),  # newest of the other ways to the edge, -1: none
        ("twin", "i4"),  # label of the first search that it was copied from, -1: none
        ("same", "i4"),  # label of this search that it is a copy of, on another route; -1: none
        ("mark", "i8"),  # place on the route that is looked at, by its stamp
        ("against", "f8"),  # weight of the ways round the edge, over that of the route
        ("done", "u1"),
    ],
    align=True,
)

RIVAL = np.dtype(
    [
        ("cost", "f8"),  # to the start of the edge, nats
        ("length", "f8"),  # m
        ("time", "f8"),  # s
        ("turn", "f8"),  # sum of turns, rad
        ("parent", "i4"),  # label that the edge was reached from, -1: the origin
        ("next", "i4"),  # the rival before, -1: none
    ],
    align=True,
)

WAY = np.dtype(
    [
        ("cost", "f8"),  # over the cheapest route, nats
        ("length", "f8"),  # the same, m
        ("time", "f8"),  # s
        ("turn", "f8"),  # rad
        ("before", "i4"),  # way with one rival less, -1: none
        ("join", "i4"),  # label at which it comes from its last rival
        ("label", "i4"),  # that it came from; from there on it is the cheapest way
    ],
    align=True,
)

GOAL = np.dtype(
    [
        ("step", "i8"),  # that wrote it
        ("edge", "i4"),
        ("number", "i4"),  # of the goal
    ],
    align=True,
)

PAIR = np.dtype(
    [
        ("score", "f8"),  # log-weight of taking the route, nats
        ("cost", "f8"),  # nats
        ("source", "i4"),  # hypothesis
        ("label", "i4"),  # -1: on along its own edge
        ("goal", "i4"),
        ("root", "i4"),  # label of the first search that the origin stands for, -1: none
        ("turned", "u1"),  # 1: it turns round on the way
    ],
    align=True,
)

RUN = np.dtype(
    [
        ("searches", "i8"),  # ever begun; stamps the slots of edges
        ("steps", "i8"),  # ever begun; stamps goals and the prefix
        ("labels", "i8"),  # used in this step
        ("rivals", "i8"),  # of this step
        ("marks", "i8"),  # routes ever looked at; stamps marks
        ("root", "i8"),  # label of the first search that this one's origin stands for, -1: none
        ("first", "i8"),  # label of the origin of the first search, -1: none
        ("goals", "i8"),  # of this step
        ("suffixes", "i8"),  # goals that are reached behind the common prefix
        ("prefix_step", "i8"),  # step that the prefix belongs to
        ("queued", "i8"),  # labels in the queue
        ("pairs", "i8"),
        ("limit", "f8"),  # routes that cost more are not followed any more, nats
        ("best_score", "f8"),  # of the pairs, nats
        ("detour", "f8"),  # least cost of a detour in this step, nats
    ],
    align=True,
)


class Search(NamedTuple):
    """Buffers of the route search; labels stay valid until the next step.

    A label is the cheapest known route to the start of an edge.  All routes of the first
    search of a step begin with a common prefix; a later search that reaches an edge of the
    prefix copies the rest of these routes, the suffixes.
    """

    run: Annotated[Records, Array(RUN, 1)]  # (1,)
    label: Annotated[Records, Array(LABEL, 1)]  # (LABELS,)
    rival: Annotated[Records, Array(RIVAL, 1)]  # (LABELS,)
    way: Annotated[Records, Array(WAY, 1)]  # (_WAYS,) ways to one goal
    goal: Annotated[Records, Array(GOAL, 1)]  # (GOALS,), hash table by edge
    pair: Annotated[Records, Array(PAIR, 1)]  # (_MOST,), for `filter.sparse.routing`
    slot: Ints  # (SLOTS,) search that wrote it, times LABELS, plus the edge's label
    prefix: Ints  # (PREFIX,) step that wrote it, times LABELS, plus the label
    suffix: Ints32  # (_MOST,) labels of the goals behind the prefix
    queue: Ints  # (LABELS,) binary heap: key and label as one number
    hit: Ints32  # (_MOST,) labels of goals, cheapest first
    goal_mass: Vector  # (_MOST,) prior mass of each goal, for `filter.sparse.routing`


class Reach(NamedTuple):
    """Cost, length, time and turn of a route."""

    cost: float  # nats
    length: float  # m
    time: float  # s
    turn: float  # rad


def new_search() -> Search:
    """Buffers for one thread."""
    return Search(
        records(1, RUN), records(LABELS, LABEL), records(LABELS, RIVAL),
        records(_WAYS, WAY), records(GOALS, GOAL),
        records(_MOST, PAIR),
        np.zeros(SLOTS, np.int64), np.zeros(PREFIX, np.int64), np.zeros(_MOST, np.int32),
        np.full(LABELS, LAST), np.zeros(_MOST, np.int32), np.zeros(_MOST),
    )  # fmt: skip


@kernel
def note_rival(search: Search, label: int, parent: int, reach: Reach) -> None:
    """Remember another way to a label's edge, while the table is not full."""
    run = search.run[0]
    new = int(run.rivals)
    if new >= len(search.rival):
        return
    rival = search.rival[new]
    rival.cost = reach.cost
    rival.length = reach.length
    rival.time = reach.time
    rival.turn = reach.turn
    rival.parent = parent
    rival.next = search.label[label].rival
    search.label[label].rival = new
    run.rivals = new + 1


@kernel
def _mark(search: Search, label: int, place: int) -> None:
    """Mark a label as the place of a route that is looked at."""
    search.label[label].mark = search.run[0].marks * LABELS + place


@kernel
def mark_route(search: Search, label: int, root: int) -> int:
    """Mark the labels of a route with their places on it, and clear what is against them.

    Args:
        search: Its labels are marked: 1, 2, ... from the origin, which is 0.  Where labels were
            copied from the first search, those that they were copied from are marked too.
        label: The route's last one.
        root: Label of the first search that the origin stands for, -1: none.

    Returns:
        How many labels the route has.
    """
    search.run[0].marks += 1
    count = 0
    at = label
    while at >= 0:
        count += 1
        at = int(search.label[at].parent)
    at = label
    place = count
    while at >= 0:
        entry = search.label[at]
        entry.against = 0.0
        _mark(search, at, place)
        if entry.twin >= 0:
            _mark(search, entry.twin, place)
        if entry.same >= 0:
            _mark(search, entry.same, place)
            if search.label[entry.same].twin >= 0:
                _mark(search, int(search.label[entry.same].twin), place)
        place -= 1
        at = int(entry.parent)
    if root >= 0:
        _mark(search, root, 0)
    return count


@kernel
def place_of(search: Search, label: int) -> int:
    """Place of a label on the marked route, -1: it is not on it."""
    if label < 0:
        return -1
    return max(int(search.label[label].mark - search.run[0].marks * LABELS), -1)


@kernel
def leaves_at(search: Search, parent: int, origin: int) -> int:
    """Where a route that comes from a label has left the marked route; `origin`: at its origin."""
    while parent >= 0:
        place = place_of(search, parent)
        if place >= 0:
            return place
        parent = int(search.label[parent].parent)
    return origin


@kernel(inline=True)
def _set_sums(entry: Record, old: Record, more: Record, less: Record) -> None:
    """What a route sums up: that of an old one, with one part in place of another."""
    entry.cost = old.cost + more.cost - less.cost
    entry.length = old.length + more.length - less.length
    entry.time = old.time + more.time - less.time
    entry.turn = old.turn + more.turn - less.turn


@kernel
def add_way(search: Search, n: int, before: int, join: int, rival: int) -> None:
    """Write the way n: the way `before`, but by a rival to the label `join`."""
    way, old = search.way[n], search.way[before]
    other, label = search.rival[rival], search.label[join]
    _set_sums(way, old, other, label)
    way.before = before
    way.join = join
    way.label = other.parent


@kernel
def write_way(search: Search, goal: int, best: int) -> int:
    """Write the labels of a way to the label of a goal; returns the last one, -1: table full."""
    now, at, below, first = 0, goal, -1, -1
    while now != best:
        then = best
        while search.way[then].before != now:
            then = int(search.way[then].before)
        while True:
            new = int(search.run[0].labels)
            if new >= len(search.label):
                return -1
            search.run[0].labels = new + 1
            _copy(search, new, at, best, now)
            if below >= 0:
                search.label[below].parent = new
            else:
                first = new
            below = new
            if at == search.way[then].join:
                break
            at = int(search.label[at].parent)
        old = search.label[at]
        note_rival(search, new, int(old.parent), Reach(old.cost, old.length, old.time, old.turn))
        at = int(search.way[then].label)
        search.label[new].parent = at
        now = then
    return first


@kernel
def _copy(search: Search, new: int, at: int, best: int, now: int) -> None:
    """Copy a label onto the way `best`, of which the part behind it is the way `now`."""
    entry, old = search.label[new], search.label[at]
    way, less = search.way[best], search.way[now]
    _set_sums(entry, old, way, less)
    entry.key = old.key
    entry.edge = old.edge
    entry.parent = old.parent
    entry.rival = old.rival
    entry.twin = -1
    entry.same = at
    entry.done = old.done
