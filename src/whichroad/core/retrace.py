"""The way along the roads from a hypothesis to one of the next step, for looking back."""

import math

from ._jit import Matrix, Vector, kernel, part
from .along import _CORNER, _CORNER_RADIUS
from .angles import wrap
from .belief import MX, MY, OFF_ROAD, H, K, Route, X, Y
from .gain import Bench
from .legs import SPEED_SIGMA, heavy_tail, spread_of, usual_speed
from .memory import Memory
from .network import Roads
from .parameters import Parameters
from .segment import locate, project
from .travel import WIDE

_HOPS = 256  # nodes of the route tree between two steps, at most
_STOOD = 0.7  # m/s and less: it stands, since the last fix if it has not moved


@kernel
def gone_along(
    roads: Roads, route: Route, edge: int, node: int, then_edge: int, then_node: int
) -> tuple[float, float]:
    """Metres and seconds from the start of the edge of then to the start of the edge of now.

    Along the route tree; negative where it does not tell.
    """
    if edge == then_edge:
        return 0.0, 0.0
    total = 0.0
    time = 0.0
    for _ in range(_HOPS):
        node = int(route.parent[node]) if node >= 0 else -1
        if node < 0:
            break
        at = route.edge[node]
        if at == OFF_ROAD or roads.opposite[edge] == at:
            break
        total += roads.length[at]
        time += roads.length[at] / max(roads.speed[at], 1.0)
        if node == then_node or at == then_edge:
            return float(total), float(time)
        edge = at
    return -1.0, 0.0


@kernel
def follow(
    bench: Bench, mean: Vector, roads: Roads, then_edge: int, then_segment: int, edge: int,
    gone: float, distance: float, odometer: float, smooth: bool, scale: float, q: Vector,
) -> float:  # fmt: skip
    """Moved a distance along the road (`motion.predict_along`), its derivative by κ given.

    Fills F and the mean; q[X], q[Y] and q[H] are left alone.  `smooth`: corners are cut.
    Returns the turn of a corner.
    """
    qx = mean[X] + scale * mean[MX]
    qy = mean[Y] + scale * mean[MY]
    _, s, across, tx, ty = project(roads, then_edge, then_segment, qx, qy)
    s += distance - gone
    at = roads.first[edge]
    at, cx, cy, nx, ny = locate(roads, edge, at, s)
    heading = math.atan2(ny, nx)
    turn = wrap(heading - math.atan2(ty, tx))
    bent = min(abs(turn), 1.6)
    if smooth and bent > _CORNER:
        s += _CORNER_RADIUS * (2.0 * math.tan(0.5 * bent) - bent)
        at, cx, cy, nx, ny = locate(roads, edge, at, s)
    c = math.cos(turn)
    sine = math.sin(turn)
    f = bench.f
    f[X, X] = c
    f[X, Y] = -sine
    f[Y, X] = sine
    f[Y, Y] = c
    f[X, MX] = c - 1.0
    f[X, MY] = -sine
    f[Y, MX] = sine
    f[Y, MY] = c - 1.0
    f[X, K] = nx * odometer
    f[Y, K] = ny * odometer
    f[K, K] = 1.0
    bench.mean[X] = cx + across * ny - scale * mean[MX]
    bench.mean[Y] = cy - across * nx - scale * mean[MY]
    bench.mean[H] = heading
    bench.mean[K] = mean[K]
    return bent


@kernel
def noise_along(
    bench: Bench, along: float, beside: float, with_rate: float, heading: float, q: Vector
) -> None:
    """Variances along and across the new heading, and the covariance of the first with κ."""
    nx = math.cos(bench.mean[H])
    ny = math.sin(bench.mean[H])
    cov = bench.cov
    cov[X, Y] = (along - beside) * nx * ny
    cov[X, K] = with_rate * nx
    cov[Y, K] = with_rate * ny
    q[X] = along * nx * nx + beside * ny * ny
    q[Y] = along * ny * ny + beside * nx * nx
    q[H] = heading


@part
def retrace_travel(
    bench: Bench, memory: Memory, roads: Roads, route: Route, i: int, j: int, mean: Vector,
    cov: Matrix, dt: float, scale: float, par: Parameters, q: Vector,
) -> bool:  # fmt: skip
    """Moved along a route between fixes far apart (`core.travel`); whether that is known."""
    edge = memory.edge[j]
    then_edge = memory.edge[i]
    if edge == OFF_ROAD or then_edge == OFF_ROAD:
        return False
    gone, time = gone_along(roads, route, edge, memory.tree[j], then_edge, memory.tree[i])
    if gone < 0.0:
        return False
    then = memory.mean[j]
    rate = memory.cov[j, K * (K + 3) // 2]
    away = (then[X] - mean[X]) ** 2 + (then[Y] - mean[Y]) ** 2
    here = away < scale * scale * (cov[X, X] + cov[Y, Y])
    if edge == then_edge and here and abs(then[K]) < _STOOD and rate < 1.0:
        for a in (X, Y):
            bench.f[a, a] = 1.0
            bench.mean[a] = mean[a]
            q[a] = 0.1
        q[H] = par.edge_heading_sigma**2
        q[K] = rate
        bench.mean[K] = then[K]
        return True
    keep, old, far, cross = spread_of(dt)
    usual = usual_speed(roads, gone, time, edge)
    distance = usual * (dt - old) + mean[K] * old
    follow(
        bench, mean, roads, then_edge, memory.segment[i], edge, gone, distance, old, False,
        scale, q,
    )  # fmt: skip
    nx = math.cos(bench.mean[H])
    ny = math.sin(bench.mean[H])
    off = (nx * (then[X] - bench.mean[X]) + ny * (then[Y] - bench.mean[Y])) / scale
    variance = far + cov[X, X] + cov[Y, Y] + old * old * cov[K, K]
    heavy = heavy_tail(variance, off, 0.0) - variance
    harder = 1.0 + heavy / max(far, 1.0)
    noise_along(
        bench, far + heavy, WIDE * WIDE, cross * harder, par.edge_heading_sigma**2 + 0.02, q
    )
    bench.f[K, K] = keep
    bench.mean[K] = usual + keep * (mean[K] - usual)
    q[K] = (1.0 - keep * keep) * SPEED_SIGMA * SPEED_SIGMA * harder
    return True
