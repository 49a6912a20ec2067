"""Which routes between sparse fixes are likely: their weights, and those that turn round."""

import math
from typing import NamedTuple

from ..._compile import kernel
from ...graph.labels import Reach, Search, add_way, write_way
from ...graph.route_costs import cost_factor
from ...graph.route_search import Query, find_routes, goal_of
from ..state import OFF_ROAD, Belief, Context
from .candidates import (
    CHOSEN,
    EXCESS_SPEED,
    SPAN,
    Departure,
    SparseFix,
    departure_of,
    fix_of,
    heavy_tail,
    query_of,
    u_turn_cost,
    usual_speed,
)
from .driven import Driven, believed, by_speed, distance_of, is_measured, trusted

_WORTH = 6.0  # nats below the best pair, from which on a route is dropped,
_TURN_WORTH = 9.0  # and one that turns round: only later fixes show it
_FAST = 20.0  # m/s, which every road allows in the cost of haste
_STRAIGHT_SPEED = 1.15  # possible speed over that of the straight line
_HASTE_SIGMA = 0.15  # of the speed above the possible one, relative
_FREE_DETOUR = 4.0  # nats, up to which a detour of the cheapest route costs nothing

_WAITING = 0  # scratch: log-weight of a hypothesis whose routes are still to be searched


@kernel
def _haste_cost(went: float, usual: float, start: Departure, fix: SparseFix) -> float:
    """Cost of a route that is longer than anybody drives in that time, nats."""
    if is_measured(fix.driven):
        return 0.0
    seconds = max(fix.dt, 1.0)
    speed = max(
        EXCESS_SPEED * usual, EXCESS_SPEED * start.rate, _FAST,
        _STRAIGHT_SPEED * start.straight / seconds,
    )  # fmt: skip
    over = max(went / seconds / speed - 1.0, 0.0)
    return 0.5 * (over / _HASTE_SIGMA) ** 2


@kernel
def _back_cost(went: float, sigma: float) -> float:
    """Cost of having driven backwards, nats: more than a sigma of both positions is seldom error.

    One sigma is free, as the error of a vehicle that stands is the same from fix to fix.
    """
    beyond = max(-went / sigma - 1.0, 0.0)
    return 0.5 * beyond * beyond


@kernel(inline=True)
def _misfit(went: float, usual: float, start: Departure, fix: SparseFix) -> float:
    """-log density of a distance, but for a constant, nats."""
    driven, square = fix.driven, fix.sigma * fix.sigma
    usual *= fix.pace
    off = went - by_speed(driven, usual, start.rate)
    wide = heavy_tail(start.variance, off, fix.jitter) + square
    if driven.gain == 0.0:
        return 0.5 * (off * off / wide + math.log(wide))
    wide = heavy_tail(start.variance + driven.free.variance, off, fix.jitter) + square
    alone = 0.5 * (off * off / wide + math.log(wide))
    off = went - distance_of(driven, usual, start.rate)
    wide = start.variance + square
    read = 0.5 * (off * off / wide + math.log(wide)) + _odd(driven, usual, start.rate)
    return believed(read, alone, driven.wrong)


@kernel
def _seen_by_fix(went: float, usual: float, start: Departure, fix: SparseFix) -> float:
    """What observing the fix will cost who arrives by a distance, nats; see `arrival`."""
    driven = trusted(fix.driven, went, start.variance + fix.sigma * fix.sigma)
    off = went - distance_of(driven, fix.pace * usual, start.rate)
    more = driven.free.variance if driven.gain < fix.driven.gain else 0.0
    wide = heavy_tail(start.variance + more, off, fix.jitter) + fix.sigma * fix.sigma
    return 0.5 * (off * off / wide + math.log(wide))


@kernel
def _odd(driven: Driven, usual: float, rate: float) -> float:
    """What the distance that was read has against the usual speed of a route, nats."""
    off = driven.metres - by_speed(driven, usual, rate)
    variance = driven.free.variance + driven.variance
    wide = heavy_tail(variance, off, 0.0)
    return 0.5 * driven.gain * (off * off / wide + math.log(wide / variance))


@kernel
def distance_cost(went: float, usual: float, start: Departure, fix: SparseFix) -> float:
    """What a distance driven says of a route, nats: its misfit, and what nobody drives."""
    haste = _haste_cost(went, usual, start, fix)
    return haste + _misfit(went, usual, start, fix)


@kernel
def _next_waiting(belief: Belief) -> int:
    """The hypothesis of the largest weight among those that wait for their search."""
    top = 0
    for j in range(belief.state[0].count):
        if belief.hyp[j].scratch[_WAITING] > belief.hyp[top].scratch[_WAITING]:
            top = j
    return top


