"""Speed and course of a receiver alone: both may come out of a filter, late, and be wrong at times.

A receiver that reports a small sigma measured them by Doppler.  Of any other the latency is learnt,
by its courses in turns: late by L they are wrong by L times the turn rate.
"""

import math

from ..._compile import Record, kernel
from ...graph.geometry import wrap
from ..gaussian import log_density
from ..hypotheses.no_sign import face_course
from ..state import CLOCK, ROUTES, WHEELS, Belief, Context, H, K, redraw
from .inflation import FILTERED
from .position import has_course, observe_rate, observe_state

LATENCY = 0.15  # s, of the receiver's Doppler speed behind the odometer
_LATE = 0.5  # s, by which speeds and courses of a filter lag, as far as is known,
_TURNS = 0.03  # rad²/s², weight of that,
_LATEST = 3.0  # s; and by no more than this
_SAFETY = 2.0  # times the latency that courses show: speeds may be later
_SECOND, _APART = 0.95, 2.5  # s, between fixes whose direction is compared with the course,
_FAR = 5.0  # and m
_MOST = 1.2  # rad, largest difference that says something of the latency
_WRONG_COURSE = 0.1 / (2.0 * math.pi)  # 1/rad, density of courses that say nothing
_WRONG_STOP = 0.05 / 30.0  # s/m, density of zeros that do
_STOP = 0.5  # m/s
_STOPS, _REST = 0.05, 0.02  # P(at rest at the end of a way), and variance of that speed, m²/s²
_TURNING = 0.2  # rad/s, from which on the antenna's speed is not M's
_TURN_SIGMA = 0.1  # rad/s, of the turn rate at the moment of a fix
_SLOW = 2.0  # m/s, below which speeds do not observe the odometer's scale
_LOWEST, _LONGEST = 1.0, 2.0  # s, between reports whose difference is a rate
_SOONEST = 0.01  # s, between two reports


@kernel
def latency_of(state: Record, sigma: float) -> float:
    """Latency of reported courses and speeds, s, as learnt by courses.

    The speeds of a filter, which their `sigma` (m/s) tells, may be later.
    """
    filtered = sigma >= FILTERED
    moments = state.reports.latency
    usual = _LATE if filtered else LATENCY
    late = (_TURNS * usual + moments[0]) / (_TURNS + moments[1])
    return float(min(max(_SAFETY * late if filtered else late, LATENCY), _LATEST))


@kernel(inline=True)
def _follow(report: Record, value: float, time: float, turns: bool) -> None:
    """How fast a report changes, over a second: `report` is its last value, when, and its rate."""
    if report[1] > -math.inf:
        change = wrap(value - report[0]) if turns else value - report[0]
        since = max(time - report[1], _SOONEST)
        rate = change / min(since, _LONGEST)
        report[2] += (rate - report[2]) * min(since / _LOWEST, 1.0)
    report[0] = value
    report[1] = time


@kernel(inline=True)
def _learn_latency(state: Record, epoch: Record) -> None:
    """Moments of the latency L, from courses and the directions between fixes a second apart.

    A direction is the heading half of the interval ago, a course is that of L ago.  In a turn of
    the rate ω they differ by (Δt/2 − L) ω.
    """
    then = state.reports.place
    lasted = epoch.time - then[2]
    if lasted < _SECOND:
        return
    x = epoch.fix[0] - then[0]
    y = epoch.fix[1] - then[1]
    if lasted < _APART and math.hypot(x, y) > _FAR * state.scale:
        rate = wrap(epoch.course - then[3]) / lasted
        off = wrap(epoch.course - math.atan2(y, x))
        if abs(off) < _MOST:
            state.reports.latency[0] += rate * (0.5 * lasted * rate - off)
            state.reports.latency[1] += rate * rate
    then[0] = epoch.fix[0]
    then[1] = epoch.fix[1]
    then[2] = epoch.time
    then[3] = epoch.course


