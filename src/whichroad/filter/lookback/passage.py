"""When and where the edges of a path were driven, by the estimates of the epochs.

The hypothesis that wins in the end may cross a node long before the vehicle does, which stands a
few metres in front of it.  An epoch is therefore one of the edge that is the likelier there.

An edge of the path is *seen* at the epochs whose most probable edge it is.  It is driven from
the first to the last of them at least, so that points and path agree, and left between the last
one and the first at which an edge behind it is seen.  An edge that is never seen has the times at
which its length is driven between the sights around, or from the start or to the end of the drive.
"""

from typing import Annotated, NamedTuple

import numpy as np

from ..._compile import Array, Ints, Record, Records, entry, kernel
from ...graph.network import Roads
from ..state import NO_EDGE, Epochs
from ..summary.estimate import Estimates

TRAVERSAL = np.dtype(
    [
        ("edge", "i8"),
        ("entered", "f8"),  # when the hypothesis entered the edge, s
        ("along", "f8"),  # where, true m
        ("left", "f8"),  # where it left the edge for a place off the roads, m; 0: it did not
        ("share", "f8"),  # of the likely routes between two fixes that pass it; else 1
        ("route", "f8"),  # of these that is the one driven; else 1
        ("enter_time", "f8"),  # s
        ("exit_time", "f8"),  # s
        ("enter_m", "f8"),  # abscissa, m
        ("exit_m", "f8"),  # abscissa, m
        ("p", "f8"),  # mean P of the edge while it was driven
        ("p_route", "f8"),  # P of all edges between the two fixes around
        ("first_seen", "i8"),  # epoch; one past the last of all: never
        ("last_seen", "i8"),  # epoch; -1: never
        ("next_seen", "i8"),  # epoch at which an edge behind it is first seen
        ("rules", "i8"),  # bits of the rules that driving into it and along it broke
        ("gap", "?"),  # does not follow from the edge before
    ],
    align=True,
)

Traversals = Annotated[Records, Array(TRAVERSAL, 1)]  # edges of a path in driving order

_BESIDE = 2  # edges before and after those that are the most probable at no epoch
_SURE = 0.9  # P of an edge from which on an epoch says where on the path the vehicle is
_NEAR = 3  # edges of the path from that of its time, among which a sure epoch's is looked for


@kernel
def joins(roads: Roads, a: int, b: int) -> bool:
    """Whether edge b follows edge a."""
    t, end = roads.edges[a].first_turn, roads.edges[a].end_turn
    while t < end and roads.turns[t].edge != b:
        t += 1
    return bool(t < end)


@entry
def broken_rules(roads: Roads, driven: Traversals) -> None:
    """Set the rules that driving into edges and along them breaks.

    Args:
        roads: The network.
        driven: (r,) TRAVERSAL, edges in driving order.
    """
    for i in range(len(driven)):
        edge = driven[i].edge
        rules = int(roads.edges[edge].rule)
        if i > 0:
            before = roads.edges[driven[i - 1].edge]
            for t in range(before.first_turn, before.end_turn):
                if roads.turns[t].edge == edge:
                    rules |= roads.turns[t].rule
        driven[i].rules = rules


@entry
def first_epochs(driven: Traversals, epochs: Epochs, found: Ints) -> None:
    """The first epoch not before each edge was entered, and behind them the number of epochs.

    Args:
        driven: (r,) TRAVERSAL with `entered`.
        epochs: (n,) EPOCH in time order.
        found: (r + 1,) written.
    """
    for i in range(len(driven)):
        low, high = 0, len(epochs)
        while low < high:
            middle = (low + high) // 2
            if epochs[middle].time < driven[i].entered:
                low = middle + 1
            else:
                high = middle
        found[i] = low
    found[len(driven)] = len(epochs)


