"""What the GNSS says to every hypothesis, its error correlated in time.

All hypotheses, off-road included, see the same rows with the same noise, so that
their likelihoods are densities of the same quantity and may be compared.
"""

import math

from ._jit import Vector, kernel, part
from .angles import wrap
from .belief import (
    GNSS_SCALE,
    GNSS_XX,
    GNSS_XY,
    GNSS_YY,
    GX,
    GY,
    QUICK_SCALE,
    SLOW_SCALE,
    STOOD,
    USED_XX,
    USED_XY,
    USED_YY,
    WANDER,
    WANDER_SCALE,
    Belief,
    H,
    K,
    N,
)
from .expect import drop_refuted, fix_row, foresee, take_in
from .gaussian import LOG_2PI, condition, innovation_variance
from .motion import age_gnss, wander

_FAULT = 6.0  # sigmas; a slow error beyond this is a receiver that has lost its way
_MOST = 9.0  # the most that one fix may say of the scale, in units of what is expected
_PERSISTS = 0.8  # of the mean of innovations, from fix to fix
_LONG = 10.0  # s of standing, from which on the error is taken to stand as well
_SPIKE = 9.0  # of the variance; more is no change of the receiver's, but of this fix
_STEP = 0.97  # of the scale of slow errors


@part
def gnss_root(
    belief: Belief, fix: Vector, factor: float, interval: float, smoothing: float, root: Vector
) -> None:
    """Scale of the slow GNSS error: what receivers report, smoothed over time.

    Scaling it by each fix's own ellipse would let the ellipse's jitter measure the
    error: a sigma that scatters by 5 % took the filter's ANEES from 0.9 to 1.4.  The
    scale moves in steps of 3 %, at which the error is drawn anew in that proportion.

    Args:
        belief: Its clock keeps the covariance, smoothed and as used; γ is aged.
        fix: x, y, sigma_major, sigma_minor (m), heading of the major axis.
        factor: Learnt, on reported variances.
        interval: Since the last fix, s; negative: begin with this one.
        smoothing: Time constant, s.
        root: Filled with the symmetric root: xx, xy, yy, m.
    """
    c = math.cos(fix[4])
    s = math.sin(fix[4])
    a = factor * fix[2] ** 2
    b = factor * fix[3] ** 2
    clock = belief.clock
    xx = a * c * c + b * s * s
    xy = (a - b) * c * s
    yy = a * s * s + b * c * c
    begin = interval < 0.0
    if not begin:
        new = 1.0 - math.exp(-interval / smoothing)
        wider = (xx + yy) / (_SPIKE * (clock[GNSS_XX] + clock[GNSS_YY]))
        if wider > 1.0:  # one fix that knows that it is bad says little of those after it
            xx /= wider
            xy /= wider
            yy /= wider
        xx = clock[GNSS_XX] + new * (xx - clock[GNSS_XX])
        xy = clock[GNSS_XY] + new * (xy - clock[GNSS_XY])
        yy = clock[GNSS_YY] + new * (yy - clock[GNSS_YY])
    clock[GNSS_XX] = xx
    clock[GNSS_XY] = xy
    clock[GNSS_YY] = yy
    used = clock[USED_XX] * clock[USED_YY] - clock[USED_XY] ** 2
    if begin or used <= 0.0:
        keep = 0.0
    else:
        ratio = math.sqrt(math.sqrt((xx * yy - xy * xy) / used))
        keep = min(ratio, 1.0 / ratio)
        if keep < _STEP:
            for i in range(belief.size[0]):
                age_gnss(belief.mean[i], belief.cov[i], -math.log(keep), 1.0)
    if keep < _STEP:
        clock[USED_XX] = xx
        clock[USED_XY] = xy
        clock[USED_YY] = yy
    xx = clock[USED_XX]
    xy = clock[USED_XY]
    yy = clock[USED_YY]
    det = math.sqrt(max(xx * yy - xy * xy, 0.0))
    trace = math.sqrt(xx + yy + 2.0 * det)
    root[0] = (xx + det) / trace
    root[1] = xy / trace
    root[2] = (yy + det) / trace


