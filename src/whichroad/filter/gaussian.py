"""Gaussians over the state: what an observation does to them, how two become one."""

import math

from .._compile import Matrix, Vector, kernel
from ..graph.geometry import wrap
from ._simd import add_times, new_row, set_times, set_to
from .state import MX, MY, D, H, N, X, Y

LOG_2PI = math.log(2.0 * math.pi)


@kernel
def normal_cdf(z: float) -> float:
    """Φ(z), the standard normal distribution function."""
    if z > 8.3:  # one, to the last bit
        return 1.0
    if z < -9.0:  # 1e-19, and less
        return 0.0
    tail = _half_erfc(abs(z) * 0.7071067811865476)
    return 1.0 - tail if z > 0.0 else tail


@kernel
def _half_erfc(x: float) -> float:
    """½ erfc(x) for x >= 0, by Cody's rational functions (1969): one exponential, or none."""
    if x <= 0.46875:
        y = x * x
        over = (0.18577770618460315 * y + 3.1611237438705656) * y + 113.86415415105016
        over = (over * y + 377.485237685302) * y + 3209.377589138469
        under = ((y + 23.601290952344122) * y + 244.02463793444417) * y + 1282.6165260773723
        return 0.5 - 0.5 * x * over / (under * y + 2844.2368334391704)
    bell = 0.5 * math.exp(-x * x)
    if x <= 4.0:
        over = (2.1531153547440383e-8 * x + 0.5641884969886701) * x + 8.883149794388377
        over = (over * x + 66.11919063714163) * x + 298.6351381974001
        over = (over * x + 881.952221241769) * x + 1712.0476126340707
        over = (over * x + 2051.0783778260716) * x + 1230.3393547979972
        under = (x + 15.744926110709835) * x + 117.6939508913125
        under = (under * x + 537.1811018620099) * x + 1621.3895745666903
        under = (under * x + 3290.7992357334597) * x + 4362.619090143247
        return bell * over / ((under * x + 3439.3676741437216) * x + 1230.3393548037495)
    y = 1.0 / (x * x)
    over = (0.016315387137302097 * y + 0.30532663496123236) * y + 0.36034489994980445
    over = ((over * y + 0.12578172611122926) * y + 0.016083785148742275) * y
    under = ((y + 2.568520192289822) * y + 1.8729528499234604) * y + 0.5279051029514285
    under = (under * y + 0.06051834131244132) * y + 0.0023352049762686918
    return bell * (0.5641895835477563 - (over + 6.587491615298378e-4) * y / under) / x


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
    return log_density(innovation, update(mean, cov, row, innovation, variance, scale))


@kernel
def update(
    mean: Vector, cov: Matrix, row: Vector, innovation: float, variance: float, scale: float
) -> float:
    """`condition`, which see; returns the innovation variance s, and takes no logarithm."""
    g = new_row()
    s = variance + _gain(cov, row, g)
    _apply_gain(mean, cov, g, innovation / s, s, scale)
    return s


@kernel
def update_state(
    mean: Vector, cov: Matrix, state: int, innovation: float, variance: float, scale: float
) -> float:
    """`update` with the row of one state."""
    g = new_row()
    set_to(g, cov[state])
    s = variance + g[state]
    _apply_gain(mean, cov, g, innovation / s, s, scale)
    return float(s)


@kernel
def log_density(innovation: float, s: float) -> float:
    """The log-density of an innovation of variance s."""
    return -0.5 * (innovation * innovation / s + math.log(s) + LOG_2PI)


@kernel
def update_state_in_part(
    mean: Vector, cov: Matrix, state: int, innovation: float, variance: float, share: float,
    scale: float,
) -> None:  # fmt: skip
    """`update_state` by a row that holds with a probability `share`, see `_apply_in_part`."""
    g = new_row()
    set_to(g, cov[state])
    _apply_in_part(mean, cov, g, innovation, variance + g[state], share, scale)


@kernel
def update_across(
    mean: Vector, cov: Matrix, nx: float, ny: float, innovation: float, variance: float,
    scale: float,
) -> float:  # fmt: skip
    """`update` with the row n · (p + m) − d of a place across a road."""
    g = new_row()
    _map_gain(cov, nx, ny, g)
    add_times(g, -1.0, cov[D])
    s = variance + nx * (g[X] + g[MX]) + ny * (g[Y] + g[MY]) - g[D]
    _apply_gain(mean, cov, g, innovation / s, s, scale)
    return float(s)


@kernel
def update_across_in_part(
    mean: Vector, cov: Matrix, normal: tuple[float, float], innovation: float, variance: float,
    share: float, scale: float,
) -> None:  # fmt: skip
    """`update_across` by a row that holds with a probability, and with an offset that may jump.

    An innovation beyond three sigmas says that the offset has changed: it grows by that.
    """
    nx, ny = normal
    g = new_row()
    _map_gain(cov, nx, ny, g)
    add_times(g, -1.0, cov[D])
    s = variance + nx * (g[X] + g[MX]) + ny * (g[Y] + g[MY]) - g[D]
    if innovation * innovation > 9.0 * s:
        cov[D, D] += innovation * innovation
        g[D] -= innovation * innovation
        s += innovation * innovation
    _apply_in_part(mean, cov, g, innovation, s, share, scale)


@kernel(inline=True)
def _apply_in_part(
    mean: Vector, cov: Matrix, g: Vector, innovation: float, s: float, share: float, scale: float
) -> None:
    """The moments of two cases, of which a row holds in one; g is overwritten.

    m⁺ = m + p g ν / s,    P⁺ = P − p (1 − (1 − p) ν² / s) g gᵀ / s
    """
    _shift(mean, g, share * innovation / s, scale)
    kept = -share * (1.0 - (1.0 - share) * innovation * innovation / s) / s
    set_times(g, math.sqrt(abs(kept)), g)
    sign = math.copysign(1.0, kept)
    for i in range(N):
        add_times(cov[i], sign * g[i], g)


