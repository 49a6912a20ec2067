"""Sparse transition: from one fix to the next along routes, when they lie far apart in time.

In place of many small steps, each hypothesis is taken along the cheapest routes to the
roads near the new fix, with the distance that its speed allows.  The fix is then observed as
usual, and each Gaussian is truncated to its edge.
"""

import math

from ..._compile import Record, kernel
from ...graph.geometry import locate
from ...graph.index import vertex_at
from ...graph.network import Roads
from ...graph.route_search import set_goals
from ..gaussian import normal_cdf, reshape_on_map, truncated_moments
from ..hypotheses.branching import own_all
from ..lookback.history import History
from ..records import Epoch
from ..road import track
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
    Path,
    X,
    Y,
    heaviest,
    lane_mean,
    lane_sigma,
    move_row,
    redraw,
    rescale,
    spawn,
)
from .arrival import HEADING_NOISE, arrive, observe_line
from .candidates import (
    SparseFix,
    find_candidates,
    fix_of,
)
from .choice import choose_routes
from .driver import SPEED_SIGMA, forget_leg
from .dropped import likelihood_left, note_dropped
from .parked import (
    REST_VARIANCE,
    comes_to_stand,
    goes_on_standing,
    is_parked,
    leave_parking,
    park,
)
from .past_wrong_fix import begin_anew, note_between
from .wrong_fix import drive_on, may_be_wrong

_OFF_ROAD_SPEED, _LEAST_OFF_ROAD_SPEED = 8.0, 5.0  # m/s
_MOST_ARRIVALS = 24  # routes that become hypotheses,
_PARKS = 3  # and of these that may end beside the road

_STANDING = 1e-3  # least weight of a hypothesis of standing
_LEAST_ON_EDGE = 0.3  # divisor of its weight at least

_BY_CHANCE = 2.0  # nats at most for being beside a road without being on one
_LEAVE = 0.1  # rate of leaving the roads between sparse fixes, over the usual one
_MOST_LEAVE = 0.3  # probability of it
_MISSING = 0.1  # P(the map lacks the road) where there is no route to a fix that may be wrong
_RETURN = 0.5  # probability of returning from off-road to the roads at the next fix
_LEAST = 1e-5  # least weight of a returning hypothesis
_FAR_ABOVE = 3.0  # nats
_ANY_DISTANCE = 1e6  # m², variance of the distance of a vehicle that comes from off-road

_STANDS = 30.0  # m of road on which as many vehicles drive as stand before a junction
_QUEUE = 6.0  # m before the junction: mean and sigma of where they stand


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
def _stand(belief: Belief, roads: Roads, i: int, dt: float) -> bool:
    """Append a child of hypothesis i that has stood all the time; the others drove.

    Returns:
        Whether there is one.
    """
    hyp = belief.hyp[i]
    share = goes_on_standing(hyp.stood, dt)
    if hyp.stood == 0.0:
        share *= comes_to_stand(hyp.mu[K], hyp.cov[K, K])
    if hyp.weight * share < _STANDING or belief.state[0].count >= CAPACITY:
        return False
    child = int(belief.state[0].count)
    move_row(belief, i, child)
    rescale(hyp, 1.0 - share)
    on_edge = normal_cdf((roads.edges[hyp.edge].length - hyp.along) / hyp.along_sigma)
    on_edge -= normal_cdf(-hyp.along / hyp.along_sigma)
    new = belief.hyp[child]
    rescale(new, share / max(on_edge, _LEAST_ON_EDGE))  # it was not beyond the edge's ends
    decay(new.mu, new.cov, K, 0.0, 0.0, REST_VARIANCE)
    new.travel_variance = 0.0
    forget_leg(new.leg)
    new.stood = hyp.stood + dt
    belief.state[0].count = child + 1
    return True


