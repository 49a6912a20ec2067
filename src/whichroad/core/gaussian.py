"""Gaussians over the state: what an observation does to them, how two become one."""

import math

from ._jit import Matrix, Vector, kernel
from .angles import wrap
from .belief import H, N, X, Y

_LOG_2PI = math.log(2.0 * math.pi)


@kernel
def normal_cdf(z: float) -> float:
    """Φ(z), the standard normal distribution function."""
    return 0.5 * math.erfc(-z * 0.7071067811865476)


@kernel
def condition(
    mean: Vector, cov: Matrix, row: Vector, innovation: float, variance: float, scale: float
) -> float:
    """Condition a Gaussian on one scalar observation; the Kalman update of §2.2.

        g  = P hᵀ
        s  = h g + r                  innovation variance
        m⁺ = m + g ν / s
        P⁺ = P − g gᵀ / s
        ℓ  = − ½ (ν² / s + log 2πs)

    Rows whose errors are independent are applied one after the other; a correlated
    observation is first turned to the axes of its ellipse.

    Args:
        mean: State, (N,), changed in place.
        cov: Covariance P, (N, N), symmetric, changed in place.
        row: Observation row h, (N,).
        innovation: Observed minus predicted ν, angles wrapped.
        variance: Error variance r, > 0.
        scale: Local scale of the plane: X and Y move by `scale` units a metre.

    Returns:
        The log-density ℓ of the innovation.
    """
    g0 = 0.0
    g1 = 0.0
    g2 = 0.0
    g3 = 0.0
    g4 = 0.0
    g5 = 0.0
    g6 = 0.0
    g7 = 0.0
    g8 = 0.0
    g9 = 0.0
    for j in range(N):
        h = row[j]
        if h != 0.0:
            g0 += cov[j, 0] * h
            g1 += cov[j, 1] * h
            g2 += cov[j, 2] * h
            g3 += cov[j, 3] * h
            g4 += cov[j, 4] * h
            g5 += cov[j, 5] * h
            g6 += cov[j, 6] * h
            g7 += cov[j, 7] * h
            g8 += cov[j, 8] * h
            g9 += cov[j, 9] * h
    g = (g0, g1, g2, g3, g4, g5, g6, g7, g8, g9)
    s = variance
    for j in range(N):
        s += row[j] * g[j]
    gain = innovation / s
    mean[X] += scale * g0 * gain
    mean[Y] += scale * g1 * gain
    for j in range(2, N):
        mean[j] += g[j] * gain
    for i in range(N):
        f = g[i] / s
        for j in range(i + 1):
            c = cov[i, j] - f * g[j]
            cov[i, j] = c
            cov[j, i] = c
    return -0.5 * (innovation * gain + math.log(s) + _LOG_2PI)


@kernel
def innovation_variance(cov: Matrix, row: Vector, variance: float) -> float:
    """H P hᵀ + r."""
    s = variance
    for i in range(N):
        if row[i] != 0.0:
            t = 0.0
            for j in range(N):
                t += cov[i, j] * row[j]
            s += row[i] * t
    return s


@kernel
def truncated_moments(mean: float, sigma: float, low: float, high: float) -> tuple[float, float]:
    """Mean and variance of a Gaussian cut to [low, high].

    With α, β the standardised ends, φ and Φ the standard normal density and
    distribution, Z = Φ(β) − Φ(α):

        mean     μ + σ (φ(α) − φ(β)) / Z
        variance σ² (1 + (α φ(α) − β φ(β)) / Z − ((φ(α) − φ(β)) / Z)²)

    Beyond five sigma a fifth of sigma inside the nearer end stands for the tail.
    """
    a = (low - mean) / sigma
    b = (high - mean) / sigma
    if a < -6.0 and b > 6.0:
        return mean, sigma * sigma
    if a > 5.0:
        return min(low + 0.2 * sigma, 0.5 * (low + high)), 0.04 * sigma * sigma
    if b < -5.0:
        return max(high - 0.2 * sigma, 0.5 * (low + high)), 0.04 * sigma * sigma
    pa = 0.0 if a < -8.0 else math.exp(-0.5 * a * a) * 0.3989422804014327
    pb = 0.0 if b > 8.0 else math.exp(-0.5 * b * b) * 0.3989422804014327
    z = max(normal_cdf(b) - normal_cdf(a), 1e-12)
    shift = (pa - pb) / z
    a_term = 0.0 if a < -8.0 else a * pa
    b_term = 0.0 if b > 8.0 else b * pb
    shrink = 1.0 + (a_term - b_term) / z - shift * shift
    return mean + sigma * shift, sigma * sigma * min(max(shrink, 1e-3), 1.0)


