"""How a hypothesis moves: by its wheels in the plane, or along its road."""

import math

from ._jit import Matrix, Vector, kernel
from .angles import wrap
from .belief import GX, GY, MX, MY, B, D, H, K, N, X, Y
from .rows import add_times, scale_by, set_times, set_to, ten


@kernel
def arc_chord(arc: float, turn: float) -> tuple[float, float]:
    """Displacement of M in its own frame after an arc (equation 1).

    The paper takes the arc for its chord; the chord is arc · sin(δθ/2)/(δθ/2):

        u = chord · (cos δθ/2, sin δθ/2)

    Args:
        arc: δs, m, negative in reverse.
        turn: δθ, rad.

    Returns:
        Forward and leftward displacement, m.
    """
    half = 0.5 * turn
    chord = arc * (1.0 - half * half / 6.0) if abs(half) < 1e-4 else arc * math.sin(half) / half
    return chord * math.cos(half), chord * math.sin(half)


@kernel
def predict_free(
    mean: Vector,
    cov: Matrix,
    forward: float,
    left: float,
    turn: float,
    arc: float,
    scale: float,
    q_along: float,
    q_across: float,
    q_heading: float,
    q_rate: float,
    q_drift: float,
) -> None:
    """Move a hypothesis by an increment in its own frame (equation 1, with calibration).

        v   = u + (b δs / 2) J u            drift turns the increment by half
        p⁺  = p + κ R(θ) v
        θ⁺  = θ + δθ + b δs
        P⁺  = F P Fᵀ + Q

    Args:
        mean: State, (N,), in place.
        cov: Covariance, (N, N), in place.
        forward: Increment u along the heading, odometer metres (or seconds).
        left: Increment across it.
        turn: δθ, rad.
        arc: δs, odometer metres (or seconds).
        scale: Local scale of the plane.
        q_along: Variance added along the heading, m².
        q_across: Variance added across it, m².
        q_heading: Variance added to the heading, rad².
        q_rate: Variance added to κ.
        q_drift: Variance added to b.
    """
    c = math.cos(mean[H])
    s = math.sin(mean[H])
    kappa = mean[K]
    half_drift = 0.5 * mean[B] * arc
    vx = forward - half_drift * left
    vy = left + half_drift * forward
    rx = c * vx - s * vy
    ry = s * vx + c * vy
    dx = kappa * rx
    dy = kappa * ry
    bx = -0.5 * kappa * arc * (c * left + s * forward)
    by = 0.5 * kappa * arc * (c * forward - s * left)
    mean[X] += scale * dx
    mean[Y] += scale * dy
    mean[H] = wrap(mean[H] + turn + mean[B] * arc)
    add_times(cov[X], -dy, cov[H])
    add_times(cov[X], rx, cov[K])
    add_times(cov[X], bx, cov[B])
    add_times(cov[Y], dx, cov[H])
    add_times(cov[Y], ry, cov[K])
    add_times(cov[Y], by, cov[B])
    add_times(cov[H], arc, cov[B])
    for j in range(K, N):
        cov[j, X] = cov[X, j]
        cov[j, Y] = cov[Y, j]
        cov[j, H] = cov[H, j]
    for i in range(3):
        ph = cov[i, H]
        pk = cov[i, K]
        pb = cov[i, B]
        cov[i, X] += -dy * ph + rx * pk + bx * pb
        cov[i, Y] += dx * ph + ry * pk + by * pb
        cov[i, H] = ph + arc * pb
    qxy = (q_along - q_across) * c * s
    cov[X, X] += q_along * c * c + q_across * s * s
    cov[Y, Y] += q_along * s * s + q_across * c * c
    cov[X, Y] += qxy
    cov[Y, X] += qxy
    cov[H, H] += q_heading
    cov[K, K] += q_rate
    cov[B, B] += q_drift


