"""What the GNSS says to every hypothesis, its error correlated in time.

All hypotheses, off-road included, see the same rows with the same noise, so that
their likelihoods are densities of the same quantity and may be compared.
"""

import math

from ._jit import Vector, kernel
from .angles import wrap
from .belief import (
    GNSS_XX,
    GNSS_XY,
    GNSS_YY,
    GX,
    GY,
    OFF_ROAD,
    Belief,
    H,
    K,
    N,
    X,
    Y,
)
from .gaussian import (
    condition,
    innovation_variance,
    normal_cdf,
    reshape_along,
    truncated_moments,
)
from .motion import age_gnss


@kernel
def _fix_row(
    mean: Vector, row: Vector, fix: Vector, root: Vector, ex: float, ey: float, scale: float,
    lever: Vector,
) -> float:  # fmt: skip
    """Fill the row of one axis (ex, ey) of the fix's ellipse; returns the innovation, m.

    z = p + R(θ) a + S γ + white, along the unit vector e of the axis; `root` is S.
    """
    ax = 0.0
    ay = 0.0
    if lever[0] != 0.0 or lever[1] != 0.0:
        c = math.cos(mean[H])
        s = math.sin(mean[H])
        ax = c * lever[0] - s * lever[1]
        ay = s * lever[0] + c * lever[1]
    row[X] = ex
    row[Y] = ey
    row[H] = -ex * ay + ey * ax
    row[GX] = ex * root[0] + ey * root[1]
    row[GY] = ex * root[1] + ey * root[2]
    dx = (fix[0] - mean[X]) / scale - ax - root[0] * mean[GX] - root[1] * mean[GY]
    dy = (fix[1] - mean[Y]) / scale - ay - root[1] * mean[GX] - root[2] * mean[GY]
    return float(ex * dx + ey * dy)


@kernel
def gnss_root(belief: Belief, fix: Vector, interval: float, smoothing: float, root: Vector) -> None:
    """Scale of the slow GNSS error: what receivers report, smoothed over time.

    Scaling it by each fix's own ellipse would let the ellipse's jitter measure the
    error: a sigma that scatters by 5 % took the filter's ANEES from 0.9 to 1.4.  Where
    the smoothed scale does change, the error is drawn anew in that proportion.

    Args:
        belief: Its clock keeps the smoothed covariance; γ is aged.
        fix: x, y, sigma_major, sigma_minor (m), heading of the major axis.
        interval: Since the last fix, s; negative: begin with this one.
        smoothing: Time constant, s.
        root: Filled with the symmetric root: xx, xy, yy, m.
    """
    c = math.cos(fix[4])
    s = math.sin(fix[4])
    a = fix[2] ** 2
    b = fix[3] ** 2
    clock = belief.clock
    xx = a * c * c + b * s * s
    xy = (a - b) * c * s
    yy = a * s * s + b * c * c
    if interval >= 0.0:
        new = 1.0 - math.exp(-interval / smoothing)
        before = clock[GNSS_XX] * clock[GNSS_YY] - clock[GNSS_XY] ** 2
        xx = clock[GNSS_XX] + new * (xx - clock[GNSS_XX])
        xy = clock[GNSS_XY] + new * (xy - clock[GNSS_XY])
        yy = clock[GNSS_YY] + new * (yy - clock[GNSS_YY])
        ratio = math.sqrt(math.sqrt((xx * yy - xy * xy) / before))
        keep = min(ratio, 1.0 / ratio)
        if keep < 0.995:
            for i in range(belief.size[0]):
                age_gnss(belief.mean[i], belief.cov[i], -math.log(keep), 1.0)
    clock[GNSS_XX] = xx
    clock[GNSS_XY] = xy
    clock[GNSS_YY] = yy
    det = math.sqrt(max(xx * yy - xy * xy, 0.0))
    trace = math.sqrt(xx + yy + 2.0 * det)
    root[0] = (xx + det) / trace
    root[1] = xy / trace
    root[2] = (yy + det) / trace


