"""Standing beside the roads, between sparse fixes.

A vehicle that comes to stand may have left its road, and stand in a yard or a car park to the
left or to the right.  There it stays where it is: its fixes keep their offset from the road,
which the receiver's error does not.  On the road it may stand as well, and as long.  Who leaves
drives off from the roads beside.
"""

import math

from ..._compile import Record, Vector, kernel
from ...graph.geometry import locate
from ...graph.index import closest_few, vertex_at
from ..gaussian import update_state
from ..gnss.inflation import COARSE
from ..lookback.path_tree import enter
from ..motion import add_across
from ..road import track
from ..state import (
    CAPACITY,
    MX,
    MY,
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
    redraw,
    rescale,
    spawn,
)
from .arrival import ACROSS_SIGMA, HEADING_NOISE, observe_line
from .driver import forget_leg

REST_VARIANCE = 0.02  # (m/s)², of the speed of a vehicle that stands
_SLOW_VARIANCE = 0.5  # (m/s)², of one that is about to

_PARKS = 3  # of those that arrive, that may end beside the road
_BESIDE = 0.08  # P(beside the road) of a vehicle that comes to stand
_ASIDE, _ASIDE_SIGMA = 22.0, 10.0  # m from the road's line, on either side
_ALONG_SIGMA = 10.0  # m along the road
_LEAST = math.log(1e-6)  # weight of those that stand beside a road, over the heaviest
_STOPS, _REMAINS = 30.0, 1800.0  # s, for which vehicles stand in traffic, and else
_BETWEEN_STOPS = 120.0  # s, between two of them
_ELSE = 0.1  # share of the latter
_MOST = 0.97  # P(goes on) from fix to fix at most: who leaves must not be missed,
_PAUSE, _FORGOTTEN = 60.0, 100.0  # s; and after a pause of more than the first

_AWAY = 15.0  # m and three sigmas of the fix, from which on it may have left
_FEW = 2e-4  # least weight of one that leaves
_LEAVES = 0.3  # P that it has; and
_BACK = 0.7  # P that it then drives from one of the roads beside, and not off the roads
_ROADS, _FARTHER = 4, 15.0  # so many, and no m farther than the nearest one,
_RADIUS = 80.0  # m; the nearest one is no farther than this
_STARTS, _START_SIGMA = 4.0, 4.0  # m/s, its mean speed after that


@kernel
def goes_on_standing(stood: float, dt: float) -> float:
    """P that who has stood for some seconds goes on to stand for dt seconds more.

    P(stands longer than τ) = 0.9 exp(−τ / 30 s) + 0.1 exp(−τ / 1800 s), the second for who was seen
    to stand already.
    """
    if stood == 0.0:
        return math.exp(-dt / _STOPS)
    short, long = (1.0 - _ELSE) * math.exp(-stood / _STOPS), _ELSE * math.exp(-stood / _REMAINS)
    goes_on = short * math.exp(-dt / _STOPS) + long * math.exp(-dt / _REMAINS)
    most = _MOST * math.exp(-max(dt - _PAUSE, 0.0) / _FORGOTTEN)
    return min(goes_on / (short + long), most)


@kernel
def comes_to_stand(rate: float, variance: float) -> float:
    """P that a vehicle of some speed (m/s, and its variance) stands."""
    least = math.exp(-0.5 * rate * rate / (variance + _SLOW_VARIANCE))
    return least / math.sqrt(1.0 + variance / _SLOW_VARIANCE)


@kernel
def comes_to_stand_within(dt: float) -> float:
    """P that a vehicle comes to stand in dt seconds, where no fix tells how fast it drives."""
    return 1.0 - math.exp(-dt / _BETWEEN_STOPS)


@kernel(inline=True)
def is_parked(hyp: Record) -> bool:
    """Whether a hypothesis stands beside the roads."""
    return bool(hyp.edge == OFF_ROAD and hyp.stood > 0.0)


@kernel(inline=True)
def most_parked(arrived: int, fix: Vector) -> int:
    """How many of those that arrive may park; a coarse fix does not tell them from the others."""
    return min(arrived, _PARKS) if fix[2] < COARSE else 0


@kernel(inline=True)
def park(belief: Belief, path: Path, ctx: Context, row: int) -> None:
    """Append children of an arriving hypothesis that stand beside its road, on either side.

    Args:
        belief: The row has arrived near a fix, and has not seen it yet.
        path: The tree of edges entered.
        ctx: The drive's constants.
        row: The hypothesis.
    """
    hyp = belief.hyp[row]
    share = 0.5 * _BESIDE * comes_to_stand(hyp.mu[K], hyp.cov[K, K])
    least = belief.hyp[heaviest(belief)].log_weight + _LEAST
    if hyp.log_weight + math.log(max(share, 1e-300)) < least:
        return
    track(belief, ctx.roads, row)
    entry = hyp.path_entry
    if hyp.new_edge == 1:
        entry = enter(path, hyp.edge, entry, belief.state[0].time, 0.0)
    for side in range(2):
        if belief.state[0].count >= CAPACITY:
            return
        child = belief.hyp[spawn(belief, row, share, OFF_ROAD, hyp.segment)]
        child.path_entry = entry
        _put_aside(child, _ASIDE if side == 0 else -_ASIDE, belief.state[0].scale)


