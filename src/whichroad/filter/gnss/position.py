"""GNSS observations: position with a correlated bias, course and Doppler speed.

All hypotheses, off-road included, see the same rows with the same noise, so that
their likelihoods are densities of the same quantity and may be compared.
"""

import math
from typing import NamedTuple

from ..._compile import Matrix, Record, Vector, kernel
from ...graph.geometry import wrap
from .._simd import add_times, new_row, set_times
from ..gaussian import (
    LOG_2PI,
    condition,
    innovation_variance,
    log_density,
    update_pair,
    update_state,
)
from ..state import (
    GX,
    GY,
    OFF_ROAD,
    WHEELS,
    WRONG,
    Belief,
    Context,
    H,
    K,
    N,
    X,
    Y,
    heaviest,
    most_probable,
    move_row,
)
from .bias import free_bias, is_fine, stray, trace_of

_OF_ONE = 0.7  # of the variance of a fix, below which fixes at rest do not tell the place better
_WRONG_VARIANCE = 1e4  # m², of the error of a fix that is wrong,
_LOG_WRONG = -3.9  # and the logarithm of how often it is
_MOVING = 2.0  # m/s, from which on a course over ground is the vehicle's heading


class Axes(NamedTuple):
    """A fix in the axes of its ellipse."""

    c: float  # cosine and
    s: float  # sine of the major axis' heading
    r0: float  # white variance along it, m²
    r1: float  # and across it


# scratch: innovations and their covariance without white noise; its two rows in `work.gains`
NU0, NU1, V00, V01, V11, GAINS = range(6)


@kernel
def lever_arm(heading: float, lever: Vector) -> tuple[float, float]:
    """The antenna's place from M, R(θ) a, along the axes of the plane, m."""
    if lever[0] == 0.0 and lever[1] == 0.0:
        return 0.0, 0.0
    c = math.cos(heading)
    s = math.sin(heading)
    return c * lever[0] - s * lever[1], s * lever[0] + c * lever[1]


@kernel
def fix_row(
    mean: Vector, row: Vector, fix: Vector, state: Record, arm: tuple[float, float], ex: float,
    ey: float,
) -> float:  # fmt: skip
    """Fill the row of one axis (ex, ey) of the fix's ellipse; returns the innovation, m.

    z = p + R(θ) a + S γ + white, along the unit vector e of the axis; S is `state.bias_root`,
    and R(θ) a the `arm`.
    """
    ax, ay = arm
    root = state.bias_root
    row[X] = ex
    row[Y] = ey
    row[H] = -ex * ay + ey * ax
    row[GX] = ex * root[0] + ey * root[1]
    row[GY] = ex * root[1] + ey * root[2]
    dx = (fix[0] - mean[X]) / state.scale - ax - root[0] * mean[GX] - root[1] * mean[GY]
    dy = (fix[1] - mean[Y]) / state.scale - ay - root[1] * mean[GX] - root[2] * mean[GY]
    return float(ex * dx + ey * dy)


@kernel
def _gain(cov: Matrix, row: Vector, g: Vector) -> float:
    """Set g = P hᵀ for the row h of a fix; returns h g."""
    set_times(g, row[X], cov[X])
    add_times(g, row[Y], cov[Y])
    add_times(g, row[GX], cov[GX])
    add_times(g, row[GY], cov[GY])
    if row[H] != 0.0:
        add_times(g, row[H], cov[H])
    return _product(row, g)


@kernel
def _product(row: Vector, g: Vector) -> float:
    """Return h g for the row h of a fix."""
    place = row[X] * g[X] + row[Y] * g[Y] + row[H] * g[H]
    return float(place + row[GX] * g[GX] + row[GY] * g[GY])


@kernel(inline=True)
def innovations(belief: Belief, ctx: Context, fix: Vector, axes: Axes) -> None:
    """Innovations of every hypothesis along the axes of the ellipse, and their covariance.

    The covariance is without the white noise.  P hᵀ of both rows is kept in `work.gains`.
    """
    state = belief.state[0]
    lever = ctx.par[0].lever
    row = ctx.work.row
    second = new_row()
    for i in range(state.count):
        hyp = belief.hyp[i]
        to = hyp.scratch
        arm = lever_arm(hyp.mu[H], lever)
        to[GAINS] = 2 * i
        to[NU0] = fix_row(hyp.mu, row, fix, state, arm, axes.c, axes.s)
        to[NU1] = fix_row(hyp.mu, second, fix, state, arm, -axes.s, axes.c)
        to[V00] = _gain(hyp.cov, row, ctx.work.gains[2 * i])
        to[V01] = _product(second, ctx.work.gains[2 * i])
        to[V11] = _gain(hyp.cov, second, ctx.work.gains[2 * i + 1])


