"""The receiver's noise relative to its reported sigmas, learnt on line.

The error of a fix is a correlated bias, scaled by the reported covariance, and white noise.
"""

import math
from typing import NamedTuple

from ..._compile import Record, Vector, kernel
from ...graph.geometry import project, wrap
from ..map_error import least_factor
from ..slow_states import age_bias
from ..state import (
    GX,
    GY,
    OFF_ROAD,
    WHEELS,
    Belief,
    Context,
    most_probable,
)
from .bias import FAULT, is_solved
from .doppler_scale import compare_with_velocity, largest_factor
from .inflation import COARSE, NEVER, is_inflated, is_vouched, learn_by_roads, most_factor, tail_of
from .position import NU0, NU1, V00, V11

_MOST = 9.0  # cap of one fix's contribution to the factor, relative to its expectation
_SECOND = 0.95  # s; fixes that come sooner say of the receiver what the one before has said
_PERSISTS = 0.8  # of the mean of innovations, from fix to fix
_LONG = 10.0  # s of standing, from which on the error is taken to stand as well
_SPIKE = 9.0  # cap of one fix's reported variance over the smoothed one,
_SINGLE = 3.0  # of one that has so many times the sigma of the fix before it is 1
_PLAY = 1.015  # ratio of bias scales up to which the one in use stays as it is
_SMOOTHING = 15.0  # s, of the reported covariance that scales the bias
_PRIOR_TIME = 5.0  # prior weight of the factor, in s of fixes
_BIAS_TIME, _BIAS_PRIOR = 300.0, 60.0  # s; forgetting and prior of the factor by biases
_RECENT = 10.0  # s, longest interval that one fix counts for
_NEXT = 2.5  # s, longest interval whose second difference is white noise,
_BRISK = 15.0  # m/s, or the reported sigma over this: the way is little beside the errors
_STRAIGHT = 0.35  # rad; largest turn between roads across which offsets are compared
_SURE = 0.8  # P of the road across which offsets are compared
_WHITE_PRIOR = 0.5  # white variance over the reported one of sparse fixes, before it is seen
_PRIOR_COUNT = 4.0  # prior sample count, in differences of fixes
_REMEMBERED = 15.0  # differences of fixes that are averaged at least
_COARSE_BIAS, _COARSE_WHITE = 0.3, 0.8  # of coarse ones: that share; σ of white noise over theirs
_LEAST_BIAS = 0.1  # share of the bias in the variance of fixes, at least


@kernel(inline=True)
def update_root(belief: Belief, fix: Vector, factor: float, interval: float) -> None:
    """Scale of the bias states: what receivers report, smoothed over time.

    Scaling the bias by each fix's own ellipse would let the ellipse's jitter measure the
    error: a sigma that scatters by 5 % took the filter's ANEES from 0.9 to 1.4.  The
    scale in use stays until the reported one is 1.5 % away, and keeps that distance from then on;
    as far as it moves the bias is redrawn.

    Args:
        belief: Its state keeps the covariance, smoothed and as used, and the symmetric root
            S of the latter; biases are aged.
        fix: x, y, sigma_major, sigma_minor (m), heading of the major axis.
        factor: Learnt, on reported variances.
        interval: Since the last fix, s; negative: begin with this one.
    """
    state = belief.state[0]
    _smooth_covariance(state, fix, factor, interval)
    cov = state.gnss_cov
    used = state.bias_cov
    xx, xy, yy = cov[0], cov[1], cov[2]
    det = used[0] * used[2] - used[1] ** 2
    if interval < 0.0 or det <= 0.0:
        used[0] = xx
        used[1] = xy
        used[2] = yy
    else:
        ratio = math.sqrt((xx * yy - xy * xy) / det)  # of variances
        far = max(ratio, 1.0 / ratio)
        if far > _PLAY * _PLAY:
            kept = math.sqrt(_PLAY * _PLAY / far)
            for i in range(state.count):
                age_bias(belief.hyp[i].mu, belief.hyp[i].cov, kept)
            edge = ratio / (_PLAY * _PLAY) if ratio > 1.0 else ratio * _PLAY * _PLAY
            share = (edge - 1.0) / (ratio - 1.0)
            used[0] += share * (xx - used[0])
            used[1] += share * (xy - used[1])
            used[2] += share * (yy - used[2])
    xx, xy, yy = used[0], used[1], used[2]
    det = math.sqrt(max(xx * yy - xy * xy, 0.0))
    trace = math.sqrt(xx + yy + 2.0 * det)
    state.bias_root[0] = (xx + det) / trace
    state.bias_root[1] = xy / trace
    state.bias_root[2] = (yy + det) / trace


