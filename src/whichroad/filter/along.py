"""Motion along the roads, for vehicles without a heading sensor: the road gives the turn."""

import math
from typing import NamedTuple

from .._compile import Record, kernel
from ..graph.geometry import angle_of, is_straight, locate, turn_within, wrap
from ..graph.network import backwards, is_at_node
from ._simd import add_times
from .gaussian import normal_cdf, reshape_along, reshape_on_map, truncated_moments
from .hypotheses.backing import LEAST_SHARE, back_up, run_back
from .hypotheses.branching import (
    BRANCH_THRESHOLD,
    OFFSET,
    own_all,
    p_within,
    pass_on,
    run_on,
    share_beyond,
)
from .hypotheses.no_sign import own_arc
from .hypotheses.successors import REACH
from .motion import ACROSS, Increment, Noise, add_across, predict_plane, predict_road, turn_by_road
from .road import track
from .slow_states import decay
from .state import (
    CLOCK,
    MX,
    MY,
    NO_BOUND,
    OFF_ROAD,
    Belief,
    Context,
    D,
    H,
    K,
    N,
    Path,
    X,
    Y,
    redraw,
    rescale,
)
from .weaving import (
    WOBBLE,
    as_on_roads,
    renew_about_road,
    turn_by_heading,
    weave,
)

CORNER = 0.15  # rad in one step; less is a bend that the map has drawn round
CORNER_RADIUS = 15.0  # m
_CORNER_SIGMA = 3.0  # m/rad, of the distance driven in a corner
_CORNERED = 0.3  # rad of the road's turn, over which a heading about it lasts
_REDRAWN = 0.03  # of it, below which nothing is kept
_FULL_TURN = 1.6  # rad, cap of a corner
_SPENT = 1e-5  # P(before the bound) below which a Gaussian is cut there
_FORWARD_EVERY = 0.95  # s between truncations of the speed
_REVERSE = -0.5  # m/s, lowest speed without odometry


class Advance(NamedTuple):
    """Where a hypothesis that follows its road comes to lie."""

    odometer: float  # δ, odometer metres, or seconds where κ is a speed
    s: float  # abscissa from the start of its edge, m
    sigma: float  # m
    lateral: float  # offset from the road before, m
    tx: float  # tangent before
    ty: float
    begin: float  # abscissa from which on the road's turn on this edge is the vehicle's, m


@kernel(inline=True)
def _about_road(ctx: Context, edge: int, segment: int, s: float) -> float:
    """Variance of the vehicle's heading about its road's, rad², more in bends and about nodes."""
    par = ctx.par[0]
    roads = ctx.roads
    variance = par.edge_heading_sigma**2
    if not is_straight(roads, edge):
        _, _, _, ax, ay = locate(roads, edge, segment, s - 4.0)
        _, _, _, bx, by = locate(roads, edge, segment, s + 4.0)
        variance += (0.5 * (ax * by - ay * bx)) ** 2
    if is_at_node(roads, edge, s, par.node_radius):
        variance += par.node_heading_sigma**2
    return float(variance)


@kernel
def corner_variance(bent: float) -> float:
    """Variance of the distance driven where the road turns by so many rad, m²."""
    return (_CORNER_SIGMA * bent) ** 2


@kernel
def keep_about(about: float, way: float, bent: float) -> tuple[float, float]:
    """What is kept of a heading about its road's over a way (m) on which the road turns (rad).

    Returns:
        φ, and the derivative of φ times the heading by the way, rad/m.
    """
    keep = math.exp(-abs(way) / WOBBLE - bent / _CORNERED)
    return keep, -math.copysign(keep / WOBBLE, way) * about


