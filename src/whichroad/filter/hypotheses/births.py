"""New hypotheses: cold starts, the exchange with the off-road mode, U-turns."""

import math
from typing import NamedTuple

from ..._compile import Record, Vector, entry, kernel
from ...graph.geometry import HALF_CHORD, chord_heading, project, wrap
from ...graph.index import near, share_beyond, vertex_at
from ...graph.network import AGAINST_ONE_WAY, NO_ACCESS
from ..beside import STARTS, p_apart
from ..gaussian import normal_cdf
from ..haste import p_returns
from ..map_error import map_variance
from ..state import (
    CAPACITY,
    CLOCK,
    GX,
    GY,
    MX,
    MY,
    OFF_ROAD,
    B,
    Belief,
    Context,
    D,
    H,
    K,
    Path,
    X,
    Y,
    blank,
    heaviest,
    lane_mean,
    lane_sigma,
    redraw,
    rescale,
    spawn,
)
from ..unmapped import leave_for_fixes
from .branching import own_all
from .reduction import drop_lightest

_LEAVES = 0.02  # weight of a road hypothesis that spawns an off-road one
_RETURNS = 1e-3  # weight of an off-road hypothesis that spawns road ones
_MOST_RETURNS = 12  # roads that one off-road hypothesis returns to at once
_TURNS = 3e-4  # probability of a U-turn in a step that is represented by a hypothesis
_FOOT_SIGMA = 3.0  # m, of the place beside which a vehicle comes back to a road, at least
_LEAST_MASS = 0.01  # of the abscissa on a road that it comes back to
_ATHWART = 1.3  # rad off the road's heading, from which on a vehicle may be turning round
_HEADINGS = 8  # components of an off-road start whose heading is unknown
_STALE = 0.02  # weight of a road that a known heading does not fit: it may be an old one
_SERVICE, _PRIVATE = 0.5, 0.1  # prior weight of service roads, and of roads without access


class Start(NamedTuple):
    """What is known at a start beside the position."""

    bias: float  # sigma of the GNSS bias over the reported sigma
    white: float  # white sigma over the reported sigma
    heading: float  # of the vehicle, rad
    heading_sigma: float  # infinite: unknown, that of each road is taken
    rate: float  # κ
    rate_sigma: float
    drift: float  # b
    drift_sigma: float
    at_antenna: bool  # whether the position is the antenna's; else M's


@kernel
def _fill_start(
    hyp: Record, ctx: Context, fix: Vector, start: Start, heading: float, sigma: float,
    state: Record,
) -> None:  # fmt: skip
    """Fill a blank hypothesis from one fix and a heading: p = z − R a − S γ − white."""
    par = ctx.par[0]
    mean = hyp.mu
    cov = hyp.cov
    forward = par.lever[0] if start.at_antenna else 0.0
    left = par.lever[1] if start.at_antenna else 0.0
    ch = math.cos(heading)
    sh = math.sin(heading)
    lx = ch * forward - sh * left
    ly = sh * forward + ch * left
    mean[X] = fix[0] - state.scale * lx
    mean[Y] = fix[1] - state.scale * ly
    mean[H] = wrap(heading)
    mean[K] = start.rate
    mean[B] = start.drift
    mean[D] = lane_mean(ctx, hyp.edge)
    c = math.cos(fix[4])
    s = math.sin(fix[4])
    rxx = fix[2] * c * c + fix[3] * s * s
    ryy = fix[2] * s * s + fix[3] * c * c
    rxy = (fix[2] - fix[3]) * c * s
    full = start.bias * start.bias + start.white * start.white
    cov[X, X] = full * (rxx * rxx + rxy * rxy)
    cov[Y, Y] = full * (ryy * ryy + rxy * rxy)
    cov[X, Y] = full * (rxx * rxy + rxy * ryy)
    cov[Y, X] = cov[X, Y]
    cov[X, GX] = cov[GX, X] = -start.bias * rxx
    cov[X, GY] = cov[GY, X] = -start.bias * rxy
    cov[Y, GX] = cov[GX, Y] = -start.bias * rxy
    cov[Y, GY] = cov[GY, Y] = -start.bias * ryy
    cov[GX, GX] = 1.0
    cov[GY, GY] = 1.0
    cov[H, H] = sigma**2
    cov[K, K] = start.rate_sigma**2
    cov[B, B] = start.drift_sigma**2
    cov[D, D] = lane_sigma(ctx, hyp.edge) ** 2
    mean[MX] = state.map.whole[0]
    mean[MY] = state.map.whole[1]
    cov[MX, MX] = map_variance(state, par)
    cov[MY, MY] = map_variance(state, par)


