"""Hypotheses branch along the road graph: the paper's switch S_k.

The paper redraws its candidates from scratch within 30 m of every estimate and does
not define the transition B(i, j).  Here a hypothesis moves along the road graph: it stays
on its edge with the probability that it has not passed the end, and gives the rest to
the edges that follow, by turn prior times the mass that lies on them.
"""

import math
from typing import NamedTuple

from .._compile import Record, kernel
from ..graph.geometry import angle_of, is_straight, locate, wrap
from ..graph.network import Roads
from .gaussian import normal_cdf, reshape_along, reshape_on_map, truncated_moments
from .motion import (
    Increment,
    Noise,
    add_across,
    predict_plane,
    predict_road,
    redraw_lane,
)
from .road import track
from .state import (
    CAPACITY,
    GRACE,
    MX,
    MY,
    OFF_ROAD,
    RARE,
    RARE_FLOOR,
    SUCCESSORS,
    WHEELS,
    Belief,
    Context,
    H,
    K,
    N,
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

BRANCH_THRESHOLD = 1e-3  # P(past an edge's end) from which on a hypothesis branches
_REACH = 3.5  # sigma of the abscissa beyond which mass is neglected
_MOSTLY = 0.5  # share of a hypothesis beyond the end that branches, however light it is
_LEAST = 0.3  # of the pruning floor: weight of what branches
_OFFSET = 0  # scratch of a child: abscissa of its edge's start, from the parent's, m
_LEAST_CHILD = 0.1  # of the pruning floor: least weight of a child, with wheels

CORNER = 0.15  # rad in one step; less is a bend that the map has drawn round
CORNER_RADIUS = 15.0  # m
CORNER_SIGMA = 3.0  # m/rad, of the distance driven in a corner
ACROSS = 0.015  # m²/m across the road; vehicles do not follow the map's line exactly
_FULL_TURN = 1.6  # rad, cap of a corner
_REVERSE = -0.5  # m/s, lowest speed without odometry


@kernel
def _list_successors(
    roads: Roads, ctx: Context, edge: int, s: float, sigma: float, least: float
) -> int:
    """List the edges on which a vehicle that left `edge` may be.

    Breadth first over the successors; an edge's mass is its turn priors' product times
    the Gaussian mass of the abscissa on it.

    Args:
        roads: The network.
        ctx: Its buffer of successors is filled.
        edge: The origin.
        s: Mean abscissa, from the origin's start, m.
        sigma: Its standard deviation, m.
        least: Priors below this are not followed.

    Returns:
        How many.
    """
    found = ctx.work.successor
    count = 0
    end = roads.edges[edge].length
    k = -1
    current = edge
    prior = 1.0
    turn = 0.0
    while True:
        low = normal_cdf((end - s) / sigma)
        for t in range(roads.edges[current].first_turn, roads.edges[current].end_turn):
            p = prior * roads.turns[t].prior
            if p < (least if p >= RARE else RARE_FLOOR * least) or count >= SUCCESSORS:
                continue
            new = found[count]
            new.edge = roads.turns[t].edge
            high = normal_cdf((end + roads.edges[new.edge].length - s) / sigma)
            new.parent = k
            new.offset = end
            new.prior = p
            new.mass = p * (high - low)
            new.turn = turn + roads.turns[t].angle
            count += 1
        k += 1
        while (
            k < count and found[k].offset + roads.edges[found[k].edge].length > s + _REACH * sigma
        ):
            k += 1
        if k >= count:
            return count
        current = found[k].edge
        end = found[k].offset + roads.edges[current].length
        prior = found[k].prior
        turn = found[k].turn


@kernel
def _successors(ctx: Context, edge: int, s: float, sigma: float, share: float) -> tuple[int, float]:
    """Edges that a share of weight may have passed on to, and the mass on them altogether."""
    prune = ctx.par[0].prune
    least = min(0.1 * prune / max(share, prune), 0.05)
    count = _list_successors(ctx.roads, ctx, edge, s, sigma, least)
    found = ctx.work.successor
    total = 0.0
    for d in range(count):
        total += found[d].mass
    if total <= 1e-12 and count > 0:  # all mass before the end: the nearest edges take it
        total = 0.0
        for d in range(count):
            found[d].mass = found[d].prior if found[d].parent < 0 else 0.0
            total += found[d].mass
    return count, total


@kernel
def _spawn_on(belief: Belief, path: Path, ctx: Context, i: int, d: int, share: float) -> int:
    """Spawn a child of i on successor d, with its share of the weight; returns its row."""
    parent = belief.hyp[i]
    found = ctx.work.successor
    edge = found[d].edge
    row = spawn(belief, i, share, edge, ctx.roads.edges[edge].first_vertex)
    child = belief.hyp[row]
    up = found[d].parent
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
    redraw_lane(
        child.mu, child.cov, found[d].turn, lane_mean(ctx, parent.edge), lane_mean(ctx, edge),
        lane_sigma(ctx, edge),
    )  # fmt: skip
    return row


@kernel
def _share_beyond(belief: Belief, ctx: Context, hyp: Record, now: float, threshold: float) -> float:
    """Share of a hypothesis that has passed its edge's end since it was last evaluated.

        1 − Φ((L − s₁)/σ₁) / Φ((L − s₀)/σ₀), at least 0

    with s₀ when last evaluated: a standing car passes nothing on.  0 where
    that is below the pruning floor, or the table is full.
    """
    share = 1.0 - min(1.0, now / max(hyp.p_not_passed, 1e-6))
    p = hyp.weight
    enough = share * p >= floor_of(hyp, _LEAST * ctx.par[0].prune)
    enough = enough and share >= min(threshold / p, _MOSTLY)
    return share if enough and belief.state[0].count < CAPACITY else 0.0


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
        if arc < 0.0 and hyp.along < _REACH * hyp.along_sigma:
            changed = _back_up(belief, ctx, i, -arc) or changed
        length = ctx.roads.edges[hyp.edge].length
        if hyp.along + _REACH * hyp.along_sigma < length:
            hyp.p_not_passed = 1.0
            continue
        now = normal_cdf((length - hyp.along) / hyp.along_sigma)
        if arc < 0.0:
            hyp.p_not_passed = now
            continue
        share = _share_beyond(belief, ctx, hyp, now, threshold)
        if share == 0.0:
            hyp.p_not_passed = max(hyp.p_not_passed, now)
            continue
        changed = True
        s = hyp.along
        first = int(belief.state[0].count)
        least = _LEAST_CHILD * ctx.par[0].prune
        given = _pass_on(belief, path, ctx, i, s, hyp.along_sigma, share, least)
        for row in range(first, belief.state[0].count):
            child = belief.hyp[row]
            if child.edge != OFF_ROAD:
                _, tx, ty = track(belief, ctx.roads, row)
                if ctx.par[0].mode != WHEELS:  # the heading is the road's
                    child.mu[H] = math.atan2(ty, tx)
                left = ctx.roads.edges[child.edge].length - (s - child.scratch[_OFFSET])
                child.p_not_passed = max(normal_cdf(left / child.along_sigma), 1e-6)
        hyp.p_not_passed = now
        rescale(hyp, 1.0 - given)
    return changed


@kernel(inline=True)
def _pass_on(
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
    p = hyp.weight
    count, total = _successors(ctx, hyp.edge, s, sigma, share * p)
    if total <= 0.0:  # the map's border, or a one-way trap: what leaves is off road
        spawn(belief, i, share, OFF_ROAD, hyp.segment)
        return share
    given = 0.0
    for d in range(count):
        part = share * ctx.work.successor[d].mass / total
        rare = ctx.work.successor[d].prior < RARE
        lowest = RARE_FLOOR * least if rare else floor_of(hyp, least)
        if part * p < lowest or belief.state[0].count >= CAPACITY:
            continue
        given += part
        child = belief.hyp[_spawn_on(belief, path, ctx, i, d, part)]
        if rare:
            child.grace = GRACE
        child.scratch[_OFFSET] = ctx.work.successor[d].offset
    return given


@kernel
def _back_up(belief: Belief, ctx: Context, i: int, arc: float) -> bool:
    """Reversing: the hazard of passing the edge's start goes to its predecessors."""
    hyp = belief.hyp[i]
    road = ctx.roads.edges[hyp.edge]
    count = 0
    for t in range(road.first_predecessor, road.end_predecessor):
        if ctx.roads.predecessors[t] != road.opposite:
            count += 1
    z = hyp.along / hyp.along_sigma
    density = math.exp(-0.5 * z**2) * 0.3989422804014327 / hyp.along_sigma
    share = min(arc * density / max(normal_cdf(z), 0.02), 0.9)
    if count == 0 or share * hyp.weight < _LEAST * ctx.par[0].prune:
        return False
    given = 0.0
    for t in range(road.first_predecessor, road.end_predecessor):
        before = ctx.roads.predecessors[t]
        if before == road.opposite or belief.state[0].count >= CAPACITY:
            continue
        given += share / count
        last = ctx.roads.edges[before].last_vertex - 1
        child = spawn(belief, i, share / count, before, last)
        belief.hyp[child].p_not_passed = 1.0
    rescale(hyp, 1.0 - given)
    return True


class Advance(NamedTuple):
    """Where a hypothesis that follows its road comes to lie."""

    odometer: float  # δ, odometer metres, or seconds where κ is a speed
    s: float  # abscissa from the start of its edge, m
    sigma: float  # m
    lateral: float  # offset from the road before, m
    tx: float  # tangent before
    ty: float


@kernel(inline=True)
def _move_to(
    belief: Belief, ctx: Context, i: int, to: Advance, noise: Noise, low: float, high: float
) -> None:
    """Put hypothesis i at an abscissa of its edge, truncated to [low, high], by its road's shape.

    In bends and about junctions the vehicle's heading is on its way from one to the other.
    """
    hyp = belief.hyp[i]
    roads = ctx.roads
    par = ctx.par[0]
    edge = hyp.edge
    length = roads.edges[edge].length
    at, variance = truncated_moments(to.s, to.sigma, low, high)
    shift = at - to.s
    shrink = variance / (to.sigma * to.sigma)
    segment, cx, cy, nx, ny = locate(roads, edge, hyp.segment, at)
    heading = math.atan2(ny, nx)
    turn = angle_of(to.tx * nx + to.ty * ny, to.tx * ny - to.ty * nx)
    bent = min(abs(turn), _FULL_TURN)
    if bent > CORNER:  # a corner on the map is an arc on the ground, and shorter
        at += CORNER_RADIUS * (2.0 * math.tan(0.5 * bent) - bent)
        segment, cx, cy, nx, ny = locate(roads, edge, segment, at)
    corner = (CORNER_SIGMA * bent) ** 2
    variance += corner
    heading_variance = par.edge_heading_sigma**2
    if not is_straight(roads, edge):
        _, _, _, ax, ay = locate(roads, edge, segment, at - 4.0)
        _, _, _, bx, by = locate(roads, edge, segment, at + 4.0)
        heading_variance += (0.5 * (ax * by - ay * bx)) ** 2
    if min(at, length - at) < par.node_radius:
        heading_variance += par.node_heading_sigma**2
    mean = hyp.mu
    cov = hyp.cov
    q = Noise(noise.along + corner, 0.0, heading_variance, noise.rate, 0.0, noise.cross)
    predict_road(mean, cov, to.odometer, turn, heading, nx, ny, q)
    add_across(cov, ACROSS * abs(to.odometer * mean[K]), nx, ny)
    scale = belief.state[0].scale
    if shrink < 0.9999:
        reshape_on_map(mean, cov, nx, ny, shift, shrink, scale)
    mean[X] = cx + scale * (to.lateral * ny - mean[MX])
    mean[Y] = cy + scale * (-to.lateral * nx - mean[MY])
    hyp.segment = segment
    hyp.along = at
    hyp.along_sigma = math.sqrt(variance)
    z = (length - at) / hyp.along_sigma
    hyp.p_not_passed = 1.0 if z > 6.0 else max(normal_cdf(z), 1e-6)


@kernel(inline=True)
def advance_along(belief: Belief, path: Path, ctx: Context, odometer: float, noise: Noise) -> bool:
    """Move the hypotheses on roads by κ δ along them, branching where roads branch.

    For vehicles without a heading sensor: the turn is that of the road.  Off the roads they move
    straight on.

    Args:
        belief: In place; children are appended.
        path: The tree of edges entered.
        ctx: The drive's constants.
        odometer: δ, odometer metres, or seconds where κ is a speed.
        noise: Process noise.

    Returns:
        Whether anything branched.
    """
    changed = False
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            continue
        lateral, tx, ty = track(belief, ctx.roads, i)
        cov = hyp.cov
        s = hyp.along + odometer * hyp.mu[K]
        cross = tx * (cov[X, K] + cov[MX, K]) + ty * (cov[Y, K] + cov[MY, K])
        variance = hyp.along_sigma**2 + odometer * (2.0 * cross + odometer * cov[K, K])
        sigma = math.sqrt(max(variance + noise.along, 1e-4))
        length = ctx.roads.edges[hyp.edge].length
        now = normal_cdf((length - s) / sigma) if s + 6.0 * sigma > length else 1.0
        share = _share_beyond(belief, ctx, hyp, now, BRANCH_THRESHOLD)
        to = Advance(odometer, s, sigma, lateral, tx, ty)
        end = 1e9
        owed = hyp.p_not_passed
        if share > 0.0:
            owed = 0.0
            changed = True
            first = int(belief.state[0].count)
            least = _LEAST * ctx.par[0].prune
            given = _pass_on(belief, path, ctx, i, s, sigma, share, least)
            for row in range(first, belief.state[0].count):
                child = belief.hyp[row]
                if child.edge != OFF_ROAD:
                    ahead = Advance(odometer, s - child.scratch[_OFFSET], sigma, lateral, tx, ty)
                    end = ctx.roads.edges[child.edge].length
                    _move_to(belief, ctx, row, ahead, noise, 0.0, end)
            rescale(hyp, 1.0 - given)
            end = length
        _move_to(belief, ctx, i, to, noise, -1e9, end)
        hyp.p_not_passed = max(hyp.p_not_passed, owed)
    straight = Increment(odometer, 0.0, odometer, 0.0)
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            predict_plane(hyp.mu, hyp.cov, straight, belief.state[0].scale, noise)
    return changed


@kernel(inline=True)
def forward_only(belief: Belief, ctx: Context) -> bool:
    """Without odometry a vehicle drives forwards.

    The speed is truncated to what is above −0.5 m/s, and the hypothesis weighed by how much
    that was.  Off the roads a negative speed first becomes the opposite heading.

    Returns:
        Whether any weight was changed; weights are yet to be normalised.
    """
    row = ctx.work.row
    weighed = False
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        mean = hyp.mu
        cov = hyp.cov
        if hyp.edge == OFF_ROAD and mean[K] < _REVERSE:
            mean[K] = -mean[K]
            mean[H] = wrap(mean[H] + math.pi)
            for j in range(N):
                cov[K, j] = -cov[K, j]
            for j in range(N):
                cov[j, K] = -cov[j, K]
        sigma = math.sqrt(cov[K, K])
        z = (mean[K] - _REVERSE) / sigma
        if z < 2.5:
            weighed = True
            rescale(hyp, max(min(2.0 * normal_cdf(z), 1.0), 1e-12))
            speed, variance = truncated_moments(mean[K], sigma, _REVERSE, 1e9)
            for j in range(N):
                row[j] = 0.0
            row[K] = 1.0
            reshape_along(
                mean, cov, row, speed - mean[K], variance / (sigma * sigma), belief.state[0].scale
            )
    return weighed
