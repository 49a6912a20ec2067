"""Route search between sparse fixes: bounded A* over the road graph, by `graph.route_costs`."""

import math
from typing import NamedTuple

from .._compile import Ints, Records, kernel
from ._ahead import prefetch
from .labels import (
    GOALS,
    LABEL_BITS,
    LABELS,
    LAST,
    PREFIX,
    SLOTS,
    Reach,
    Search,
    note_rival,
)
from .network import Roads
from .route_costs import MIN_FACTOR

_PER_NAT, _MAX_NATS = 2.0**30, 2.0**18  # resolution and limit of keys in the queue
_ROUNDING = 0.1  # m, of the ends of edges, which are float32
_RIVAL_WORTH = 4.0  # nats that a rival way to an edge may cost more than the cheapest
_OPEN, _SETTLED, _COPIED = range(3)  # of a label; copied: its route to a goal is complete


class Query(NamedTuple):
    """Goals, costs and limits of a search."""

    x: float  # middle of the goals, m, plane
    y: float
    radius: float  # within which they lie, m, plane
    per_metre: float  # nats/m
    u_turn: float  # cost of turning round at once, nats; infinite: never
    longest: float  # longer routes are not followed, m
    limit: float  # nor those that cost more, nats
    slack: float  # nor those to goals that cost this much more than the cheapest one, nats
    most: int  # labels that may be used
    alone: bool  # not to share routes with other searches of the step


@kernel
def push(queue: Ints, n: int, label: int, key: float) -> int:
    """Put a label into the queue of n; returns the new n.

    Key and label are one whole number, so that they are compared and moved at once.
    """
    code = (int(min(key, _MAX_NATS) * _PER_NAT) << LABEL_BITS) | label
    i = n
    while i > 0:
        up = (i - 1) >> 1
        if queue[up] <= code:
            break
        queue[i] = queue[up]
        i = up
    queue[i] = code
    return n + 1


@kernel
def pop(queue: Ints, n: int) -> int:
    """Take the first label out of the queue of n, which then has n - 1."""
    label = queue[0] & ((1 << LABEL_BITS) - 1)
    n -= 1
    code = queue[n]
    queue[n] = LAST
    i = 0
    while True:
        down = 2 * i + 1
        if down >= n:
            break
        down += int(queue[down + 1] < queue[down])
        if queue[down] >= code:
            break
        queue[i] = queue[down]
        i = down
    queue[i] = code
    return int(label)


@kernel
def set_goals(search: Search, candidates: Records, n: int) -> None:
    """Begin a step: forget all labels, and enter the goals.

    Args:
        search: In place.
        candidates: (..., ) CANDIDATE; the edges of the first n, each once, are the goals.
        n: How many.
    """
    run = search.run[0]
    run.steps += 1
    run.labels = 0
    run.rivals = 0
    run.first = -1
    run.goals = n
    for c in range(n):
        place = candidates[c].edge & (GOALS - 1)
        while search.goal[place].step == run.steps:
            place = (place + 1) & (GOALS - 1)
        goal = search.goal[place]
        goal.step = run.steps
        goal.edge = candidates[c].edge
        goal.number = c


@kernel
def goal_of(search: Search, edge: int) -> int:
    """Number of the goal that an edge is, or -1."""
    step = search.run[0].steps
    place = edge & (GOALS - 1)
    while search.goal[place].step == step:
        if search.goal[place].edge == edge:
            return int(search.goal[place].number)
        place = (place + 1) & (GOALS - 1)
    return -1


@kernel
def _slot_of(search: Search, edge: int) -> tuple[int, int]:
    """The edge's slot in this search's table and its label; -1: the slot is free.

    Neighbouring edges mostly have neighbouring numbers, and so neighbouring slots.
    """
    now = search.run[0].searches * LABELS
    place = edge & (SLOTS - 1)
    while search.slot[place] >= now:
        label = search.slot[place] - now
        if search.label[label].edge == edge:
            return place, label
        place = (place + 1) & (SLOTS - 1)
    return place, -1