@entry
def cold_start(
    belief: Belief, path: Path, ctx: Context, fix: Vector, start: Start, total: float
) -> int:
    """Start with every road near a position, both directions, and with none of them.

    Or, for a belief that stands, add all of these as one more possibility.

    A road's prior is the Gaussian mass of the position along it, so that splitting a
    road at nodes changes nothing (the paper draws equal chances per segment).

    Args:
        belief: Normalised where it stands; replaced or added to.
        path: Unchanged; new hypotheses follow the best old one's entry.
        ctx: The drive's constants.
        fix: x, y (plane), sigma_major, sigma_minor (m), heading of the major axis.
        start: What else is known.
        total: Probability of this start; 1 replaces the belief.

    Returns:
        How many roads are near.
    """
    state = belief.state[0]
    parent = belief.hyp[heaviest(belief)].path_entry if state.count > 0 else -1
    towards = belief.hyp[heaviest(belief)].mu[H] if state.count > 0 else 0.0
    kept = 0
    if total < 1.0:
        while state.count > CAPACITY - _HEADINGS:
            drop_lightest(belief)
        kept = int(state.count)
        for i in range(kept):
            rescale(belief.hyp[i], 1.0 - total)
    state.count = kept
    found, towards, beyond = _start_on_roads(belief, ctx, fix, start, towards)
    n = int(state.count)
    mass = 0.0
    for i in range(kept, n):
        mass += math.exp(belief.hyp[i].log_weight)
    off_road = max(ctx.par[0].off_road_start, beyond)
    share = math.log(total * (1.0 - off_road) / mass) if mass > 0.0 else 0.0
    for i in range(kept, n):
        belief.hyp[i].log_weight += share
    _start_off_road(belief, ctx, fix, start, towards, total * (off_road if mass > 0.0 else 1.0))
    for i in range(kept, state.count):
        belief.hyp[i].path_entry = parent
        for a in range(state.parents):
            belief.lineage[i, a] = 0.0
    return found


@kernel(inline=True)
def _start_on_roads(
    belief: Belief, ctx: Context, fix: Vector, start: Start, towards: float
) -> tuple[int, float, float]:
    """Append a hypothesis on each road near.

    Without odometry the heading may be that of an earlier drive: receivers and phones begin so.

    Returns:
        How many are near; the nearest one's heading, or `towards` where there is none; P that it
        is farther off than all of them.
    """
    par = ctx.par[0]
    roads = ctx.roads
    state = belief.state[0]
    known = start.heading_sigma < 10.0
    full = start.bias * start.bias + start.white * start.white
    sigma = math.sqrt(fix[2] ** 2 * full + map_variance(state, par))
    radius = max(par.search_radius, 4.5 * sigma + par.lane_sigma)
    x = fix[0] + state.scale * state.map.whole[0]  # in the map's frame
    y = fix[1] + state.scale * state.map.whole[1]
    found = near(roads, x, y, radius, ctx.work.near)
    for c in range(found):
        edge = ctx.work.near[c].edge
        road = roads.edges[edge]
        segment, s, _, _, _ = project(roads, edge, vertex_at(roads, edge, ctx.work.near[c].s), x, y)
        mass = normal_cdf((road.length - s) / sigma) - normal_cdf(-s / sigma)
        if road.rule & AGAINST_ONE_WAY:
            mass *= par.wrong_way
        if road.rule & NO_ACCESS:
            mass *= _PRIVATE
        if road.service:
            mass *= _SERVICE
        along = chord_heading(roads, edge, segment, min(max(s, 0.0), road.length), HALF_CHORD)
        if c == 0:
            towards = along
        fits = known and abs(wrap(along - start.heading)) <= 4.0 * start.heading_sigma + 0.6
        if known and not fits:
            mass *= _STALE if state.mode == CLOCK else 0.0
        if mass < 1e-9 or state.count >= CAPACITY - 64:
            continue
        hyp = belief.hyp[state.count]
        blank(hyp, edge, segment)
        _fill_start(
            hyp, ctx, fix, start, start.heading if fits else along,
            start.heading_sigma if fits else 0.12, state,
        )  # fmt: skip
        hyp.along, hyp.along_sigma = s, sigma
        own_all(hyp, road.length)
        hyp.log_weight = math.log(mass)
        state.count += 1
    return found, towards, share_beyond(found, ctx.work.near, sigma)