@kernel(inline=True)
def _wobble(
    hyp: Record, state: Record, odometer: float, turn: float, tangent: tuple[float, float]
) -> None:
    """One Gauss-Markov step of a heading about its road's, which has turned to a tangent.

    Nothing renews it where the vehicle stands, and it varies alike for all hypotheses: an antenna
    ahead of M moves with it, and who expects more of that pays for it with every fix.
    """
    mean, cov = hyp.mu, hyp.cov
    heading = math.atan2(tangent[1], tangent[0])
    about = wrap(mean[H] - heading + turn)
    bent = 0.0 if state.weaves == 1 else min(abs(turn), _FULL_TURN)
    keep, rate = keep_about(about, odometer * mean[K], bent)
    if (state.mode != CLOCK and state.weaves == 0) or keep < _REDRAWN:
        redraw(hyp, H, heading, state.about_road[0])
        return
    mean[H] = heading + about
    decay(mean, cov, H, heading, keep, state.about_road[0])
    mean[H] = wrap(mean[H])
    add_times(cov[H], rate * odometer, cov[K])
    for j in range(N):
        cov[j, H] = cov[H, j]
    cov[H, H] += rate * odometer * cov[H, K]


@kernel(inline=True)
def _move_to(
    belief: Belief, ctx: Context, i: int, to: Advance, noise: Noise, low: float, high: float
) -> None:
    """Put hypothesis i at an abscissa of its edge, truncated to [low, high], by its road's shape.

    In bends and about junctions the vehicle's heading is on its way from one to the other.
    """
    hyp = belief.hyp[i]
    roads = ctx.roads
    edge = hyp.edge
    at, variance = truncated_moments(to.s, to.sigma, low, high)
    shift = at - to.s
    shrink = variance / (to.sigma * to.sigma)
    segment, cx, cy, nx, ny = locate(roads, edge, hyp.segment, at)
    knows = belief.state[0].knows_heading
    turn = angle_of(to.tx * nx + to.ty * ny, to.tx * ny - to.ty * nx)
    bent = min(abs(turn), _FULL_TURN)
    free = belief.state[0].weaves == 1
    if free:
        turn_by_heading(hyp, (to.tx, to.ty), to.odometer, belief.state[0].about_road[0])
        if bent > CORNER:
            _move_on(belief, ctx, i, to, noise, (shift, shrink))
            return
    elif bent > CORNER:  # a corner on the map is an arc on the ground, and shorter
        at += math.copysign(CORNER_RADIUS * (2.0 * math.tan(0.5 * bent) - bent), to.odometer)
        segment, cx, cy, nx, ny = locate(roads, edge, segment, at)
    corner = 0.0 if free else corner_variance(bent)
    variance += corner
    mean = hyp.mu
    cov = hyp.cov
    q = Noise(noise.along + corner, 0.0, 0.0, noise.rate, 0.0, noise.cross)
    if knows:
        turn_by_road(mean, cov, turn_within(roads, edge, segment, to.begin, at), noise.heading)
    else:
        _wobble(hyp, belief.state[0], to.odometer, turn, (nx, ny))
        belief.state[0].about_road[1] += hyp.weight * _about_road(ctx, edge, segment, at)
    predict_road(cov, to.odometer, turn, nx, ny, q)
    add_across(cov, ACROSS * abs(to.odometer * mean[K]), nx, ny)
    scale = belief.state[0].scale
    if shrink < 0.9999:
        reshape_on_map(mean, cov, nx, ny, shift, shrink, scale)
    mean[X] = cx + scale * (to.lateral * ny - mean[MX])
    mean[Y] = cy + scale * (-to.lateral * nx - mean[MY])
    hyp.segment = segment
    hyp.stood = 0.0
    hyp.along = at
    hyp.along_sigma = math.sqrt(variance)


