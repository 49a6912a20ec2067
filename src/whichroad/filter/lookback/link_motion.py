"""The process model of a link of the history: motion over all epochs between two steps.

For a link i → j the smoother needs the state of i as predicted for j's step, before anything
was observed there, and F:

    x⁻ = f(xᵢ),   P⁻ = F Pᵢ Fᵀ + Q

The equations and the noise are those of `filter.motion`, `filter.along` (corners) and
`filter.sparse.routing` (routes between sparse fixes).
"""

import math

import numpy as np

from ..._compile import Record, Vector, kernel
from ...graph.geometry import locate, project, wrap
from ...graph.network import Roads
from .._simd import N, add_times, set_times
from ..along import corner_variance
from ..hypotheses.lane_offset import kept_lane
from ..motion import ACROSS, Increment, Noise
from ..slow_states import keep_lane, keep_map
from ..sparse.arrival import ACROSS_SIGMA, HEADING_NOISE
from ..sparse.candidates import heavy_tail, usual_speed
from ..sparse.driven import conditioned, distance_of, driven_by, faster_by
from ..speed_process import speed_process
from ..state import (
    CLOCK,
    GX,
    GY,
    MX,
    MY,
    OFF_ROAD,
    WHEELS,
    B,
    Context,
    D,
    H,
    K,
    Path,
    V,
    X,
    Y,
    lane_mean,
    lane_sigma,
)
from ..weaving import add_weaving
from .history import History
from .link_road import (
    Advance,
    Link,
    add_road_noise,
    keep_heading,
    move_on_road,
    move_with_lane,
    skipped_along,
    weave_on_road,
    wobble,
)
from .packed_noise import unpack_noise

_STRANGE = 16.0  # squared sigmas beyond which something not modelled here moved a state
_PACKED_RATE = K * (K + 3) // 2  # place of the variance of κ in a packed covariance
_STOOD = 0.7  # m/s up to which a vehicle stands that did not move between sparse fixes

LINK_MODEL = np.dtype(
    [
        ("then_mean", "f8", (N,)),  # xᵢ, filtered
        ("then_cov", "f8", (N, N)),  # Pᵢ
        ("f", "f8", (N, N)),  # F
        ("mu", "f8", (N,)),  # x⁻
        ("cov", "f8", (N, N)),  # P⁻
        ("q", "f8", (N,)),  # diagonal of Q
        ("cross", "f8", (N, N)),  # F Pᵢ
        ("root", "f8", (N, N)),  # Cholesky factor of P⁻, scaled, its columns as rows
        ("gain", "f8", (N, N)),  # Gᵀ
        ("scale", "f8"),  # plane metres per true metre
        ("about", "f8"),  # heading of xᵢ about its road's, rad
    ],
    align=True,
)


@kernel(inline=True)
def _propagate(model: Record) -> None:
    """F P and F P Fᵀ + Q; what Q has off the diagonal is in `cov` of the model already."""
    f = model.f
    cov = model.then_cov
    for a in range(N):
        row = model.cross[a]
        set_times(row, f[a, 0], cov[0])
        for c in range(1, N):
            if f[a, c] != 0.0:
                add_times(row, f[a, c], cov[c])
    turned = model.gain
    for a in range(N):
        for b in range(N):
            turned[b, a] = model.cross[a, b]
    for a in range(N):
        row = model.cov[a]
        for c in range(N):
            if f[a, c] != 0.0:
                add_times(row, f[a, c], turned[c])
        row[a] += model.q[a]
    for a in range(N):
        for b in range(a):
            model.cov[a, b] = model.cov[b, a]


