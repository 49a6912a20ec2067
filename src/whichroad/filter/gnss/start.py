"""Starts at a fix: what is known then of odometer, heading and receiver."""

import math

from ..._compile import Record, kernel
from ..gyro import restart
from ..hypotheses.births import Start, cold_start
from ..map_error import forget_map
from ..state import CLOCK, WHEELS, Belief, Context, Path, X, Y
from .bias import may_lead_astray
from .inflation import COARSE, inflation_of, is_inflated, tail_of
from .noise import update_root
from .position import has_course
from .sides import keep_bias

_FINER = 3.0  # times
_EITHER = 0.5  # P(fixes err) where the vehicle is looked for anew at them
_LONG_WAY = 100.0  # m without a fix, behind which hypotheses may be anywhere:
_ANYWHERE, _FINE = 150.0, 10.0  # m, least sigma of them, and over that of the fix


@kernel
def _calibration(state: Record, par: Record, epoch: Record) -> tuple[float, float, float, float]:
    """κ and b at a start, each with its sigma: as last known, the speed without odometry."""
    rate = 1.0
    rate_sigma = par.scale_sigma
    drift = 0.0
    drift_sigma = par.drift_sigma if state.mode == WHEELS else 0.0
    if state.mode == CLOCK:
        rate = epoch.speed if epoch.speed_sigma < 10.0 else 6.0
        rate_sigma = min(epoch.speed_sigma, 8.0)
    elif state.known_rate[1] > 0.0:
        rate = state.known_rate[0]
        rate_sigma = math.sqrt(state.known_rate[1])
    if state.mode == WHEELS and state.known_drift[1] > 0.0:
        drift = state.known_drift[0]
        drift_sigma = math.sqrt(state.known_drift[1])
    return rate, rate_sigma, drift, drift_sigma


@kernel
def start_of(belief: Belief, ctx: Context, epoch: Record) -> Start:
    """What is known at a start at the epoch's fix."""
    par = ctx.par[0]
    state = belief.state[0]
    heading_sigma = math.inf
    if has_course(epoch, 0.5):
        heading_sigma = epoch.course_sigma + 0.03
    rate, rate_sigma, drift, drift_sigma = _calibration(state, par, epoch)
    sigmas = math.sqrt(state.gnss_factor)
    return Start(
        sigmas, sigmas * par.gnss_white_ratio, epoch.course, heading_sigma, rate, rate_sigma,
        drift, drift_sigma, True,
    )  # fmt: skip


@kernel
def begin_factor(state: Record, par: Record, epoch: Record) -> None:
    """Nothing is known of how much larger the receiver's errors are than reported."""
    least = 1.0 / (1.0 + par.gnss_white_ratio**2)
    state.gnss_factor = least * par.gnss_start**2
    state.innovation_factor = least * par.gnss_start**2
    state.windowed_factor = least
    state.bias_factor = least
    state.road_prior = inflation_of(par, epoch.fix)
    state.road_energy[0] = state.road_energy[1] = 0.0
    if is_inflated(state, par, epoch):
        state.gnss_factor = state.road_prior
    state.level_tail = tail_of(state, par)


@kernel
def forget_factor(belief: Belief, par: Record, epoch: Record) -> None:
    """Begin the factor anew; biases stay the same metres."""
    state = belief.state[0]
    before = state.gnss_factor
    begin_factor(state, par, epoch)
    keep_bias(belief, math.sqrt(before / state.gnss_factor))


@kernel
def is_far_finer(state: Record, epoch: Record) -> bool:
    """Whether a fix is so much finer than all since a coarse start that it had better begin."""
    finer = state.reported[0] > COARSE and epoch.fix[2] * _FINER < state.reported[0]
    return bool(epoch.has_fix and finer)


@kernel
def is_anywhere(belief: Belief, epoch: Record) -> bool:
    """Whether a fix tells far more than all hypotheses do, and had better begin.

    Where odometry was withheld for long, each of them is sure to hundreds of metres only.  The
    few dozen roads that they are on stand for thousands, so that a fix beside all of them is
    rather right than a jump.
    """
    state = belief.state[0]
    if not epoch.has_fix or state.since_fix < _LONG_WAY:
        return False
    square = 0.0
    for i in range(state.count):
        square += belief.hyp[i].weight * (belief.hyp[i].cov[X, X] + belief.hyp[i].cov[Y, Y])
    return bool(square > max(_ANYWHERE, _FINE * epoch.fix[2]) ** 2)


@kernel(inline=True)
def start_at_fix(belief: Belief, path: Path, ctx: Context, epoch: Record) -> bool:
    """Start, or start anew, from the epoch's fix; returns whether the heading is known."""
    par = ctx.par[0]
    state = belief.state[0]
    if state.misfits >= par.lost_after:
        may_lead_astray(state, _EITHER)
    if state.gnss_factor == 0.0 or is_far_finer(state, epoch):
        begin_factor(state, par, epoch)
    forget_map(state)
    start = start_of(belief, ctx, epoch)
    cold_start(belief, path, ctx, epoch.fix, start, 1.0)
    restart(state.vetting.turn_offset, start.drift, start.drift_sigma**2)
    state.started = 1
    state.misfits = 0.0
    state.still.age = -1.0
    state.still.stands = state.still.at_rest = 0
    state.still.apart = 0.0
    state.since_map = 0.0
    state.moving = 0.0
    state.since_fix = 0.0
    state.unmeasured = 0.0
    state.last_fix = epoch.time
    state.reported[0] = state.reported[1] = epoch.fix[2]
    state.factor_time = epoch.time
    state.unlearnt = 0.0
    state.on_road_at = epoch.time
    state.restarted_at = epoch.time
    state.learnt_time = 0.0
    state.fix_1[2] = -math.inf
    state.fix_2[2] = -math.inf
    state.across_time = -math.inf
    known = start.heading_sigma < 10.0
    state.course_time = epoch.time if known else -math.inf
    state.forward_time = -math.inf
    update_root(belief, epoch.fix, start.bias**2, -1.0)
    return bool(known)
