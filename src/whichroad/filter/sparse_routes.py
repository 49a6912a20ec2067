"""Route candidates between sparse fixes: the speed's model, the search, the weights."""

import math
from typing import NamedTuple

from .._compile import Record, Vector, kernel
from ..graph.index import closest
from ..graph.network import Roads
from ..graph.search import Query, Search, find_routes, goal_of
from .road import track
from .state import GX, GY, MX, MY, OFF_ROAD, Belief, Context, K, X, Y, heaviest

SPEED_SIGMA = 5.0  # m/s, of a vehicle's speed about the usual one of the roads

_SPEED_TIME = 22.0  # s, correlation time of the speed
_USUAL_SHARE = 0.7  # average over the usual speed, stops included
_TAIL = 0.3  # least variance of a distance over its squared deviation, where it is longer,
_SLOW_TAIL = 2.0  # and where it is shorter than expected

_FAST = 20.0  # m/s, which every road allows in the cost of haste
_EXCESS_SPEED = 1.3  # possible speed over the usual one
_STRAIGHT_SPEED = 1.15  # possible speed over that of the straight line
_HASTE_SIGMA = 0.15  # of the speed above the possible one, relative
_EXCESS = 10.0  # m, likely excess of a route over the shortest one,
_EXCESS_RATE = 1.8  # m/s, its growth with time,
_MAX_EXCESS = 120.0  # m, and the limit of that growth
_FREE_DETOUR = 4.0  # nats, up to which a detour of the cheapest route costs nothing
_U_TURN = 5.0  # nats, of turning round between junctions; twice that into a one-way
_SPAN = 4.0  # sigmas within which roads and distances are considered
_REACH = 100.0  # m, added to the longest route
_LABELS = 3000  # of one search

_WORTH = 6.0  # nats below the best pair, from which on a route is dropped
_AHEAD = 5.0  # nats, the same for the upper bound of routes still to be found
_SLACK = 4.0  # nats that a route may cost more than the cheapest one of its hypothesis

_WAITING = 0  # scratch: log-weight of a hypothesis whose routes are still to be searched


class SpeedProcess(NamedTuple):
    """An Ornstein-Uhlenbeck speed about the usual one, over some seconds."""

    keep: float  # share of the old speed's deviation that is kept
    distance_by_speed: float  # derivative of the distance by the old speed, s
    variance: float  # of the distance, m²
    cross: float  # its covariance with the new speed, m²/s


class SparseFix(NamedTuple):
    """A sparse fix, and the roads near it."""

    x: float  # m, plane
    y: float
    map_x: float  # the same in the map's frame by the heaviest hypothesis, m, plane
    map_y: float
    sigma: float  # of the fix and the map together, m
    radius: float  # in which roads are candidates, m
    jitter: float  # sigma of the change of the fix's error since the last fix, m
    bias_keep: float  # share of the GNSS bias that is kept since the last fix
    dt: float  # s since the last epoch
    process: SpeedProcess
    found: int  # candidates, in `work.near`


class Departure(NamedTuple):
    """Where a hypothesis starts, and how it moves."""

    s: float  # abscissa, m
    rate: float  # speed, m/s
    variance: float  # of the abscissa after the transition, m²
    straight: float  # straight distance to the fix, m


@kernel
def speed_process(dt: float) -> SpeedProcess:
    """Moments of the speed and the distance after dt seconds."""
    keep = math.exp(-dt / _SPEED_TIME)
    by_speed = _SPEED_TIME * (1.0 - keep)
    v = SPEED_SIGMA * SPEED_SIGMA
    variance = v * _SPEED_TIME**2 * (2.0 * dt / _SPEED_TIME - 3.0 + 4.0 * keep - keep * keep)
    cross = v * _SPEED_TIME * (1.0 - keep) ** 2
    return SpeedProcess(keep, by_speed, max(variance, 0.0), cross)


@kernel
def heavy_tail(variance: float, off: float, sigma: float) -> float:
    """Variance of a distance that is `off` longer than expected: vehicles stop, or drive faster.

    What the fix's own sigma explains is not counted.
    """
    beyond = max(abs(off) - 2.0 * sigma, 0.0)
    return max(variance, (_TAIL if off > 0.0 else _SLOW_TAIL) * beyond * beyond)


@kernel
def usual_speed(roads: Roads, length: float, time: float, edge: int) -> float:
    """Average speed on a route of so many metres and seconds, m/s; of an edge without a route."""
    if time > 0.5 and length > 1.0:
        return _USUAL_SHARE * length / time
    return _USUAL_SHARE * float(roads.edges[edge].speed)


