"""One wrong fix: a hypothesis that drives on along its road, and takes the fix to say nothing.

It is there where the routes to the fix are less likely than the usual one.  The fix costs it
what a wrong one is worth, and does not move it.  How far it has come is a guess only: with the
next fix it begins anew where it was before (`past_wrong_fix`).  Where the receiver was
silent before, its error may last: see `sides.fork_biased`.
"""

import math

from ..._compile import Record, kernel
from ...graph.geometry import locate
from ...graph.index import vertex_at
from ...graph.labels import Search
from ..gnss.inflation import was_silent
from ..road import track
from ..state import (
    BIASED,
    CAPACITY,
    MX,
    MY,
    NO_BOUND,
    NO_EDGE,
    OFF_ROAD,
    WRONG,
    Belief,
    Context,
    K,
    Path,
    X,
    Y,
    move_row,
)
from .arrival import (
    Drive,
    Foot,
    Transition,
    enter_route,
    place_on_road,
    predict_transition,
)
from .candidates import SparseFix, usual_speed, variance_along
from .driven import distance_of, faster_by
from .driver import forget_leg

_DEARER = 1.0  # nats by which the best route to a fix that may be wrong is dearer than usual
_LONGEST = 200.0  # s, by which a hypothesis is taken on along its road,
_SILENT = 30.0  # and that after which a fix may be biased for good
_LEAST = 0.1  # weight of a hypothesis that drives on
_MOST = 64  # edges that it drives through


@kernel
def _may_be_biased(state: Record, par: Record, dt: float) -> bool:
    """Whether the error of a fix after dt seconds of silence may last."""
    return bool(dt <= _SILENT and was_silent(state, par, dt))


@kernel
def may_be_wrong(belief: Belief, ctx: Context, top: int, fix: SparseFix) -> bool:
    """Whether the routes to a fix are so dear that it may be wrong, or its receiver was silent.

    Args:
        belief: Normalised.
        ctx: With the routes of `choose_routes`.
        top: The heaviest hypothesis.
        fix: The fix.
    """
    hyp = belief.hyp[top]
    if hyp.edge == OFF_ROAD or hyp.weight < _LEAST or belief.state[0].count >= CAPACITY:
        return False
    if _may_be_biased(belief.state[0], ctx.par[0], fix.dt):
        return True
    if fix.dt > _LONGEST:
        return False
    track(belief, ctx.roads, top)
    tx, ty = hyp.tangent[0], hyp.tangent[1]
    wide = variance_along(hyp, tx, ty, fix.process) + fix.sigma * fix.sigma
    usual = hyp.log_weight - 0.5 * math.log(wide)
    return bool(ctx.work.search.run[0].best_score < usual - _DEARER)


@kernel
def _straight_on(ctx: Context, edge: int) -> int:
    """The edge that most drive on to from the end of an edge, -1: none."""
    roads = ctx.roads
    best = -1
    for t in range(roads.edges[edge].first_turn, roads.edges[edge].end_turn):
        turn = roads.turns[t]
        if turn.rule != 0 or turn.edge == roads.edges[edge].opposite:
            continue
        if best < 0 or turn.prior > roads.turns[best].prior:
            best = t
    return int(roads.turns[best].edge) if best >= 0 else -1


@kernel
def _add_label(search: Search, edge: int, parent: int, length: float) -> int:
    """A label of an edge behind another one, `length` metres on; -1: the table is full."""
    new = int(search.run[0].labels)
    if new >= len(search.label):
        return -1
    label = search.label[new]
    label.edge = edge
    label.parent = parent
    label.length = length
    label.cost = 0.0
    label.time = 0.0
    label.turn = 0.0
    label.against = 0.0
    label.rival = -1
    label.twin = -1
    label.same = -1
    search.run[0].labels = new + 1
    return new


@kernel
def _walk(ctx: Context, edge: int, s: float, metres: float) -> int:
    """The label of the edge on which one is who drives on for some metres, or to the road's end.

    -1: the same edge.
    """
    roads = ctx.roads
    label = -1
    length = float(roads.edges[edge].length) - s
    steps = 0
    while length < metres and steps < _MOST:
        edge = _straight_on(ctx, edge)
        new = _add_label(ctx.work.search, edge, label, length) if edge >= 0 else -1
        if new < 0:
            break
        label = new
        length += float(roads.edges[edge].length)
        steps += 1
    return label