@kernel(inline=True)
def _predict_off_road(hyp: Record, fix: SparseFix) -> None:
    """Off the roads any motion towards the fix is possible."""
    mean = hyp.mu
    cov = hyp.cov
    process = fix.process
    reach = max(mean[K], _LEAST_OFF_ROAD_SPEED) * fix.dt
    variance = 0.5 * reach * reach + process.variance
    redraw(hyp, H, math.atan2(fix.y - mean[Y], fix.x - mean[X]), 0.5)
    forget_leg(hyp.leg)
    cov[X, X] += variance
    cov[Y, Y] += variance
    decay(mean, cov, K, _OFF_ROAD_SPEED, process.keep, SPEED_SIGMA * SPEED_SIGMA)
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
    rescale(hyp, 1.0 - _RETURN)
    for c in range(fix.found):
        share = _RETURN / (1.0 - _RETURN) * mass[c] / total
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
    hyp.cov[H, H] = ctx.par[0].edge_heading_sigma ** 2 + HEADING_NOISE
    mean[H] = math.atan2(ty, tx)
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
def _take_best_routes(
    belief: Belief, path: Path, history: History, ctx: Context, fix: SparseFix
) -> int:
    """Append children for the pairs of the largest scores; returns how many."""
    search = ctx.work.search
    whole = likelihood_left(search)
    first = int(belief.state[0].count)
    arrived = 0
    while arrived < _MOST_ARRIVALS and search.run[0].pairs > 0:
        if belief.state[0].count >= CAPACITY:
            break
        best = 0
        for p in range(search.run[0].pairs):
            if search.pair[p].score > search.pair[best].score:
                best = p
        if search.pair[best].score == -math.inf:
            break
        search.pair[best].score = -math.inf
        source = int(search.pair[best].source)
        own = fix_of(belief.hyp[source], fix)
        arrive(belief, path, ctx, best, own)
        if belief.hyp[source].origin.waits == 2:
            label = int(search.pair[best].label)
            note_between(belief, path, history, ctx, source, label, own)
            belief.hyp[belief.state[0].count - 1].origin.waits = 0
        arrived += 1
    note_dropped(belief, ctx, fix, whole, first)
    return arrived


@kernel(inline=True)
def _exchange_off_road(
    belief: Belief, ctx: Context, top: int, n: int, metres: float, fix: SparseFix
) -> None:
    """Off-road hypotheses move and return to the roads; the heaviest, `top`, may leave them."""
    par = ctx.par[0]
    chance = 0.0
    if fix.found > 0 and ctx.work.near[0].distance < 2.0 * fix.sigma:
        chance = min(_BY_CHANCE, par.off_road_cost * metres)
    share = min(_LEAVE * par.off_road_leave * (metres + 10.0), _MOST_LEAVE)
    leaves = belief.hyp[top].log_weight + math.log(max(share, 1e-300)) - _FAR_ABOVE
    for i in range(n):
        hyp = belief.hyp[i]
        if is_parked(hyp):
            continue
        if hyp.edge == OFF_ROAD:
            if i != top and hyp.weight < _LEAST and hyp.log_weight < leaves:
                hyp.edge = NO_EDGE  # a hypothesis that leaves the roads now is as good
                continue
            _predict_off_road(hyp, fix)
            hyp.log_weight -= chance
            if fix.found > 0 and hyp.weight > _LEAST:
                _return_to_roads(belief, ctx, i, n, fix)
        elif i == top and belief.state[0].count < CAPACITY:
            child = spawn(belief, i, share, OFF_ROAD, hyp.segment)
            _predict_off_road(belief.hyp[child], fix)


@kernel
def transit(
    belief: Belief, path: Path, history: History, ctx: Context, epoch: Epoch, dt: float
) -> float:
    """Take every hypothesis along the routes to the roads near a sparse fix.

    Args:
        belief: In place, normalised; those on roads are replaced by those that arrive.
        path: The tree of edges entered.
        history: Past a wrong fix its last step may get more nodes.
        ctx: The drive's constants.
        epoch: With the fix.
        dt: Since the last epoch, s.

    Returns:
        The straight distance that the heaviest hypothesis is from the fix, m.
    """
    state = belief.state[0]
    leave_parking(belief, path, ctx, epoch, dt)
    n = int(state.count)
    begin_anew(belief, path, ctx, dt)
    top = heaviest(belief)
    mean = belief.hyp[top].mu
    metres = math.hypot(epoch.fix[0] - mean[X], epoch.fix[1] - mean[Y]) / state.scale
    sparse = find_candidates(belief, ctx, epoch, dt)
    set_goals(ctx.work.search, ctx.work.near, sparse.found)
    choose_routes(belief, ctx, sparse)
    off_road = False
    seen = fix_of(belief.hyp[top], sparse)
    doubtful = may_be_wrong(belief, ctx, top, seen)
    if doubtful:
        drive_on(belief, path, ctx, top, seen)
    for i in range(n):
        if belief.hyp[i].edge == OFF_ROAD:
            off_road = True
            continue
        own = fix_of(belief.hyp[i], sparse)
        if _stand(belief, ctx.roads, i, own.dt) and belief.hyp[i].origin.waits == 2:
            note_between(belief, path, history, ctx, i, -1, own)
            belief.hyp[state.count - 1].origin.waits = 0
    first = int(state.count)
    arrived = _take_best_routes(belief, path, history, ctx, sparse)
    if arrived > 0:
        for row in range(first, first + min(arrived, _PARKS)):
            park(belief, path, ctx, row)
    elif not off_road:
        if doubtful:
            rescale(belief.hyp[top], _MISSING)
        belief.hyp[top].edge = OFF_ROAD  # no route: the road driven is not on the map
        belief.hyp[top].new_edge = 1
    _exchange_off_road(belief, ctx, top, n, metres, sparse)
    for i in range(n - 1, -1, -1):  # the last one takes the place of one that has left its road
        if belief.hyp[i].edge != OFF_ROAD:
            state.count -= 1
            if i != state.count:
                move_row(belief, int(state.count), i)
    return float(metres)