@kernel(inline=True)
def _start_off_road(
    belief: Belief, ctx: Context, fix: Vector, start: Start, towards: float, total: float
) -> None:
    """Append hypotheses on no road, of a total probability; headings fan out where unknown."""
    state = belief.state[0]
    known = start.heading_sigma < 10.0
    free = 1 if known else _HEADINGS
    share = math.log(total / free)
    for a in range(min(free, CAPACITY - state.count)):
        heading = start.heading if known else wrap(towards + 2.0 * math.pi * a / free)
        hyp = belief.hyp[state.count]
        blank(hyp, OFF_ROAD, 0)
        hyp.beside[0] = STARTS
        sigma = start.heading_sigma if known else 0.3
        _fill_start(hyp, ctx, fix, start, heading, sigma, state)
        hyp.log_weight = share
        state.count += 1


@kernel(inline=True)
def exchange_off_road(belief: Belief, ctx: Context) -> None:
    """Off the roads at a small rate per metre, and back on to those near at a larger one."""
    par = ctx.par[0]
    state = belief.state[0]
    metres = state.since_exit
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.edge != OFF_ROAD:
            if hyp.weight > _LEAVES and state.count < CAPACITY:
                share = min(par.off_road_leave * metres, 0.5)
                child = spawn(belief, i, share, OFF_ROAD, hyp.segment)
                rescale(hyp, 1.0 - share)
                leave_for_fixes(belief.hyp[child], state)
                if not state.knows_heading:  # the heading was the road's
                    belief.hyp[child].cov[H, H] += 0.04
        elif hyp.weight > _RETURNS:
            _return_to_roads(belief, ctx, i, min(par.off_road_return * metres, 0.5))
    state.since_exit = 0.0


@kernel(inline=True)
def _return_to_roads(belief: Belief, ctx: Context, i: int, share: float) -> None:
    """Spawn children of off-road hypothesis i on the roads that it may have come back to.

    With wheels, who is on a road that runs beside another does not come back to that one.
    """
    hyp = belief.hyp[i]
    p = hyp.weight
    count = _roads_about(hyp, ctx, belief.state[0].scale)
    total = 0.0
    for c in range(count):
        total += ctx.work.near[c].mass
    given = 0.0
    for c in range(count):
        if belief.state[0].count >= CAPACITY:
            break
        edge = ctx.work.near[c].edge
        part = share * ctx.work.near[c].mass / total
        if ctx.roads.edges[edge].rule & AGAINST_ONE_WAY:
            part *= max(ctx.par[0].wrong_way, 1e-6)
        segment = vertex_at(ctx.roads, edge, ctx.work.near[c].s)
        part *= 1.0 - p_apart(belief, ctx, i, edge, segment)
        part *= p_returns(belief.state[0], float(ctx.roads.edges[edge].speed))
        if part * p < 1e-6:
            continue
        given += part
        child = spawn(belief, i, part, edge, segment)
        new = belief.hyp[child]
        new.p_not_passed = 1.0
        redraw(new, D, lane_mean(ctx, edge), lane_sigma(ctx, edge) ** 2)
    if given > 0.0:
        rescale(hyp, 1.0 - given)