@kernel(inline=True)
def predict_link(model: Record, history: History, path: Path, ctx: Context, link: Link) -> None:
    """Predict node i of the step before for node j of a step: x⁻, P⁻ and F Pᵢ of the model.

    Where the motion is not known (a sparse transition whose route is not known, a U-turn
    without a heading sensor, two paths merged) the position is taken as observed anew.
    Later steps do not smooth it; they do smooth the slow states.

    Args:
        model: Holds the filtered state of node i; the rest is filled, but for the gain.
        history: The graph.
        path: The tree of edges entered.
        ctx: The drive's constants.
        link: The link.
    """
    for a in range(N):
        model.q[a] = 0.0
        model.mu[a] = history.states[link.j].mu[a]
        for b in range(N):
            model.f[a, b] = 0.0
            model.cov[a, b] = 0.0
    _decay_slow_states(model, history, ctx, link)
    for a in (B, V):  # nothing moves the spare state; U is the filter's own
        model.f[a, a] = 1.0
        model.mu[a] = model.then_mean[a]
    known = _move(model, history, path, ctx, link)
    _propagate(model)
    if not known:
        _forget_position(model, history, link.j)
    inflate_strange(model, history.states[link.j].mu)


@kernel(inline=True)
def _decay_slow_states(model: Record, history: History, ctx: Context, link: Link) -> None:
    """Lane, map error and GNSS bias: decayed as far as the filter had decayed them."""
    par = ctx.par[0]
    mean = model.then_mean
    motion = history.steps[link.step].motion
    then = history.steps[link.step - 1]
    f = model.f
    q = model.q
    edge = history.nodes[link.j].edge
    then_edge = history.nodes[link.i].edge
    sigma = lane_sigma(ctx, edge)
    kept = keep_lane(par, math.exp(-motion.map_aged / par.lane_length), sigma)
    kept = _kept_lane(ctx, kept, then_edge, edge)
    then_lane = lane_mean(ctx, then_edge) if edge != OFF_ROAD else 0.0
    f[D, D] = kept
    model.mu[D] = lane_mean(ctx, edge) + kept * (mean[D] - then_lane)
    q[D] = (1.0 - kept * kept) * sigma * sigma
    kept = keep_map(par, then.map_rate, motion.map_aged)
    slower = max(1.0, math.sqrt(mean[GX] ** 2 + mean[GY] ** 2) / 3.0)
    gnss_kept = math.exp(-motion.gnss_aged / (par.gnss_time * slower))
    for a in (MX, MY):
        f[a, a] = kept
        model.mu[a] = kept * mean[a] + (1.0 - kept) * then.map_mean[a - MX]
        q[a] = (1.0 - kept * kept) * then.map_factor * par.map_sigma**2
    for a in (GX, GY):
        f[a, a] = gnss_kept
        model.mu[a] = gnss_kept * mean[a]
        q[a] = 1.0 - gnss_kept * gnss_kept + history.nodes[link.j].freed


@kernel
def _kept_lane(ctx: Context, kept: float, then_edge: int, edge: int) -> float:
    """What is kept of the lane offset from one edge to another, `kept` on the same one."""
    if edge == OFF_ROAD:
        return kept if then_edge == OFF_ROAD else 0.0
    if then_edge == OFF_ROAD or ctx.roads.edges[edge].opposite == then_edge:
        return 0.0
    if edge == then_edge:
        return kept
    return kept * kept_lane(_turn_between(ctx.roads, then_edge, edge))


@kernel
def _turn_between(roads: Roads, then_edge: int, edge: int) -> float:
    """Turn from the end of one edge to the start of another, rad."""
    then = roads.edges[then_edge]
    _, _, _, ax, ay = locate(roads, then_edge, then.last_vertex - 1, then.length)
    _, _, _, bx, by = locate(roads, edge, roads.edges[edge].first_vertex, 0.0)
    return math.atan2(ax * by - ay * bx, ax * bx + ay * by)


@kernel
def _change_lane(model: Record, ctx: Context, then_edge: int, edge: int) -> None:
    """Moved across the road from one edge to another, where that has lanes of its own."""
    if then_edge != edge:
        lanes = lane_mean(ctx, then_edge), lane_mean(ctx, edge), lane_sigma(ctx, edge)
        move_with_lane(model, kept_lane(_turn_between(ctx.roads, then_edge, edge)), lanes)