@entry
def time_edges(
    roads: Roads, driven: Traversals, first: Ints, epochs: Epochs, estimates: Estimates,
    last_epoch: int,
) -> None:  # fmt: skip
    """Fill in each edge's times, ends and probability.

    A path ends where the vehicle was last seen on it, or left it.  Edges behind are none of it.

    P is the mean P of the edge at the epochs at which it was the most probable.  Where there
    are none it is P of being on the path at the epochs around, whichever is less.

    Args:
        roads: The network.
        driven: (r,) TRAVERSAL, edges in driving order, with `entered`, `along`, `left`,
            `share` and `route`; the rest but for the rules is written.  P is -1 of edges behind
            the path's end.
        first: (r + 1,) the first epoch of each edge, and the number of epochs; overwritten.
        epochs: (n,) EPOCH.
        estimates: (n,) ESTIMATE.
        last_epoch: The last one with an estimate.
    """
    _enter_when_likelier(driven, first, epochs, estimates, last_epoch)
    _see(driven, first, estimates, last_epoch)
    rows = len(driven)
    while rows > 1 and driven[rows - 1].last_seen < 0 and driven[rows - 1].left <= 0.0:
        rows -= 1
        driven[rows].p = -1.0
    if rows == len(driven):
        _time_seen(roads, driven, first, epochs, estimates, last_epoch)
        return
    first[rows] = len(epochs)
    _see(driven[:rows], first[: rows + 1], estimates, last_epoch)
    _time_seen(roads, driven[:rows], first[: rows + 1], epochs, estimates, last_epoch)


@kernel
def _enter_when_likelier(
    driven: Traversals, first: Ints, epochs: Epochs, estimates: Estimates, last_epoch: int
) -> None:  # fmt: skip
    """Move first epochs of edges on while the edge before is the likelier one, in sum.

    Of the epochs from which on an edge may have the time, that one is taken for which P of the
    edge before, up to it, and P of its own, from it on, have the largest sum.  The epoch that is
    first sure of an edge is the last of them.
    """
    for back in range(1, len(driven)):
        i = len(driven) - back
        before, own = driven[i - 1].edge, driven[i].edge
        lead = most = 0.0
        for k in range(first[i], min(first[i + 1], last_epoch + 1)):
            if estimates[k].edge == own and estimates[k].p_edge >= _SURE:
                break
            if epochs[k].filled == 1:  # nothing is known
                continue
            for a in range(len(estimates[k].alt_edge)):
                if estimates[k].alt_edge[a] == before:
                    lead += estimates[k].alt_p[a]
                elif estimates[k].alt_edge[a] == own:
                    lead -= estimates[k].alt_p[a]
            if lead > most:
                most = lead
                first[i] = k + 1


@kernel
def _see(driven: Traversals, first: Ints, estimates: Estimates, last_epoch: int) -> None:
    """First and last sight of each edge."""
    _see_where_sure(driven, first, estimates, last_epoch)
    _see_elsewhere(driven, first, estimates, last_epoch)


@kernel
def _time_seen(
    roads: Roads, driven: Traversals, first: Ints, epochs: Epochs, estimates: Estimates,
    last_epoch: int,
) -> None:  # fmt: skip
    """`time_edges` where sights are known."""
    rows = len(driven)
    for i in range(rows):
        own = driven[i]
        own.gap = i > 0 and not joins(roads, driven[i - 1].edge, own.edge)
        if own.first_seen == first[i] and own.last_seen >= 0:  # a sight knows better
            own.along = estimates[own.first_seen].s
    for i in range(rows):
        _place_ends(roads, driven, i, estimates)
    _bridge(driven, first, estimates, last_epoch)
    _time_nodes(driven, first, epochs, estimates, last_epoch)