@kernel(inline=True)
def _drop_refuted(belief: Belief, least: float) -> None:
    """Drop hypotheses on roads whose weight is below a limit."""
    state = belief.state[0]
    low = belief.hyp[heaviest(belief)].log_weight + math.log(least)
    kept = 0
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.log_weight < low and hyp.edge != OFF_ROAD and hyp.grace <= 0.0:
            continue
        if kept != i:
            move_row(belief, i, kept)
        kept += 1
    state.count = kept


@kernel(inline=True)
def _condition(hyp: Record, state: Record, ctx: Context) -> None:
    """Condition a hypothesis on both axes of a fix, the second one given the first.

    While the vehicle stands the receiver errs much alike.  One that has stood since the last fix,
    and whose place is known as well as a fix tells it, considers that place, and does not
    estimate it (Schmidt 1966): the fix tells the receiver's error.
    """
    s0 = hyp.scratch[V00]
    s1 = hyp.scratch[V11]
    at = int(hyp.scratch[GAINS])
    g = ctx.work.gains[at]
    second = ctx.work.gains[at + 1]
    add_times(second, -hyp.scratch[V01] / s0, g)
    gains = (hyp.scratch[NU0] / s0, hyp.scratch[NU1] / s1)
    mean, cov = hyp.mu, hyp.cov
    x, y, xx, xy, yy = mean[X], mean[Y], cov[X, X], cov[X, Y], cov[Y, Y]
    update_pair(mean, cov, g, second, gains, (s0, s1), state.scale)
    if hyp.stood > 0.0 and xx + yy < _OF_ONE * trace_of(state):
        mean[X], mean[Y], cov[X, X], cov[Y, Y] = x, y, xx, yy
        cov[X, Y] = cov[Y, X] = xy


@kernel(inline=True)
def observe_position(
    belief: Belief, ctx: Context, fix: Vector, axes: Axes, gate: float, jumps: bool, refuted: float
) -> float:
    """Condition every hypothesis on a GNSS position (the paper's Y₁), its error correlated.

    A fix that no hypothesis of weight explains within the gate is given the variance that
    makes it fit the best one, alike for all.  Where wheels and a recent fix confirm
    the motion, the receiver has jumped, and the variance is added to its bias; else
    to the fix.  Beside a fine receiver without wheels it is the place that is wrong.

    Args:
        belief: In place; weights are to be normalised afterwards.
        ctx: The drive's constants.
        fix: x, y (plane), sigma_major, sigma_minor (m), heading of the major axis (rad).
        axes: Its axes and white noise.
        gate: Chi-square (two degrees) of a fix that is taken at its word.
        jumps: Whether a misfit is the receiver's.
        refuted: Weight below which a hypothesis on a road is dropped before it is updated.

    Returns:
        The smallest chi-square, before variance was added.
    """
    innovations(belief, ctx, fix, axes)
    return observe_given(belief, ctx, fix, axes, gate, jumps, refuted)


@kernel(inline=True)
def _weigh(belief: Belief, axes: Axes, extra0: float, extra1: float) -> None:
    """Weigh every hypothesis by a fix of some extra variance along its axes, m².

    One that ignores the fix takes it to be wrong.
    """
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        to = hyp.scratch
        wrong = hyp.ignores == WRONG
        s0 = to[V00] + axes.r0 + (_WRONG_VARIANCE if wrong else extra0)
        to[NU1] -= to[NU0] * to[V01] / s0
        s1 = to[V11] - to[V01] * to[V01] / s0 + axes.r1 + (_WRONG_VARIANCE if wrong else extra1)
        misfit = to[NU0] * to[NU0] / s0 + to[NU1] * to[NU1] / s1
        hyp.log_weight -= 0.5 * (misfit + math.log(s0 * s1)) + LOG_2PI
        if wrong:
            hyp.log_weight += _LOG_WRONG
        to[V00] = s0
        to[V11] = s1