@kernel(inline=True)
def _move_on(
    belief: Belief, ctx: Context, i: int, to: Advance, noise: Noise,
    truncated: tuple[float, float],
) -> None:  # fmt: skip
    """Move hypothesis i by its heading where its road turns a corner, and find it on its edge.

    Args:
        belief: Its covariance holds what the heading does.
        ctx: The drive's constants.
        i: The hypothesis.
        to: Where it comes to lie.
        noise: Process noise.
        truncated: Shift of its abscissa, m, and share of the variance that is left.
    """
    hyp = belief.hyp[i]
    state = belief.state[0]
    mean, cov = hyp.mu, hyp.cov
    tx, ty = to.tx, to.ty
    way = weave(hyp.mu, (tx, ty), to.odometer)
    mean[X] += state.scale * (way.ahead * tx - way.aside * ty)
    mean[Y] += state.scale * (way.ahead * ty + way.aside * tx)
    metres = to.odometer * mean[K]
    _wobble(hyp, state, to.odometer, 0.0, (tx, ty))
    predict_road(cov, to.odometer, 0.0, tx, ty, noise)
    add_across(cov, ACROSS * abs(metres), tx, ty)
    if truncated[1] < 0.9999:
        reshape_on_map(mean, cov, tx, ty, truncated[0], truncated[1], state.scale)
    track(belief, ctx.roads, i)
    hyp.stood = 0.0
    state.about_road[1] += hyp.weight * _about_road(ctx, hyp.edge, hyp.segment, hyp.along)


@kernel(inline=True)
def _pass_beyond(
    belief: Belief, path: Path, ctx: Context, i: int, share: float, to: Advance, noise: Noise
) -> None:
    """Move the share of hypothesis i that is beyond its edge's end to the edges that follow."""
    hyp = belief.hyp[i]
    first = int(belief.state[0].count)
    least = LEAST_SHARE * ctx.par[0].prune
    given = pass_on(belief, path, ctx, i, to.s, to.sigma, share, least)
    for row in range(first, belief.state[0].count):
        child = belief.hyp[row]
        if child.edge != OFF_ROAD:
            moved = 0.0 if belief.state[0].weaves == 1 else child.mu[D] - hyp.mu[D]
            beside = to.lateral + moved
            ahead = Advance(
                to.odometer, to.s - child.scratch[OFFSET], to.sigma, beside, to.tx, to.ty, 0.0
            )
            length = ctx.roads.edges[child.edge].length
            end = min(length, hyp.bound - child.scratch[OFFSET])
            _move_to(belief, ctx, row, ahead, noise, 0.0, end)
            own_all(child, length)
    rescale(hyp, 1.0 - given)


@kernel(inline=True)
def _move_straight(belief: Belief, odometer: float, noise: Noise) -> None:
    """Move the hypotheses off the roads."""
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            own = own_arc(hyp, odometer)
            move = Increment(own, 0.0, own, 0.0, own)
            q = as_on_roads(belief.state[0], noise, abs(own * hyp.mu[K]))
            predict_plane(hyp.mu, hyp.cov, move, belief.state[0].scale, q)


@kernel
def _place_ahead(state: Record, hyp: Record, own: float) -> tuple[float, float]:
    """Abscissa of a tracked hypothesis behind an increment, and its offset from the road, m."""
    if state.weaves == 0:
        return hyp.along + own * hyp.mu[K], float(hyp.lateral)
    way = weave(hyp.mu, (hyp.tangent[0], hyp.tangent[1]), own)
    return hyp.along + way.ahead, hyp.lateral - way.aside


@kernel
def _sigma_ahead(hyp: Record, own: float, noise: float) -> float:
    """Sigma of a tracked hypothesis' abscissa behind an increment, m."""
    cov = hyp.cov
    tx, ty = hyp.tangent[0], hyp.tangent[1]
    cross = tx * (cov[X, K] + cov[MX, K]) + ty * (cov[Y, K] + cov[MY, K])
    variance = hyp.along_sigma**2 + own * (2.0 * cross + own * cov[K, K])
    return math.sqrt(max(variance + noise, 1e-4))


@kernel
def _move_back(
    belief: Belief, path: Path, ctx: Context, i: int, to: Advance, noise: Noise
) -> bool:  # fmt: skip
    """Move hypothesis i, which backs up; returns whether anything branched."""
    hyp = belief.hyp[i]
    edge, begin = hyp.edge, to.begin
    s = run_back(belief, path, ctx, i, to.s)
    if hyp.edge != edge:
        begin = ctx.roads.edges[hyp.edge].length
    to = Advance(to.odometer, s, to.sigma, to.lateral, to.tx, to.ty, begin)
    _move_to(belief, ctx, i, to, noise, -NO_BOUND, NO_BOUND)
    hyp.bound += hyp.along - s
    hyp.p_not_passed = p_within(hyp)
    if hyp.along > REACH * hyp.along_sigma or backwards(ctx.roads, hyp.edge) >= 0:
        return bool(hyp.edge != edge)
    track(belief, ctx.roads, i)
    return back_up(belief, ctx, i, abs(to.odometer)) or hyp.edge != edge