@kernel
def _see_where_sure(driven: Traversals, first: Ints, estimates: Estimates, last_epoch: int) -> None:
    """First and last sight of each edge by the epochs that are sure of theirs.

    Such an epoch may lie a little before or after the time at which a hypothesis entered the
    edge.  What was seen later is farther along the path.
    """
    rows = len(driven)
    for i in range(rows):
        driven[i].first_seen = last_epoch + 1
        driven[i].last_seen = -1
    row = 0  # of the path at the epoch
    newest = 0  # seen
    for k in range(first[0], last_epoch + 1):
        while row + 1 < rows and first[row + 1] <= k:
            row += 1
        if estimates[k].edge < 0 or estimates[k].p_edge < _SURE:
            continue
        best = -1
        for j in range(max(row - _NEAR, newest), min(row + _NEAR + 1, rows)):
            if driven[j].edge != estimates[k].edge:
                continue
            if best < 0 or abs(j - row) < abs(best - row):
                best = j
        if best >= 0:
            newest = best
            driven[best].first_seen = min(driven[best].first_seen, k)
            driven[best].last_seen = k


@kernel
def _see_elsewhere(driven: Traversals, first: Ints, estimates: Estimates, last_epoch: int) -> None:
    """Sights of edges by the other epochs of their time, where these contradict no sure one."""
    rows = len(driven)
    following = last_epoch + 1
    for back in range(rows):
        own = driven[rows - 1 - back]
        own.next_seen = following
        following = min(following, own.first_seen)
    newest = -1  # epoch of the edges before
    for i in range(rows):
        own = driven[i]
        high = first[i + 1] if i + 1 < rows else last_epoch + 1
        for k in range(max(first[i], newest + 1), min(high, own.next_seen)):
            if estimates[k].edge == own.edge:
                own.first_seen = min(own.first_seen, k)
                own.last_seen = max(own.last_seen, k)
        newest = max(newest, own.last_seen)


@kernel
def _place_ends(roads: Roads, driven: Traversals, i: int, estimates: Estimates) -> None:
    """Ends and P of edge i of a path, the ends of the edge before being known."""
    own = driven[i]
    edge, length = own.edge, roads.edges[own.edge].length
    unseen = min(own.left, length) if own.left > 0.0 else length
    last = i + 1 == len(driven)
    count, top, total = 0, 0.0, 0.0
    last_s = unseen if own.left > 0.0 else own.along
    for k in range(own.first_seen, own.last_seen + 1):
        estimate = estimates[k]
        if estimate.edge == edge:
            count += 1
            last_s = estimate.s
            top = max(top, estimate.s)
            for a in range(len(estimate.alt_edge)):
                if estimate.alt_edge[a] == edge:
                    total += estimate.alt_p[a]
    own.p = own.p_route = total / count if count else -1.0
    own.enter_m = min(max(own.along, 0.0), length) if i == 0 or own.gap else 0.0
    own.exit_m = length
    if last:
        own.exit_m = max(last_s, own.enter_m)
    elif driven[i + 1].gap and count:  # the farthest place: it may stand there, and the fixes creep
        own.exit_m = max(top, own.enter_m)
    elif driven[i + 1].gap:
        own.exit_m = max(unseen, own.enter_m)
    if i > 0 and roads.edges[edge].opposite == driven[i - 1].edge:  # turned round on the way
        own.enter_m = length - driven[i - 1].exit_m
        own.exit_m = max(own.exit_m, own.enter_m)
    if not last and roads.edges[edge].opposite == driven[i + 1].edge:
        after = driven[i + 1]
        for k in range(after.first_seen, after.last_seen + 1):
            if estimates[k].edge == after.edge:
                top = max(top, length - estimates[k].s)
        own.exit_m = max(min(top, length), own.enter_m)


@kernel
def _bridge(driven: Traversals, first: Ints, estimates: Estimates, last_epoch: int) -> None:
    """P of the edges that are the most probable at no epoch, by the epochs on both sides.

    Of that the share of the routes that pass the edge.
    """
    rows, i = len(driven), 0
    while i < rows:
        end = i + 1
        if driven[i].p < 0.0:
            while end < rows and driven[end].p < 0.0:
                end += 1
            low, high = max(i - _BESIDE, 0), min(end + _BESIDE, rows)
            on = 1.0
            for k in range(max(first[i] - 1, first[0]), min(first[end], last_epoch) + 1):
                if estimates[k].edge != NO_EDGE:  # else nothing is known
                    on = min(on, _p_on_path(driven, low, high, estimates[k]))
            route = 1.0
            for j in range(i, end):
                driven[j].p = on * driven[j].share
                route = min(route, driven[j].route, driven[j].share)
            for j in range(i, end):
                driven[j].p_route = on * route
        i = end