@kernel(inline=True)
def _new_label(search: Search, place: int) -> int:
    """A new label for a free slot, -1 when there is none left."""
    run = search.run[0]
    label = int(run.labels)
    if label >= LABELS:
        return -1
    run.labels = label + 1
    search.slot[place] = run.searches * LABELS + label
    search.label[label].rival = -1
    search.label[label].twin = -1
    search.label[label].same = -1
    return label


@kernel(inline=True)
def _set_label(search: Search, label: int, edge: int, reach: Reach, ahead: float) -> None:
    """Write a label; at least `ahead` nats are to come."""
    entry = search.label[label]
    entry.edge = edge
    entry.cost = reach.cost
    entry.key = reach.cost + ahead
    entry.length = reach.length
    entry.time = reach.time
    entry.turn = reach.turn


@kernel(inline=True)
def _enqueue(search: Search, label: int) -> None:
    """Put a label into the queue."""
    run = search.run[0]
    run.queued = push(search.queue, int(run.queued), label, search.label[label].key)


@kernel(inline=True)
def _relax(search: Search, edge: int, parent: int, reach: Reach, ahead: float) -> None:
    """Label an edge and queue it if this route to it is new or cheaper, else note it as a rival.

    At least `ahead` nats are to come.
    """
    place, label = _slot_of(search, edge)
    if search.run[0].queued >= LABELS - 1:
        return
    if label < 0:
        label = _new_label(search, place)
        if label < 0:
            return
    else:
        entry = search.label[label]
        if entry.done == _SETTLED or entry.cost <= reach.cost:
            if reach.cost - entry.cost < _RIVAL_WORTH:
                note_rival(search, label, parent, reach)
            return
        if entry.cost - reach.cost < _RIVAL_WORTH:
            old = Reach(entry.cost, entry.length, entry.time, entry.turn)
            note_rival(search, label, int(entry.parent), old)
    _set_label(search, label, edge, reach, ahead)
    search.label[label].parent = parent
    search.label[label].done = _OPEN
    _enqueue(search, label)


@kernel(inline=True)
def _expand(
    roads: Roads, search: Search, query: Query, current: int, label: int, end: Reach
) -> None:
    """Label the successors of an edge; `end` is the route to its end."""
    edge = roads.edges[current]
    dx = float(edge.end_x) - query.x
    dy = float(edge.end_y) - query.y
    away = max(math.sqrt(dx * dx + dy * dy) - (query.radius + _ROUNDING), 0.0)
    ahead = MIN_FACTOR * query.per_metre * away
    limit = search.run[0].limit
    if end.cost + ahead > limit or end.length + away > query.longest:
        return
    for t in range(edge.first_turn, edge.end_turn):
        turn = roads.turns[t]
        cost = end.cost + float(turn.cost)
        if cost + ahead <= limit:
            prefetch(roads.edges[turn.edge])
            reach = Reach(cost, end.length, end.time, end.turn + float(turn.angle))
            _relax(search, turn.edge, label, reach, ahead)


@kernel
def _prefix_label(search: Search, edge: int) -> int:
    """Label of an edge on the common prefix, or -1."""
    step = search.run[0].steps * LABELS
    place = edge & (PREFIX - 1)
    while search.prefix[place] >= step:
        label = search.prefix[place] - step
        if search.label[label].edge == edge:
            return int(label)
        place = (place + 1) & (PREFIX - 1)
    return -1


@kernel
def _add_to_prefix(search: Search, label: int) -> None:
    """Enter a label into the table of the common prefix."""
    step = search.run[0].steps * LABELS
    place = search.label[label].edge & (PREFIX - 1)
    while search.prefix[place] >= step:
        place = (place + 1) & (PREFIX - 1)
    search.prefix[place] = step + label


@kernel
def _common_prefix(search: Search, hits: int) -> tuple[int, bool]:
    """Last label of the common prefix of all routes, and whether one turns round at once.

    The label is -1 where the routes have none in common.  Their goals are written down.
    """
    end = int(search.hit[0])
    top = end
    up = end
    while up >= 0:
        search.label[up].done = _COPIED  # marks the first route
        top = up
        up = int(search.label[up].parent)
    turned = bool(search.label[top].length <= 0.0)
    for h in range(hits):
        label = int(search.hit[h])
        search.suffix[h] = label
        while label >= 0 and search.label[label].done != _COPIED:
            top = label
            label = int(search.label[label].parent)
        if label < 0:
            turned = turned or bool(search.label[top].length <= 0.0)
            end = -1
        elif end >= 0 and search.label[label].cost < search.label[end].cost:
            end = label
    return end, turned