@kernel(inline=True)
def _move(model: Record, history: History, path: Path, ctx: Context, link: Link) -> bool:
    """Position, heading and rate by the motion since the step before; whether it is known."""
    par = ctx.par[0]
    mean = model.then_mean
    motion = history.steps[link.step].motion
    backed = history.nodes[link.i].backs + history.nodes[link.j].backs
    if motion.switched > 0 or backed > 0:  # the motion is that of vehicles that drive on
        return False
    if motion.mode == WHEELS:
        step = Increment(motion.arc, motion.turn, motion.forward, motion.left, motion.clock)
        _move_in_plane(model, motion, step)
        return True
    odometer = motion.arc
    if motion.jumped > 0:
        return _move_on_route(model, history, path, ctx, link)
    edge = history.nodes[link.j].edge
    then = history.nodes[link.i]
    if then.edge == OFF_ROAD:
        _move_in_plane(model, motion, Increment(odometer, 0.0, odometer, 0.0, odometer))
        return True
    skipped = -1.0
    if edge != OFF_ROAD:
        skipped, _ = skipped_along(ctx.roads, path, history, link)
    if skipped < 0.0:
        return False
    distance = odometer * mean[K]
    advance = Advance(then.edge, then.segment, edge, skipped, distance, odometer)
    if motion.drawn == 2:
        _weave(model, history, ctx, link, advance)
        return True
    bent = move_on_road(model, ctx.roads, advance, True)
    along = motion.road_noise[0] + corner_variance(bent)
    across, usual = ACROSS * abs(distance), par.edge_heading_sigma**2
    rate, cross = motion.road_noise[2], motion.road_noise[1]
    add_road_noise(model, Noise(along, across, usual, rate, 0.0, cross))
    _change_lane(model, ctx, then.edge, edge)
    if motion.drawn and motion.mode == CLOCK:
        wobble(model, advance, bent, history.steps[link.step].about_road)
    elif not motion.drawn:
        keep_heading(model, history, ctx.roads, link)
    return True


@kernel(inline=True)
def _weave(model: Record, history: History, ctx: Context, link: Link, advance: Advance) -> None:
    """Moved by the heading between fine and frequent fixes; the lane moves nobody."""
    motion = history.steps[link.step].motion
    variance = history.steps[link.step].about_road
    weave_on_road(model, ctx.roads, advance)
    noise = motion.road_noise
    across = ACROSS * abs(advance.distance)
    add_road_noise(model, Noise(noise[0], across, 0.0, noise[2], 0.0, noise[1]))
    tangent = math.cos(model.mu[H]), math.sin(model.mu[H])
    add_weaving(model.cov, tangent, advance.distance, variance)
    wobble(model, advance, 0.0, variance)
    if advance.then_edge != advance.edge:
        model.q[D] += (lane_mean(ctx, advance.edge) - lane_mean(ctx, advance.then_edge)) ** 2


@kernel(inline=True)
def _move_in_plane(model: Record, motion: Record, step: Increment) -> None:
    """Moved in the plane, as `motion.predict_plane` does epoch by epoch; Q is what it added."""
    mean = model.then_mean
    c = math.cos(mean[H])
    s = math.sin(mean[H])
    kappa = mean[K]
    bx = kappa * (c * motion.lever_forward - s * motion.lever_left)
    by = kappa * (s * motion.lever_forward + c * motion.lever_left)
    rx = c * step.forward - s * step.left
    ry = s * step.forward + c * step.left
    dx = kappa * rx + mean[B] * bx
    dy = kappa * ry + mean[B] * by
    f = model.f
    f[X, X] = 1.0
    f[Y, Y] = 1.0
    f[H, H] = 1.0
    f[K, K] = 1.0
    f[X, H] = -dy
    f[Y, H] = dx
    f[X, K] = rx
    f[Y, K] = ry
    f[X, B] = bx
    f[Y, B] = by
    f[H, B] = step.clock
    model.mu[X] = mean[X] + model.scale * dx
    model.mu[Y] = mean[Y] + model.scale * dy
    model.mu[H] = wrap(mean[H] + step.turn + mean[B] * step.clock)
    model.mu[K] = mean[K]
    unpack_noise(motion.plane_noise, c, s, model.cov)


