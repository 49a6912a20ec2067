"""Off the roads between sparse fixes: how a vehicle moves there, leaves the roads and returns."""

import math

from ..._compile import Record, kernel
from ...graph.geometry import locate
from ...graph.index import vertex_at
from ..gaussian import normal_cdf, update_state
from ..motion import Increment, Noise, chord_moments, predict_plane
from ..slow_states import decay
from ..state import (
    CAPACITY,
    MX,
    MY,
    NO_EDGE,
    OFF_ROAD,
    Belief,
    Context,
    D,
    H,
    K,
    X,
    Y,
    lane_mean,
    lane_sigma,
    redraw,
    rescale,
    spawn,
)
from .arrival import HEADING_NOISE, observe_line
from .candidates import SparseFix
from .driven import is_measured, straight_cost
from .driver import SPEED_SIGMA, forget_leg
from .parked import is_parked

_LEAST_SPEED, _MOST_SPEED = 5.0, 70.0  # m/s
_TURNS = 0.09  # rad²/s, random walk of the heading
_ANY_HEADING = 2.5  # rad², variance of one of which nothing is known
_TAIL = 0.3  # least variance of an axis over the square of the way to the fix
_CHORD = 0.15  # sigma of the speed between two fixes over that of the straight line, relative

_BY_CHANCE = 2.0  # nats at most for being beside a road without being on one
_LEAVE = 0.1  # rate of leaving the roads between sparse fixes, over the usual one
_MOST_LEAVE = 0.3  # probability of it
_FOLLOWED = 32.0  # roads that are followed from there; of more, it stands for the rest
_RETURN = 0.5  # probability of returning from off-road to the roads at the next fix
_LEAST = 1e-5  # least weight of a returning hypothesis
_FAR_ABOVE = 3.0  # nats
_ANY_DISTANCE = 1e6  # m², variance of the distance of a vehicle that comes from off-road


@kernel
def _prior_mass(ctx: Context, c: int, sigma: float) -> float:
    """Prior mass of a candidate for a vehicle that comes from off-road."""
    near = ctx.work.near[c]
    edge = ctx.roads.edges[near.edge]
    mass = normal_cdf((edge.length - near.s) / sigma) - normal_cdf(-near.s / sigma)
    if edge.rule:
        mass *= max(ctx.par[0].wrong_way, 1e-6)
    return float(mass)


@kernel(inline=True)
def _learn_speed(hyp: Record, state: Record, fix: SparseFix, straight: float) -> None:
    """The speed by the straight line to the fix, where the heading tells nothing of it."""
    mean = hyp.mu
    jitter = 2.0 * fix.jitter * fix.jitter
    square = ((fix.x - mean[X]) ** 2 + (fix.y - mean[Y]) ** 2) / state.scale**2
    way = math.sqrt(max(square - jitter, 0.0))
    speed = min(way / fix.dt, _MOST_SPEED)
    noise = (_CHORD * speed) ** 2 + 1.0 + jitter / fix.dt**2 * (1.0 + jitter / max(square, 1.0))
    noise /= max(1.0 - straight, 0.01)
    update_state(mean, hyp.cov, K, speed - mean[K], noise, state.scale)


@kernel(inline=True)
def _predict_off_road(hyp: Record, state: Record, fix: SparseFix) -> None:
    """Off the roads any motion towards the fix is possible that a vehicle or a train can make.

    It drives on by its speed and its heading, which walks at random.  Over many seconds nothing
    is left of that, and any direction is as likely.
    """
    mean = hyp.mu
    cov = hyp.cov
    process = fix.driven.free
    walked = max(min(_TURNS * fix.dt, _ANY_HEADING - cov[H, H]), 0.01)
    chord = chord_moments(cov[H, H], walked)
    _learn_speed(hyp, state, fix, chord.mean)
    way = max(mean[K], _LEAST_SPEED) * fix.dt
    more = process.variance + fix.dt * fix.dt * cov[K, K]
    if is_measured(fix.driven):
        way, more = max(fix.driven.metres, _LEAST_SPEED), fix.driven.variance
    square = way * way + more
    forward = chord.mean * fix.dt
    moved = (forward * mean[K]) ** 2
    along = square * chord.along - moved - forward * forward * cov[K, K]
    across = square * chord.across - moved * cov[H, H]
    c, s = math.cos(mean[H]), math.sin(mean[H])
    dx = (fix.x - mean[X]) / state.scale - c * forward * mean[K]
    dy = (fix.y - mean[Y]) / state.scale - s * forward * mean[K]
    off = max(math.hypot(dx, dy) - 2.0 * fix.jitter, 0.0)
    tail = _TAIL * min(off, _MOST_SPEED * fix.dt) ** 2
    least = max(tail, process.variance)
    q = Noise(max(along, least), max(across, least), walked, 0.0, 0.0, 0.0)
    anywhere = max(0.5 * way * way, tail) + process.variance + fix.sigma**2
    seen = math.sqrt((q.along + fix.sigma**2) * (q.across + fix.sigma**2))
    straight = math.hypot(fix.x - mean[X], fix.y - mean[Y]) / state.scale
    hyp.log_weight -= straight_cost(fix.driven, straight, 2.0 * fix.sigma)
    hyp.log_weight -= max(math.log(anywhere / seen), 0.0)  # else who drives straight on gains
    predict_plane(mean, cov, Increment(forward, 0.0, forward, 0.0, 0.0), state.scale, q)
    decay(mean, cov, K, mean[K], process.keep, SPEED_SIGMA * SPEED_SIGMA)
    forget_leg(hyp.leg)
    hyp.stood = 0.0