@kernel(inline=True)
def _store_prefix(
    roads: Roads, search: Search, query: Query, edge: int, s: float, hits: int
) -> None:
    """Store the common prefix of a search's routes for the next searches of the step.

    The origin belongs to it, with the values of the start of its edge.
    """
    run = search.run[0]
    end, turned = _common_prefix(search, hits)
    run.suffixes = hits
    run.prefix_step = run.steps
    left = PREFIX // 2
    while end >= 0 and left > 0:
        _add_to_prefix(search, end)
        end = int(search.label[end].parent)
        left -= 1
    label = int(run.labels)
    if not turned and label < LABELS:
        run.labels = label + 1
        origin = roads.edges[edge]
        share = s / origin.length
        back = Reach(
            -query.per_metre * share * float(origin.cost), -s, -share * float(origin.time), 0.0
        )
        _set_label(search, label, edge, back, 0.0)
        search.label[label].parent = -1
        search.label[label].rival = -1
        search.label[label].twin = -1
        search.label[label].same = -1
        run.first = label
        _add_to_prefix(search, label)


@kernel
def _copy_route(
    search: Search, found: int, prefix: int, origin: int, shift: Reach, ahead: float
) -> bool:
    """Copy the labels of a route from its goal up to the prefix; False: the tables are full.

    `shift` is what this search's route to the prefix has more than that of the first search.
    """
    run = search.run[0]
    complete = True
    below = -1
    while found != prefix and found >= 0:
        entry = search.label[found]
        cost = entry.cost + shift.cost
        place, label = _slot_of(search, entry.edge)
        if label < 0:
            if run.queued >= LABELS - 1:
                complete = False
                break
            label = _new_label(search, place)
            if label < 0:
                complete = False
                break
        elif search.label[label].done == _SETTLED or search.label[label].cost <= cost:
            if below >= 0:
                search.label[below].parent = label
            return True
        reach = Reach(
            cost, entry.length + shift.length, entry.time + shift.time, entry.turn + shift.turn
        )
        _set_label(search, label, entry.edge, reach, ahead)
        search.label[label].done = _COPIED
        search.label[label].twin = found
        if below >= 0:
            search.label[below].parent = label
        else:
            _enqueue(search, label)
        below = label
        found = int(entry.parent)
    if below >= 0:
        search.label[below].parent = origin
    return complete


@kernel(inline=True)
def _copy_suffixes(
    roads: Roads, search: Search, query: Query, prefix: int, origin: int, end: Reach
) -> None:
    """Copy the routes that the first search found behind an edge of the prefix.

    The label `origin` is this search's own of that edge; `end` is the route to its end.
    """
    run = search.run[0]
    if origin >= 0:
        search.label[origin].twin = prefix
    else:
        run.root = prefix
    first = search.label[prefix]
    edge = roads.edges[first.edge]
    shift = Reach(
        end.cost - (first.cost + query.per_metre * float(edge.cost)),
        end.length - (first.length + float(edge.route_length)),
        end.time - (first.time + float(edge.time)),
        end.turn - first.turn,
    )
    for h in range(run.suffixes):
        found = search.suffix[h]
        entry = search.label[found]
        ahead = entry.key - entry.cost
        away = ahead / (MIN_FACTOR * query.per_metre)
        if entry.key + shift.cost > run.limit:
            continue
        if entry.length + shift.length + away > query.longest:
            continue
        if not _copy_route(search, found, prefix, origin, shift, ahead):
            return