@kernel
def carry(
    belief: Belief, ctx: Context, row: int, label: int, metres: float, fix: SparseFix
) -> None:
    """Move a hypothesis some metres along a route, without a fix.

    Args:
        belief: Its row is changed; the row's tangent is that of its road.
        ctx: The drive's constants; the labels of its search are the route.
        row: The hypothesis.
        label: The edge on which it then is; -1: its own.
        metres: How far.
        fix: The time that it takes.
    """
    hyp = belief.hyp[row]
    tx, ty = hyp.tangent[0], hyp.tangent[1]
    free = usual_speed(ctx.roads, 0.0, 0.0, int(hyp.edge), 0.0)
    edge = ctx.work.search.label[label].edge if label >= 0 else hyp.edge
    length = ctx.work.search.label[label].length if label >= 0 else -hyp.along
    s = min(max(metres - length, 0.0), float(ctx.roads.edges[edge].length))
    variance = variance_along(hyp, tx, ty, fix.process)
    usual = fix.pace * free
    faster = faster_by(fix.driven, usual, hyp.mu[K])
    taken = Transition(length, 0.0, usual, free, s, variance, faster, fix.process.variance, 1.0)
    segment, x, y, ux, uy = locate(ctx.roads, edge, vertex_at(ctx.roads, edge, s), s)
    foot = Foot(s, x, y, ux, uy)
    hyp.segment = segment
    predict_transition(hyp, ctx, taken, foot, math.atan2(ty, tx), fix.process)
    place_on_road(hyp, belief.state[0], ctx, taken, foot, edge)
    forget_leg(hyp.leg)
    hyp.edge = edge
    hyp.before = NO_EDGE
    hyp.p_not_passed = 1.0
    hyp.bound = NO_BOUND
    hyp.travel_variance = max(variance - hyp.along_sigma**2, 1.0)
    hyp.along = s


@kernel
def _note_origin(belief: Belief, row: int, fix: SparseFix) -> None:
    """Note where a hypothesis is, and when it was there."""
    hyp = belief.hyp[row]
    cov = hyp.cov
    tx, ty = hyp.tangent[0], hyp.tangent[1]
    origin = hyp.origin
    origin.ignored = belief.state[0].time
    origin.since = belief.state[0].time - fix.dt
    origin.along = hyp.along
    origin.variance = hyp.along_sigma**2
    origin.rate = hyp.mu[K]
    origin.rate_variance = cov[K, K]
    origin.cross = tx * (cov[X, K] + cov[MX, K]) + ty * (cov[Y, K] + cov[MY, K])
    origin.driven[0], origin.driven[1] = fix.driven.metres, fix.driven.variance
    origin.edge = hyp.edge
    origin.entries = 0
    origin.waits = 1


@kernel
def drive_on(belief: Belief, path: Path, ctx: Context, top: int, fix: SparseFix) -> None:
    """Append a child of a hypothesis that drives on along its road, and ignores the fix.

    Args:
        belief: Normalised; one hypothesis longer afterwards.
        path: The tree of edges entered.
        ctx: The drive's constants.
        top: The hypothesis.
        fix: The fix that is ignored.
    """
    state = belief.state[0]
    track(belief, ctx.roads, top)
    begin = int(belief.hyp[top].edge)
    usual = usual_speed(ctx.roads, 0.0, 0.0, begin, 0.0)
    metres = max(distance_of(fix.driven, fix.pace * usual, belief.hyp[top].mu[K]), 0.0)
    label = _walk(ctx, begin, belief.hyp[top].along, metres)
    child = int(state.count)
    move_row(belief, top, child)
    hyp = belief.hyp[child]
    biased = _may_be_biased(state, ctx.par[0], fix.dt)
    if not biased:
        _note_origin(belief, child, fix)
    carry(belief, ctx, child, label, metres, fix)
    hyp.ignores = BIASED if biased else WRONG
    if label >= 0:
        hyp.new_edge = 1
        search = ctx.work.search
        drive = Drive(state.time - fix.dt, fix.dt, metres, 1.0)
        enter_route(hyp, path, search, label, drive)
        up = label
        while up >= 0:
            hyp.origin.entries += 1
            up = int(search.label[up].parent)
    state.count = child + 1
