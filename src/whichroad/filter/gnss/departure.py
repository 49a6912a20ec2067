"""Fixes that leave a vehicle: either the receiver errs, or it is no longer where it seems.

Counters that stand still while the vehicle drives off look like a stop.  Until fixes and odometer
have been compared for long enough, the level covers the place of the fixes, too, and how far the
vehicle has come since the last one.  Where positions are measured, and at most a distance, who
turns round or into a street that the map lacks is followed along the road that was left.  The same
holds there.
"""

import math

from ..._compile import Record, Vector, kernel
from ..state import CLOCK, WHEELS, Belief, X, Y, heaviest
from ..vetting.motion_sources import SPEED
from .position import NU0, NU1, Axes
from .separation import cover_place

_ANOTHER = 0.5  # s between the beginnings of two stops
_PRIOR = 8.0  # nats for the odometer where a fix is as far away as expected,
_BOTH = 11.5  # and for odometer and receiver's speed that both stand,
_DRIFTS = 10.0  # m, for each of which fixes of a standing vehicle drift off by a nat seldomer
_DOPPLER, _STANDS = 1.0, 0.5  # m/s: sigma of a speed that was measured; a receiver that stands
_REPORTED = 5.0  # nats less where the receiver says that the vehicle drives
_LATE = 3.0  # s by which receivers' speeds may be late
_SOFT = 1.5  # times: squared distances over their variances
_RECENT = 5.0  # s, the age of a fix up to which it is covered
_FASTEST = 30.0  # m/s
_USUAL = 15.0  # s over which the error of a receiver is taken that the vehicle has not left
_SLIGHT = 0.02  # P that a vehicle whose motion nothing measures has left its road, that is nothing
_MOVES = -math.inf  # in place of when it came to rest


@kernel
def drives(epoch: Record) -> bool:
    """Whether the receiver has measured that the vehicle drives."""
    return bool(epoch.speed_sigma < _DOPPLER and epoch.speed > _STANDS + 3.0 * epoch.speed_sigma)


@kernel
def _begin(state: Record, hyp: Record, fix: Vector, dx: float, dy: float, since: float) -> None:
    """Note where a vehicle has come to rest, and by what its fixes differ from its place."""
    left = state.separation.departure
    left.since = since
    left.p = 0.0
    left.variance = 0.5 * (hyp.cov[X, X] + hyp.cov[Y, Y])
    left.variance += 2.0 * state.gnss_factor * fix[2] * fix[3]
    left.place[0] = hyp.mu[X]
    left.place[1] = hyp.mu[Y]
    left.offset[0] = fix[0] - state.scale * dx - hyp.mu[X]
    left.offset[1] = fix[1] - state.scale * dy - hyp.mu[Y]


@kernel(inline=True)
def note_departure(belief: Belief, epoch: Record, axes: Axes) -> None:
    """Where a fix of a standing vehicle is, and P(the vehicle is there).

        S = P + 2 R,    P(departed) = 1 / (1 + exp(8 − d² / (3 S)))

    with d how far the fix is from where it was expected when the vehicle came to rest, and R its
    variance then, which counts twice as the receiver's error may be another one by now.  Where
    the receiver's speed is 0, too, it is 1 / (1 + exp(11.5 − d / 10 m)).

    Args:
        belief: With the innovations of the fix.
        epoch: With the fix.
        axes: Of the fix.
    """
    state = belief.state[0]
    left = state.separation.departure
    slow = state.vetting.slow.seconds > 0.0  # it may creep
    if state.standing <= 0.0 or state.mode == CLOCK or slow:
        if is_followed_blindly(state, epoch):
            _note_stray(belief, epoch, axes)
        return
    fix = epoch.fix
    since = epoch.time - state.standing
    if abs(since - left.since) > _ANOTHER:
        hyp = belief.hyp[heaviest(belief)]
        along = hyp.scratch[NU0]
        aside = hyp.scratch[NU1]
        dx = axes.c * along - axes.s * aside
        _begin(state, hyp, fix, dx, axes.s * along + axes.c * aside, since)
        return
    windows = state.vetting.windows
    left.at[0] = fix[0] - left.offset[0]
    left.at[1] = fix[1] - left.offset[1]
    dx = (left.at[0] - left.place[0]) / state.scale
    dy = (left.at[1] - left.place[1]) / state.scale
    prior = _PRIOR
    odds = 0.5 * (dx * dx + dy * dy) / (_SOFT * left.variance)
    pace = math.hypot(windows.vx, windows.vy) if windows.moves == 1 else 0.0
    if epoch.speed_sigma < _DOPPLER and state.vetting.refused[SPEED] == 0:
        if epoch.speed < _STANDS:
            prior = _BOTH
            odds = min(odds, math.hypot(dx, dy) / _DRIFTS)
        else:
            pace = epoch.speed
            if drives(epoch) and state.standing > _LATE:
                prior = _PRIOR - _REPORTED
    left.p = 1.0 / (1.0 + math.exp(prior - odds))
    left.pace = min(pace, _FASTEST)
    left.time = epoch.time