@part
def observe_fix(
    belief: Belief,
    fix: Vector,
    root: Vector,
    interval: float,
    scale: float,
    lever: Vector,
    white_ratio: float,
    gate: float,
    jumps: bool,
    row: Vector,
    refuted: float = 0.0,
) -> float:
    """Condition every hypothesis on a GNSS fix (the paper's Y₁), its error correlated.

    The white part is scaled with the interval, so that measuring ten times as often
    teaches nearly nothing more.  A fix that no hypothesis of weight explains within
    the gate is given the variance that makes it fit the best one, alike for all.  Where
    wheels and a fix a moment ago vouch for the motion, it is the receiver that has
    jumped, and the variance goes to its slow error; else the fix is weighed down.

    Args:
        belief: In place.
        fix: x, y (plane), sigma_major, sigma_minor (m), heading of the major axis (rad).
        root: S, the symmetric root of the covariance that scales the slow error, xx, xy, yy (m).
        interval: Since the last fix, s.
        scale: Local scale of the plane.
        lever: Antenna ahead and left of M, m.
        white_ratio: White sigma over reported sigma for one fix a second.
        gate: Chi-square (two degrees) of a fix that is taken at its word.
        jumps: Whether a misfit is the receiver's.
        row: Scratch, (N,).
        refuted: Probability below which a hypothesis on a road is dropped before it is updated.

    Returns:
        The smallest chi-square, before variance was added.
    """
    thin = max(1.0, 1.0 / max(interval, 0.01))
    r0 = (white_ratio * fix[2]) ** 2 * thin
    r1 = (white_ratio * fix[3]) ** 2 * thin
    c = math.cos(fix[4])
    s = math.sin(fix[4])
    best = math.inf
    extra0 = 0.0
    extra1 = 0.0
    foresee(belief, fix, root, c, s, scale, lever, row)
    nu0 = belief.scratch[0]
    nu1 = belief.scratch[1]
    v00 = belief.scratch[2]
    v01 = belief.scratch[3]
    v11 = belief.scratch[4]
    for i in range(belief.size[0]):
        if belief.probability[i] < 0.01:
            continue
        s0 = v00[i] + r0
        s1 = v11[i] + r1
        chi2 = nu0[i] * nu0[i] / s0 + nu1[i] * nu1[i] / s1
        if chi2 < best:
            best = chi2
            over = max(chi2 / gate - 1.0, 0.0)
            extra0 = s0 * over
            extra1 = s1 * over
    if jumps and best > gate:
        more = (extra0 + extra1) / (root[0] ** 2 + 2.0 * root[1] ** 2 + root[2] ** 2)
        for i in range(belief.size[0]):
            belief.cov[i, GX, GX] += more
            belief.cov[i, GY, GY] += more
        foresee(belief, fix, root, c, s, scale, lever, row)
        extra0 = 0.0
        extra1 = 0.0
    for i in range(belief.size[0]):
        s0 = v00[i] + r0 + extra0
        nu1[i] -= nu0[i] * v01[i] / s0
        s1 = v11[i] - v01[i] * v01[i] / s0 + r1 + extra1
        misfit = nu0[i] * nu0[i] / s0 + nu1[i] * nu1[i] / s1
        belief.log_weight[i] -= 0.5 * (misfit + math.log(s0 * s1)) + LOG_2PI
        v00[i] = s0
        v11[i] = s1
    if refuted > 0.0:
        drop_refuted(belief, refuted)
    for i in range(belief.size[0]):
        take_in(belief, i, fix, root, c, s, scale, lever, row)
    return best