@kernel(inline=True)
def _smooth_covariance(state: Record, fix: Vector, factor: float, interval: float) -> None:
    """Low-pass the reported covariance, in the plane's axes, times the learnt factor."""
    c = math.cos(fix[4])
    s = math.sin(fix[4])
    a = factor * fix[2] ** 2
    b = factor * fix[3] ** 2
    cov = state.gnss_cov
    xx = a * c * c + b * s * s
    xy = (a - b) * c * s
    yy = a * s * s + b * c * c
    if interval >= 0.0:
        new = 1.0 - math.exp(-interval / _SMOOTHING)
        ratio = (xx + yy) / (cov[0] + cov[2])
        new /= new + min(ratio, 1.0) * (1.0 - new)  # finer ones by their information
        if is_solved(state, fix):  # its error has nothing of the one before
            new = 1.0
        single = 0.0 < _SINGLE * state.reported[1] <= fix[2]
        wider = ratio if single else ratio / _SPIKE
        if wider > 1.0:  # one fix with a large sigma says little of the next ones
            xx /= wider
            xy /= wider
            yy /= wider
        xx = cov[0] + new * (xx - cov[0])
        xy = cov[1] + new * (xy - cov[1])
        yy = cov[2] + new * (yy - cov[2])
    cov[0] = xx
    cov[1] = xy
    cov[2] = yy


@kernel(inline=True)
def learn_factor(belief: Belief, ctx: Context, epoch: Record, white: float, moving: float) -> None:
    """Learn from a fix how much larger GNSS errors are than reported, once a second.

    Args:
        belief: Before it is conditioned on the fix, with its innovations.
        ctx: The drive's constants.
        epoch: With the fix.
        white: White sigma over reported sigma, with the factor in it.
        moving: Seconds of motion since the last fix.
    """
    par = ctx.par[0]
    state = belief.state[0]
    state.unlearnt += moving
    since = min(max(epoch.time - state.factor_time, 0.0), _RECENT)
    if since < _SECOND:
        return
    compare_with_velocity(state, epoch)
    moving = state.unlearnt
    state.unlearnt = 0.0
    state.factor_time = epoch.time
    state.learnt_time += since
    if par.gnss_adapt_time > NEVER:
        return
    gain = since / (_PRIOR_TIME + state.learnt_time)
    gain = max(gain, 1.0 - math.exp(-since / par.gnss_adapt_time))
    state.level_tail = tail_of(state, par)
    if not is_vouched(state, epoch):
        if is_inflated(state, par, epoch):
            state.gnss_factor = learn_by_roads(belief, par, min(moving, _RECENT))
            return
        state.innovation_factor += gain * (1.0 - state.innovation_factor)
        state.gnss_factor = max(state.innovation_factor, 1.0)
        return
    if state.mode == WHEELS and state.learnt_time > _BIAS_PRIOR:
        state.road_prior = max(state.gnss_factor, 1.0)
    moving = min(moving, _RECENT)
    bias_gain = max(
        moving / (_BIAS_PRIOR + state.learnt_time), 1.0 - math.exp(-moving / _BIAS_TIME)
    )
    drifted = 1.0 - math.exp(-2.0 * state.standing / par.gnss_time)
    _average_energy(belief, ctx, epoch.fix, white, drifted, gain, bias_gain)


