"""Fixes that fit badly where no turns are measured: a jump of the receiver, or another way.

Such a vehicle is moved along its road's line.  What differs from that is the receiver's error, or
the vehicle has left the line.
"""

import math

from ..._compile import Record, kernel
from ..state import Belief
from .bias import FINE, free_bias, may_lead_astray, stray, trace_of
from .position import NU0, NU1, V00, V01, V11, Axes
from .sides import weight_off_roads

_CHANGES, _CHANGE = 0.01, 12.0  # 1/s, m per axis: the error of a receiver that is alone
_ASIDE = 3.0  # m per axis, by which a vehicle leaves its road's line about as often
_ERRS = 0.1  # P(it errs by more) from a jump on, if fixes lead off the roads
_FREQUENT = 4.0  # s between fixes, up to which it is followed


@kernel
def _fit(hyp: Record, axes: Axes, more: float) -> tuple[float, float]:
    """Chi-square of a fix under a hypothesis, and the determinant of its innovations, m⁴.

    Args:
        hyp: With its innovations.
        axes: Of the fix, and its white noise.
        more: Variance that is added to each axis, m².
    """
    to = hyp.scratch
    s0, s1, v = to[V00] + axes.r0 + more, to[V11] + axes.r1 + more, to[V01]
    det = s0 * s1 - v * v
    misfit = (to[NU0] * (to[NU0] * s1 - 2.0 * to[NU1] * v) + to[NU1] * to[NU1] * s0) / det
    return misfit, det


@kernel
def _gain(hyp: Record, axes: Axes, more: float, misfit: float, det: float) -> float:
    """Nats by which a hypothesis with more variance on each axis explains a fix better."""
    wide, wide_det = _fit(hyp, axes, more)
    return 0.5 * (misfit - wide - math.log(wide_det / det))


@kernel(inline=True)
def jump_or_stray(
    belief: Belief, axes: Axes, since: float, alone: bool, gate: float
) -> bool:  # fmt: skip
    """Without turns a receiver's error may be another one since the last fix, or the place is.

    A receiver in a street finds and loses reflections.  Each moves it by metres to tens of metres,
    for seconds to minutes.  So the prior of the error is a sum of Gaussians (Alspach and
    Sorenson, 1972): the usual one, and with the rate of such changes one of 12 m more per axis.
    A vehicle that goes on beside its fixes costs some ten nats then, and not half of a chi-square.
    The vehicle may have left its road's line as well: it cuts a corner, or drives where nothing is
    mapped.  A fine receiver shows that at every second corner, and is not what is wrong.  So a
    third Gaussian has 3 m more of the position, and below 1 m the receiver's jumps are as much
    rarer as its errors are smaller.  Each hypothesis keeps the one that explains the fix best.
    Where it is off the roads, its own motion explains as much, and nothing is changed.

    Args:
        belief: In place, with its innovations.
        axes: Of the fix, and its white noise.
        since: Seconds since the last fix.  Between sparse ones `sparse.wrong_fix` drives on.
        alone: Whether nothing vouches for the receiver.  Else its jumps are found by the gate,
        gate: a chi-square of two degrees.

    Returns:
        Whether an error or a place has changed, so that innovations have to be found again.
    """
    if since <= 0.0 or since > _FREQUENT:
        return False
    state = belief.state[0]
    if weight_off_roads(belief) > 0.5:
        return False
    trace = trace_of(state)
    more = 2.0 * _CHANGE**2 / trace
    rarer = min(0.5 * math.log(0.5 * trace / FINE**2), 0.0)
    price = math.log(_CHANGES * since)
    if not alone:
        price = max(price, -0.5 * gate)
    changed = False
    for i in range(state.count):
        hyp = belief.hyp[i]
        misfit, det = _fit(hyp, axes, 0.0)
        if 0.5 * misfit < -price:  # no other error would pay
            continue
        jump = rarer + _gain(hyp, axes, _CHANGE**2, misfit, det)
        aside = _gain(hyp, axes, _ASIDE**2, misfit, det)
        if max(jump, aside) <= -price:
            continue
        if aside > jump:
            stray(hyp, _ASIDE**2)
        elif alone:
            free_bias(hyp, more)
            may_lead_astray(state, _ERRS)
            hyp.log_weight += rarer
        else:
            continue
        hyp.log_weight += price
        changed = True
    return changed