@kernel(inline=True)
def _return_to_roads(belief: Belief, ctx: Context, i: int, first: int, fix: SparseFix) -> None:
    """Children of an off-road hypothesis on the roads near the fix, in proportion to length.

    A road that a route leads to with far more weight (hypotheses from `first` on) needs none.
    """
    mass = ctx.work.search.goal_mass
    total = 0.0
    for c in range(fix.found):
        mass[c] = _prior_mass(ctx, c, fix.sigma)
        total += mass[c]
    if total <= 0.0:
        return
    hyp = belief.hyp[i]
    back = _RETURN * min(_FOLLOWED / fix.found, 1.0)
    rescale(hyp, 1.0 - back)
    for c in range(fix.found):
        share = back / (1.0 - back) * mass[c] / total
        if hyp.weight * share < _LEAST or belief.state[0].count >= CAPACITY:
            continue
        edge = ctx.work.near[c].edge
        if not _is_reached(belief, first, edge, hyp.log_weight + math.log(share)):
            _return_to(belief, ctx, i, c, share)


@kernel
def _return_to(belief: Belief, ctx: Context, i: int, c: int, share: float) -> None:
    """Append a child of an off-road hypothesis on candidate c."""
    near = ctx.work.near[c]
    edge = near.edge
    scale = belief.state[0].scale
    segment, cx, cy, tx, ty = locate(ctx.roads, edge, vertex_at(ctx.roads, edge, near.s), near.s)
    hyp = belief.hyp[spawn(belief, i, share, edge, segment)]
    mean = hyp.mu
    redraw(hyp, D, lane_mean(ctx, edge), lane_sigma(ctx, edge) ** 2)
    redraw(hyp, H, math.atan2(ty, tx), ctx.par[0].edge_heading_sigma ** 2 + HEADING_NOISE)
    lateral = ty * (mean[X] - cx) / scale - tx * (mean[Y] - cy) / scale
    lateral += ty * mean[MX] - tx * mean[MY]
    observe_line(hyp, ctx, tx, ty, mean[D] - lateral, scale)
    hyp.p_not_passed = 1.0
    hyp.travel_variance = _ANY_DISTANCE


@kernel
def _is_reached(belief: Belief, first: int, edge: int, log_weight: float) -> bool:
    """Whether a hypothesis from `first` on is on an edge with far more than a weight."""
    top = -math.inf
    for j in range(first, belief.state[0].count):
        if belief.hyp[j].edge == edge:
            top = max(top, belief.hyp[j].log_weight)
    return bool(top > log_weight + _FAR_ABOVE)


@kernel(inline=True)
def exchange_off_road(
    belief: Belief, ctx: Context, top: int, n: int, metres: float, fix: SparseFix
) -> None:
    """Off-road hypotheses move and return to the roads; the heaviest, `top`, may leave them."""
    par = ctx.par[0]
    chance = 0.0
    if fix.found > 0 and ctx.work.near[0].distance < 2.0 * fix.sigma:
        chance = min(_BY_CHANCE, par.off_road_cost * metres)
        chance *= 1.0 - belief.state[0].separation.unmapped.haste[0]
    share = min(_LEAVE * par.off_road_leave * (metres + 10.0), _MOST_LEAVE)
    share = max(share, fix.beyond)  # stands for those on roads that are not followed
    leaves = belief.hyp[top].log_weight + math.log(max(share, 1e-300)) - _FAR_ABOVE
    for i in range(n):
        hyp = belief.hyp[i]
        if is_parked(hyp):
            continue
        if hyp.edge == OFF_ROAD:
            if i != top and hyp.weight < _LEAST and hyp.log_weight < leaves:
                hyp.edge = NO_EDGE  # a hypothesis that leaves the roads now is as good
                continue
            _predict_off_road(hyp, belief.state[0], fix)
            hyp.log_weight -= chance
            if fix.found > 0 and hyp.weight > _LEAST:
                _return_to_roads(belief, ctx, i, n, fix)
        elif i == top and belief.state[0].count < CAPACITY:
            child = spawn(belief, i, share, OFF_ROAD, hyp.segment)
            _predict_off_road(belief.hyp[child], belief.state[0], fix)
