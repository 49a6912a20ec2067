"""How a hypothesis arrives at the end of its route between two sparse fixes."""

import math
from typing import NamedTuple

from ..._compile import Record, kernel
from ...graph.geometry import locate, project, wrap
from ...graph.index import vertex_at
from ...graph.labels import Search
from .._simd import N
from ..gaussian import condition
from ..hypotheses.lane_offset import redraw_lane
from ..motion import Noise, add_across, predict_road
from ..road import track
from ..slow_states import age_map, decay
from ..speed_process import SpeedProcess
from ..state import (
    MX,
    MY,
    NO_BOUND,
    NO_EDGE,
    Belief,
    Context,
    D,
    H,
    K,
    Path,
    X,
    Y,
    enter,
    lane_mean,
    lane_sigma,
    move_row,
    redraw,
)
from .candidates import (
    SparseFix,
    heavy_tail,
    on_map,
    trusting,
    usual_speed,
    variance_along,
)
from .competitors import weigh_rivals
from .driven import distance_of, faster_by

ACROSS_SIGMA = 30.0  # m, across the road before the road is observed
HEADING_NOISE = 0.02  # rad², of a vehicle's heading about its road's after a transition

_UNSURE = 0.2  # of the weight of all other ways over its own, which tells no odometer's scale
_FOOT_VARIANCE = 100.0  # m², of the fix's foot where the tangent is taken


class Transition(NamedTuple):
    """What a hypothesis drives along its route, by its speed."""

    length: float  # of the route, from the abscissa now to the start of the last edge, m
    turn: float  # sum of turns, rad
    usual: float  # likely average speed, m/s
    free: float  # usual speed of its roads, m/s
    along: float  # abscissa on the last edge, m
    variance: float  # of the abscissa, m²
    faster: float  # m/s, by which the odometer shows it faster than that at the end
    noise: float  # process noise along the road, m²
    inflation: float  # of the speed's variance: the vehicle braked or hurried more than usual


class Drive(NamedTuple):
    """When a route was driven, and how sure it is."""

    since: float  # s
    seconds: float
    metres: float
    share: float  # of all likely routes between the same two fixes


class Foot(NamedTuple):
    """A point of an edge, and its tangent."""

    s: float  # m
    x: float  # m, plane
    y: float
    tx: float
    ty: float


@kernel
def observe_line(
    hyp: Record, ctx: Context, tx: float, ty: float, behind: float, scale: float
) -> None:
    """Condition on the road's line; `behind` is d less the lateral offset, m."""
    row = ctx.work.row
    for j in range(N):
        row[j] = 0.0
    row[X] = ty
    row[Y] = -tx
    row[MX] = ty
    row[MY] = -tx
    row[D] = -1.0
    condition(hyp.mu, hyp.cov, row, behind, ctx.par[0].relative_sigma ** 2, scale)


@kernel(inline=True)
def _transition(
    hyp: Record, ctx: Context, pair: Record, tx: float, ty: float, fix: SparseFix
) -> Transition:
    """How far a hypothesis comes along the route of a pair."""
    near = ctx.work.near[pair.goal]
    entry = ctx.work.search.label[max(pair.label, 0)]
    if pair.label >= 0:
        length = entry.length
        turn = entry.turn
        usual = usual_speed(ctx.roads, length, entry.time, near.edge, near.s)
    else:
        length = -hyp.along
        turn = 0.0
        usual = usual_speed(ctx.roads, 0.0, 0.0, near.edge, 0.0)
    free = usual
    usual *= fix.pace
    along = distance_of(fix.driven, usual, hyp.mu[K]) - length
    faster = faster_by(fix.driven, usual, hyp.mu[K])
    variance = variance_along(hyp, tx, ty, fix.process)
    heavy = heavy_tail(variance, near.s - along, fix.jitter) - variance
    return Transition(
        length, turn, usual, free, along, variance + heavy, faster,
        fix.process.variance + heavy, 1.0 + heavy / max(fix.driven.free.variance, 1.0),
    )  # fmt: skip


@kernel(inline=True)
def _foot(
    hyp: Record, state: Record, ctx: Context, goal: int, transition: Transition, fix: SparseFix
) -> Foot:
    """The point of a candidate between the fix's foot and where the speed has the vehicle.

    The hypothesis gets its segment.
    """
    near = ctx.work.near[goal]
    x, y = on_map(hyp, state, fix.x, fix.y, fix.bias_keep)
    at = vertex_at(ctx.roads, near.edge, near.s)
    segment, s, _, _, _ = project(ctx.roads, near.edge, at, x, y)
    weight = transition.variance / (transition.variance + _FOOT_VARIANCE)
    s = transition.along + weight * (s - transition.along)
    s = min(max(s, 0.0), ctx.roads.edges[near.edge].length)
    segment, cx, cy, tx, ty = locate(ctx.roads, near.edge, segment, s)
    hyp.segment = segment
    return Foot(s, cx, cy, tx, ty)