class Way(NamedTuple):
    """A way to a goal."""

    label: int  # of the route, -1: on along the edge
    edge: int
    to: float  # abscissa of the goal, m
    went: float  # distance driven, m
    cost: float  # nats
    usual: float  # usual speed of its roads, m/s
    worth: float  # nats that its score may be below the best


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
        worth = _TURN_WORTH if pair.turned == 1 else _WORTH
        if pair.score >= run.best_score - worth:
            turned, root = pair.turned, pair.root
            _add_pair(
                search, pair.source, pair.label, pair.goal, pair.score, pair.cost - run.detour
            )
            search.pair[run.pairs - 1].turned = turned
            search.pair[run.pairs - 1].root = root


@kernel
def _own_cost(ctx: Context, edge: int, way: Way) -> float:
    """What the beginning of a way costs for roads as the one it begins on, over usual roads, m.

    Who is on a slow road has chosen it, and does not choose it anew from fix to fix.
    """
    if way.label < 0:  # on along its edge: no road is chosen
        return 0.0
    own = cost_factor(float(ctx.roads.edges[edge].speed))
    factor = cost_factor(way.usual)
    return (min(max(factor, min(own, 1.0)), max(own, 1.0)) - 1.0) * min(max(way.went, 0.0), CHOSEN)


@kernel(inline=True)
def _weigh(
    belief: Belief, ctx: Context, i: int, way: Way, start: Departure, query: Query, fix: SparseFix
) -> None:
    """Weigh a way of hypothesis i; store it if likely.

        score = log w − cost − ½ (δ² / v + log v) − ½ (distance to the road / σ)²

    with δ the route's length less what the speed allows, v its variance.
    """
    search = ctx.work.search
    run = search.run[0]
    goal = goal_of(search, way.edge)
    near = ctx.work.near[goal]
    went = way.went
    cost = way.cost - query.per_metre * min(start.straight, max(went, 0.0))
    cost -= query.per_metre * _own_cost(ctx, int(belief.hyp[i].edge), way)
    turned = way.worth > _WORTH
    if not turned:
        run.detour = min(run.detour, cost)
    cost += _haste_cost(went, way.usual, start, fix)
    if went < 0.0:
        cost += _back_cost(went, math.hypot(belief.hyp[i].along_sigma, fix.jitter))
    misfit = _misfit(went, way.usual, start, fix)
    score = belief.hyp[i].log_weight - cost - misfit
    score -= 0.5 * (near.distance / fix.sigma) ** 2
    if score >= run.best_score - way.worth:
        run.best_score = max(run.best_score, score)
        before = run.pairs
        if fix.driven.gain > 0.0:  # the fix says the rest
            cost += misfit - _seen_by_fix(went, way.usual, start, fix)
        _add_pair(search, i, way.label, goal, score, cost)
        if run.pairs > before:
            search.pair[before].turned = 1 if turned else 0
            search.pair[before].root = run.root


@kernel(inline=True)
def _weigh_route(
    belief: Belief, ctx: Context, i: int, label: int, start: Departure, query: Query,
    fix: SparseFix,
) -> None:  # fmt: skip
    """Weigh a route of hypothesis i (label -1: on along its edge)."""
    search = ctx.work.search
    edge = search.label[label].edge if label >= 0 else belief.hyp[i].edge
    goal = goal_of(search, edge)
    if goal < 0:
        return
    to = ctx.work.near[goal].s
    if label < 0:
        length = -start.s
        cost = query.per_metre * max(to - start.s, 0.0)
        usual = usual_speed(ctx.roads, 0.0, 0.0, edge, 0.0)
    else:
        entry = search.label[label]
        if entry.parent < 0 and edge == ctx.roads.edges[belief.hyp[i].edge].opposite:
            return  # turned round at once: see `_weigh_turn`
        length = entry.length
        factor = float(ctx.roads.edges[edge].cost) / ctx.roads.edges[edge].length
        cost = entry.cost + query.per_metre * max(to, 0.0) * factor
        usual = usual_speed(ctx.roads, length, entry.time, edge, to)
    went = length + to
    if went < -SPAN * fix.sigma:
        return
    way = Way(label, edge, to, went, cost, usual, _WORTH)
    if label >= 0:
        way = _in_time(ctx, way, start, fix)
    _weigh(belief, ctx, i, way, start, query, fix)