@kernel(inline=True)
def _average_energy(
    belief: Belief, ctx: Context, fix: Vector, white: float, drifted: float, gain: float,
    bias_gain: float,
) -> None:  # fmt: skip
    """Expectation and maximisation of the factor λ² with exponential forgetting.

    Averaged over the hypotheses by their weight after the fix, with innovations ν of
    variances s, of which the receiver's own part is share · s, and γ the bias with
    covariance P:

        innovation += η (λ² (1 + share (½ Σ ν² / s − 1)) − innovation)
        windowed: the same with the mean of the last five innovations in place of ν
        bias   += η' (λ² ½ (|γ|² + tr P) − bias)
        λ²      = max(least, innovation, windowed, bias), at most `most_factor`

    What is averaged is the expected energy of the error over the reported one.  The
    second average sees an error that wanders under the noise of single fixes, the third one
    so slow that no innovation shows it, but the roads do.

    Args:
        belief: Before it is conditioned on the fix.
        ctx: The drive's constants.
        fix: x, y (plane), sigma_major, sigma_minor (m), heading of the major axis (rad).
        white: White sigma over reported sigma, with λ in it.
        drifted: Share (0 to 1) of the bias' variance redrawn while standing.
        gain: η.
        bias_gain: η'.
    """
    state = belief.state[0]
    stands = bias_gain == 0.0 and state.standing > _LONG
    factor = state.gnss_factor
    sides = (
        _side(state, math.cos(fix[4]), math.sin(fix[4]), white * fix[2], drifted),
        _side(state, -math.sin(fix[4]), math.cos(fix[4]), white * fix[3], drifted),
    )
    total = 0.0
    by_innovations = 0.0
    windowed = 0.0
    by_bias = 0.0
    first = 0.0
    second = 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.weight < 0.01:
            continue
        chi2, share, determinant, drift, side_0, side_1 = _normalised(hyp, state, sides)
        weight = hyp.weight * math.exp(-0.5 * min(chi2, 1e3)) / math.sqrt(determinant)
        weight = max(weight, 1e-250)  # when nothing fits, all weigh the same
        drift *= (1.0 + _PERSISTS) / (1.0 - _PERSISTS)
        mean = hyp.mu
        energy = mean[GX] ** 2 + hyp.cov[GX, GX] + mean[GY] ** 2 + hyp.cov[GY, GY]
        lost = mean[GX] ** 2 + mean[GY] ** 2 > FAULT**2
        lost = lost or (hyp.edge == OFF_ROAD and state.mode != WHEELS)
        total += weight
        if stands and chi2 < 9.0:  # the error is constant as well, and innovations vanish
            by_innovations += weight * state.innovation_factor / factor
        else:
            by_innovations += weight * (1.0 + share * (min(0.5 * chi2, _MOST) - 1.0))
        windowed += weight * (1.0 + share * (min(0.5 * drift, _MOST) - 1.0))
        by_bias += weight * (state.bias_factor / factor if lost else min(0.5 * energy, _MOST))
        first += weight * side_0
        second += weight * side_1
    if total == 0.0:
        return
    new = (1.0 - _PERSISTS) / total
    if not stands:
        state.windowed_factor += gain * (factor * windowed / total - state.windowed_factor)
    state.innovation_mean[0] += new * first - (1.0 - _PERSISTS) * state.innovation_mean[0]
    state.innovation_mean[1] += new * second - (1.0 - _PERSISTS) * state.innovation_mean[1]
    state.innovation_factor += gain * (factor * by_innovations / total - state.innovation_factor)
    state.bias_factor += bias_gain * (factor * by_bias / total - state.bias_factor)
    most = most_factor(state, ctx.par[0], fix)
    if state.mode != WHEELS and largest_factor(state) < math.inf:  # forget what refuted roads told
        state.windowed_factor = min(state.windowed_factor, most)
        state.bias_factor = min(state.bias_factor, most)
    learnt = max(state.innovation_factor, state.windowed_factor, state.bias_factor)
    state.gnss_factor = min(max(learnt, least_factor(state, ctx.par[0])), most)


class Side(NamedTuple):
    """One axis of a fix, alike for all hypotheses."""

    gx: float  # how the bias enters, m
    gy: float
    variance: float  # white, and of the bias that was redrawn while standing, m²


@kernel(inline=True)
def _side(state: Record, ex: float, ey: float, white: float, drifted: float) -> Side:
    """The axis (ex, ey) of a fix with this white sigma (m), see `_average_energy`."""
    root = state.bias_root
    gx = ex * root[0] + ey * root[1]
    gy = ex * root[1] + ey * root[2]
    return Side(gx, gy, white**2 + drifted * (gx * gx + gy * gy))


@kernel(inline=True)
def _normalised(
    hyp: Record, state: Record, sides: tuple[Side, Side]
) -> tuple[float, float, float, float, float, float]:
    """Normalised innovations of a fix under one hypothesis, whose scratch has them.

    Returns:
        Chi-square; the receiver's own share of the innovation variances; their product; the
        squared windowed mean of the innovations; the innovations of both axes, in sigmas.
    """
    cov = hyp.cov
    chi2 = 0.0
    share = 0.0
    determinant = 1.0
    drift = 0.0
    side_0 = 0.0
    side = 0.0
    for axis in range(2):
        one = sides[0] if axis == 0 else sides[1]
        gx, gy, r = one.gx, one.gy, one.variance
        nu = hyp.scratch[NU0] if axis == 0 else hyp.scratch[NU1]
        own = r + gx * gx * cov[GX, GX] + 2.0 * gx * gy * cov[GX, GY] + gy * gy * cov[GY, GY]
        variance = r + (hyp.scratch[V00] if axis == 0 else hyp.scratch[V11])
        chi2 += nu * nu / variance
        share += 0.5 * min(own / variance, 1.0)
        determinant *= variance
        side = nu / math.sqrt(variance)
        windowed = _PERSISTS * state.innovation_mean[axis] + (1.0 - _PERSISTS) * side
        drift += windowed * windowed
        if axis == 0:
            side_0 = side
    return chi2, share, determinant, drift, side_0, side