@kernel
def _p_on_path(driven: Traversals, low: int, high: int, estimate: Record) -> float:
    """P of the edges low ... high - 1 of a path at an epoch."""
    total = 0.0
    for a in range(len(estimate.alt_edge)):
        for j in range(low, high):
            if estimate.alt_edge[a] == driven[j].edge:
                total += estimate.alt_p[a]
                break
    return total


class _Place(NamedTuple):
    """Where on the path the vehicle is at a time."""

    row: int  # of the path
    begin: float  # distance along the path at which the row begins, m
    far: float  # of the vehicle, m
    time: float  # s
    epoch: int


@kernel
def _time_nodes(
    driven: Traversals, first: Ints, epochs: Epochs, estimates: Estimates, last_epoch: int
) -> None:
    """Times at which one edge ended and the next began, from the start to the last epoch.

    Hypotheses branch a little before or after the node is passed.  Positions are brought to
    distances along the path, at which the vehicle drives evenly from one sight to the next.
    """
    rows = len(driven)
    begin = 0.0
    place = _Place(0, 0.0, 0.0, driven[0].entered, first[0] - 1)
    for i in range(rows):
        length = driven[i].exit_m - driven[i].enter_m
        for k in range(driven[i].first_seen, driven[i].last_seen + 1):
            if estimates[k].edge != driven[i].edge:
                continue
            far = begin + min(max(estimates[k].s - driven[i].enter_m, 0.0), length)
            seen = _Place(i, begin, far, epochs[k].time, k)
            _drive(driven, first, epochs, place, seen)
            place = seen
        if i + 1 < rows:
            begin += length
    end = begin + driven[rows - 1].exit_m - driven[rows - 1].enter_m
    time = max(epochs[last_epoch].time, place.time)
    _drive(driven, first, epochs, place, _Place(rows - 1, begin, end, time, last_epoch))
    driven[rows - 1].exit_time = time
    before = driven[0].entered
    for i in range(rows):
        driven[i].enter_time = before
        before = driven[i].exit_time = max(driven[i].exit_time, before)


@kernel
def _drive(driven: Traversals, first: Ints, epochs: Epochs, since: _Place, to: _Place) -> None:
    """Leave the edges between two places, being on the path's edge at each epoch between."""
    place = since
    row = since.row
    begin = since.begin
    for k in range(since.epoch + 1, to.epoch):
        if epochs[k].filled == 1:  # it may be anywhere between
            continue
        while row < to.row and first[row + 1] <= k:
            begin += driven[row].exit_m - driven[row].enter_m
            row += 1
        if first[row] > k or first[row + 1] <= k:
            continue
        early = row > since.row and first[row] <= since.epoch
        if early or (row < to.row and first[row + 1] > to.epoch):  # the sights say otherwise
            continue
        time = epochs[k].time
        part = (time - place.time) / max(to.time - place.time, 1e-9)
        even = place.far + min(max(part, 0.0), 1.0) * (to.far - place.far)
        far = min(max(even, begin), begin + driven[row].exit_m - driven[row].enter_m)
        if far != even:
            turn = _Place(row, begin, far, time, k)
            _leave(driven, place, turn)
            place = turn
    _leave(driven, place, to)


@kernel
def _leave(driven: Traversals, since: _Place, to: _Place) -> None:
    """Leave the edges between two places, driving evenly."""
    end = since.begin
    for i in range(since.row, to.row):
        end += driven[i].exit_m - driven[i].enter_m
        way = to.far - since.far
        part = min(max((end - since.far) / way, 0.0), 1.0) if way > 0.0 else 1.0
        driven[i].exit_time = since.time + part * (to.time - since.time)
