"""A fine receiver that reports centimetres and errs by metres: wrong integers, for a minute or so.

Where a fix fits nothing, two sides live: the receiver has jumped, or the motion was wrong
(`gnss.sides`).  Such a receiver is wrong by a constant.  So it is the likelier side for long, and
nothing but time speaks for the other one: with P(the receiver) = 0.9 at the jump, and gross errors
that last for τ = `gnss_fault_time` on average,

    P(the motion was wrong | T s later) = 1 / (1 + 9 exp(−T / τ))

A side that has died lives again at the fix with that probability, now and then, and the level
covers it.  Where a jump takes back the one before it, the fixes in between were wrong.

Beside wheels a receiver that goes from metres to centimetres has solved its integers.  They are
wrong with P = 0.01, by some 1.5 m, which the errors before may hide.  So a side lives at once that
keeps the place, and the level covers it.  Where a fix comes back to the place of a side for which
the receiver was wrong, the receiver is right again.

Where no turns are measured, a single wrong fix may have moved the belief: P(the receiver) = 1/6
there.

Where fixes have jumped, or the vehicle was looked for anew at them, they may err by some 30 m for
about τ.  Roads show that; a vehicle that they lead off the roads is covered (`summary.estimate`).

Any other receiver is held so where no turns are measured.  A fix that fits nothing is its error
then (`gnss.position`), and the map's line may have turned elsewhere than the vehicle.
"""

import math

from ..._compile import Record, kernel
from ..slow_states import age_bias
from ..state import (
    CAPACITY,
    GX,
    GY,
    MOTION,
    NOTHING,
    RECEIVER,
    WHEELS,
    Belief,
    Context,
    N,
    X,
    Y,
    heaviest,
    move_row,
    rescale,
)
from .bias import FAULT, free_bias, is_fine, is_solved, trace_of
from .position import NU0, NU1, Axes, innovations
from .sides import fits_best

_WRONG, _WRONG_BY = 0.01, 1.5  # P(integers that were just fixed are wrong), and by how much, m
_AS_BEFORE = 0.5  # the same, of a receiver that is taken to be wrong before
_ODDS = 9.0  # of the receiver against the motion, at a jump
_UNMEASURED = 0.2  # the same where nothing measures turns
_EVERY = 20.0  # s, between two times that a side is offered anew
_OF_WEIGHT, _OF_SIDE = 0.01, 1e-3  # as in `gnss.sides`
_TAKEN_BACK = 0.35  # of a jump, up to which it and the next one together are none,
_NEAR = 3.0  # chi-square of a fix that is where a side has the vehicle
_WITHIN = 300.0  # s after it
_LATELY = 5.0  # s after a jump, for which an error is that
_MOST = 0.9  # P(the motion was wrong), at most
_SMALL = 3.0  # sigmas up to which an error is no gross one


@kernel
def _square(hyp: Record) -> float:
    """Of the receiver's error, in sigmas."""
    return float(hyp.mu[GX] ** 2 + hyp.mu[GY] ** 2)


@kernel
def _misses(state: Record, hyp: Record, axes: Axes) -> float:
    """Chi-square (two degrees) of a fix with a usual error, where its innovations are known."""
    dx, dy, sigma = error_of(state, hyp)
    dx += axes.c * hyp.scratch[NU0] - axes.s * hyp.scratch[NU1]
    dy += axes.s * hyp.scratch[NU0] + axes.c * hyp.scratch[NU1]
    own = 0.5 * (sigma**2 + axes.r0 + axes.r1)
    xx, xy, yy = hyp.cov[X, X] + own, hyp.cov[X, Y], hyp.cov[Y, Y] + own
    return float((dx * (dx * yy - 2.0 * dy * xy) + dy * dy * xx) / (xx * yy - xy * xy))


@kernel
def _is_at_doubted(belief: Belief, axes: Axes) -> bool:
    """Whether a fix comes back to a place at which a fine receiver was wrong all the time."""
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        gross = hyp.blames == RECEIVER and hyp.weight > _OF_SIDE and _square(hyp) > FAULT**2
        if gross and _misses(state, hyp, axes) < _NEAR:
            return True
    return False


@kernel
def takes_back(belief: Belief, axes: Axes, time: float) -> bool:
    """Note a fix that fits nothing; whether it takes back a jump that was believed.

    Args:
        belief: With the innovations; the jump is kept.
        axes: Of the fix.
        time: Of the fix, s.
    """
    state = belief.state[0]
    gross = state.separation.gross
    _, i = fits_best(belief, axes, -1)
    hyp = belief.hyp[i]
    dx = axes.c * hyp.scratch[NU0] - axes.s * hyp.scratch[NU1]
    dy = axes.s * hyp.scratch[NU0] + axes.c * hyp.scratch[NU1]
    left = (dx + gross.jump[0]) ** 2 + (dy + gross.jump[1]) ** 2
    before = gross.jump[0] ** 2 + gross.jump[1] ** 2
    recent = time - gross.time < _WITHIN
    gross.jump[0] = dx
    gross.jump[1] = dy
    gross.time = gross.offered = time
    believed = _square(belief.hyp[heaviest(belief)]) < FAULT**2
    back = left < _TAKEN_BACK**2 * before or _is_at_doubted(belief, axes)
    return bool(is_fine(state) and recent and believed and back)


