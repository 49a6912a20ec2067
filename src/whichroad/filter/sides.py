"""Fixes that fit nothing: the receiver is wrong, or the motion; both live until it is decided."""

import math

from .._compile import kernel
from .gnss import NU0, NU1, V00, V11, Axes
from .state import (
    CAPACITY,
    GX,
    GY,
    MOTION,
    RECEIVER,
    WHEELS,
    B,
    Belief,
    H,
    K,
    X,
    Y,
    move_row,
    rescale,
)

_OF_SIDE = 1e-3  # of one for which a side is alive
_OF_WEIGHT = 0.01  # of a hypothesis that is asked whether a fix fits
_OF_TURNS = 0.3  # share of motion that is wrong in which turns are right; else
_SCALED = 0.05  # by which its scale may be wrong
_TURNED, _DRIFTED = 0.3, 0.02  # rad, rad/m by which they may be wrong


@kernel
def _misfit(belief: Belief, axes: Axes, side: int) -> tuple[float, float]:
    """Chi-square under the hypothesis of weight that fits best, and the distance from it, m².

    Args:
        belief: With the innovations.
        axes: Of the fix.
        side: Only hypotheses that blame this; negative: all.
    """
    best = math.inf
    square = 0.0
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.weight < (_OF_WEIGHT if side < 0 else _OF_SIDE) or 0 <= side != hyp.blames:
            continue
        first = hyp.scratch[NU0] ** 2
        second = hyp.scratch[NU1] ** 2
        chi2 = first / (hyp.scratch[V00] + axes.r0) + second / (hyp.scratch[V11] + axes.r1)
        if chi2 < best:
            best = chi2
            square = first + second
    return best, square


@kernel
def _explain(belief: Belief, square: float, side: int) -> None:
    """Let a misfit be what hypotheses blame: more variance of bias, or of position.

    Args:
        belief: In place.
        square: The misfit, m².
        side: RECEIVER or MOTION; hypotheses that blame it.
    """
    state = belief.state[0]
    root = state.bias_root
    more = square / (root[0] ** 2 + 2.0 * root[1] ** 2 + root[2] ** 2)
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.blames != side:
            continue
        if side == RECEIVER:
            hyp.cov[GX, GX] += more
            hyp.cov[GY, GY] += more
        else:
            hyp.cov[X, X] += square
            hyp.cov[Y, Y] += square


@kernel(inline=True)
def loosen(belief: Belief, axes: Axes, gate: float) -> bool:
    """Let the vehicle be elsewhere, where odometry is in doubt and a fix fits no hypothesis.

    Args:
        belief: With its innovations (`gnss.innovations`); the position's covariance grows by the
            misfit, alike for all.
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
def take_sides(belief: Belief, axes: Axes, gate: float, share: float) -> tuple[bool, bool]:
    """Where a fix fits no hypothesis: either the receiver has jumped, or the motion was wrong.

    Each hypothesis of weight becomes three.  One believes that the receiver's error has changed,
    one that the distance was another one, and one that the turns were as well.  While both sides
    live, each explains what does not fit it in its own way, and roads and fixes decide.

    Args:
        belief: In place, with its innovations.
        axes: Of the fix, and its white noise.
        gate: Chi-square (two degrees) of a fix that fits.
        share: P(the motion was wrong), where sides are taken anew.

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
    _fork(belief, share)
    _explain(belief, square, RECEIVER)
    _explain(belief, square, MOTION)
    return True, True


@kernel(inline=True)
def _fork(belief: Belief, share: float) -> None:
    """Make each hypothesis of weight three, see `take_sides`."""
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
        turned.cov[H, H] += _TURNED * _TURNED
        if state.mode == WHEELS:
            turned.cov[B, B] += _DRIFTED * _DRIFTED
        rescale(moved, _OF_TURNS)
        rescale(turned, 1.0 - _OF_TURNS)
        rescale(hyp, 1.0 - share)
        state.count += 2
