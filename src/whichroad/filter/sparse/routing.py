"""Sparse transition: from one fix to the next along routes, when they lie far apart in time.

In place of many small steps, each hypothesis is taken along the cheapest routes to the
roads near the new fix, with the distance that its speed allows.  The fix is then observed as
usual, and each Gaussian is truncated to its edge.
"""

import math

from ..._compile import kernel
from ...graph.network import Roads
from ...graph.route_search import set_goals
from ..gaussian import normal_cdf, reshape_on_map, truncated_moments
from ..haste import weigh_legs
from ..hypotheses.branching import own_all
from ..lookback.history import History
from ..records import Epoch
from ..road import track
from ..slow_states import decay
from ..state import (
    CAPACITY,
    OFF_ROAD,
    Belief,
    Context,
    K,
    Path,
    X,
    Y,
    heaviest,
    move_row,
    rescale,
)
from .arrival import arrive
from .candidates import (
    SparseFix,
    find_candidates,
    fix_of,
    usual_speed,
)
from .choice import choose_routes
from .driven import stood_by_odometer
from .driver import forget_leg
from .dropped import likelihood_left, note_dropped
from .off_road import exchange_off_road
from .parked import (
    REST_VARIANCE,
    comes_to_stand,
    comes_to_stand_within,
    goes_on_standing,
    leave_parking,
    most_parked,
    park,
)
from .past_wrong_fix import begin_anew, note_between
from .wrong_fix import drive_on, may_be_wrong

_MOST_ARRIVALS = 24  # routes that become hypotheses

_STANDING = 1e-3  # least weight of a hypothesis of standing
_LEAST_ON_EDGE = 0.3  # divisor of its weight at least
_MISSING = 0.1  # P(the map lacks the road) where there is no route to a fix that may be wrong

_STANDS = 30.0  # m of road on which as many vehicles drive as stand before a junction
_QUEUE = 6.0  # m before the junction: mean and sigma of where they stand


@kernel(inline=True)
def _stand(belief: Belief, roads: Roads, i: int, fix: SparseFix) -> bool:
    """Append a child of hypothesis i that has stood all the time; the others drove.

    By coarse fixes any speed is likely, and nobody stops at each of them.

    Returns:
        Whether there is one.
    """
    hyp = belief.hyp[i]
    share = goes_on_standing(hyp.stood, fix.dt)
    if hyp.stood == 0.0:
        share *= comes_to_stand(hyp.mu[K], hyp.cov[K, K])
        share = min(share, comes_to_stand_within(fix.dt)) if fix.coarse else share
    if fix.driven.gain > 0.0:
        usual = fix.pace * usual_speed(roads, 0.0, 0.0, hyp.edge, 0.0)
        share = stood_by_odometer(share, fix.driven, usual, hyp.mu[K])
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
    new.stood = hyp.stood + fix.dt
    belief.state[0].count = child + 1
    return True


@kernel(inline=True)
def _take_best_routes(
    belief: Belief, path: Path, history: History, ctx: Context, fix: SparseFix
) -> int:
    """Append children for the pairs of the largest scores; returns how many."""
    search = ctx.work.search
    since = history.since[0]
    since.driven[0], since.driven[1] = fix.driven.metres, fix.driven.variance
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
        if _stand(belief, ctx.roads, i, own) and belief.hyp[i].origin.waits == 2:
            note_between(belief, path, history, ctx, i, -1, own)
            belief.hyp[state.count - 1].origin.waits = 0
    first = int(state.count)
    arrived = _take_best_routes(belief, path, history, ctx, sparse)
    if arrived > 0:
        for row in range(first, first + most_parked(arrived, epoch.fix)):
            park(belief, path, ctx, row)
    elif not off_road:
        if doubtful:
            rescale(belief.hyp[top], _MISSING)
        belief.hyp[top].edge = OFF_ROAD  # no route: the road driven is not on the map
        belief.hyp[top].new_edge = 1
    exchange_off_road(belief, ctx, top, n, metres, sparse)
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
    if queue <= 1e-3 * max(mass, 1e-12):
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
def truncate_to_edges(belief: Belief, ctx: Context) -> None:
    """After a sparse fix: truncate each Gaussian to its edge, with the queue prior.

    The weight is multiplied by the mass on the edge, and the Gaussian gets the moments there.
    A hypothesis that stood since the last fix got the queue prior then.  One that ignores the
    fix takes the next one as it comes.  Then routes are weighed by their speeds.
    """
    state = belief.state[0]
    roads = ctx.roads
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
    weigh_legs(belief, ctx)