@kernel(inline=True)
def observe_reported(
    belief: Belief, ctx: Context, epoch: Record, course_variance: float, thin: float
) -> None:
    """Condition on course and speed where nothing else measures the motion.

    Args:
        belief: In place; weights are to be normalised afterwards.
        ctx: The drive's constants.
        epoch: With a fix.
        course_variance: Of the course, rad², before its latency.
        thin: Factor on variances of reports that come sooner than every second.
    """
    state = belief.state[0]
    filtered = epoch.speed_sigma >= FILTERED
    late = latency_of(state, epoch.speed_sigma)
    if has_course(epoch, 1.0):
        _follow(state.reports.course, epoch.course, epoch.time, True)
        _learn_latency(state, epoch)
    if has_course(epoch, 1.0) and state.speed > -0.5:
        variance = (course_variance + (late * state.reports.course[2]) ** 2) * thin
        observe_state(belief, ctx, H, epoch.course, variance, _WRONG_COURSE if filtered else 0.0)
        state.course_time = epoch.time
    if epoch.speed_sigma < 20.0:
        _follow(state.reports.speed, epoch.speed, epoch.time, False)
        variance = (epoch.speed_sigma**2 + 0.04 + (late * state.reports.speed[2]) ** 2) * thin
        wrong = _WRONG_STOP if filtered and epoch.speed < _STOP else 0.0
        if wrong > 0.0 and state.motion == ROUTES:
            _let_stop(belief, epoch.speed, variance)
        observe_state(belief, ctx, K, epoch.speed, variance, wrong)


@kernel
def _let_stop(belief: Belief, speed: float, variance: float) -> None:
    """Let hypotheses have come to rest at the end of a way since a sparse fix, if a report says so.

    Else its mean speed is taken for that of its end, and who creeps on in a queue still drives.

    Args:
        belief: In place.
        speed: As reported, m/s.
        variance: Of its error.
    """
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        drives = math.exp(log_density(speed - hyp.mu[K], variance + hyp.cov[K, K]))
        stops = _STOPS * math.exp(log_density(speed, variance + _REST))
        if stops > drives:
            redraw(hyp, K, 0.0, _REST)
            hyp.log_weight += math.log(_STOPS)


@kernel(inline=True)
def observe_motion(belief: Belief, ctx: Context, epoch: Record, thin: float) -> None:
    """Course and Doppler speed of an epoch.

    Args:
        belief: In place; weights are to be normalised afterwards.
        ctx: The drive's constants.
        epoch: With a fix.
        thin: Times the variance, for fixes less than a second apart.
    """
    par = ctx.par[0]
    state = belief.state[0]
    if state.mode == CLOCK:
        observe_reported(belief, ctx, epoch, epoch.course_sigma**2 + 0.0025, thin)
        return
    if has_course(epoch, 1.0) and state.speed > -0.5:
        speed = max(abs(state.speed), 1.0)
        _learn_latency(state, epoch)
        swing = state.turn_rate[1] * par.lever[0] / speed  # the antenna's own
        unknown = _TURN_SIGMA * par.lever[0] / speed
        behind = (latency_of(state, epoch.speed_sigma) - LATENCY) * state.turn_rate[1]
        variance = epoch.course_sigma**2 + 0.0025 + unknown * unknown + behind * behind
        variance *= thin
        face_course(belief)
        observe_state(belief, ctx, H, epoch.course - math.atan(swing), variance, 0.0)
        face_course(belief)
        state.course_time = epoch.time
    rolls = state.mode == WHEELS and state.vetting.slip.by == 0.0 and state.vetting.slow.coarse == 0
    if rolls and epoch.speed_sigma < 5.0 and abs(state.turn_rate[0]) < _TURNING:
        odometer_speed = abs(state.odometer_speed)
        if min(epoch.speed, odometer_speed) > _SLOW:
            late = latency_of(state, epoch.speed_sigma) * state.odometer_acceleration
            variance = (epoch.speed_sigma**2 + 0.04 + late * late) * thin
            observe_rate(belief, ctx, odometer_speed, epoch.speed, variance)