@kernel(inline=True)
def observe_given(
    belief: Belief, ctx: Context, fix: Vector, axes: Axes, gate: float, jumps: bool, refuted: float
) -> float:
    """`observe_position` where the innovations are known already."""
    state = belief.state[0]
    best = math.inf
    extra0 = 0.0
    extra1 = 0.0
    least = 0.01
    for i in range(state.count):
        if belief.hyp[i].ignores == 1:
            least -= 0.01 * belief.hyp[i].weight
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.weight < least or hyp.ignores == WRONG:
            continue
        s0 = hyp.scratch[V00] + axes.r0
        s1 = hyp.scratch[V11] + axes.r1
        chi2 = hyp.scratch[NU0] * hyp.scratch[NU0] / s0 + hyp.scratch[NU1] * hyp.scratch[NU1] / s1
        if chi2 < best:
            best = chi2
            over = max(chi2 / gate - 1.0, 0.0)
            extra0 = s0 * over
            extra1 = s1 * over
    if jumps and best > gate:
        root = state.bias_root
        more = (extra0 + extra1) / (root[0] ** 2 + 2.0 * root[1] ** 2 + root[2] ** 2)
        strays = state.mode != WHEELS and is_fine(state)
        for i in range(state.count):
            if strays:
                stray(belief.hyp[i], 0.5 * (extra0 + extra1))
            else:
                free_bias(belief.hyp[i], more)
        innovations(belief, ctx, fix, axes)
        extra0 = 0.0
        extra1 = 0.0
    _weigh(belief, axes, extra0, extra1)
    if refuted > 0.0:
        _drop_refuted(belief, refuted)
    for i in range(state.count):
        if belief.hyp[i].ignores != WRONG:
            _condition(belief.hyp[i], state, ctx)
    return best


@kernel
def observe_state(
    belief: Belief, ctx: Context, index: int, value: float, variance: float, wrong: float
) -> None:
    """Condition every hypothesis on one of its states: course (H) or speed (K).

    Args:
        belief: In place; weights are to be normalised afterwards.
        ctx: The drive's constants.
        index: H or K.
        value: As reported, rad or m/s.
        variance: Of its error.
        wrong: Density of values that say nothing of the vehicle, in 1/rad or s/m: a hypothesis
            that they fit better is not moved.
    """
    scale = belief.state[0].scale
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        nu = value - hyp.mu[index]
        if index == H:
            nu = wrap(nu)
        if wrong > 0.0:
            s = variance + hyp.cov[index, index]
            fits = math.exp(-0.5 * nu * nu / s) / math.sqrt(2.0 * math.pi * s)
            if fits < wrong:
                hyp.log_weight += math.log(fits + wrong)
                continue
            hyp.log_weight += math.log(1.0 + wrong / fits)
        s = update_state(hyp.mu, hyp.cov, index, nu, variance, scale)
        hyp.log_weight += log_density(nu, s)


@kernel
def observe_rate(
    belief: Belief, ctx: Context, odometer_speed: float, speed: float, variance: float
) -> None:
    """Condition the odometer's scale on a Doppler speed: v = κ v_odometer + e.

    A speed that the most probable hypothesis does not explain is left out for all.

    Args:
        belief: In place, weights set.
        ctx: The drive's constants.
        odometer_speed: m/s by the odometer.
        speed: m/s over ground, as the receiver reports it.
        variance: Of e, m²/s².
    """
    row = ctx.work.row
    scale = belief.state[0].scale
    top = belief.hyp[most_probable(belief)]
    for j in range(N):
        row[j] = 0.0
    row[K] = odometer_speed
    nu = speed - odometer_speed * top.mu[K]
    if nu * nu > ctx.par[0].gnss_gate * innovation_variance(top.cov, row, variance):
        return
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        nu = speed - odometer_speed * hyp.mu[K]
        hyp.log_weight += condition(hyp.mu, hyp.cov, row, nu, variance, scale)


@kernel
def has_course(epoch: Record, sigma: float) -> bool:
    """Whether the receiver reports a course better than `sigma` (rad) and moves."""
    moving = epoch.speed_sigma > 1e6 or epoch.speed > _MOVING
    return bool(epoch.course_sigma < sigma and moving)
