"""Route candidates between sparse fixes: the speed's model, and what is searched for."""

import math
from typing import NamedTuple

from ..._compile import Record, kernel
from ...graph.index import closest, share_beyond
from ...graph.network import Roads
from ...graph.route_costs import cost_factor
from ...graph.route_search import Query
from ..gnss.inflation import COARSE, bias_time
from ..map_error import map_variance
from ..road import track
from ..speed_process import SpeedProcess, speed_process
from ..state import GX, GY, MX, MY, OFF_ROAD, Belief, Context, K, X, Y, heaviest
from .driven import Driven, conditioned, driven_by, driven_to, trusted
from .driver import begin_driver, learn_leg, learn_scale, likely_excess, pace_of

_TAIL = 0.3  # least variance of a distance over its squared deviation, where it is longer,
_SLOW_TAIL = 2.0  # and where it is shorter than expected

EXCESS_SPEED = 1.3  # possible speed over the usual one
_U_TURN = 5.0  # nats, of turning round between junctions; twice that into a one-way
SPAN = 4.0  # sigmas within which roads and distances are considered
P_ELSEWHERE = 0.1  # P that a vehicle on one of too many roads is not where it was foreseen
LEAST_ELSEWHERE, KNOWN = 0.02, 25.0  # and at least, where that is not known to so many m
_EXCESS = 0.15  # of the sigma of coarse fixes, by which the straight line may be longer
_APART = 13.8  # squared sigmas from where it was foreseen, beyond which a fix counts alone
_REACH = 100.0  # m, added to the longest route
_LABELS = 3000  # of one search

CHOSEN = 150.0  # m, for which a road is chosen at once
_AHEAD = 5.0  # nats, the same for the upper bound of routes still to be found
_LEARNS, _LEADS = 0.01, 0.5  # least weight of one that learns its pace, and tells the drive's
_SHORT = 20.0  # s, up to which, or by an odometer, no search copies routes: copies lack rivals
_SLACK = 4.0  # nats that a route may cost more than the cheapest one of its hypothesis


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
    process: SpeedProcess  # of the speed, the odometer being known
    found: int  # candidates, in `work.near`
    beyond: float  # P that it is farther off than all of them
    pace: float  # speed over the usual one
    per_metre: float  # what a metre of a detour costs, nats
    coarse: bool  # whether its sigma is that of `COARSE` at least
    driven: Driven  # by the odometer, where there is one


class Departure(NamedTuple):
    """Where a hypothesis starts, and how it moves."""

    s: float  # abscissa, m
    rate: float  # speed, m/s
    variance: float  # of the abscissa after the transition, m²
    straight: float  # straight distance to the fix, m


@kernel
def heavy_tail(variance: float, off: float, sigma: float) -> float:
    """Variance of a distance that is `off` longer than expected: vehicles stop, or drive faster.

    What the fix's own sigma explains is not counted.
    """
    beyond = max(abs(off) - 2.0 * sigma, 0.0)
    return max(variance, (_TAIL if off > 0.0 else _SLOW_TAIL) * beyond * beyond)


@kernel
def usual_speed(roads: Roads, length: float, time: float, edge: int, to: float) -> float:
    """Usual speed on a route of so many metres and seconds to the start of its last edge, m/s.

    On that edge it goes on to an abscissa.  Without a route it is that of the edge.
    """
    speed = float(roads.edges[edge].speed)
    to = max(to, 0.0)
    time += to / max(speed, 1.0)
    if time > 0.5 and length + to > 1.0:
        return (length + to) / time
    return speed


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


class Disc(NamedTuple):
    """About where the vehicle is, in the map's frame."""

    x: float  # m, plane
    y: float
    sigma: float  # m, of each axis


