"""Fixes that fit nothing: the receiver is wrong, or the motion; both live until it is decided."""

import math

from ..._compile import kernel
from ..state import (
    BIASED,
    CAPACITY,
    GX,
    GY,
    MOTION,
    OFF_ROAD,
    RECEIVER,
    WHEELS,
    B,
    Belief,
    H,
    K,
    N,
    heaviest,
    move_row,
    rescale,
)
from .bias import BIASED_BY, free_bias, may_lead_astray, stray, trace_of
from .position import NU0, NU1, V00, V11, Axes

_OF_SIDE = 1e-3  # of one for which a side is alive
MOST_ODDS = 7.0  # logarithm of the odds up to which two sides live
_OF_WEIGHT = 0.01  # of a hypothesis that is asked whether a fix fits
_OF_BACKING = 1e-5  # the same, where it backs up on odometry without a sign
_OF_TURNS = 0.3  # share of motion that is wrong in which turns are right; else
_SCALED = 0.05  # by which its scale may be wrong
_TURNED, _DRIFTED = 0.3, 0.02  # rad, rad/m by which they may be wrong
_MOST_TURNED = 1.5  # rad, more than a linear model bears
_LASTING = 0.1  # by which a scale may be wrong for long (one sigma),
_LASTS = 10.0  # and s, of which each says so anew
_COUNTS = 0.2  # share of a fix's evidence that counts between sides
_BIASED = 0.2  # P(a receiver that was silent has found its satellites in a wrong place)
_OF_BIASED = 1e-4  # of the weight, of a hypothesis for which that is considered


@kernel
def fits_best(belief: Belief, axes: Axes, side: int) -> tuple[float, int]:
    """Least chi-square of a fix under hypotheses of weight, and the hypothesis; none: infinite, 0.

    Args:
        belief: With the innovations.
        axes: Of the fix.
        side: Only hypotheses that blame this; negative: all.
    """
    best = math.inf
    found = 0
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        least = _OF_WEIGHT if side < 0 else _OF_SIDE
        if hyp.backs == 1:
            least = _OF_BACKING
        if hyp.weight < least or 0 <= side != hyp.blames:
            continue
        chi2 = hyp.scratch[NU0] ** 2 / (hyp.scratch[V00] + axes.r0)
        chi2 += hyp.scratch[NU1] ** 2 / (hyp.scratch[V11] + axes.r1)
        if chi2 < best:
            best = chi2
            found = i
    return best, found


@kernel
def _misfit(belief: Belief, axes: Axes, side: int) -> tuple[float, float]:
    """`fits_best`, with the distance from that hypothesis, m², in place of it."""
    best, i = fits_best(belief, axes, side)
    scratch = belief.hyp[i].scratch
    return best, scratch[NU0] ** 2 + scratch[NU1] ** 2 if best < math.inf else 0.0


@kernel
def misfit(belief: Belief, axes: Axes) -> float:
    """Chi-square of a fix under the hypothesis of weight that fits best, by its innovations."""
    best, _ = fits_best(belief, axes, -1)
    return best


@kernel
def both_live(belief: Belief, axes: Axes) -> bool:
    """Whether a side that blames the receiver lives, and one that blames the motion."""
    receiver, _ = fits_best(belief, axes, RECEIVER)
    motion, _ = fits_best(belief, axes, MOTION)
    return bool(receiver < math.inf and motion < math.inf)


@kernel
def _explain(belief: Belief, square: float, side: int) -> None:
    """Let a misfit be what hypotheses blame: more variance of bias, or of position.

    Args:
        belief: In place.
        square: The misfit, m².
        side: RECEIVER or MOTION; hypotheses that blame it.
    """
    more = square / trace_of(belief.state[0])
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.blames != side:
            continue
        if side == RECEIVER:
            free_bias(hyp, more)
        else:
            stray(hyp, square)


@kernel(inline=True)
def loosen(belief: Belief, axes: Axes, gate: float) -> bool:
    """Let the vehicle be elsewhere, where odometry is in doubt and a fix fits no hypothesis.

    Args:
        belief: With its innovations (`gnss.position.innovations`); the position's covariance grows
            by the misfit, alike for all.
        axes: Of the fix, and its white noise.
        gate: Chi-square (two degrees) of a fix that fits.

    Returns:
        Whether it did not fit.
    """
    best, square = _misfit(belief, axes, -1)
    if best <= gate:
        return False
    for i in range(belief.state[0].count):
        belief.hyp[i].blames = MOTION
    _explain(belief, square, MOTION)
    return True


@kernel(inline=True)
def take_sides(
    belief: Belief, axes: Axes, gate: float, share: float, turned: float
) -> tuple[bool, bool]:
    """Where a fix fits no hypothesis: either the receiver has jumped, or the motion was wrong.

    Each hypothesis of weight becomes three.  One believes that the receiver's error has changed,
    one that the distance was another one, and one that the turns were as well.  While both sides
    live, each explains what does not fit it in its own way, and roads and fixes decide.

    Args:
        belief: In place, with its innovations.
        axes: Of the fix, and its white noise.
        gate: Chi-square (two degrees) of a fix that fits.
        share: P(the motion was wrong), where sides are taken anew.
        turned: By how much turns may be wrong then beyond the usual, rad.

    Returns:
        Whether the belief has changed, so that innovations have to be found again; and whether
        the fix fitted neither side.
    """
    receiver, of_receiver = _misfit(belief, axes, RECEIVER)
    motion, of_motion = _misfit(belief, axes, MOTION)
    if receiver < math.inf and motion < math.inf:  # both live
        if receiver > gate:
            _explain(belief, of_receiver, RECEIVER)
        if motion > gate:
            _explain(belief, of_motion, MOTION)
        return bool(receiver > gate or motion > gate), bool(receiver > gate and motion > gate)
    best, square = _misfit(belief, axes, -1)
    if best <= gate:
        return False, False
    _fork(belief, share, turned)
    _explain(belief, square, RECEIVER)
    _explain(belief, square, MOTION)
    return True, True


