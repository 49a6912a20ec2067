"""How a hypothesis came from one of the step before: the motion again, for looking back.

For a link i → j of the memory, the state of i as predicted for j's step, before anything
was observed there,

    x⁻ = f(xᵢ),   P⁻ = F Pᵢ Fᵀ + Q

by the same equations as in `core.motion`, and F, which the smoother needs too.
"""

import math

from ._jit import Matrix, Vector, kernel, part
from .along import _ACROSS, _CORNER_DOUBT
from .angles import wrap
from .belief import GX, GY, MX, MY, OFF_ROAD, B, D, H, K, N, Route, X, Y
from .epoch import CLOCK, WHEELS
from .gain import Bench, spread_forward
from .memory import (
    ARC,
    FORWARD,
    GNSS_AGED,
    JUMPED,
    LEFT,
    LEVER_FORWARD,
    LEVER_LEFT,
    MAP_AGED,
    METRES,
    SWUNG,
    TURN,
    Memory,
)
from .network import Roads, lane_sigma_of
from .parameters import Parameters
from .retrace import follow, gone_along, noise_along, retrace_travel
from .segment import locate

_STRANGE = 16.0  # squared sigmas beyond which a state moved by what is not modelled here


@kernel
def _turn_between(roads: Roads, then_edge: int, edge: int) -> float:
    """Turn from the end of one edge to the start of another, rad."""
    last = roads.first[then_edge + 1] - 2
    _, _, _, ax, ay = locate(roads, then_edge, last, roads.length[then_edge])
    _, _, _, bx, by = locate(roads, edge, roads.first[edge], 0.0)
    return math.atan2(ax * by - ay * bx, ax * bx + ay * by)


@part
def _slow_states(
    bench: Bench, mean: Vector, memory: Memory, step: int, roads: Roads, then_edge: int,
    edge: int, side: float, par: Parameters, q: Vector,
) -> None:  # fmt: skip
    """Lane, map and receiver: decayed as far as the filter had decayed them."""
    past = memory.past[step]
    f = bench.f
    kept = math.exp(-past[MAP_AGED] / par.lane_length)
    lane = side * roads.lane[edge] if edge != OFF_ROAD else 0.0
    then_lane = side * roads.lane[then_edge] if then_edge != OFF_ROAD else 0.0
    sigma = lane_sigma_of(roads, edge, par.lane_sigma) if edge != OFF_ROAD else par.lane_sigma
    if edge != then_edge:
        if then_edge == OFF_ROAD or (edge != OFF_ROAD and roads.opposite[edge] == then_edge):
            kept = 0.0
        elif edge != OFF_ROAD:
            kept *= max(math.cos(_turn_between(roads, then_edge, edge)), 0.0)
        else:
            lane = 0.0
            then_lane *= 0.0
    f[D, D] = kept
    bench.mean[D] = lane + kept * (mean[D] - then_lane)
    q[D] = (1.0 - kept * kept) * sigma * sigma
    kept = math.exp(-past[MAP_AGED] / par.map_length)
    slower = max(1.0, math.sqrt(mean[GX] ** 2 + mean[GY] ** 2) / 3.0)
    gnss_kept = math.exp(-past[GNSS_AGED] / (par.gnss_time * slower))
    for a in (MX, MY):
        f[a, a] = kept
        bench.mean[a] = kept * mean[a]
        q[a] = (1.0 - kept * kept) * par.map_sigma**2
    for a in (GX, GY):
        f[a, a] = gnss_kept
        bench.mean[a] = gnss_kept * mean[a]
        q[a] = 1.0 - gnss_kept * gnss_kept


@kernel
def _rolled(
    bench: Bench, mean: Vector, past: Vector, forward: float, left: float, turn: float,
    scale: float, q: Vector,
) -> None:  # fmt: skip
    """Moved in the plane (`motion.predict_free`); q holds the variances along, across."""
    c = math.cos(mean[H])
    s = math.sin(mean[H])
    kappa = mean[K]
    bx = kappa * (c * past[LEVER_FORWARD] - s * past[LEVER_LEFT])
    by = kappa * (s * past[LEVER_FORWARD] + c * past[LEVER_LEFT])
    rx = c * forward - s * left
    ry = s * forward + c * left
    dx = kappa * rx + mean[B] * bx
    dy = kappa * ry + mean[B] * by
    f = bench.f
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
    f[H, B] = past[ARC]
    bench.mean[X] = mean[X] + scale * dx
    bench.mean[Y] = mean[Y] + scale * dy
    bench.mean[H] = wrap(mean[H] + turn + mean[B] * past[ARC])
    bench.mean[K] = mean[K]
    along = q[X]
    across = q[Y]
    bench.cov[X, Y] = (along - across) * c * s
    q[X] = along * c * c + across * s * s
    q[Y] = along * s * s + across * c * c