@kernel
def observe_fix(
    belief: Belief,
    fix: Vector,
    root: Vector,
    interval: float,
    scale: float,
    lever: Vector,
    white_ratio: float,
    gate: float,
    row: Vector,
) -> float:
    """Condition every hypothesis on a GNSS fix (the paper's Y₁), its error correlated.

    The white part is scaled with the interval, so that measuring ten times as often
    teaches nearly nothing more.  A fix that no hypothesis of weight explains within
    the gate is given the variance that makes it fit the best one: it is weighed
    down, never locked out, and alike for all.

    Args:
        belief: In place.
        fix: x, y (plane), sigma_major, sigma_minor (m), heading of the major axis (rad).
        root: S, the symmetric root of the covariance that scales the slow error, xx, xy, yy (m).
        interval: Since the last fix, s.
        scale: Local scale of the plane.
        lever: Antenna ahead and left of M, m.
        white_ratio: White sigma over reported sigma for one fix a second.
        gate: Chi-square (two degrees) of a fix that is taken at its word.
        row: Scratch, (N,).

    Returns:
        The smallest chi-square before weighing down.
    """
    n = belief.size[0]
    thin = max(1.0, 1.0 / max(interval, 0.01))
    r0 = (white_ratio * fix[2]) ** 2 * thin
    r1 = (white_ratio * fix[3]) ** 2 * thin
    c = math.cos(fix[4])
    s = math.sin(fix[4])
    for j in range(N):
        row[j] = 0.0
    best = math.inf
    extra0 = 0.0
    extra1 = 0.0
    for i in range(n):
        if belief.probability[i] < 0.01:
            continue
        nu0 = _fix_row(belief.mean[i], row, fix, root, c, s, scale, lever)
        s0 = innovation_variance(belief.cov[i], row, r0)
        nu1 = _fix_row(belief.mean[i], row, fix, root, -s, c, scale, lever)
        s1 = innovation_variance(belief.cov[i], row, r1)
        chi2 = nu0 * nu0 / s0 + nu1 * nu1 / s1
        if chi2 < best:
            best = chi2
            over = max(chi2 / gate - 1.0, 0.0)
            extra0 = s0 * over
            extra1 = s1 * over
    for i in range(n):
        nu = _fix_row(belief.mean[i], row, fix, root, c, s, scale, lever)
        gain = condition(belief.mean[i], belief.cov[i], row, nu, r0 + extra0, scale)
        nu = _fix_row(belief.mean[i], row, fix, root, -s, c, scale, lever)
        gain += condition(belief.mean[i], belief.cov[i], row, nu, r1 + extra1, scale)
        belief.log_weight[i] += gain
    return best


@kernel
def observe_state(
    belief: Belief, state: int, value: float, variance: float, scale: float, row: Vector
) -> None:
    """Condition every hypothesis on one of its states: course (H) or speed (K)."""
    for j in range(N):
        row[j] = 0.0
    row[state] = 1.0
    for i in range(belief.size[0]):
        nu = value - belief.mean[i, state]
        if state == H:
            nu = wrap(nu)
        belief.log_weight[i] += condition(belief.mean[i], belief.cov[i], row, nu, variance, scale)


@kernel
def forward_only(belief: Belief, row: Vector, scale: float) -> None:
    """Without odometry a vehicle drives forwards.

    The speed is cut to what is above −0.5 m/s, and the hypothesis weighed by how much
    that was.  Off the roads a negative speed is first told as the other heading.
    """
    for i in range(belief.size[0]):
        mean = belief.mean[i]
        cov = belief.cov[i]
        if belief.edge[i] == OFF_ROAD and mean[K] < -0.5:
            mean[K] = -mean[K]
            mean[H] = wrap(mean[H] + math.pi)
            for j in range(N):
                cov[K, j] = -cov[K, j]
            for j in range(N):
                cov[j, K] = -cov[j, K]
        sigma = math.sqrt(cov[K, K])
        z = (mean[K] + 0.5) / sigma
        if z < 2.5:
            belief.log_weight[i] += math.log(max(min(2.0 * normal_cdf(z), 1.0), 1e-12))
            cut, variance = truncated_moments(mean[K], sigma, -0.5, 1e9)
            for j in range(N):
                row[j] = 0.0
            row[K] = 1.0
            reshape_along(mean, cov, row, cut - mean[K], variance / (sigma * sigma), scale)