@kernel
def predict_along(
    mean: Vector,
    cov: Matrix,
    odometer: float,
    turn: float,
    heading: float,
    tx: float,
    ty: float,
    q_along: float,
    q_rate: float,
    q_cross: float,
    heading_variance: float,
) -> None:
    """Covariance of a hypothesis that follows its road without a heading sensor.

    With p = c(s) + n d − m, moving on by κ δ turns what surrounds the road with it:

        δp⁺ = R (δp + δm) − δm + t⁺ δ δκ,    R the road's turn from s to s⁺

    The mean is set by the caller, who knows the road.

    Args:
        mean: State, (N,); only the heading is set.
        cov: Covariance, (N, N), in place.
        odometer: δ, odometer metres (or seconds).
        turn: Turn of the road between the two abscissae, rad.
        heading: New heading of the road, rad.
        tx: New unit tangent, x.
        ty: New unit tangent, y.
        q_along: Variance added along the road, m².
        q_rate: Variance added to κ.
        q_cross: Covariance added between κ and the abscissa.
        heading_variance: Of the vehicle's heading about the road's, rad².
    """
    c = 1.0
    s = 0.0
    if turn != 0.0:
        c = math.cos(turn)
        s = math.sin(turn)
    sx = ten()  # what surrounds the road
    sy = ten()
    set_to(sx, cov[X])
    add_times(sx, 1.0, cov[MX])
    set_to(sy, cov[Y])
    add_times(sy, 1.0, cov[MY])
    set_times(cov[X], c, sx)
    add_times(cov[X], -s, sy)
    add_times(cov[X], -1.0, cov[MX])
    add_times(cov[X], tx * odometer, cov[K])
    set_times(cov[Y], s, sx)
    add_times(cov[Y], c, sy)
    add_times(cov[Y], -1.0, cov[MY])
    add_times(cov[Y], ty * odometer, cov[K])
    for j in range(2, N):
        cov[j, X] = cov[X, j]
        cov[j, Y] = cov[Y, j]
    for i in range(2):
        px = cov[i, X] + cov[i, MX]
        py = cov[i, Y] + cov[i, MY]
        pk = odometer * cov[i, K]
        cov[i, X] = c * px - s * py - cov[i, MX] + tx * pk
        cov[i, Y] = s * px + c * py - cov[i, MY] + ty * pk
    cov[X, X] += q_along * tx * tx
    cov[Y, Y] += q_along * ty * ty
    cov[X, Y] += q_along * tx * ty
    cov[Y, X] = cov[X, Y]
    cov[K, K] += q_rate
    cov[X, K] += q_cross * tx
    cov[Y, K] += q_cross * ty
    cov[K, X] = cov[X, K]
    cov[K, Y] = cov[Y, K]
    for j in range(N):
        cov[H, j] = 0.0
        cov[j, H] = 0.0
    cov[H, H] = heading_variance
    mean[H] = heading


@kernel
def decay(
    mean: Vector, cov: Matrix, state: int, target: float, keep: float, variance: float
) -> None:
    """One Gauss-Markov step of a slow state: x⁺ = x̄ + φ (x − x̄) + w, w ~ (1 − φ²) σ²."""
    mean[state] = target + keep * (mean[state] - target)
    row = cov[state]
    own = keep * keep * row[state]
    set_times(row, keep, row)
    row[state] = own + (1.0 - keep * keep) * variance
    for j in range(N):
        cov[j, state] = row[j]


@kernel
def age_map(
    mean: Vector, cov: Matrix, lane: float, lane_keep: float, lane_sigma: float,
    map_keep: float, map_sigma: float,
) -> None:  # fmt: skip
    """Let the lane offset and the map's error wander: exp(−distance / length) is kept."""
    keep = ten()
    for i in range(N):
        keep[i] = 1.0
    keep[D] = lane_keep
    keep[MX] = map_keep
    keep[MY] = map_keep
    for i in range(N):
        scale_by(cov[i], keep[i], keep)
    mean[D] = lane + lane_keep * (mean[D] - lane)
    mean[MX] *= map_keep
    mean[MY] *= map_keep
    lost = 1.0 - map_keep * map_keep
    cov[D, D] += (1.0 - lane_keep * lane_keep) * lane_sigma * lane_sigma
    cov[MX, MX] += lost * map_sigma * map_sigma
    cov[MY, MY] += lost * map_sigma * map_sigma


@kernel
def age_gnss(mean: Vector, cov: Matrix, time: float, correlation_time: float) -> None:
    """Let the GNSS error wander over a time (s) spent moving."""
    wander(mean, cov, math.exp(-time / correlation_time))


@kernel
def wander(mean: Vector, cov: Matrix, keep: float) -> None:
    """Let the GNSS error wander until so much of it is kept."""
    kept = ten()
    for i in range(N):
        kept[i] = 1.0
    kept[GX] = keep
    kept[GY] = keep
    for i in range(N):
        scale_by(cov[i], kept[i], kept)
    mean[GX] *= keep
    mean[GY] *= keep
    cov[GX, GX] += 1.0 - keep * keep
    cov[GY, GY] += 1.0 - keep * keep


@kernel
def redraw_lane(
    mean: Vector, cov: Matrix, turn: float, old: float, new: float, sigma: float
) -> None:
    """Draw the lane offset anew in part when turning into another road.

    d⁺ = d̄' + c (d − d̄), variance + σ² (1 − c²), with c = max(cos turn, 0).
    """
    c = max(math.cos(turn), 0.0)
    mean[D] += new - old
    decay(mean, cov, D, new, c, sigma * sigma)