@part
def adapt_scale(
    belief: Belief, fix: Vector, root: Vector, white: float, drifted: float, scale: float,
    lever: Vector, gain: float, slow_gain: float, least: float, row: Vector,
) -> None:  # fmt: skip
    """Learn how much larger the GNSS errors are than reported (core.belief.GNSS_SCALE).

    Expectation and maximisation with exponential forgetting, averaged over the hypotheses
    by what they are worth after the fix, with innovations ν of variances s, of which the
    receiver's own part is share · s, and γ the slow error with covariance P:

        quick += η (λ² (1 + share (½ Σ ν² / s − 1)) − quick)
        wander: the same with the mean of the last five innovations in place of ν
        slow  += η' (λ² ½ (|γ|² + tr P) − slow)
        λ²     = max(least, quick, wander, slow)

    What is averaged is the expected energy of the error over the reported one.  The
    second average sees an error that wanders under the noise of single fixes, the third one
    so slow that no innovation shows it, but the roads do.

    Args:
        belief: Before it is conditioned on the fix.
        fix: x, y (plane), sigma_major, sigma_minor (m), heading of the major axis (rad).
        root: S, with λ in it.
        white: White sigma over reported sigma, with λ in it.
        drifted: Share (0 to 1) of the slow error's variance drawn anew while standing.
        scale: Local scale of the plane.
        lever: Antenna ahead and left of M, m.
        gain: η.
        slow_gain: η'.
        least: λ² where slow and white error together are as large as reported.
        row: Scratch, (N,).
    """
    clock = belief.clock
    stands = slow_gain == 0.0 and clock[STOOD] > _LONG
    factor = clock[GNSS_SCALE]
    c = math.cos(fix[4])
    s = math.sin(fix[4])
    for j in range(N):
        row[j] = 0.0
    total = 0.0
    quick = 0.0
    wander = 0.0
    slow = 0.0
    first = 0.0
    second = 0.0
    for i in range(belief.size[0]):
        if belief.probability[i] < 0.01:
            continue
        mean = belief.mean[i]
        cov = belief.cov[i]
        chi2 = 0.0
        share = 0.0
        spread = 1.0
        drift = 0.0
        for axis in range(2):
            if axis == 0:
                nu = fix_row(mean, row, fix, root, c, s, scale, lever)
            else:
                nu = fix_row(mean, row, fix, root, -s, c, scale, lever)
            gx = row[GX]
            gy = row[GY]
            r = (white * fix[2 + axis]) ** 2 + drifted * (gx * gx + gy * gy)
            own = r + gx * gx * cov[GX, GX] + 2.0 * gx * gy * cov[GX, GY] + gy * gy * cov[GY, GY]
            variance = innovation_variance(cov, row, r)
            chi2 += nu * nu / variance
            share += 0.5 * min(own / variance, 1.0)
            spread *= variance
            side = nu / math.sqrt(variance)
            stays = _PERSISTS * clock[WANDER + axis] + (1.0 - _PERSISTS) * side
            drift += stays * stays
            if axis == 0:
                side_0 = side
        worth = belief.probability[i] * math.exp(-0.5 * min(chi2, 1e3)) / math.sqrt(spread)
        worth = max(worth, 1e-250)  # when nothing fits, all are worth the same
        drift *= (1.0 + _PERSISTS) / (1.0 - _PERSISTS)
        energy = mean[GX] ** 2 + cov[GX, GX] + mean[GY] ** 2 + cov[GY, GY]
        lost = mean[GX] ** 2 + mean[GY] ** 2 > _FAULT**2
        total += worth
        if stands and chi2 < 9.0:  # the error stands as well, and looks like none
            quick += worth * clock[QUICK_SCALE] / factor
        else:
            quick += worth * (1.0 + share * (min(0.5 * chi2, _MOST) - 1.0))
        wander += worth * (1.0 + share * (min(0.5 * drift, _MOST) - 1.0))
        slow += worth * (clock[SLOW_SCALE] / factor if lost else min(0.5 * energy, _MOST))
        first += worth * side_0
        second += worth * side
    if total == 0.0:
        return
    new = (1.0 - _PERSISTS) / total
    if not stands:
        clock[WANDER_SCALE] += gain * (factor * wander / total - clock[WANDER_SCALE])
    clock[WANDER] += new * first - (1.0 - _PERSISTS) * clock[WANDER]
    clock[WANDER + 1] += new * second - (1.0 - _PERSISTS) * clock[WANDER + 1]
    clock[QUICK_SCALE] += gain * (factor * quick / total - clock[QUICK_SCALE])
    clock[SLOW_SCALE] += slow_gain * (factor * slow / total - clock[SLOW_SCALE])
    learnt = max(clock[QUICK_SCALE], clock[WANDER_SCALE], clock[SLOW_SCALE])
    clock[GNSS_SCALE] = min(max(learnt, least), 400.0)


@part
def age_receiver(belief: Belief, time: float, correlation_time: float, fault_time: float) -> None:
    """Let the GNSS error of every hypothesis wander over a time (s) spent moving.

    An error far beyond its sigma is a receiver that has lost its way: it comes back when it
    comes back, and not as small errors do.  That it is still lost costs the hypothesis
    exp(−time / fault_time).
    """
    usual = math.exp(-time / correlation_time)
    for i in range(belief.size[0]):
        mean = belief.mean[i]
        square = mean[GX] ** 2 + mean[GY] ** 2
        if square <= 9.0:
            wander(mean, belief.cov[i], usual)
            continue
        size = math.sqrt(square)
        age_gnss(mean, belief.cov[i], time, correlation_time * size / 3.0)
        if size > _FAULT:
            belief.log_weight[i] -= time / fault_time


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
def observe_rate(
    belief: Belief, odometer_speed: float, speed: float, variance: float, gate: float,
    scale: float, row: Vector,
) -> None:  # fmt: skip
    """Condition the odometer's scale on a Doppler speed: v = κ v_odometer + e.

    A speed that the most probable hypothesis does not explain is left out for all.

    Args:
        belief: In place, probabilities set.
        odometer_speed: m/s by the odometer.
        speed: m/s over ground, as the receiver says.
        variance: Of e, m²/s².
        gate: Chi-square.
        scale: Local scale of the plane.
        row: Scratch, (N,).
    """
    top = 0
    for i in range(belief.size[0]):
        if belief.probability[i] > belief.probability[top]:
            top = i
    for j in range(N):
        row[j] = 0.0
    row[K] = odometer_speed
    nu = speed - odometer_speed * belief.mean[top, K]
    if nu * nu > gate * innovation_variance(belief.cov[top], row, variance):
        return
    for i in range(belief.size[0]):
        nu = speed - odometer_speed * belief.mean[i, K]
        belief.log_weight[i] += condition(belief.mean[i], belief.cov[i], row, nu, variance, scale)