@kernel
def reshape_along(
    mean: Vector, cov: Matrix, row: Vector, shift: float, shrink: float, scale: float
) -> None:
    """Give h·x a new mean and variance, and let the rest of the state follow.

        g = P hᵀ / (h P hᵀ),   m⁺ = m + g·shift,   P⁺ = P − g gᵀ (h P hᵀ)(1 − shrink)

    Exact moments of a Gaussian whose component h·x was cut to an interval.
    """
    # The product g is written out here as in `condition`: as a function of its own, which
    # returns ten numbers, it cost a third of the filter's speed.
    v = innovation_variance(cov, row, 0.0)
    if v <= 1e-12:
        return
    factor = (1.0 - shrink) / v
    gain = shift / v
    g0 = 0.0
    g1 = 0.0
    g2 = 0.0
    g3 = 0.0
    g4 = 0.0
    g5 = 0.0
    g6 = 0.0
    g7 = 0.0
    g8 = 0.0
    g9 = 0.0
    for j in range(N):
        h = row[j]
        if h != 0.0:
            g0 += cov[j, 0] * h
            g1 += cov[j, 1] * h
            g2 += cov[j, 2] * h
            g3 += cov[j, 3] * h
            g4 += cov[j, 4] * h
            g5 += cov[j, 5] * h
            g6 += cov[j, 6] * h
            g7 += cov[j, 7] * h
            g8 += cov[j, 8] * h
            g9 += cov[j, 9] * h
    g = (g0, g1, g2, g3, g4, g5, g6, g7, g8, g9)
    mean[X] += scale * g0 * gain
    mean[Y] += scale * g1 * gain
    for j in range(2, N):
        mean[j] += g[j] * gain
    for i in range(N):
        f = g[i] * factor
        for j in range(i + 1):
            c = cov[i, j] - f * g[j]
            cov[i, j] = c
            cov[j, i] = c


@kernel
def merge_moments(
    mean_a: Vector, cov_a: Matrix, mean_b: Vector, cov_b: Matrix, share_a: float, scale: float
) -> None:
    """Replace two Gaussians by one of the same mean and covariance, into the first.

        m = α m_a + β m_b,   P = α P_a + β P_b + α β (m_a − m_b)(m_a − m_b)ᵀ

    `share_a` is α, the first one's share of the common weight; β = 1 − α.
    """
    beta = 1.0 - share_a
    d0 = (mean_b[0] - mean_a[0]) / scale
    d1 = (mean_b[1] - mean_a[1]) / scale
    d2 = wrap(mean_b[H] - mean_a[H])
    d = (
        d0,
        d1,
        d2,
        mean_b[3] - mean_a[3],
        mean_b[4] - mean_a[4],
        mean_b[5] - mean_a[5],
        mean_b[6] - mean_a[6],
        mean_b[7] - mean_a[7],
        mean_b[8] - mean_a[8],
        mean_b[9] - mean_a[9],
    )
    for i in range(N):
        di = share_a * beta * d[i]
        for j in range(i + 1):
            c = share_a * cov_a[i, j] + beta * cov_b[i, j] + di * d[j]
            cov_a[i, j] = c
            cov_a[j, i] = c
    mean_a[X] += beta * d0 * scale
    mean_a[Y] += beta * d1 * scale
    mean_a[H] = wrap(mean_a[H] + beta * d2)
    for i in range(3, N):
        mean_a[i] += beta * d[i]