@kernel
def _put_aside(hyp: Record, away: float, scale: float) -> None:
    """Let a hypothesis stand some metres to the right of its road.

    It is conditioned on having come to stand: then it has not come as far.
    """
    update_state(hyp.mu, hyp.cov, K, -hyp.mu[K], _SLOW_VARIANCE, scale)
    redraw(hyp, K, 0.0, REST_VARIANCE)
    tx, ty = hyp.tangent[0], hyp.tangent[1]
    hyp.mu[X] += scale * away * ty
    hyp.mu[Y] -= scale * away * tx
    add_across(hyp.cov, _ASIDE_SIGMA * _ASIDE_SIGMA, tx, ty)
    add_across(hyp.cov, _ALONG_SIGMA * _ALONG_SIGMA, -ty, tx)
    hyp.stood = 1.0
    forget_leg(hyp.leg)


@kernel
def leave_parking(belief: Belief, path: Path, ctx: Context, epoch: Record, dt: float) -> None:
    """Where a fix lies away from a parked hypothesis, children of it start from its roads.

    Another child goes off the roads, which then no longer stands.

    Args:
        belief: Normalised; children are appended.
        path: The tree of edges entered.
        ctx: The drive's constants.
        epoch: With the fix.
        dt: s since the last one.
    """
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        if not is_parked(hyp):
            continue
        goes_on = goes_on_standing(hyp.stood, dt)
        hyp.stood += dt
        dx = (epoch.fix[0] - hyp.mu[X]) / state.scale
        dy = (epoch.fix[1] - hyp.mu[Y]) / state.scale
        away = math.hypot(dx, dy) >= _AWAY + 3.0 * epoch.fix[2]
        if not away or hyp.weight < _FEW or state.count >= CAPACITY:
            rescale(hyp, goes_on)  # as one on the road; who leaves comes back to where it was
            continue
        belief.hyp[spawn(belief, i, (1.0 - _BACK) * _LEAVES, OFF_ROAD, hyp.segment)].stood = 0.0
        x = hyp.mu[X] + state.scale * hyp.mu[MX]
        y = hyp.mu[Y] + state.scale * hyp.mu[MY]
        near = ctx.work.near[:_ROADS]
        found = closest_few(ctx.roads, x, y, _RADIUS, _FARTHER, near)
        for c in range(found):
            if state.count < CAPACITY:
                _start_from(belief, path, ctx, i, c, (_BACK * _LEAVES / found, dt))
        rescale(hyp, 1.0 - _LEAVES)


@kernel
def _start_from(
    belief: Belief, path: Path, ctx: Context, i: int, c: int, start: tuple[float, float]
) -> None:
    """Append a child of a parked hypothesis on the road of candidate c: share and s since then."""
    share, dt = start
    edge, s = ctx.work.near[c].edge, ctx.work.near[c].s
    scale = belief.state[0].scale
    segment, cx, cy, tx, ty = locate(ctx.roads, edge, vertex_at(ctx.roads, edge, s), s)
    hyp = belief.hyp[spawn(belief, i, share, edge, segment)]
    mean = hyp.mu
    redraw(hyp, D, lane_mean(ctx, edge), lane_sigma(ctx, edge) ** 2)
    redraw(hyp, H, math.atan2(ty, tx), ctx.par[0].edge_heading_sigma ** 2 + HEADING_NOISE)
    redraw(hyp, K, _STARTS, _START_SIGMA * _START_SIGMA)
    mean[X] = cx + scale * (mean[D] * ty - mean[MX])
    mean[Y] = cy + scale * (-mean[D] * tx - mean[MY])
    add_across(hyp.cov, ACROSS_SIGMA * ACROSS_SIGMA, tx, ty)
    add_across(hyp.cov, _ALONG_SIGMA * _ALONG_SIGMA, -ty, tx)
    observe_line(hyp, ctx, tx, ty, 0.0, scale)
    hyp.stood = 0.0
    forget_leg(hyp.leg)
    hyp.along = s
    hyp.p_not_passed = hyp.travel_variance = 1.0
    hyp.path_entry = enter(path, edge, hyp.path_entry, belief.state[0].time - dt, s)
    hyp.new_edge = 0
