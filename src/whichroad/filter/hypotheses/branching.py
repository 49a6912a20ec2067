"""Hypotheses branch along the road graph: the paper's switch S_k.

The paper redraws its candidates from scratch within 30 m of every estimate and does
not define the transition B(i, j).  Here a hypothesis moves along the road graph: it stays
on its edge with the probability that it has not passed the end, and gives the rest to
the edges that follow, by turn prior times the mass that lies on them.

Its Gaussian stays as it is: one with the moments of what is left would reach beyond the end again,
and a node passed in ten steps would be passed otherwise than in one.  Without a heading sensor
`bound` tells from which abscissa on it was passed on, and what is passed on is truncated.
"""

import math

from ..._compile import Record, kernel
from ...graph.geometry import project
from ...graph.network import onwards
from ..gaussian import normal_cdf, reshape_on_map, truncated_moments
from ..road import track
from ..state import (
    CAPACITY,
    GRACE,
    MX,
    MY,
    NO_BOUND,
    NO_EDGE,
    OFF_ROAD,
    RARE,
    RARE_FLOOR,
    WHEELS,
    Belief,
    Context,
    D,
    H,
    Path,
    X,
    Y,
    enter,
    floor_of,
    lane_mean,
    lane_sigma,
    rescale,
    spawn,
)
from .backing import LEAST_SHARE, back_up
from .corners import BEFORE, list_corners, turned_before_end
from .lane_offset import change_lane, redraw_lane
from .no_sign import own_arc
from .successors import REACH, p_drives_on, successors

BRANCH_THRESHOLD = 1e-3  # P(past an edge's end) from which on a hypothesis branches
_WHOLE = 6.0  # sigma
_MOSTLY = 0.5  # share of a hypothesis beyond the end that branches, however light it is
_TENTH = 0.1  # and where fixes are so frequent that it passes by decimetres
OFFSET = 0  # scratch of a child: abscissa of its edge's start, from the parent's, m
_LEAST_CHILD = 0.1  # of the pruning floor: least weight of a child, with wheels


@kernel
def _spawn_on(belief: Belief, path: Path, ctx: Context, i: int, d: int, share: float) -> int:
    """Spawn a child of i on successor d, with its share of the weight; returns its row."""
    parent = belief.hyp[i]
    found = ctx.work.successor
    edge = found[d].edge
    row = spawn(belief, i, share, edge, ctx.roads.edges[edge].first_vertex)
    child = belief.hyp[row]
    up = found[d].parent
    child.before = parent.edge if up < 0 else found[up].edge
    if up >= 0 and parent.path_entry >= 0:  # edges that it crossed within this step
        chain = 0
        while up >= 0:
            chain += 1
            up = found[up].parent
        for back in range(chain, 0, -1):
            up = found[d].parent
            for _ in range(back - 1):
                up = found[up].parent
            child.path_entry = enter(
                path, found[up].edge, child.path_entry, belief.state[0].time, 0.0
            )
    take_lane(belief, ctx, row, parent.edge, found[d].turn)
    return row


@kernel(inline=True)
def take_lane(belief: Belief, ctx: Context, i: int, before: int, turn: float) -> None:
    """Redraw the lane of hypothesis i, which has just left an edge with a turn."""
    hyp = belief.hyp[i]
    old, new, sigma = lane_mean(ctx, before), lane_mean(ctx, hyp.edge), lane_sigma(ctx, hyp.edge)
    if belief.state[0].mode == WHEELS or belief.state[0].weaves == 1:
        redraw_lane(hyp.mu, hyp.cov, turn, old, new, sigma)
        if belief.state[0].mode != WHEELS:
            hyp.cov[D, D] += (new - old) ** 2
        return
    x = hyp.mu[X] + belief.state[0].scale * hyp.mu[MX]
    y = hyp.mu[Y] + belief.state[0].scale * hyp.mu[MY]
    _, _, _, tx, ty = project(ctx.roads, before, ctx.roads.edges[before].last_vertex - 1, x, y)
    change_lane(hyp.mu, hyp.cov, turn, (old, new, sigma), (tx, ty), belief.state[0].scale)


@kernel
def share_beyond(belief: Belief, ctx: Context, hyp: Record, now: float, threshold: float) -> float:
    """Share of a hypothesis that has passed its edge's end since it was last evaluated.

        1 − Φ((L − s₁)/σ₁) / Φ((L − s₀)/σ₀), at least 0

    with s₀ when last evaluated: a standing car passes nothing on.  Where there is a bound, b, the
    denominator is Φ((b − s₁)/σ₁).  0 where that is below the pruning floor, or the table is full.
    """
    share = 1.0 - min(1.0, now / max(hyp.p_not_passed, 1e-6))
    p = hyp.weight
    enough = share * p >= floor_of(hyp, LEAST_SHARE * ctx.par[0].prune)
    least = _TENTH if belief.state[0].weaves == 1 else min(threshold / p, _MOSTLY)
    enough = enough and share >= least
    return share if enough and belief.state[0].count < CAPACITY else 0.0