@kernel
def fork_solution(belief: Belief, ctx: Context, epoch: Record, axes: Axes) -> None:
    """Where a receiver has fixed its integers, see `bias.is_solved`, they may be wrong ones.

    Args:
        belief: In place, with its innovations; beside each hypothesis of weight one is added that
            blames the receiver.
        ctx: The drive's constants.
        epoch: With a fix.
        axes: Of the fix.
    """
    state = belief.state[0]
    if not is_solved(state, epoch.fix):
        return
    takes_back(belief, axes, epoch.time)
    more = 2.0 * _WRONG_BY**2 / trace_of(state)
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.weight < _OF_WEIGHT or state.count + 1 > CAPACITY:
            continue
        p = _AS_BEFORE if hyp.blames == RECEIVER else _WRONG
        hyp.blames = NOTHING
        move_row(belief, i, state.count)
        wrong = belief.hyp[state.count]
        wrong.blames = RECEIVER
        free_bias(wrong, more)
        rescale(wrong, p)
        rescale(hyp, 1.0 - p)
        state.count += 1
    innovations(belief, ctx, epoch.fix, axes)


@kernel
def comes_back(belief: Belief, axes: Axes, gate: float) -> bool:
    """Let a receiver that is taken to be wrong be right again, where a fix at the place says so.

    Args:
        belief: In place, with the innovations of a fix that fits nothing.
        axes: Of the fix.
        gate: Chi-square (two degrees) of a fix that fits.

    Returns:
        Whether errors have changed, so that innovations have to be found again.
    """
    state = belief.state[0]
    if not is_fine(state) or _square(belief.hyp[heaviest(belief)]) < FAULT**2:
        return False
    changed = False
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.blames != RECEIVER or _square(hyp) < FAULT**2:
            continue
        if _misses(state, hyp, axes) < gate:
            age_bias(hyp.mu, hyp.cov, 0.0)
            hyp.blames = NOTHING
            changed = True
    return changed


@kernel
def _move_to_fix(hyp: Record, state: Record) -> None:
    """Let the receiver be right, and the vehicle where it says: p' = p + S γ − S γ'."""
    root = state.bias_root
    cov = hyp.cov
    for axis in range(2):
        a = root[axis]
        b = root[axis + 1]
        hyp.mu[X + axis] += state.scale * (a * hyp.mu[GX] + b * hyp.mu[GY])
        for j in range(N):
            cov[X + axis, j] += a * cov[GX, j] + b * cov[GY, j]
        for j in range(N):
            cov[j, X + axis] += a * cov[j, GX] + b * cov[j, GY]
    hyp.mu[GX] = hyp.mu[GY] = 0.0
    for j in range(N):
        cov[GX, j] = cov[j, GX] = cov[GY, j] = cov[j, GY] = 0.0
    cov[GX, GX] = cov[GY, GY] = 1.0
    for i in range(2):
        for j in range(2):
            cov[X + i, X + j] += root[i] * root[j] + root[i + 1] * root[j + 1]
            cov[X + i, GX + j] = cov[GX + j, X + i] = -root[i + j]


@kernel
def _offer(belief: Belief, p: float) -> None:
    """Add hypotheses at the fix, one beside each of weight, that blame the motion."""
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.weight < _OF_WEIGHT or state.count + 1 > CAPACITY:
            continue
        hyp.blames = RECEIVER
        move_row(belief, i, state.count)
        moved = belief.hyp[state.count]
        moved.blames = MOTION
        _move_to_fix(moved, state)
        rescale(moved, p)
        rescale(hyp, 1.0 - p)
        state.count += 1
    state.changed = 1


@kernel
def heed_gross_error(belief: Belief, ctx: Context, time: float) -> None:
    """With each fix: whether the likeliest place is far from a fine receiver's, or from any one's.

    Args:
        belief: In place; hypotheses at the fix are added where none lives there.
        ctx: The drive's constants.
        time: Of the fix, s.
    """
    state = belief.state[0]
    gross = state.separation.gross
    gross.astray *= math.exp(-max(time - gross.aged, 0.0) / ctx.par[0].gnss_fault_time)
    gross.aged = time
    agreed = gross.p == 0.0
    gross.p = 0.0
    fine = is_fine(state)
    if not (fine or state.mode != WHEELS) or not is_gross(belief.hyp[heaviest(belief)]):
        return
    if agreed and time - gross.time > _LATELY:
        gross.time = gross.offered = time
    prior = _UNMEASURED if fine and state.mode != WHEELS else _ODDS
    odds = prior * math.exp(-(time - gross.time) / ctx.par[0].gnss_fault_time)
    gross.p = min(1.0 / (1.0 + odds), _MOST)
    gross.error[0], gross.error[1], gross.sigma = error_of(state, belief.hyp[heaviest(belief)])
    if time - gross.offered < _EVERY:
        return
    gross.offered = time
    for i in range(state.count):
        if belief.hyp[i].weight > _OF_SIDE and _square(belief.hyp[i]) < _SMALL**2:
            return
    _offer(belief, gross.p)


@kernel
def is_gross(hyp: Record) -> bool:
    """Whether the receiver is far off by a hypothesis."""
    return bool(_square(hyp) > FAULT**2)


@kernel
def error_of(state: Record, hyp: Record) -> tuple[float, float, float]:
    """A receiver's error, m, by the axes of the plane, and its usual sigma; smoothed, as then."""
    gross = state.separation.gross
    if state.hindsight == 1:
        return gross.error[0], gross.error[1], gross.sigma
    root = state.bias_root
    dx = root[0] * hyp.mu[GX] + root[1] * hyp.mu[GY]
    dy = root[1] * hyp.mu[GX] + root[2] * hyp.mu[GY]
    return dx, dy, math.sqrt(trace_of(state))