@kernel
def moments_on_edge(
    s: float, sigma: float, length: float, is_junction: bool, travel_variance: float
) -> tuple[float, float, float]:
    """A Gaussian abscissa truncated to an edge, with a queue prior before a junction.

        p(u) ~ N(u; s, sigma²) (1 on [0, length] + S N(u; length - Q, Q²)) / (1 + S h)
        h = max(1 / length, N(s; length - Q, Q² + variance of the distance))

    A moving vehicle is as likely on one metre as on the next.  A standing one stands in the
    queue before a junction: S = 30 m, less on edges inside a junction, Q = 6 m.  The division
    is by what was known of the queue before the fix, so that neither roads of many junctions
    nor a vehicle whose way was foreseen gain by it.

    Args:
        s: Mean, m.
        sigma: Standard deviation, m.
        length: Of the edge, m.
        is_junction: Whether the road forks at its end.
        travel_variance: Variance of the distance driven since the last fix, m².

    Returns:
        Mass, mean (m) and variance (m²).
    """
    mass = normal_cdf((length - s) / sigma) - normal_cdf(-s / sigma)
    mean, variance = s, sigma * sigma
    if mass < 0.999:
        mean, variance = truncated_moments(s, sigma, 0.0, length)
    if not is_junction:
        return mass, mean, variance
    away = length - _QUEUE - s
    stands = _STANDS * min(1.0, length / (2.0 * _QUEUE))
    here = max(1.0 / length, _density(away, _QUEUE * _QUEUE + travel_variance))
    even = 1.0 / (1.0 + stands * here)
    both = sigma * sigma + _QUEUE * _QUEUE
    queue = stands * _density(away, both)
    if queue < 1e-3:
        return even * mass, mean, variance
    gain = sigma * sigma / both
    share = queue / (mass + queue)
    off = s + gain * away - mean
    variance += share * (gain * _QUEUE * _QUEUE - variance + (1.0 - share) * off * off)
    return even * (mass + queue), mean + share * off, variance


@kernel
def _density(off: float, variance: float) -> float:
    """Density of a Gaussian of mean zero."""
    return math.exp(-0.5 * off * off / variance) / math.sqrt(2.0 * math.pi * variance)


@kernel
def is_junction(roads: Roads, edge: int) -> bool:
    """Whether more than one way leads on from an edge, its opposite not counted."""
    exits = 0
    for t in range(roads.edges[edge].first_turn, roads.edges[edge].end_turn):
        if roads.turns[t].edge != roads.edges[edge].opposite:
            exits += 1
    return exits > 1


@kernel(inline=True)
def truncate_to_edges(belief: Belief, roads: Roads) -> None:
    """After a sparse fix: truncate each Gaussian to its edge, with the queue prior.

    The weight is multiplied by the mass on the edge, and the Gaussian gets the moments there.
    A hypothesis that stood since the last fix got the queue prior then.  One that ignores the
    fix takes the next one as it comes.
    """
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            continue
        if hyp.ignores != 0:
            hyp.ignores = 0
            continue
        track(belief, roads, i)
        tx, ty = hyp.tangent[0], hyp.tangent[1]
        s, sigma = hyp.along, hyp.along_sigma
        length = roads.edges[hyp.edge].length
        driven = hyp.travel_variance
        junction = driven > 0.0 and is_junction(roads, hyp.edge)
        mass, mean, variance = moments_on_edge(s, sigma, length, junction, driven)
        if abs(mass - 1.0) > 1e-3:
            hyp.log_weight += math.log(max(mass, 1e-12))
        if mean != s:
            shrink = variance / (sigma * sigma)
            reshape_on_map(hyp.mu, hyp.cov, tx, ty, mean - s, shrink, state.scale)
            track(belief, roads, i)
        own_all(hyp, length)