@kernel
def _foreseen(belief: Belief, about: Disc, process: SpeedProcess) -> Disc:
    """About where a coarse fix and the way from where the vehicle was say that it is.

    Within some sigmas of the fix alone are more roads than can be followed.  A fix that is far from
    where the vehicle was foreseen counts alone.
    """
    state = belief.state[0]
    x = y = square = reach = 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        east, north = hyp.mu[X] + state.scale * hyp.mu[MX], hyp.mu[Y] + state.scale * hyp.mu[MY]
        x += hyp.weight * east
        y += hyp.weight * north
        square += hyp.weight * ((east - about.x) ** 2 + (north - about.y) ** 2)
        reach += hyp.weight * (hyp.cov[X, X] + hyp.cov[Y, Y] + 2.0 * process.variance)
        speed = hyp.mu[K] * process.distance_by_speed
        reach += hyp.weight * speed * speed
    square -= (x - about.x) ** 2 + (y - about.y) ** 2
    before = 0.5 * (square / state.scale**2 + reach)
    apart = ((x - about.x) ** 2 + (y - about.y) ** 2) / state.scale**2
    if apart > _APART * (before + about.sigma**2):
        return about
    share = before / (before + about.sigma**2)
    return Disc(
        x + share * (about.x - x), y + share * (about.y - y), math.sqrt(share) * about.sigma
    )


@kernel(inline=True)
def find_candidates(belief: Belief, ctx: Context, epoch: Record, dt: float) -> SparseFix:
    """Find the roads near a fix, into `work.near`."""
    par = ctx.par[0]
    state = belief.state[0]
    fix = epoch.fix
    keep = math.exp(-dt / bias_time(state, par, epoch))
    x, y = on_map(belief.hyp[heaviest(belief)], state, fix[0], fix[1], keep)
    ratio = par.gnss_white_ratio**2
    factor = state.gnss_factor * (1.0 + ratio)
    sigma = math.sqrt(factor * fix[2] ** 2 + map_variance(state, par))
    white = max(state.white_factor, state.gnss_factor * ratio)
    jitter = math.sqrt(white + state.gnss_factor * (1.0 - keep * keep)) * fix[2]
    coarse = fix[2] >= COARSE
    excess = likely_excess(dt) + (_EXCESS * fix[2] if coarse else 0.0)
    driver = state.driver
    driven = driven_to(driver, epoch, speed_process(dt, driver.speed_sigma), dt)
    process = conditioned(driven)
    about = Disc(x, y, sigma)
    elsewhere = 0.0
    if coarse:
        found = closest(ctx.roads, x, y, SPAN * sigma + 3.0, ctx.work.near)
        elsewhere = P_ELSEWHERE * share_beyond(found, ctx.work.near, sigma)
        about = _foreseen(belief, about, process)
        if about.sigma <= KNOWN:
            elsewhere = 0.0
        elif state.reported[1] >= COARSE:  # so was the one before
            elsewhere = max(elsewhere, LEAST_ELSEWHERE)
    radius = SPAN * about.sigma + 3.0
    found = closest(ctx.roads, about.x, about.y, radius, ctx.work.near)
    beyond = max(share_beyond(found, ctx.work.near, about.sigma), elsewhere)
    return SparseFix(
        fix[0], fix[1], x, y, sigma, radius, jitter, keep, dt, process, found, beyond,
        driver.pace, 1.0 / excess, bool(coarse), driven,
    )  # fmt: skip


@kernel(inline=True)
def fix_of(hyp: Record, fix: SparseFix) -> SparseFix:
    """A fix as a hypothesis sees it: where it was before a wrong one, the time is longer.

    Its pace is its own.
    """
    dt = fix.dt
    pace = pace_of(hyp.leg, fix.pace)
    process = fix.process
    per_metre = fix.per_metre
    driven = fix.driven
    if hyp.origin.waits == 2:
        dt += hyp.origin.ignored - hyp.origin.since
        per_metre *= likely_excess(fix.dt) / likely_excess(dt)
        read = hyp.origin.driven
        known = fix.driven.gain > 0.0 and read[1] > 0.0
        driven = driven_by(
            speed_process(dt, process.sigma), dt, fix.driven.metres + read[0],
            fix.driven.variance + read[1] if known else 0.0, fix.driven.wrong,
        )  # fmt: skip
        process = conditioned(driven)
    return SparseFix(
        fix.x, fix.y, fix.map_x, fix.map_y, fix.sigma, fix.radius, fix.jitter, fix.bias_keep, dt,
        process, fix.found, fix.beyond, pace, per_metre, fix.coarse, driven,
    )  # fmt: skip