@kernel(inline=True)
def _move_on_route(model: Record, history: History, path: Path, ctx: Context, link: Link) -> bool:
    """Moved along a route between sparse fixes (`filter.sparse.routing`); whether that is known."""
    par = ctx.par[0]
    mean = model.then_mean
    cov = model.then_cov
    dt = history.steps[link.step].motion.arc
    edge = history.nodes[link.j].edge
    then = history.nodes[link.i]
    skipped = -1.0
    time = 0.0
    if edge != OFF_ROAD and then.edge != OFF_ROAD:
        skipped, time = skipped_along(ctx.roads, path, history, link)
    if skipped < 0.0:
        return False
    if _stood(model, history, link):
        _keep_standing(model, history.states[link.j], par)
        return True
    later = history.states[link.j].mu
    x, y = later[X] + model.scale * later[MX], later[Y] + model.scale * later[MY]
    _, to, _, _, _ = project(ctx.roads, edge, history.nodes[link.j].segment, x, y)
    step = history.steps[link.step]
    free = speed_process(dt, step.speed_sigma)
    driven = driven_by(free, dt, step.motion.driven[0], step.motion.driven[1], 0.0)
    keep, old, far, cross, sigma = conditioned(driven)
    usual = history.nodes[link.j].pace * usual_speed(ctx.roads, skipped, time, edge, to)
    distance = distance_of(driven, usual, mean[K])
    advance = Advance(then.edge, then.segment, edge, skipped, distance, old)
    move_on_road(model, ctx.roads, advance, False)
    nx = math.cos(model.mu[H])
    ny = math.sin(model.mu[H])
    off = (nx * (later[X] - model.mu[X]) + ny * (later[Y] - model.mu[Y])) / model.scale
    variance = far + cov[X, X] + cov[Y, Y] + old * old * cov[K, K]
    heavy = heavy_tail(variance, off, 0.0) - variance
    harder = 1.0 + heavy / max(free.variance, 1.0)
    rate = (1.0 - keep * keep) * sigma * sigma * harder
    heading = par.edge_heading_sigma**2 + HEADING_NOISE
    across = ACROSS_SIGMA * ACROSS_SIGMA
    add_road_noise(model, Noise(far + heavy, across, heading, rate, 0.0, cross * harder))
    model.f[K, K] = keep
    model.mu[K] = usual + keep * (mean[K] - usual) + faster_by(driven, usual, mean[K])
    return True


@kernel
def _stood(model: Record, history: History, link: Link) -> bool:
    """Whether the vehicle stood between two sparse fixes."""
    mean = model.then_mean
    cov = model.then_cov
    scale = model.scale
    later = history.states[link.j].mu
    rate = history.states[link.j].cov[_PACKED_RATE]
    away = (later[X] - mean[X]) ** 2 + (later[Y] - mean[Y]) ** 2
    here = away < scale * scale * (cov[X, X] + cov[Y, Y])
    same = history.nodes[link.i].edge == history.nodes[link.j].edge
    return bool(same and here and abs(later[K]) < _STOOD and rate < 1.0)


@kernel
def _keep_standing(model: Record, later: Record, par: Record) -> None:
    """Not moved; the rate is that of the node j."""
    q = model.q
    for a in (X, Y):
        model.f[a, a] = 1.0
        model.mu[a] = model.then_mean[a]
        q[a] = 0.1
    q[H] = par.edge_heading_sigma**2
    q[K] = later.cov[_PACKED_RATE]
    model.mu[K] = later.mu[K]


@kernel(inline=True)
def _forget_position(model: Record, history: History, j: int) -> None:
    """Position, heading and rate are independent of the step before."""
    for a in (X, Y, H, K):
        for b in range(N):
            model.cov[a, b] = 0.0
            model.cov[b, a] = 0.0
            model.cross[a, b] = 0.0
    for a in (X, Y, H, K):
        model.cov[a, a] = history.states[j].cov[a * (a + 3) // 2]


@kernel(inline=True)
def inflate_strange(model: Record, later: Vector) -> None:
    """More variance for a state far from its prediction: something else moved it.

    Gains are not below 1: without it the smoothed state would grow from step to step.

    Args:
        model: With P⁻, in place.
        later: The state of node j, as filtered or smoothed.
    """
    for a in range(N):
        off = later[a] - model.mu[a]
        if a == H:
            off = wrap(off)
        if a <= Y:
            off /= model.scale
        if off * off > _STRANGE * model.cov[a, a]:
            model.cov[a, a] += off * off
