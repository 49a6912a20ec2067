"""When and where the edges of a route were driven, from the positions said along them."""

from ._jit import Bytes, Ints, Ints32, Matrix32, Table32, Vector, entry, kernel
from .network import Roads

_BESIDE = 2  # edges before and after those of which no epoch speaks
_STEP = 1e-6  # m; positions closer than this tell no new time


@kernel
def joins(roads: Roads, a: int, b: int) -> bool:
    """Whether edge b follows edge a."""
    t, end = roads.succ_first[a], roads.succ_first[a + 1]
    while t < end and roads.succ[t] != b:
        t += 1
    return bool(t < end)


@entry
def turn_rules(roads: Roads, edge: Ints, bits: Ints) -> None:
    """Add the rules that the turns into edges break.

    Args:
        roads: The network.
        edge: (r,) edges in driving order.
        bits: (r,) rules, see `core.network`; those of turns are added.
    """
    for i in range(1, len(edge)):
        for t in range(roads.succ_first[edge[i - 1]], roads.succ_first[edge[i - 1] + 1]):
            if roads.succ[t] == edge[i]:
                bits[i] |= roads.succ_rule[t]


@entry
def drive_edges(
    roads: Roads, edge: Ints, entered: Vector, abscissa: Vector, first: Ints,
    time: Vector, said: Ints32, s: Vector, alt_edge: Table32, alt_p: Matrix32, last_epoch: int,
    enter_time: Vector, exit_time: Vector, enter_m: Vector, exit_m: Vector, p: Vector, gap: Bytes,
) -> None:  # fmt: skip
    """Fill in each edge's times, ends and probability.

    Args:
        roads: The network.
        edge: (r,) edges in driving order.
        entered: (r,) when the hypothesis entered each, s.
        abscissa: (r,) where, true m.
        first: (r + 1,) the first epoch of each edge, and the number of epochs.
        time: (n,) of the epochs, s.
        said: (n,) most probable edge.
        s: (n,) abscissa there.
        alt_edge: (n, ALTERNATIVES) edges.
        alt_p: Their P.
        last_epoch: The last one with an answer.
        enter_time: (r,) s; written, as are all that follow.
        exit_time: (r,) s.
        enter_m: (r,) abscissa.
        exit_m: (r,) abscissa.
        p: (r,) mean P of the edge at the epochs at which it was the most probable; where there
            are none, P of being on the route at the epochs around, whichever is less.
        gap: (r,) 1 where an edge does not follow from the one before.
    """
    n, rows = len(time), len(edge)
    for i in range(rows):
        e, length = edge[i], roads.length[edge[i]]
        high = first[i + 1] if i + 1 < rows else last_epoch + 1
        count, last_s, top, total = 0, length, 0.0, 0.0
        for k in range(first[i], high):
            if said[k] == e:
                count += 1
                last_s = s[k]
                top = max(top, s[k])
                for a in range(alt_edge.shape[1]):
                    if alt_edge[k, a] == e:
                        total += alt_p[k, a]
        last = i + 1 == rows
        gap[i] = i > 0 and not joins(roads, edge[i - 1], e)
        gap_after = not last and not joins(roads, e, edge[i + 1])
        p[i] = total / count if count else -1.0
        enter_time[i] = entered[i]
        exit_time[i] = time[min(high, n - 1)]
        enter_m[i] = min(max(abscissa[i], 0.0), length) if i == 0 or gap[i] else 0.0
        exit_m[i] = max(last_s, enter_m[i]) if last or gap_after else length
        if i > 0 and roads.opposite[e] == edge[i - 1]:  # turned round on the way
            enter_m[i] = length - exit_m[i - 1]
            exit_m[i] = max(exit_m[i], enter_m[i])
        if not last and roads.opposite[e] == edge[i + 1]:
            exit_m[i] = max(min(top, length) if count else enter_m[i], enter_m[i])
    _bridge(edge, first, alt_edge, alt_p, last_epoch, p)
    _time_nodes(edge, first, time, said, s, enter_m, exit_m, enter_time, exit_time)


@kernel
def _bridge(
    edge: Ints, first: Ints, alt_edge: Table32, alt_p: Matrix32, last_epoch: int, p: Vector
) -> None:
    """P of the edges of which no epoch speaks, by the epochs on both sides of them."""
    rows, i = len(edge), 0
    while i < rows:
        end = i + 1
        if p[i] < 0.0:
            while end < rows and p[end] < 0.0:
                end += 1
            low, high = max(i - _BESIDE, 0), min(end + _BESIDE, rows)
            on = 1.0
            for k in range(max(first[i] - 1, first[0]), min(first[end], last_epoch) + 1):
                on = min(on, _on_route(edge, low, high, alt_edge[k], alt_p[k]))
            for j in range(i, end):
                p[j] = on
        i = end


@kernel
def _on_route(edge: Ints, low: int, high: int, alt_edge: Table32, alt_p: Matrix32) -> float:
    """P of the edges low ... high - 1 of a route at an epoch."""
    total = 0.0
    for a in range(len(alt_edge)):
        for j in range(low, high):
            if alt_edge[a] == edge[j]:
                total += alt_p[a]
                break
    return total


@kernel
def _time_nodes(
    edge: Ints, first: Ints, time: Vector, said: Ints32, s: Vector, enter_m: Vector,
    exit_m: Vector, enter_time: Vector, exit_time: Vector,
) -> None:  # fmt: skip
    """Times at which one edge ended and the next began, between the positions around.

    The hand-over between hypotheses itself happens a little late or early.  Positions are
    brought to distances along the route, which may not run back.
    """
    rows, seen = len(edge), 0
    base, end, far, when = 0.0, exit_m[0] - enter_m[0], 0.0, 0.0
    node = 0  # the next one to be timed: that between `node` and `node + 1`
    for i in range(rows):
        for k in range(first[i], first[i + 1]):
            if said[k] != edge[i]:
                continue
            at = base + max(s[k] - enter_m[i], 0.0)
            if seen and at <= far + _STEP:
                seen += 1
                continue
            while node < rows - 1 and end <= at:
                share = (end - far) / (at - far) if seen and end > far else 0.0
                exit_time[node] = when + share * (time[k] - when) if seen else time[k]
                node += 1
                end += exit_m[node] - enter_m[node]
            seen, far, when = seen + 1, at, time[k]
        base += exit_m[i] - enter_m[i]
    if seen < 2:
        return
    for i in range(node, rows - 1):
        exit_time[i] = when
    before = enter_time[0]
    for i in range(rows):
        enter_time[i] = before
        before = exit_time[i] = max(exit_time[i], before)