@kernel(inline=True)
def trusting(fix: SparseFix, went: float, variance: float) -> SparseFix:
    """A fix without the odometer where that contradicts the way to it, of so many metres."""
    driven = trusted(fix.driven, went, variance + fix.sigma * fix.sigma)
    return SparseFix(
        fix.x, fix.y, fix.map_x, fix.map_y, fix.sigma, fix.radius, fix.jitter, fix.bias_keep,
        fix.dt, conditioned(driven), fix.found, fix.beyond, fix.pace, fix.per_metre, fix.coarse,
        driven,
    )  # fmt: skip


@kernel
def u_turn_cost(roads: Roads, edge: int) -> float:
    """Cost of turning round on an edge, nats."""
    other = roads.edges[edge].opposite
    if other < 0:
        return math.inf
    return 2.0 * _U_TURN if roads.edges[other].rule else _U_TURN


@kernel(inline=True)
def departure_of(belief: Belief, roads: Roads, i: int, fix: SparseFix) -> Departure:
    """Where hypothesis i starts; its segment and abscissa are brought up to date."""
    track(belief, roads, i)
    hyp = belief.hyp[i]
    tx, ty = hyp.tangent[0], hyp.tangent[1]
    s = min(max(hyp.along, 0.0), roads.edges[hyp.edge].length)
    variance = variance_along(hyp, tx, ty, fix.process)
    straight = math.hypot(hyp.mu[X] - fix.map_x, hyp.mu[Y] - fix.map_y) / belief.state[0].scale
    return Departure(s, hyp.mu[K], variance, straight)


@kernel(inline=True)
def query_of(hyp: Record, ctx: Context, start: Departure, fix: SparseFix, scale: float) -> Query:
    """Costs and limits of the search from one hypothesis."""
    sigma = fix.sigma
    driven, per_metre = fix.driven, fix.per_metre
    beside = 0.5 * (ctx.work.near[0].distance / sigma) ** 2  # no road is nearer
    speed = float(ctx.roads.edges[hyp.edge].speed)
    reach = driven.free.distance_by_speed * start.rate + EXCESS_SPEED * speed * driven.seconds
    reach = max(reach, driven.metres + SPAN * math.sqrt(driven.variance))
    longest = max(reach + SPAN * math.sqrt(start.variance), 1.5 * start.straight) + _REACH
    floor = hyp.log_weight - 0.5 * math.log(start.variance + sigma * sigma) - beside
    best = ctx.work.search.run[0].best_score
    own = max(cost_factor(speed) - 1.0, 0.0) * per_metre * min(start.straight, CHOSEN)
    return Query(
        fix.map_x, fix.map_y, fix.radius * scale, per_metre, u_turn_cost(ctx.roads, hyp.edge),
        longest, floor + per_metre * start.straight - best + _AHEAD + own, _SLACK + own, _LABELS,
        bool(hyp.origin.waits == 2 or fix.dt < _SHORT or driven.gain > 0.0),
    )  # fmt: skip


@kernel
def learn_driver(belief: Belief, ctx: Context, dt: float) -> None:
    """Learn how the vehicle drives from what hypotheses drove to the last fix."""
    state = belief.state[0]
    if state.driver.pace == 0.0:
        begin_driver(state.driver)
    top = heaviest(belief)
    for i in range(state.count):
        hyp = belief.hyp[i]
        leg = hyp.leg
        if hyp.edge == OFF_ROAD or leg.seconds == 0.0 or hyp.weight < _LEARNS:
            continue
        if abs(leg.at - (state.time - dt)) > 1e-3:
            continue
        track(belief, ctx.roads, i)
        unit = speed_process(leg.seconds, 1.0)
        leads = i == top and hyp.weight >= _LEADS
        learn_leg(state.driver, hyp, unit.distance_by_speed, unit.variance, leads)
        if leads:
            learn_scale(state.driver, hyp)