@kernel
def own_all(hyp: Record, length: float) -> None:
    """Note that all of a hypothesis is on its edge, once it has an abscissa."""
    hyp.bound = length
    hyp.p_not_passed = p_within(hyp)


@kernel
def p_within(hyp: Record) -> float:
    """P(a tracked hypothesis' Gaussian is before its bound)."""
    z = (hyp.bound - hyp.along) / hyp.along_sigma
    return 1.0 if z > _WHOLE else max(normal_cdf(z), 1e-6)


@kernel
def _weigh_rest(hyp: Record) -> None:
    """Weigh a tracked hypothesis by what was observed, as its Gaussian ends at its bound.

    An observation has weighed the whole Gaussian.  Before the bound b its likelihood is as large
    times Φ((b − s₁)/σ₁) / Φ((b − s₀)/σ₀).
    """
    now = p_within(hyp)
    if now < 1.0 or hyp.p_not_passed < 1.0:
        rescale(hyp, now / hyp.p_not_passed)
        hyp.p_not_passed = now


@kernel(inline=True)
def run_on(belief: Belief, path: Path, ctx: Context, i: int, s: float) -> tuple[int, float]:
    """Move hypothesis i on, as a whole, where its road just runs on beyond a node.

    Nothing is decided there, so that its Gaussian is not cut.

    Args:
        belief: Its edge and lane are set.
        path: Edges that it passes are entered.
        ctx: The drive's constants.
        i: The hypothesis.
        s: Its abscissa, m.

    Returns:
        The edge on which the road runs on from there, -1: none; and the abscissa.
    """
    hyp = belief.hyp[i]
    after = -1
    if s + REACH * hyp.along_sigma > ctx.roads.edges[hyp.edge].length:
        after = onwards(ctx.roads, hyp.edge)
    while after >= 0 and s > ctx.roads.edges[hyp.edge].length:
        if hyp.new_edge == 1:
            hyp.path_entry = enter(path, hyp.edge, hyp.path_entry, belief.state[0].time, 0.0)
        s -= ctx.roads.edges[hyp.edge].length
        before = hyp.edge
        hyp.edge = after
        hyp.before = before
        take_lane(belief, ctx, i, before, 0.0)
        hyp.segment = ctx.roads.edges[after].first_vertex
        hyp.new_edge = 1
        hyp.p_not_passed = 1.0
        hyp.bound = NO_BOUND
        after = onwards(ctx.roads, after)
    return after, s


@kernel(inline=True)
def _pass_end(belief: Belief, path: Path, ctx: Context, i: int, share: float) -> float:
    """Give a share of hypothesis i, as it stands, to what follows; returns what was given."""
    hyp = belief.hyp[i]
    s, sigma, tx, ty = hyp.along, hyp.along_sigma, hyp.tangent[0], hyp.tangent[1]
    first = int(belief.state[0].count)
    given = pass_on(belief, path, ctx, i, s, sigma, share, _LEAST_CHILD * ctx.par[0].prune)
    for row in range(first, belief.state[0].count):
        child = belief.hyp[row]
        if child.edge != OFF_ROAD:
            length = ctx.roads.edges[child.edge].length
            if belief.state[0].mode != WHEELS:
                low = child.scratch[OFFSET]
                at, variance = truncated_moments(s, sigma, low, min(low + length, hyp.bound))
                shrink = variance / (sigma * sigma)
                reshape_on_map(child.mu, child.cov, tx, ty, at - s, shrink, belief.state[0].scale)
            track(belief, ctx.roads, row)
            if not (belief.state[0].knows_heading or belief.state[0].weaves == 1):  # the road's
                child.mu[H] = math.atan2(child.tangent[1], child.tangent[0])
            if belief.state[0].mode == WHEELS:
                left = length - (s - child.scratch[OFFSET])
                child.p_not_passed = max(normal_cdf(left / child.along_sigma), 1e-6)
            else:
                own_all(child, length)
    return float(given)


@kernel(inline=True)
def _round_corner(belief: Belief, path: Path, ctx: Context, i: int, arc: float) -> bool:
    """Let hypothesis i, which turns before its road's end, be on the roads that turn so.

    Once, and beside wheels.  Returns whether there are such.
    """
    hyp = belief.hyp[i]
    if belief.state[0].mode != WHEELS or arc <= 0.0:
        return False
    if hyp.along + BEFORE < ctx.roads.edges[hyp.edge].length:
        return False
    turned = turned_before_end(hyp)
    if turned == 0.0:
        return False
    hyp.corner = NO_EDGE
    count = list_corners(belief, ctx, i, turned)
    first = int(belief.state[0].count)
    given = _give(belief, path, ctx, i, count, 1.0, _LEAST_CHILD * ctx.par[0].prune)
    for row in range(first, belief.state[0].count):
        child = belief.hyp[row]
        track(belief, ctx.roads, row)
        left = ctx.roads.edges[child.edge].length - child.along
        child.p_not_passed = max(normal_cdf(left / child.along_sigma), 1e-6)
    rescale(hyp, 1.0 - given)
    return given > 0.0