@kernel(inline=True)
def _turn_round(roads: Roads, search: Search, query: Query, edge: int, left: float) -> None:
    """Label the opposite of the edge on which the search begins, `left` metres before its end."""
    limit = search.run[0].limit
    other = roads.edges[edge].opposite
    if other >= 0 and query.u_turn < limit:
        v = roads.edges[other].first_vertex
        away = math.hypot(roads.vertices[v].x - query.x, roads.vertices[v].y - query.y)
        away = max(away - (query.radius + _ROUNDING), 0.0)
        ahead = MIN_FACTOR * query.per_metre * away
        if away <= query.longest + left and query.u_turn + ahead <= limit:
            _relax(search, other, -1, Reach(query.u_turn, -left, 0.0, math.pi), ahead)


@kernel(inline=True)
def _next_label(roads: Roads, search: Search) -> int:
    """Take the open label of the least key out of the queue, -1: there is none."""
    run = search.run[0]
    while run.queued > 0:
        label = pop(search.queue, int(run.queued))
        run.queued -= 1
        if run.queued > 0:
            following = search.queue[0] & ((1 << LABEL_BITS) - 1)
            after = roads.edges[search.label[following].edge]
            if after.first_turn < after.end_turn:
                prefetch(roads.turns[after.first_turn])
        if search.label[label].done != _SETTLED:
            return label
    return -1


@kernel(inline=True)
def _end_of(roads: Roads, search: Search, query: Query, label: int) -> Reach:
    """The route to the end of a label's edge."""
    entry = search.label[label]
    edge = roads.edges[entry.edge]
    return Reach(
        entry.cost + query.per_metre * float(edge.cost),
        entry.length + float(edge.route_length),
        entry.time + float(edge.time),
        entry.turn,
    )


@kernel(inline=True)
def _begin(roads: Roads, search: Search, query: Query, edge: int, s: float) -> Reach:
    """Begin a search; returns the route to the end of its first edge."""
    run = search.run[0]
    run.searches += 1
    run.queued = 0
    run.root = -1
    run.limit = query.limit
    origin = roads.edges[edge]
    left = max(origin.length - s, 0.0)
    share = left / origin.length
    _turn_round(roads, search, query, edge, left)
    return Reach(
        query.per_metre * share * float(origin.cost), origin.length - s,
        share * float(origin.time), 0.0,
    )  # fmt: skip


@kernel
def find_routes(roads: Roads, search: Search, query: Query, edge: int, s: float) -> int:
    """The cheapest routes from abscissa s of an edge to the goals around a point.

    A* with the straight distance to the goals' circle as the lower bound.  Where a later
    search of the same step reaches the common prefix of the first one's routes, it copies
    the suffixes that the first one found.

    Args:
        roads: The network.
        search: `hit` is filled with the labels of goals, cheapest first; the origin itself
            has no label.
        query: Costs and limits; the goals are those of `set_goals`.
        edge: Where the search begins.
        s: Abscissa there, m.

    Returns:
        How many goals were hit.
    """
    run = search.run[0]
    first_label = int(run.labels)
    hits = 0
    shared = bool(run.prefix_step == run.steps and not query.alone)
    complete = False  # whether all goals within the slack are found
    copied = False
    label = -1
    current = edge
    end = _begin(roads, search, query, edge, s)
    while True:
        prefix = _prefix_label(search, current) if shared and not copied else -1
        if label < 0 and prefix == search.suffix[0]:
            prefix = -1  # from a goal: the first search has no limit for it
        if prefix >= 0:
            _copy_suffixes(roads, search, query, prefix, label, end)
        elif not copied:
            _expand(roads, search, query, current, label, end)
        label = _next_label(roads, search)
        if run.labels - first_label >= query.most:
            return hits
        if label < 0 or search.label[label].key > run.limit:
            break
        entry = search.label[label]
        copied = bool(entry.done == _COPIED)
        entry.done = _SETTLED
        current = entry.edge
        if hits < len(search.hit) and goal_of(search, current) >= 0:
            if hits == 0:
                complete = bool(entry.key + query.slack <= run.limit)
                run.limit = min(run.limit, entry.key + query.slack)
            search.hit[hits] = label
            hits += 1
            if hits == run.goals:
                break
        end = _end_of(roads, search, query, label)
    if complete and not shared and not query.alone:
        _store_prefix(roads, search, query, edge, s, hits)
    return hits