@kernel(inline=True)
def observe_white(
    belief: Belief, ctx: Context, epoch: Record, factor: float, white: float
) -> tuple[float, float]:
    """White noise from second differences of positions: nothing drives so.

        e = z_k - (1 + a) z_k-1 + a z_k-2,    a = (t_k - t_k-1) / (t_k-1 - t_k-2)

    has the variance (s_k + (1 + a)^2 s_k-1 + a^2 s_k-2) white^2 on each axis, by the reported
    variances s, and the acceleration's, which is little between fixes a second or two apart.

    Returns:
        The bias' factor and the white sigma over the reported one, both as they are now: what
        is white is no bias.
    """
    par = ctx.par[0]
    state = belief.state[0]
    fix = epoch.fix
    one = state.fix_1
    two = state.fix_2
    last = epoch.time - one[2]
    first = one[2] - two[2]
    near = max(_NEXT, fix[2] / _BRISK)
    if 0.05 < last < near and 0.05 < first < near:
        a = last / first
        ex = (fix[0] - (1.0 + a) * one[0] + a * two[0]) / state.scale
        ey = (fix[1] - (1.0 + a) * one[1] + a * two[1]) / state.scale
        reported = fix[2] * fix[3] + (1.0 + a) ** 2 * one[3] + a * a * two[3]
        usual = max(state.white_factor, par.gnss_white_ratio**2)
        seen = min(0.5 * (ex * ex + ey * ey) / reported, 4.0 * usual)
        gain = max(
            last / (_PRIOR_TIME + state.learnt_time), 1.0 - math.exp(-last / par.gnss_adapt_time)
        )
        state.white_factor += min(gain, 1.0) * (seen - state.white_factor)
    for i in range(4):
        two[i] = one[i]
    one[0], one[1], one[2], one[3] = fix[0], fix[1], epoch.time, fix[2] * fix[3]
    if is_inflated(state, par, epoch) and fix[2] < COARSE:
        return factor, math.sqrt(max(state.white_factor, par.gnss_white_ratio**2))
    if fix[2] >= COARSE and last > _NEXT:  # much of what they err by is new
        return _COARSE_BIAS * factor, max(math.sqrt(state.white_factor), _COARSE_WHITE)
    more = state.white_factor - white * white
    if more > 0.0 and par.gnss_adapt_time < NEVER:  # less of the error is bias
        factor = max(factor - more, _LEAST_BIAS * factor)
        white = math.sqrt(state.white_factor)
    return factor, white


@kernel(inline=True)
def observe_across(belief: Belief, ctx: Context, epoch: Record) -> None:
    """White noise of sparse fixes, from their offsets across a road.

    Along the road it may have been driven in any way; across it the difference of two
    offsets has twice the variance of what does not last from one to the other.
    """
    par = ctx.par[0]
    state = belief.state[0]
    fix = epoch.fix
    if state.white_factor == 0.0:
        state.white_factor = _WHITE_PRIOR
    top = belief.hyp[most_probable(belief)]
    if top.edge == OFF_ROAD:
        state.across_time = -math.inf
        return
    p = 0.0
    for i in range(state.count):
        if belief.hyp[i].edge == top.edge:
            p += belief.hyp[i].weight
    _, _, across, tx, ty = project(ctx.roads, top.edge, top.segment, fix[0], fix[1])
    across /= state.scale
    heading = math.atan2(ty, tx)
    last = state.time - state.across_time
    if p > _SURE and last < 100.0 and abs(wrap(heading - state.across_heading)) < _STRAIGHT:
        usual = max(state.white_factor, par.gnss_white_ratio**2)
        seen = 0.5 * (across - state.fix_across) ** 2 / (fix[2] * fix[3])
        count = state.learnt_time / min(last, _RECENT)
        forgets = max(par.gnss_adapt_time, _REMEMBERED * last)
        gain = max(1.0 / (_PRIOR_COUNT + count), 1.0 - math.exp(-last / forgets))
        state.white_factor += min(gain, 1.0) * (min(seen, 4.0 * usual) - state.white_factor)
    state.fix_across = across
    state.across_heading = heading
    state.across_time = state.time if p > _SURE else -math.inf
