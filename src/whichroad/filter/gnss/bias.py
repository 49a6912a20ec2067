"""The receiver's slow error over time, of one that has lost lock too; what a misfit adds."""

import math

from ..._compile import Record, Vector, kernel
from ..slow_states import age_bias
from ..state import GX, GY, NOTHING, RECEIVER, WHEELS, Belief, Context, X, Y

FAULT = 6.0  # sigmas; an error beyond this is a receiver that has lost lock
BIASED_BY = 30.0  # m, on each axis, of one that has found its satellites in a wrong place
FINE = 1.0  # m; a receiver whose errors are smaller shows how a vehicle leaves its line
_USUAL = 2.0  # sigmas within which an error is a usual one again
_WANDERS = 3.0  # m in the first second, of the error of a receiver that is blamed,
_WANDERS_ALONE = 2.0  # and where motion is not measured, and explains as much;
_FINE_WANDERS = 0.3  # sigmas, of a fine one that is blamed: it is wrong by a constant,
_CENTIMETRES, _SOLVED = 0.2, 3.0  # m, reported by one with integers; times that, before them
_SETTLED = 30.0  # s of fixes from the start on, where the place may not have been wrong before


@kernel
def trace_of(state: Record) -> float:
    """Variances of the receiver's error along both axes, m²."""
    root = state.bias_root
    return float(root[0] ** 2 + 2.0 * root[1] ** 2 + root[2] ** 2)


@kernel
def is_fine(state: Record) -> bool:
    """Whether a receiver shows how a vehicle leaves its line: its errors are below a metre."""
    return bool(0.5 * trace_of(state) < FINE**2)


@kernel
def is_solved(state: Record, fix: Vector) -> bool:
    """Whether a receiver beside wheels reports centimetres since this fix: it has new integers."""
    finer = fix[2] < _CENTIMETRES and fix[2] * _SOLVED < state.reported[1]
    return bool(finer and state.mode == WHEELS)


@kernel
def may_lead_astray(state: Record, p: float) -> None:
    """Note that fixes err from now on by 30 m with a probability, unless the receiver is fine."""
    gross = state.separation.gross
    if not is_fine(state):
        gross.astray = max(float(gross.astray), p)
        gross.aged = state.time


@kernel
def free_bias(hyp: Record, more: float) -> None:
    """Let the error be another one: more variance on each axis, in units of the reported one."""
    hyp.cov[GX, GX] += more
    hyp.cov[GY, GY] += more
    hyp.freed += more


@kernel
def stray(hyp: Record, more: float) -> None:
    """Let the place be another one: more variance on each axis, m²."""
    hyp.cov[X, X] += more
    hyp.cov[Y, Y] += more


@kernel(inline=True)
def age_receiver(belief: Belief, ctx: Context, lasts: float, measured: bool) -> None:
    """Gauss-Markov step of every hypothesis' GNSS bias over the time spent moving.

    A bias far beyond its sigma is a receiver that has lost lock: it recovers by
    re-acquisition, and not as small errors do.  That it is still lost costs the hypothesis
    exp(−time / fault_time).  The error of a receiver that is blamed for fixes that fitted nothing
    may wander anywhere; its fixes then say little of the position.  Without wheels it is blamed
    until its error is a usual one again.

    Args:
        belief: In place.
        ctx: The drive's constants.
        lasts: How long the error lasts, s.
        measured: Whether the motion is, by odometry or reported speeds.
    """
    par = ctx.par[0]
    state = belief.state[0]
    time = state.moving
    wanders = (_WANDERS if measured else _WANDERS_ALONE) ** 2 / max(trace_of(state), 1e-12)
    if is_fine(state) and state.learnt_time > _SETTLED:
        wanders = min(wanders, _FINE_WANDERS**2)
    wanders *= time
    usual = math.exp(-time / lasts)
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.blames == RECEIVER:
            free_bias(hyp, wanders)
        square = hyp.mu[GX] ** 2 + hyp.mu[GY] ** 2
        if state.mode != WHEELS and square < _USUAL**2:
            hyp.blames = NOTHING
        if square <= 9.0:
            age_bias(hyp.mu, hyp.cov, usual)
            continue
        size = math.sqrt(square)
        age_bias(hyp.mu, hyp.cov, math.exp(-time / (lasts * size / 3.0)))
        if size > FAULT:
            hyp.log_weight -= time / par.gnss_fault_time