@kernel(inline=True)
def _roads_about(hyp: Record, ctx: Context, scale: float) -> int:
    """List the roads that fit an off-road hypothesis' place and heading, nearest first.

    Their mass is the Gaussian's of the abscissa on them, so that nodes on a road change nothing.
    """
    par = ctx.par[0]
    roads = ctx.roads
    mean = hyp.mu
    cov = hyp.cov
    half = 0.5 * (cov[X, X] - cov[Y, Y])
    worst = 0.5 * (cov[X, X] + cov[Y, Y]) + math.sqrt(half * half + cov[X, Y] ** 2)
    sigma = math.sqrt(worst + 2.0 * par.lane_sigma**2)
    radius = min(max(par.search_radius, 2.5 * sigma), 150.0)
    qx = mean[X] + scale * mean[MX]
    qy = mean[Y] + scale * mean[MY]
    found = near(roads, qx, qy, radius, ctx.work.near)
    heading_sigma = math.sqrt(cov[H, H] + 0.15)
    count = 0
    for c in range(found):
        place = ctx.work.near[c]
        edge = place.edge
        v = vertex_at(roads, edge, place.s)
        along = chord_heading(roads, edge, v, place.s, HALF_CHORD)
        turned = abs(wrap(along - mean[H]))
        _, foot, _, _, _ = project(roads, edge, v, qx, qy)
        along_sigma = max(sigma, _FOOT_SIGMA)
        length = roads.edges[edge].length
        mass = normal_cdf((length - foot) / along_sigma) - normal_cdf(-foot / along_sigma)
        fits = mass > _LEAST_MASS and turned < min(2.5 * heading_sigma, 1.6)
        if fits and place.distance < 3.0 * sigma + 5.0:
            ctx.work.near[count].edge = edge
            ctx.work.near[count].s = place.s
            ctx.work.near[count].mass = mass
            count += 1
    return min(count, _MOST_RETURNS)


@kernel
def _spawn_opposite(belief: Belief, ctx: Context, i: int, share: float) -> None:
    """Spawn a child of hypothesis i on the opposite edge."""
    hyp = belief.hyp[i]
    other = ctx.roads.edges[hyp.edge].opposite
    v = vertex_at(ctx.roads, other, ctx.roads.edges[other].length - hyp.along)
    child = belief.hyp[spawn(belief, i, share, other, v)]
    rescale(hyp, 1.0 - share)
    child.p_not_passed = 1.0
    redraw(child, D, lane_mean(ctx, other), lane_sigma(ctx, other) ** 2)
    child.cov[X, X] += 4.0
    child.cov[Y, Y] += 4.0
    if belief.state[0].mode == CLOCK:
        redraw(child, K, 3.0, 16.0)
        child.mu[H] = wrap(child.mu[H] + math.pi)


@kernel(inline=True)
def turn_round(belief: Belief, ctx: Context, dt: float) -> bool:
    """Without a heading sensor: U-turns between junctions, mostly at low speed.

    Args:
        belief: In place; children are appended.
        ctx: The drive's constants.
        dt: Duration of the epoch, s.

    Returns:
        Whether any turned.
    """
    par = ctx.par[0]
    share = par.u_turn_rate * dt
    speed_scale = 3.0 + par.acceleration_noise * dt  # m/s, at which it is less by exp(−½)
    changed = False
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD or hyp.weight < 0.01 or ctx.roads.edges[hyp.edge].opposite < 0:
            continue
        part = share
        if part * hyp.weight <= _TURNS:
            continue
        if belief.state[0].mode == CLOCK:
            part *= math.exp(-0.5 * (hyp.mu[K] / speed_scale) ** 2)
        if ctx.roads.edges[ctx.roads.edges[hyp.edge].opposite].rule & AGAINST_ONE_WAY:
            part *= 0.01
        part = min(part, 0.2)
        if part * hyp.weight > _TURNS and belief.state[0].count < CAPACITY:
            _spawn_opposite(belief, ctx, i, part)
            changed = True
    return changed


@kernel(inline=True)
def turn_with_heading(belief: Belief, ctx: Context) -> None:
    """With a heading sensor: a vehicle athwart its road may be turning round."""
    roads = ctx.roads
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD or hyp.weight < 1e-4 or roads.edges[hyp.edge].opposite < 0:
            continue
        if hyp.along < HALF_CHORD:  # it has not driven along the road yet: nodes have U-turns
            continue
        s = min(hyp.along, roads.edges[hyp.edge].length)
        along = chord_heading(roads, hyp.edge, hyp.segment, s, HALF_CHORD)
        if abs(wrap(along - hyp.mu[H])) > _ATHWART and belief.state[0].count < CAPACITY:
            _spawn_opposite(belief, ctx, i, 0.1)