@kernel
def variance_along(hyp: Record, tx: float, ty: float, process: SpeedProcess) -> float:
    """Variance of the abscissa after the transition, m²."""
    cov = hyp.cov
    old = process.distance_by_speed
    cross = tx * (cov[X, K] + cov[MX, K]) + ty * (cov[Y, K] + cov[MY, K])
    return float(
        max(hyp.along_sigma**2 + old * (2.0 * cross + old * cov[K, K]) + process.variance, 1.0)
    )


@kernel(inline=True)
def on_map(hyp: Record, state: Record, x: float, y: float, bias_keep: float) -> tuple[float, float]:
    """A fix (m, plane) in the map's frame, less the GNSS bias of a hypothesis."""
    mean = hyp.mu
    root = state.bias_root
    return (
        x + state.scale * (mean[MX] - bias_keep * (root[0] * mean[GX] + root[1] * mean[GY])),
        y + state.scale * (mean[MY] - bias_keep * (root[1] * mean[GX] + root[2] * mean[GY])),
    )


@kernel(inline=True)
def find_candidates(belief: Belief, ctx: Context, fix: Vector, dt: float) -> SparseFix:
    """Find the roads near a fix, into `work.near`."""
    par = ctx.par[0]
    state = belief.state[0]
    keep = math.exp(-dt / par.gnss_time)
    x, y = on_map(belief.hyp[heaviest(belief)], state, fix[0], fix[1], keep)
    ratio = par.gnss_white_ratio**2
    factor = state.gnss_factor * (1.0 + ratio)
    sigma = math.sqrt(factor * fix[2] ** 2 + par.map_sigma**2)
    white = max(state.white_factor, state.gnss_factor * ratio)
    jitter = math.sqrt(white + state.gnss_factor * (1.0 - keep * keep)) * fix[2]
    radius = _SPAN * sigma + 3.0
    found = closest(ctx.roads, x, y, radius, ctx.work.near)
    return SparseFix(
        fix[0], fix[1], x, y, sigma, radius, jitter, keep, dt, speed_process(dt), found
    )


@kernel
def _u_turn_cost(roads: Roads, edge: int) -> float:
    """Cost of turning round on an edge, nats."""
    other = roads.edges[edge].opposite
    if other < 0:
        return math.inf
    return 2.0 * _U_TURN if roads.edges[other].rule else _U_TURN


@kernel
def _haste_cost(went: float, dt: float, usual: float, rate: float, straight: float) -> float:
    """Cost of a route that is longer than anybody drives in that time, nats."""
    speed = max(
        _EXCESS_SPEED * usual / _USUAL_SHARE, _EXCESS_SPEED * rate, _FAST,
        _STRAIGHT_SPEED * straight / max(dt, 1.0),
    )  # fmt: skip
    over = max(went / max(dt, 1.0) / speed - 1.0, 0.0)
    return 0.5 * (over / _HASTE_SIGMA) ** 2


@kernel
def _next_waiting(belief: Belief) -> int:
    """The hypothesis of the largest weight among those that wait for their search."""
    top = 0
    for j in range(belief.state[0].count):
        if belief.hyp[j].scratch[_WAITING] > belief.hyp[top].scratch[_WAITING]:
            top = j
    return top


@kernel(inline=True)
def _departure(belief: Belief, roads: Roads, i: int, fix: SparseFix) -> Departure:
    """Where hypothesis i starts; its segment and abscissa are brought up to date."""
    _, tx, ty = track(belief, roads, i)
    hyp = belief.hyp[i]
    s = min(max(hyp.along, 0.0), roads.edges[hyp.edge].length)
    variance = variance_along(hyp, tx, ty, fix.process)
    straight = math.hypot(hyp.mu[X] - fix.map_x, hyp.mu[Y] - fix.map_y) / belief.state[0].scale
    return Departure(s, hyp.mu[K], variance, straight)


@kernel(inline=True)
def _query(hyp: Record, ctx: Context, start: Departure, fix: SparseFix, scale: float) -> Query:
    """Costs and limits of the search from one hypothesis."""
    sigma = fix.sigma
    old = fix.process.distance_by_speed
    per_metre = 1.0 / (_EXCESS + min(_EXCESS_RATE * fix.dt, _MAX_EXCESS))
    beside = 0.5 * (ctx.work.near[0].distance / sigma) ** 2  # no road is nearer
    speed = float(ctx.roads.edges[hyp.edge].speed)
    reach = old * start.rate + _EXCESS_SPEED * speed * (fix.dt - old)
    longest = max(reach + _SPAN * math.sqrt(start.variance), 1.5 * start.straight) + _REACH
    floor = hyp.log_weight - 0.5 * math.log(start.variance + sigma * sigma) - beside
    best = ctx.work.search.run[0].best_score
    return Query(
        fix.map_x, fix.map_y, fix.radius * scale, per_metre, _u_turn_cost(ctx.roads, hyp.edge),
        longest, floor + per_metre * start.straight - best + _AHEAD, _SLACK, _LABELS,
    )  # fmt: skip


