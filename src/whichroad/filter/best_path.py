"""The best path through the graph of merged hypotheses, and when its edges were driven."""

import math
from typing import Annotated

import numpy as np

from .._compile import Array, Ints, Record, Records, Vector, entry, kernel
from ..graph.network import Roads
from .estimate import Estimates
from .history import History
from .state import Epochs

TRAVERSAL = np.dtype(
    [
        ("edge", "i8"),
        ("entered", "f8"),  # when the hypothesis entered the edge, s
        ("along", "f8"),  # where, true m
        ("enter_time", "f8"),  # s
        ("exit_time", "f8"),  # s
        ("enter_m", "f8"),  # abscissa, m
        ("exit_m", "f8"),  # abscissa, m
        ("p", "f8"),  # mean P of the edge while it was driven
        ("rules", "i8"),  # bits of the rules that driving into it and along it broke
        ("gap", "?"),  # does not follow from the edge before
    ],
    align=True,
)

Traversals = Annotated[Records, Array(TRAVERSAL, 1)]  # edges of a path in driving order

_BESIDE = 2  # edges before and after those that are the most probable at no epoch
_STEP = 1e-6  # m; closer positions do not give a new time
_LEAST_SHARE = 1e-3  # share of a node's weight up to which a link is not part of a path


@entry
def edge_probability(history: History, total: Vector) -> None:
    """Smoothed P of each node's edge at its step, components of one edge added up, (M,)."""
    nodes = history.nodes
    for step in range(history.count[0].steps):
        first = history.steps[step].first_node
        last = history.steps[step].end_node
        for i in range(first, last):
            total[i] = 0.0
            for j in range(first, last):
                if nodes[j].edge == nodes[i].edge:
                    total[i] += nodes[j].smoothed


@entry
def best_path(
    history: History, weight: Vector, p: Vector, viterbi: bool, score: Vector, back: Ints,
    path: Ints,
) -> None:  # fmt: skip
    """The best chain of linked nodes, one a step.

    Either that of the largest Σ weight · P(edge) along links of some share, or (Viterbi) the
    most probable one, P(last) Π f.

    Args:
        history: The graph.
        weight: Of each step, (T,).
        p: P of each node's edge, (M,).
        viterbi: Which.
        score: Buffer, (M,).
        back: Buffer, (M,).
        path: Filled with nodes, (T,).
    """
    steps = history.count[0].steps
    best = -1
    for step in range(steps):
        before = best
        best = -1
        then = history.steps[step - 1].first_node if step > 0 else 0
        for j in range(history.steps[step].first_node, history.steps[step].end_node):
            top = _best_origin(history, then, j, viterbi, score, back)
            if back[j] < 0:
                back[j] = before
                top = score[before] if before >= 0 else 0.0
            score[j] = top if viterbi else top + weight[step] * p[j]
            value = score[j]
            if viterbi:
                value += math.log(max(history.nodes[j].p, 1e-300))
            if best < 0 or value > score[best] + (
                math.log(max(history.nodes[best].p, 1e-300)) if viterbi else 0.0
            ):
                best = j
    for step in range(steps - 1, -1, -1):
        path[step] = best
        best = back[best]


@kernel
def _best_origin(
    history: History, then: int, j: int, viterbi: bool, score: Vector, back: Ints
) -> float:
    """The best score of the nodes that node j came from; `back` of j is set, -1: none."""
    first = history.nodes[j].first_link
    end = history.nodes[j].end_link
    back[j] = -1
    top = -math.inf
    heaviest = 0.0
    for at in range(first, end):
        heaviest = max(heaviest, history.links[at].share)
    for at in range(first, end):
        share = history.links[at].share
        if share < min(_LEAST_SHARE, heaviest):
            continue
        i = then + history.links[at].origin
        value = score[i] + (math.log(share) if viterbi else 0.0)
        if value > top:
            top = value
            back[j] = i
    return top


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
def time_edges(
    roads: Roads, driven: Traversals, first: Ints, epochs: Epochs, estimates: Estimates,
    last_epoch: int,
) -> None:  # fmt: skip
    """Fill in each edge's times, ends and probability.

    P is the mean P of the edge at the epochs at which it was the most probable.  Where there
    are none it is P of being on the path at the epochs around, whichever is less.

    Args:
        roads: The network.
        driven: (r,) TRAVERSAL, edges in driving order, with `entered` and `along`; the rest but
            for the rules is written.
        first: (r + 1,) the first epoch of each edge, and the number of epochs.
        epochs: (n,) EPOCH.
        estimates: (n,) ESTIMATE.
        last_epoch: The last one with an estimate.
    """
    rows = len(driven)
    for i in range(rows):
        high = first[i + 1] if i + 1 < rows else last_epoch + 1
        _time_edge(roads, driven, i, epochs, estimates, first[i], high)
    _bridge(driven, first, estimates, last_epoch)
    _time_nodes(driven, first, epochs, estimates)