@kernel(inline=True)
def advance_along(belief: Belief, path: Path, ctx: Context, odometer: float, noise: Noise) -> bool:
    """Move the hypotheses on roads by κ δ along them, branching where roads branch.

    For vehicles without a heading sensor: the turn is that of the road, about which the heading
    varies.  Where a course was heard a moment ago, the heading turns with the road within an edge,
    and walks at random as off the roads; at nodes the courses tell it.  Off the roads vehicles
    move straight on.

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
    renew_about_road(belief, ctx.par[0], odometer)
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            continue
        track(belief, ctx.roads, i)
        tx, ty = hyp.tangent[0], hyp.tangent[1]
        begin, edge, lane = hyp.along, hyp.edge, hyp.mu[D]
        own = own_arc(hyp, odometer)
        s, lateral = _place_ahead(belief.state[0], hyp, own)
        sigma = _sigma_ahead(hyp, own, noise.along)
        hyp.bound = min(s + (hyp.bound - begin) * sigma / hyp.along_sigma, NO_BOUND)
        hyp.along_sigma = sigma
        if own < 0.0:
            to = Advance(own, s, sigma, lateral, tx, ty, begin)
            changed = _move_back(belief, path, ctx, i, to, noise) or changed
            continue
        after, s = run_on(belief, path, ctx, i, s)
        if hyp.edge != edge:
            changed = True
            begin = 0.0
            lateral += 0.0 if belief.state[0].weaves == 1 else hyp.mu[D] - lane
        length = ctx.roads.edges[hyp.edge].length
        hyp.along = s
        hyp.p_not_passed = now = p_within(hyp)
        if after < 0 and s + 6.0 * sigma > length:
            now = min(normal_cdf((length - s) / sigma), now)
        share = float(share_beyond(belief, ctx, hyp, now, BRANCH_THRESHOLD))
        to = Advance(own, s, sigma, lateral, tx, ty, begin)
        if share > 0.0:
            changed = True
            _pass_beyond(belief, path, ctx, i, share, to, noise)
            hyp.bound = length
        spent = hyp.p_not_passed < _SPENT  # nothing else fits, and it is still before its bound
        _move_to(belief, ctx, i, to, noise, -NO_BOUND, hyp.bound if spent else NO_BOUND)
        hyp.bound += 0.0 if spent else hyp.along - s
        hyp.p_not_passed = p_within(hyp)
    _move_straight(belief, odometer, noise)
    return changed


@kernel(inline=True)
def forward_only(belief: Belief, ctx: Context) -> bool:
    """Without odometry a vehicle drives forwards.

    Where the mean speed is below −0.5 m/s, the speed is truncated to what is above, and the
    hypothesis weighed by how much that was, once a second.  The Gaussian of a vehicle that stands
    reaches below that too, and stays: truncated again and again it would creep on.  Off the roads
    a negative speed first becomes the opposite heading.

    Returns:
        Whether any weight was changed; weights are yet to be normalised.
    """
    row = ctx.work.row
    state = belief.state[0]
    due = state.time - state.forward_time >= _FORWARD_EVERY
    if due:
        state.forward_time = state.time
    weighed = False
    for i in range(state.count):
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
        if not due or z >= 0.0:
            continue
        weighed = True
        rescale(hyp, max(2.0 * normal_cdf(z), 1e-12))
        speed, variance = truncated_moments(mean[K], sigma, _REVERSE, 1e9)
        for j in range(N):
            row[j] = 0.0
        row[K] = 1.0
        reshape_along(mean, cov, row, speed - mean[K], variance / (sigma * sigma), state.scale)
    return weighed
