"""Fixes that come sooner than every second are held against the belief together.

Each of them is taken to say little, so that ten a second say no more than one does.  So none fits
badly where the receiver creeps away, though the second does.
"""

import math

from ..._compile import Record, kernel
from ..state import WHEELS, Belief
from .bias import free_bias, is_fine, stray, trace_of
from .position import NU0, NU1, V00, V11, Axes
from .sides import fits_best

_SECOND = 0.95  # s; a fix that comes later is asked by itself
_KEPT = 1.0  # s, for which innovations are remembered


@kernel
def _gather(state: Record, hyp: Record, axes: Axes, kept: float) -> float:
    """Chi-square (two degrees) of the mean of the last second's innovations.

    Of innovations ν with variances s, forgotten by φ from fix to fix,

        m = φ m + (1 − φ) ν / √s,        chi² = |m|² (1 + φ) / (1 − φ)
    """
    mean = state.second_mean
    first = hyp.scratch[NU0] / math.sqrt(hyp.scratch[V00] + axes.r0)
    second = hyp.scratch[NU1] / math.sqrt(hyp.scratch[V11] + axes.r1)
    mean[0] = kept * mean[0] + (1.0 - kept) * first
    mean[1] = kept * mean[1] + (1.0 - kept) * second
    return float((mean[0] ** 2 + mean[1] ** 2) * (1.0 + kept) / (1.0 - kept))


@kernel
def second_misfits(belief: Belief, axes: Axes, gate: float, since: float) -> bool:
    """Let a second of fixes that fits no hypothesis be the receiver's error, as one fix would.

    Where no turns are measured and the receiver is a fine one, the vehicle has left its line.

    Args:
        belief: In place, with its innovations.
        axes: Of the fix, and its white noise.
        gate: Chi-square (two degrees) of fixes that fit.
        since: The last fix, s.

    Returns:
        Whether biases or places have changed, so that innovations have to be found again.
    """
    state = belief.state[0]
    if since >= _SECOND or since <= 0.0:
        state.second_mean[0] = state.second_mean[1] = 0.0
        return False
    _, best = fits_best(belief, axes, -1)
    hyp = belief.hyp[best]
    over = _gather(state, hyp, axes, math.exp(-since / _KEPT)) / gate - 1.0
    if over <= 0.0:
        return False
    square = hyp.scratch[V00] + hyp.scratch[V11] + since * (axes.r0 + axes.r1)  # a fix a second
    strays = state.mode != WHEELS and is_fine(state)
    more = over * square / trace_of(state)
    for i in range(state.count):
        if strays:
            stray(belief.hyp[i], 0.5 * over * square)
        else:
            free_bias(belief.hyp[i], more)
    state.second_mean[0] = state.second_mean[1] = 0.0
    return True