@kernel
def _time_edge(
    roads: Roads, driven: Traversals, i: int, epochs: Epochs, estimates: Estimates, low: int,
    high: int,
) -> None:  # fmt: skip
    """Edge i of a path by itself, whose epochs are low ... high - 1."""
    own = driven[i]
    edge, length = own.edge, roads.edges[own.edge].length
    count, last_s, top, total = 0, length, 0.0, 0.0
    for k in range(low, high):
        estimate = estimates[k]
        if estimate.edge == edge:
            count += 1
            last_s = estimate.s
            top = max(top, estimate.s)
            for a in range(len(estimate.alt_edge)):
                if estimate.alt_edge[a] == edge:
                    total += estimate.alt_p[a]
    last = i + 1 == len(driven)
    own.gap = i > 0 and not joins(roads, driven[i - 1].edge, edge)
    gap_after = not last and not joins(roads, edge, driven[i + 1].edge)
    own.p = total / count if count else -1.0
    own.enter_time = own.entered
    own.exit_time = epochs[min(high, len(epochs) - 1)].time
    own.enter_m = min(max(own.along, 0.0), length) if i == 0 or own.gap else 0.0
    own.exit_m = max(last_s, own.enter_m) if last or gap_after else length
    if i > 0 and roads.edges[edge].opposite == driven[i - 1].edge:  # turned round on the way
        own.enter_m = length - driven[i - 1].exit_m
        own.exit_m = max(own.exit_m, own.enter_m)
    if not last and roads.edges[edge].opposite == driven[i + 1].edge:
        own.exit_m = max(min(top, length) if count else own.enter_m, own.enter_m)


@kernel
def _bridge(driven: Traversals, first: Ints, estimates: Estimates, last_epoch: int) -> None:
    """P of the edges that are the most probable at no epoch, by the epochs on both sides."""
    rows, i = len(driven), 0
    while i < rows:
        end = i + 1
        if driven[i].p < 0.0:
            while end < rows and driven[end].p < 0.0:
                end += 1
            low, high = max(i - _BESIDE, 0), min(end + _BESIDE, rows)
            on = 1.0
            for k in range(max(first[i] - 1, first[0]), min(first[end], last_epoch) + 1):
                on = min(on, _p_on_path(driven, low, high, estimates[k]))
            for j in range(i, end):
                driven[j].p = on
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


@kernel
def _time_nodes(driven: Traversals, first: Ints, epochs: Epochs, estimates: Estimates) -> None:
    """Times at which one edge ended and the next began, between the positions around.

    Hypotheses branch a little before or after the node is passed.  Positions are brought to
    distances along the path, which may not run back.
    """
    rows, seen = len(driven), 0
    base, end, far, when = 0.0, driven[0].exit_m - driven[0].enter_m, 0.0, 0.0
    node = 0  # the next one to be timed: that between edges `node` and `node + 1`
    for i in range(rows):
        for k in range(first[i], first[i + 1]):
            if estimates[k].edge != driven[i].edge:
                continue
            time = epochs[k].time
            at = base + max(estimates[k].s - driven[i].enter_m, 0.0)
            if seen and at <= far + _STEP:
                seen += 1
                continue
            while node < rows - 1 and end <= at:
                part = (end - far) / (at - far) if seen and end > far else 0.0
                driven[node].exit_time = when + part * (time - when) if seen else time
                node += 1
                end += driven[node].exit_m - driven[node].enter_m
            seen, far, when = seen + 1, at, time
        base += driven[i].exit_m - driven[i].enter_m
    if seen < 2:
        return
    for i in range(node, rows - 1):
        driven[i].exit_time = when
    before = driven[0].enter_time
    for i in range(rows):
        driven[i].enter_time = before
        before = driven[i].exit_time = max(driven[i].exit_time, before)


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