@kernel(inline=True)
def branch(belief: Belief, path: Path, ctx: Context, arc: float, threshold: float) -> bool:
    """Give the part of every hypothesis that has passed its edge's end to what follows.

    In reverse the part that passed the start goes to the edges before.

    Args:
        belief: In place; children are appended.
        path: The tree of edges entered.
        ctx: The drive's constants.
        arc: Distance moved in this step, m; its sign tells the direction.
        threshold: Weight past an end, or most of the hypothesis, from which on it branches.

    Returns:
        Whether anything branched.
    """
    changed = False
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            continue
        track(belief, ctx.roads, i)
        own = own_arc(hyp, arc)
        if belief.state[0].mode != WHEELS:
            _weigh_rest(hyp)
        if own < 0.0 and hyp.along < REACH * hyp.along_sigma:
            changed = back_up(belief, ctx, i, -own) or changed
        length = ctx.roads.edges[hyp.edge].length
        changed = _round_corner(belief, path, ctx, i, own) or changed
        if hyp.along + REACH * hyp.along_sigma < length:
            if belief.state[0].mode == WHEELS:
                hyp.p_not_passed = 1.0
            continue
        now = normal_cdf((length - hyp.along) / hyp.along_sigma)
        if own < 0.0:
            hyp.p_not_passed = now
            continue
        if belief.state[0].mode != WHEELS:
            edge = hyp.edge
            after, _ = run_on(belief, path, ctx, i, hyp.along)
            if hyp.edge != edge:
                changed = True
                track(belief, ctx.roads, i)
            length = ctx.roads.edges[hyp.edge].length
            if after >= 0 or hyp.along + REACH * hyp.along_sigma < length:
                continue
            now = normal_cdf((length - hyp.along) / hyp.along_sigma)
        share = share_beyond(belief, ctx, hyp, now, threshold)
        if share == 0.0:
            hyp.p_not_passed = max(hyp.p_not_passed, now)
            continue
        changed = True
        given = _pass_end(belief, path, ctx, i, share)
        hyp.p_not_passed, hyp.bound = now, length
        rescale(hyp, 1.0 - given)
    return changed


@kernel(inline=True)
def pass_on(
    belief: Belief, path: Path, ctx: Context, i: int, s: float, sigma: float, share: float,
    least: float,
) -> float:  # fmt: skip
    """Spawn children of hypothesis i on the edges that follow.

    Each child's scratch holds the abscissa of its edge's start, from the start of i's edge.

    Args:
        belief: In place; children are appended.
        path: The tree of edges entered.
        ctx: The drive's constants.
        i: The hypothesis.
        s: Its abscissa now, beyond its edge's end, m.
        sigma: m.
        share: Share of its weight that has left.
        least: Weight below which there is no child.

    Returns:
        The share that the children got; what is below the limit, or finds the table full, stays.
    """
    hyp = belief.hyp[i]
    bound = NO_BOUND if belief.state[0].mode == WHEELS else hyp.bound
    count, total = successors(belief, ctx, i, s, sigma, share * hyp.weight, bound)
    if total <= 0.0:  # the map's border, or a one-way trap: what leaves is off road
        spawn(belief, i, share, OFF_ROAD, hyp.segment)
        return share
    on = share * p_drives_on(belief, ctx, hyp)
    if on * hyp.weight < least or belief.state[0].count >= CAPACITY:
        return _give(belief, path, ctx, i, count, share / total, least)
    spawn(belief, i, on, OFF_ROAD, hyp.segment)
    return on + _give(belief, path, ctx, i, count, (share - on) / total, least)


@kernel
def _give(
    belief: Belief, path: Path, ctx: Context, i: int, count: int, each: float, least: float
) -> float:
    """Spawn children of hypothesis i on the successors listed; returns the share that they got.

    Args:
        belief: In place.
        path: The tree of edges entered.
        ctx: Its buffer of successors is filled.
        i: The hypothesis.
        count: How many.
        each: Share of the hypothesis per unit of a successor's mass.
        least: Weight below which there is no child.
    """
    hyp = belief.hyp[i]
    p = hyp.weight
    given = 0.0
    for d in range(count):
        part = each * ctx.work.successor[d].mass
        rare = ctx.work.successor[d].prior < RARE
        lowest = RARE_FLOOR * least if rare else floor_of(hyp, least)
        if part <= 0.0 or part * p < lowest or belief.state[0].count >= CAPACITY:
            continue
        given += part
        child = belief.hyp[_spawn_on(belief, path, ctx, i, d, part)]
        if rare:
            child.grace = GRACE
        child.scratch[OFFSET] = ctx.work.successor[d].offset
    return given