@kernel(inline=True)
def predict_transition(
    hyp: Record,
    ctx: Context,
    transition: Transition,
    foot: Foot,
    before: float,
    process: SpeedProcess,
) -> None:
    """Move the covariance along the road, and let the speed decay to the usual one.

    `before` is the road's heading where the vehicle was, rad.
    """
    mean = hyp.mu
    cov = hyp.cov
    variance = ctx.par[0].edge_heading_sigma ** 2 + HEADING_NOISE
    noise = Noise(transition.noise, 0.0, variance, 0.0, 0.0, 0.0)
    heading = math.atan2(foot.ty, foot.tx)
    bend = wrap(heading - before)
    predict_road(cov, process.distance_by_speed, bend, foot.tx, foot.ty, noise)
    redraw(hyp, H, heading, noise.heading)
    speed = process.sigma * process.sigma * transition.inflation
    decay(mean, cov, K, transition.usual, process.keep, speed)
    mean[K] = max(mean[K] + transition.faster, 0.0)
    cross = process.cross * transition.inflation
    cov[X, K] += cross * foot.tx
    cov[Y, K] += cross * foot.ty
    cov[K, X] = cov[X, K]
    cov[K, Y] = cov[Y, K]


@kernel(inline=True)
def place_on_road(
    hyp: Record, state: Record, ctx: Context, transition: Transition, foot: Foot, edge: int
) -> None:
    """Age the slow states over the route, and put the vehicle on the road's line."""
    mean = hyp.mu
    scale = state.scale
    lane = lane_mean(ctx, edge)
    sigma = lane_sigma(ctx, edge)
    if edge != hyp.edge:
        redraw_lane(mean, hyp.cov, transition.turn, lane_mean(ctx, hyp.edge), lane, sigma)
    metres = max(foot.s + transition.length, 0.0)
    age_map(mean, hyp.cov, ctx.par[0], state.map, metres, lane, sigma)
    add_across(hyp.cov, ACROSS_SIGMA * ACROSS_SIGMA, foot.tx, foot.ty)
    ahead = transition.along - foot.s
    mean[X] = foot.x + scale * (mean[D] * foot.ty - mean[MX] + ahead * foot.tx)
    mean[Y] = foot.y + scale * (-mean[D] * foot.tx - mean[MY] + ahead * foot.ty)
    observe_line(hyp, ctx, foot.tx, foot.ty, 0.0, scale)


@kernel(inline=True)
def _note_leg(hyp: Record, state: Record, transition: Transition, fix: SparseFix) -> None:
    """Note what a hypothesis has driven since the last fix."""
    leg = hyp.leg
    leg.at = state.time
    leg.seconds = fix.dt
    leg.length = transition.length
    leg.free = transition.free
    leg.driven = fix.driven.metres if fix.driven.gain > 0.0 else -1.0
    leg.driven_variance = fix.driven.variance


@kernel(inline=True)
def arrive(belief: Belief, path: Path, ctx: Context, p: int, fix: SparseFix) -> None:
    """Append a child of a pair's hypothesis that has taken its route."""
    state = belief.state[0]
    pair = ctx.work.search.pair[p]
    edge = ctx.work.near[pair.goal].edge
    track(belief, ctx.roads, pair.source)
    child = int(state.count)
    move_row(belief, pair.source, child)
    hyp = belief.hyp[child]
    tx, ty = hyp.tangent[0], hyp.tangent[1]
    hyp.leg.variance = hyp.along_sigma**2
    hyp.leg.begun = hyp.mu[K] * fix.driven.free.distance_by_speed
    length = ctx.work.search.label[pair.label].length if pair.label >= 0 else -hyp.along
    seen = trusting(fix, length + ctx.work.near[pair.goal].s, hyp.along_sigma**2)
    transition = _transition(hyp, ctx, pair, tx, ty, seen)
    foot = _foot(hyp, state, ctx, pair.goal, transition, seen)
    predict_transition(hyp, ctx, transition, foot, math.atan2(ty, tx), seen.process)
    place_on_road(hyp, state, ctx, transition, foot, edge)
    _note_leg(hyp, state, transition, fix)
    hyp.log_weight -= pair.cost
    hyp.edge = edge
    hyp.before = NO_EDGE
    hyp.p_not_passed = 1.0
    hyp.bound = NO_BOUND
    hyp.travel_variance = max(transition.variance - hyp.along_sigma**2, 1.0)
    hyp.along = foot.s
    hyp.stood = 0.0
    if pair.label >= 0:
        hyp.new_edge = 1
        metres = max(foot.s + transition.length, 0.0)
        against = weigh_rivals(belief, ctx, p, fix)
        if against > _UNSURE:
            hyp.leg.driven = -1.0
        drive = Drive(state.time - fix.dt, fix.dt, metres, 1.0 / (1.0 + against))
        enter_route(hyp, path, ctx.work.search, pair.label, drive)
    state.count = child + 1


@kernel
def enter_route(hyp: Record, path: Path, search: Search, label: int, drive: Drive) -> None:
    """Enter the edges between two fixes in the path tree, with times by the distance."""
    chain = 0
    up = search.label[label].parent
    while up >= 0:
        chain += 1
        up = search.label[up].parent
    for back in range(chain, 0, -1):
        up = label
        for _ in range(back):
            up = search.label[up].parent
        entry = search.label[up]
        part = min(max(entry.length / max(drive.metres, 1.0), 0.0), 1.0)
        passed = 1.0 / (1.0 + entry.against)
        when = drive.since + part * drive.seconds
        hyp.path_entry = enter(path, entry.edge, hyp.path_entry, when, 0.0, passed, drive.share)