@part
def predict_link(
    bench: Bench, q: Vector, memory: Memory, roads: Roads, route: Route, step: int, i: int,
    j: int, mean: Vector, cov: Matrix, mode: int, scale: float, side: float, par: Parameters,
) -> None:  # fmt: skip
    """Predict node i of the step before for node j of a step.

    Where the motion is not known (routes between fixes far apart, a U-turn without a heading
    sensor, two routes merged) the
    position is taken as told anew: nothing of it is learnt from what came later, but the
    slow errors go on.

    Args:
        bench: Its f, mean, cov and cross are filled.
        q: Scratch, (N,).
        memory: The graph.
        roads: The network.
        route: Its tree of edges.
        step: The step of j.
        i: Node of the step before.
        j: Node.
        mean: Filtered state of i, (N,).
        cov: Its covariance, (N, N).
        mode: WHEELS, DISTANCE or CLOCK.
        scale: Local scale of the plane.
        side: 1 where one drives on the right, −1 on the left.
        par: The settings.
    """
    past = memory.past[step]
    edge = memory.edge[j]
    then_edge = memory.edge[i]
    for a in range(N):
        q[a] = 0.0
        bench.mean[a] = memory.mean[j, a]
        for b in range(N):
            bench.f[a, b] = 0.0
            bench.cov[a, b] = 0.0
    _slow_states(bench, mean, memory, step, roads, then_edge, edge, side, par, q)
    metres = past[METRES]
    bench.f[B, B] = 1.0
    bench.mean[B] = mean[B]
    known = True
    if mode == WHEELS:
        q[X] = par.along_noise**2 * metres
        q[Y] = par.lateral_noise**2 * metres
        q[H] = par.heading_noise**2 * metres + par.turn_noise**2 * 0.5 * math.pi * past[SWUNG]
        q[K] = 1e-10 * metres
        q[B] = par.yaw_bias_noise**2 * metres
        _rolled(bench, mean, past, past[FORWARD], past[LEFT], past[TURN], scale, q)
    else:
        odometer = past[ARC]
        if mode == CLOCK:
            q[K] = par.acceleration_noise**2 * odometer
            q[X] = q[K] * odometer * odometer / 3.0 + 0.01 * odometer
            q[Y] = 0.5 * q[K] * odometer  # with κ
            q[H] = 0.09 * odometer
        else:
            q[K] = 1e-10 * metres
            q[X] = (3.0 * par.along_noise) ** 2 * metres
            q[H] = 0.0025 * metres
        if past[JUMPED] > 0.0:
            known = retrace_travel(
                bench, memory, roads, route, i, j, mean, cov, odometer, scale, par, q
            )
        elif then_edge == OFF_ROAD:
            q[Y] = 0.25 * q[X]
            _rolled(bench, mean, past, odometer, 0.0, 0.0, scale, q)
        else:
            gone = -1.0
            if edge != OFF_ROAD:
                gone, _ = gone_along(roads, route, edge, memory.tree[j], then_edge, memory.tree[i])
            known = gone >= 0.0
            if known:
                bent = follow(
                    bench, mean, roads, then_edge, memory.segment[i], edge, gone,
                    odometer * mean[K], odometer, True, scale, q,
                )  # fmt: skip
                noise_along(
                    bench, q[X] + (_CORNER_DOUBT * bent) ** 2, _ACROSS * abs(odometer * mean[K]),
                    q[Y], par.edge_heading_sigma**2, q,
                )  # fmt: skip
    spread_forward(bench, q, cov)
    if not known:
        _anew(bench, memory, j)
    _doubt(bench, memory, j, scale)


@part
def _anew(bench: Bench, memory: Memory, j: int) -> None:
    """Position, heading and rate owe nothing to the step before."""
    for a in (X, Y, H, K):
        for b in range(N):
            bench.cov[a, b] = 0.0
            bench.cov[b, a] = 0.0
            bench.cross[a, b] = 0.0
    for a in (X, Y, H, K):
        bench.cov[a, a] = memory.cov[j, a * (a + 3) // 2]


@part
def _doubt(bench: Bench, memory: Memory, j: int, scale: float) -> None:
    """A state that is far from what was predicted was moved by something else: be as unsure."""
    for a in range(N):
        off = memory.mean[j, a] - bench.mean[a]
        if a == H:
            off = wrap(off)
        if a <= Y:
            off /= scale
        if off * off > _STRANGE * bench.cov[a, a]:
            bench.cov[a, a] += off * off