@kernel(inline=True)
def _apply_gain(mean: Vector, cov: Matrix, g: Vector, gain: float, s: float, scale: float) -> None:
    """m⁺ = m + g gain, P⁺ = P − g gᵀ / s; g is overwritten."""
    _shift(mean, g, gain, scale)
    set_times(g, 1.0 / math.sqrt(s), g)  # both factors alike: P stays symmetric to the bit
    for i in range(N):
        add_times(cov[i], -g[i], g)


@kernel(inline=True)
def _map_gain(cov: Matrix, ex: float, ey: float, g: Vector) -> float:
    """Set g = P hᵀ for the row h x = e · (p + m) of a place on the map; returns h g."""
    set_times(g, ex, cov[X])
    add_times(g, ey, cov[Y])
    add_times(g, ex, cov[MX])
    add_times(g, ey, cov[MY])
    return float(ex * (g[X] + g[MX]) + ey * (g[Y] + g[MY]))


@kernel(inline=True)
def _gain(cov: Matrix, row: Vector, g: Vector) -> float:
    """Set g = P hᵀ; returns h g."""
    for j in range(N):
        g[j] = 0.0
    for j in range(N):
        if row[j] != 0.0:
            add_times(g, row[j], cov[j])
    v = 0.0
    for j in range(N):
        v += row[j] * g[j]
    return v


@kernel(inline=True)
def _shift(mean: Vector, g: Vector, gain: float, scale: float) -> None:
    """M += g gain, with X and Y in the plane's units."""
    x = mean[X] + scale * g[X] * gain
    y = mean[Y] + scale * g[Y] * gain
    add_times(mean, gain, g)
    mean[X] = x
    mean[Y] = y


@kernel
def update_pair(
    mean: Vector, cov: Matrix, first: Vector, second: Vector, gains: tuple[float, float],
    variances: tuple[float, float], scale: float,
) -> None:  # fmt: skip
    """`update` with one row and then with another, going through the covariance once.

    Args:
        mean: State, (N,), changed in place.
        cov: Covariance P, (N, N), changed in place.
        first: g = P hᵀ of the first row, (N,); overwritten.
        second: That of the second row given the first, overwritten.
        gains: Innovation over innovation variance, ν / s, of each row.
        variances: s of each row, the second one given the first.
        scale: Local scale of the plane.
    """
    _shift(mean, first, gains[0], scale)
    _shift(mean, second, gains[1], scale)
    set_times(first, 1.0 / math.sqrt(variances[0]), first)
    set_times(second, 1.0 / math.sqrt(variances[1]), second)
    for i in range(N):
        add_times(cov[i], -first[i], first)
        add_times(cov[i], -second[i], second)


@kernel
def innovation_variance(cov: Matrix, row: Vector, variance: float) -> float:
    """H P hᵀ + r."""
    return variance + _gain(cov, row, new_row())


@kernel
def truncated_moments(mean: float, sigma: float, low: float, high: float) -> tuple[float, float]:
    """Mean and variance of a Gaussian truncated to [low, high].

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
    z = normal_cdf(b) - normal_cdf(a)
    if z < 1e-9:  # nothing lies between, or the ends have changed places
        return min(max(mean, min(low, high)), max(low, high)), 0.04 * sigma * sigma
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

    Exact moments of a Gaussian whose component h·x was truncated to an interval.
    """
    g = new_row()
    _reshape(mean, cov, g, _gain(cov, row, g), shift, shrink, scale)


@kernel
def reshape_on_map(
    mean: Vector, cov: Matrix, tx: float, ty: float, shift: float, shrink: float, scale: float
) -> None:
    """`reshape_along` with the row t · (p + m) of a place along a road."""
    g = new_row()
    _reshape(mean, cov, g, _map_gain(cov, tx, ty, g), shift, shrink, scale)


@kernel(inline=True)
def _reshape(
    mean: Vector, cov: Matrix, g: Vector, v: float, shift: float, shrink: float, scale: float
) -> None:
    """`reshape_along` with g = P hᵀ and v = h g; g is overwritten."""
    if v <= 1e-12:
        return
    _shift(mean, g, shift / v, scale)
    kept = (shrink - 1.0) / v
    set_times(g, math.sqrt(abs(kept)), g)
    sign = math.copysign(1.0, kept)
    for i in range(N):
        add_times(cov[i], sign * g[i], g)


@kernel
def merge_moments(
    mean_a: Vector, cov_a: Matrix, mean_b: Vector, cov_b: Matrix, share_a: float, scale: float
) -> None:
    """Replace two Gaussians by one of the same mean and covariance, into the first.

        m = α m_a + β m_b,   P = α P_a + β P_b + α β (m_a − m_b)(m_a − m_b)ᵀ

    `share_a` is α, the first one's share of the common weight; β = 1 − α.
    """
    beta = 1.0 - share_a
    d = new_row()
    set_times(d, -1.0, mean_a)
    add_times(d, 1.0, mean_b)
    d[X] /= scale
    d[Y] /= scale
    d[H] = wrap(d[H])
    x = mean_a[X] + beta * d[X] * scale
    y = mean_a[Y] + beta * d[Y] * scale
    add_times(mean_a, beta, d)
    mean_a[X] = x
    mean_a[Y] = y
    mean_a[H] = wrap(mean_a[H])
    set_times(d, math.sqrt(share_a * beta), d)
    for i in range(N):
        row = cov_a[i]
        set_times(row, share_a, row)
        add_times(row, beta, cov_b[i])
        add_times(row, d[i], d)