@kernel(inline=True)
def _fork(belief: Belief, share: float, turned_by: float) -> None:
    """Make each hypothesis of weight three, see `take_sides`."""
    heading = min(max(_TURNED, turned_by), _MOST_TURNED)
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        hyp.blames = RECEIVER
        if hyp.weight < _OF_WEIGHT or state.count + 2 > CAPACITY:
            continue
        move_row(belief, i, state.count)
        moved = belief.hyp[state.count]
        moved.blames = MOTION
        moved.cov[K, K] += _SCALED * _SCALED
        rescale(moved, share)
        move_row(belief, state.count, state.count + 1)
        turned = belief.hyp[state.count + 1]
        turned.cov[H, H] += heading * heading
        if state.mode == WHEELS:
            turned.cov[B, B] += _DRIFTED * _DRIFTED
        rescale(moved, _OF_TURNS)
        rescale(turned, 1.0 - _OF_TURNS)
        rescale(hyp, 1.0 - share)
        state.count += 2


@kernel(inline=True)
def blame_receiver(belief: Belief, axes: Axes) -> None:
    """Let a misfit be the receiver's, under all hypotheses.

    Args:
        belief: In place, with its innovations.
        axes: Of the fix, and its white noise.
    """
    _, square = _misfit(belief, axes, -1)
    for i in range(belief.state[0].count):
        belief.hyp[i].blames = RECEIVER
    _explain(belief, square, RECEIVER)


@kernel(inline=True)
def fork_biased(belief: Belief) -> None:
    """A receiver that was silent may have found its satellites in a wrong place.

    Each hypothesis of weight becomes two, of which one has a larger error of the receiver.  One
    that has driven on regardless of the fix is of the latter kind.
    """
    state = belief.state[0]
    may_lead_astray(state, _BIASED)
    more = 2.0 * BIASED_BY**2 / trace_of(state)
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.ignores == BIASED:
            free_bias(hyp, more)
            hyp.blames = RECEIVER
            rescale(hyp, _BIASED)
            continue
        if hyp.weight < _OF_BIASED or state.count + 1 > CAPACITY:
            continue
        move_row(belief, i, state.count)
        biased = belief.hyp[state.count]
        free_bias(biased, more)
        biased.blames = RECEIVER
        rescale(biased, _BIASED)
        rescale(hyp, 1.0 - _BIASED)
        state.count += 1


@kernel
def weight_off_roads(belief: Belief) -> float:
    """P of all hypotheses off the roads."""
    off = 0.0
    for i in range(belief.state[0].count):
        if belief.hyp[i].edge == OFF_ROAD:
            off += belief.hyp[i].weight
    return off


@kernel
def odds_of_sides(belief: Belief) -> float:
    """Logarithm of the odds of the side that blames the receiver."""
    state = belief.state[0]
    top = belief.hyp[heaviest(belief)].log_weight
    receiver = 0.0
    others = 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        weight = math.exp(hyp.log_weight - top)
        if hyp.blames == RECEIVER:
            receiver += weight
        else:
            others += weight
    return math.log(max(receiver, 1e-300) / max(others, 1e-300))


@kernel
def even_out(belief: Belief, odds: float, seconds: float) -> None:
    """Let a fix count little between two sides, of which one says that fixes are wrong.

    Two sources cannot outvote each other: what moves with the fixes fits them.  But wheels
    do not measure distances much too long or too short for long.

    Args:
        belief: In place, weighed by the fix.
        odds: Before it, see `odds_of_sides`.
        seconds: Since the last fix.
    """
    back = (1.0 - _COUNTS) * (odds - odds_of_sides(belief))
    usual = math.nan
    best = -math.inf
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.blames == RECEIVER and hyp.log_weight > best:
            best = hyp.log_weight
            usual = hyp.mu[K]
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.blames == RECEIVER:
            hyp.log_weight += back
        else:
            hyp.log_weight -= 0.5 * ((hyp.mu[K] - usual) / _LASTING) ** 2 * seconds / _LASTS


@kernel
def keep_bias(belief: Belief, ratio: float) -> None:
    """Let biases be the same metres by a scale that is so many times smaller.

    Args:
        belief: In place; the reported covariance, as smoothed and as used, includes the factor.
        ratio: The scale until now over that from now on.
    """
    state = belief.state[0]
    for k in range(3):
        state.gnss_cov[k] /= ratio * ratio
        state.bias_cov[k] /= ratio * ratio
        state.bias_root[k] /= ratio
    for i in range(state.count):
        hyp = belief.hyp[i]
        for state_of_bias in (GX, GY):
            hyp.mu[state_of_bias] *= ratio
            for j in range(N):
                hyp.cov[state_of_bias, j] *= ratio
                hyp.cov[j, state_of_bias] *= ratio