@kernel
def is_followed_blindly(state: Record, epoch: Record) -> bool:
    """Whether positions, and at most a distance, are all that is measured of a vehicle."""
    silent = epoch.speed_sigma == math.inf and epoch.course_sigma == math.inf
    return bool(state.mode != WHEELS and silent)


@kernel
def _note_stray(belief: Belief, epoch: Record, axes: Axes) -> None:
    """Where a fix of a moving vehicle is, and P(the vehicle is there), as where it stands.

    The receiver's error is what fixes differ from the belief by, on average over 15 s.  Without an
    odometer, a fix farther from the one before than a vehicle drives is wrong, and is left out.
    """
    state = belief.state[0]
    left = state.separation.departure
    hyp = belief.hyp[heaviest(belief)]
    fix = epoch.fix
    along = hyp.scratch[NU0]
    aside = hyp.scratch[NU1]
    dx = axes.c * along - axes.s * aside  # to the fix, less the error that the belief expects
    dy = axes.s * along + axes.c * aside
    ex = fix[0] - hyp.mu[X] - state.scale * dx
    ey = fix[1] - hyp.mu[Y] - state.scale * dy
    since = epoch.time - left.time
    keep = math.exp(-since / _USUAL)
    if left.since != _MOVES or since > _USUAL:
        keep = 0.0
    if state.mode == CLOCK and keep > 0.0:
        moved = math.hypot(
            fix[0] - left.offset[0] - left.at[0], fix[1] - left.offset[1] - left.at[1]
        )
        if moved > state.scale * (_FASTEST * since + 3.0 * math.sqrt(left.variance)):  # it errs
            left.p = 0.0
            return
    left.since = _MOVES
    left.time = epoch.time
    left.pace = abs(state.speed if state.mode == CLOCK else state.odometer_speed)
    left.offset[0] = ex + keep * (left.offset[0] - ex)
    left.offset[1] = ey + keep * (left.offset[1] - ey)
    left.at[0] = fix[0] - left.offset[0]
    left.at[1] = fix[1] - left.offset[1]
    dx = (left.at[0] - hyp.mu[X]) / state.scale
    dy = (left.at[1] - hyp.mu[Y]) / state.scale
    left.variance = 0.5 * (hyp.cov[X, X] + hyp.cov[Y, Y])
    left.variance += 2.0 * state.gnss_factor * fix[2] * fix[3]
    odds = 0.5 * (dx * dx + dy * dy) / (_SOFT * left.variance)
    left.p = 1.0 / (1.0 + math.exp(_PRIOR - odds))


@kernel
def p_strayed(state: Record) -> float:
    """P(the vehicle has left what it is thought to drive on, though nothing measures turns)."""
    left = state.separation.departure
    if state.mode == WHEELS or left.since != _MOVES or state.time - left.time > _RECENT:
        return 0.0
    return float(left.p) if state.mode != CLOCK or left.p > _SLIGHT else 0.0


@kernel
def p_elsewhere(state: Record) -> float:
    """P(the vehicle is at its fixes, and not at its place by the odometer)."""
    return max(p_departed(state), p_strayed(state))


@kernel
def p_departed(state: Record) -> float:
    """P(the vehicle has driven off, though its odometer stands)."""
    left = state.separation.departure
    another = abs(state.time - state.standing - left.since) > _ANOTHER
    if state.standing <= 0.0 or another or state.time - left.time > _RECENT:
        return 0.0
    return float(left.p)


@kernel
def cover_departure(state: Record, out: Record, risk: float) -> None:
    """Let an estimate cover where the fixes are of a vehicle that may have left its place.

    A fix at a distance d with sigma a, the vehicle's place with the probability p, at the speed
    v and t seconds ago is covered by r = d + v t + a √(2 log(p / risk)).

    Args:
        state: With the last fix.
        out: The estimate, in place: levels and covariance.
        risk: Of the level.
    """
    left = state.separation.departure
    p = p_elsewhere(state)
    if p <= risk:
        return
    dx = (left.at[0] - out.x) / state.scale
    dy = (left.at[1] - out.y) / state.scale
    times = math.sqrt(2.0 * math.log(p / risk))
    more = left.pace * (state.time - left.time) + times * math.sqrt(left.variance)
    cover_place(out, dx, dy, p, (more, more, more))