@kernel
def _in_time(ctx: Context, way: Way, start: Departure, fix: SparseFix) -> Way:
    """The way to the same goal whose cost and time are best: by rivals in place of the cheapest."""
    search = ctx.work.search
    goal = search.label[way.label]
    first = search.way[0]
    first.cost = first.length = first.time = first.turn = 0.0
    first.before = first.join = -1
    first.label = way.label
    least = way.cost + 0.5 * math.log(start.variance + fix.sigma * fix.sigma)
    nats = way.cost + distance_cost(way.went, way.usual, start, fix)
    best, best_usual = 0, way.usual
    n, now = 1, 0
    while now < n:
        at = int(search.way[now].label)
        while at >= 0:
            rival = int(search.label[at].rival)
            while rival >= 0 and n < len(search.way):
                add_way(search, n, now, at, rival)
                rival = int(search.rival[rival].next)
                new = search.way[n]
                if least + new.cost >= nats:
                    continue
                usual = usual_speed(
                    ctx.roads, goal.length + new.length, goal.time + new.time, way.edge, way.to
                )
                total = way.cost + new.cost
                total += distance_cost(way.went + new.length, usual, start, fix)
                if total < nats:
                    nats, best, best_usual = total, n, usual
                n += 1
            at = int(search.label[at].parent)
        now += 1
    if best == 0:
        return way
    label = write_way(search, way.label, best)
    if label < 0:
        return way
    found = search.way[best]
    return Way(
        label, way.edge, way.to, way.went + found.length, way.cost + found.cost, best_usual,
        way.worth,
    )  # fmt: skip


@kernel
def _label_turn(
    search: Search, label: int, edge: int, driven: Reach, came: float, speed: float
) -> None:
    """Write a free label: turned into an edge behind a route of `came` metres, at a speed, m/s."""
    new = search.label[int(search.run[0].labels)]
    new.edge = edge
    new.parent = label
    new.cost = driven.cost
    new.length = driven.length
    new.time = driven.time + (driven.length - came) / speed
    new.turn = driven.turn
    new.rival = -1
    new.twin = -1
    new.same = -1


@kernel(inline=True)
def _weigh_turn(
    belief: Belief, ctx: Context, i: int, label: int, start: Departure, query: Query,
    fix: SparseFix,
) -> None:  # fmt: skip
    """Weigh turning round on the last edge of a route (label -1: on the hypothesis' own).

    Where it turned is not known: between the goal and the edge's end, so that the distance is
    as near to what the speed allows as can be.
    """
    search = ctx.work.search
    roads = ctx.roads
    hyp = belief.hyp[i]
    edge = search.label[label].edge if label >= 0 else hyp.edge
    other = int(roads.edges[edge].opposite)
    if other < 0 or edge == roads.edges[hyp.edge].opposite or other == hyp.edge:
        return
    goal = goal_of(search, other)
    if goal < 0:
        return
    road = roads.edges[edge]
    to = ctx.work.near[goal].s
    here = road.length - to  # of the goal, on this edge
    came, cost, time, turn, begin = 0.0, 0.0, 0.0, 0.0, start.s
    if label >= 0:
        entry = search.label[label]
        came, cost, time, turn, begin = entry.length, entry.cost, entry.time, entry.turn, 0.0
    nearest = max(begin, here)
    least = 2.0 * nearest - begin - here
    usual = usual_speed(roads, came, time, edge, least)
    expected = distance_of(fix.driven, fix.pace * usual, start.rate)
    more = min(max(expected - came - least, 0.0), 2.0 * (road.length - nearest))
    factor = float(road.cost) / road.length
    cost += u_turn_cost(roads, edge) + query.per_metre * factor * (least + more)
    run = search.run[0]
    new = int(run.labels)
    if new >= len(search.label):
        return
    driven = Reach(cost, came + least + more - to, time, turn + math.pi)
    _label_turn(search, label, other, driven, came, max(float(road.speed), 1.0))
    pairs = run.pairs
    _weigh(
        belief, ctx, i, Way(new, other, to, came + least + more, cost, usual, _TURN_WORTH), start,
        query, fix,
    )  # fmt: skip
    if run.pairs > pairs:
        run.labels = new + 1


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
        own = fix_of(hyp, fix)
        start = departure_of(belief, ctx.roads, i, own)
        query = query_of(hyp, ctx, start, own, belief.state[0].scale)
        hits = find_routes(ctx.roads, search, query, hyp.edge, start.s)
        for h in range(-1, hits):  # -1: on along the edge
            label = int(search.hit[h]) if h >= 0 else -1
            _weigh_route(belief, ctx, i, label, start, query, own)
            _weigh_turn(belief, ctx, i, label, start, query, own)
    _keep_pairs(search)