@kernel
def _add_pair(search: Search, i: int, label: int, goal: int, score: float, cost: float) -> None:
    """Store a pair of a hypothesis and a goal, while the table is not full."""
    run = search.run[0]
    if run.pairs >= len(search.pair):
        return
    pair = search.pair[run.pairs]
    pair.source = i
    pair.label = label
    pair.goal = goal
    pair.score = score
    pair.cost = cost
    run.pairs += 1


@kernel
def _keep_pairs(search: Search) -> None:
    """Drop the pairs far below the best; what even the cheapest detour costs is free."""
    run = search.run[0]
    n = int(run.pairs)
    run.pairs = 0
    for p in range(n):
        pair = search.pair[p]
        if pair.score >= run.best_score - _WORTH:
            _add_pair(
                search, pair.source, pair.label, pair.goal, pair.score, pair.cost - run.detour
            )


@kernel(inline=True)
def _weigh_route(
    belief: Belief, ctx: Context, i: int, label: int, start: Departure, query: Query,
    fix: SparseFix,
) -> None:  # fmt: skip
    """Weigh a route of hypothesis i (label -1: on along its edge); store it if likely.

        score = log w − cost − ½ (δ² / v + log v) − ½ (distance to the road / σ)²

    with δ the route's length less what the speed allows, v its variance.
    """
    search = ctx.work.search
    run = search.run[0]
    edge = search.label[label].edge if label >= 0 else belief.hyp[i].edge
    goal = goal_of(search, edge)
    if goal < 0:
        return
    near = ctx.work.near[goal]
    to = near.s
    if label < 0:
        length = -start.s
        cost = query.per_metre * max(to - start.s, 0.0)
        usual = usual_speed(ctx.roads, 0.0, 0.0, edge)
    else:
        length = search.label[label].length
        factor = float(ctx.roads.edges[edge].cost) / ctx.roads.edges[edge].length
        cost = search.label[label].cost + query.per_metre * max(to, 0.0) * factor
        usual = usual_speed(ctx.roads, length, search.label[label].time, edge)
    went = length + to
    if went < -_SPAN * fix.sigma:
        return
    cost -= query.per_metre * min(start.straight, max(went, 0.0))
    run.detour = min(run.detour, cost)
    cost += _haste_cost(went, fix.dt, usual, start.rate, start.straight)
    old = fix.process.distance_by_speed
    off = went - usual * (fix.dt - old) - start.rate * old
    wide = heavy_tail(start.variance, off, fix.jitter) + fix.sigma * fix.sigma
    score = belief.hyp[i].log_weight - cost - 0.5 * (off * off / wide + math.log(wide))
    score -= 0.5 * (near.distance / fix.sigma) ** 2
    if score >= run.best_score - _WORTH:
        run.best_score = max(run.best_score, score)
        _add_pair(search, i, label, goal, score, cost)


@kernel
def choose_routes(belief: Belief, ctx: Context, fix: SparseFix) -> None:
    """Find the routes from all hypotheses to the roads near a fix that are likely enough.

    Args:
        belief: Normalised.
        ctx: The drive's constants; `pair` of its search is filled, and `pairs` counted.
        fix: The fix; its candidates are the goals of the search.
    """
    search = ctx.work.search
    run = search.run[0]
    run.pairs = 0
    run.best_score = -math.inf
    run.detour = _FREE_DETOUR
    if fix.found == 0:
        return
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        hyp.scratch[_WAITING] = -math.inf if hyp.edge == OFF_ROAD else hyp.log_weight
    while belief.state[0].count > 0:
        i = _next_waiting(belief)
        hyp = belief.hyp[i]
        waiting = hyp.scratch[_WAITING]
        if waiting < run.best_score - _WORTH or waiting == -math.inf:
            break
        hyp.scratch[_WAITING] = -math.inf
        start = _departure(belief, ctx.roads, i, fix)
        query = _query(hyp, ctx, start, fix, belief.state[0].scale)
        hits = find_routes(ctx.roads, search, query, hyp.edge, start.s)
        for h in range(-1, hits):  # -1: on along the edge
            label = int(search.hit[h]) if h >= 0 else -1
            _weigh_route(belief, ctx, i, label, start, query, fix)
    _keep_pairs(search)
