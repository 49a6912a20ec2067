"""A gyro at rest: standing means no turn, so that what it says then is its bias.

A yaw rate computed from a steering wheel whose zero is wrong errs by so many rad a metre, and shows
nothing of that at rest.  With o what is to be added a metre, and v the vehicle's pace, b is

    β at rest,    β + o v / GYRO_PACE in motion

So it may be another by as much as is not known of o, where the vehicle comes to rest and where it
drives off.  What the motion between two rests has told of b, less what the rest tells, observes o.
Gyros have none: o is 0 with a probability that each rest weighs, and is normal else.  Turns are
mended by its mean.
"""

import math

from .._compile import Record, kernel
from .gaussian import log_density, update_state
from .lookback.history import History, accumulate_noise
from .motion import GYRO_PACE, Increment, Noise, arc_chord
from .records import COPIES
from .state import B, Belief, most_probable
from .vetting.scales import forget_drift, forget_scale
from .vetting.windows import AT_REST, BY_GYRO, GYRO_ALONE

_RESTS = 0.05  # m/s by the odometer, below which the vehicle stands
_TURNS = 0.03  # rad/s beyond which a gyro turns, whatever the odometer says
_WALK = 1e-3  # rad/√s, random walk of a gyro's turn,
_UNEVEN = 3e-4  # and rad/s by which its bias differs from reading to reading
_PRIOR, _SIGMA = 0.1, 1e-3  # P(turns err by the metre), and by how much then, rad/m
_LEFT = 3.0  # m, after which a vehicle has driven off
_PACE, _PACE_TIME = 10.0, 20.0  # m/s, pace before any was seen; s, over which it is averaged
_OF_BIAS = 1.5e-3  # rad/s, by which a bias in motion is another than at rest, whatever the pace
_INFORMS = 0.7  # share of the variance, below which motion has told something
_ANOTHER = 2e-4  # rad/m, change of the offset from which on turns until now were others


@kernel
def mend_turn(offset: Record, reading: Record) -> None:
    """Add to a gyro's turn what it errs by the metre, as learnt.

    Args:
        offset: TURN_OFFSET.
        reading: What the sensors measured, in place.
    """
    by_gyro = reading.gyro == BY_GYRO or reading.gyro == GYRO_ALONE
    if by_gyro and offset.mends != 0.0:
        reading.turn += offset.mends * reading.arc
        reading.forward, reading.left = arc_chord(reading.arc, reading.turn)


@kernel
def restart(offset: Record, drift: float, variance: float) -> None:
    """The drift b is drawn anew: what motion tells of it is told from here on.

    Args:
        offset: TURN_OFFSET, in place.
        drift: b,
        variance: and its variance.
    """
    offset.left[0], offset.left[1] = drift, variance
    offset.before[1] = math.inf


@kernel
def forget_offset(offset: Record) -> None:
    """Nothing is known of an offset any more."""
    offset.pace = offset.mends = 0.0
    offset.rests = 0


@kernel
def rest(belief: Belief, history: History, par: Record, epoch: Record, dt: float) -> None:
    """Where the vehicle stands, learn the gyro's bias, and turn nothing.

    All hypotheses have the same bias, nearly: their weights stay as they are.

    Args:
        belief: In place.
        history: Its noise since the last step is added to.
        par: The parameters.
        epoch: By a gyro; in place: at rest it has no turn.
        dt: Its duration, s.
    """
    if dt <= 0.0:
        return
    rate = epoch.turn / dt
    offset = belief.state[0].vetting.turn_offset
    if abs(epoch.arc) > _RESTS * dt or epoch.odometry_valid != 1 or abs(rate) > _TURNS:
        offset.left[1] += par.yaw_bias_noise**2 * abs(epoch.arc)
        _move(belief, history, abs(epoch.arc), dt)
        return
    if offset.rests == 0:
        _come_to_rest(belief, history)
    value = -rate / GYRO_PACE
    variance = (_WALK * _WALK / dt + _UNEVEN * _UNEVEN) / (GYRO_PACE * GYRO_PACE)
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        update_state(hyp.mu, hyp.cov, B, value - hyp.mu[B], variance, belief.state[0].scale)
    epoch.turn = 0.0
    epoch.forward = epoch.arc
    epoch.left = 0.0
    epoch.gyro = AT_REST


@kernel
def _come_to_rest(belief: Belief, history: History) -> None:
    """Keep what is known of b in motion; at rest it may be another."""
    offset = belief.state[0].vetting.turn_offset
    if offset.pace <= 0.0:
        offset.pace = _PACE
        offset.p = _PRIOR
        offset.own[0], offset.own[1] = 0.0, _SIGMA * _SIGMA
        offset.variance = _PRIOR * _SIGMA * _SIGMA
    top = belief.hyp[most_probable(belief)]
    offset.rests = 1
    offset.moved = 0.0
    offset.before[0] = top.mu[B]
    offset.before[1] = top.cov[B, B]
    _loosen(belief, history)


@kernel
def _move(belief: Belief, history: History, metres: float, dt: float) -> None:
    """Follow the pace of a vehicle that moves, and learn as it drives off."""
    offset = belief.state[0].vetting.turn_offset
    if offset.rests == 1:
        offset.moved += metres
        if offset.moved > _LEFT:
            _drive_off(belief, history)
    elif offset.pace > 0.0:
        offset.pace += (metres / dt - offset.pace) * dt / (_PACE_TIME + dt)


@kernel
def _drive_off(belief: Belief, history: History) -> None:
    """What the rest has told of b is held against the motion before; in motion b may be another."""
    state = belief.state[0]
    offset = state.vetting.turn_offset
    top = belief.hyp[most_probable(belief)]
    offset.rests = 0
    before = offset.mends
    _learn(offset, top.mu[B], top.cov[B, B])
    if abs(offset.mends - before) > _ANOTHER:
        state.vetting.windows.count = 0
        state.vetting.turn_size.begun = 0
        forget_scale(state.vetting.turn_size.scale)
        forget_drift(state.vetting.turn_size.scale)
    _loosen(belief, history)
    offset.left[0] = top.mu[B]
    offset.left[1] = top.cov[B, B]


@kernel
def _learn(offset: Record, bias: float, variance: float) -> None:
    """Weigh what motion has told of b, less that at rest, for and against an offset.

    Args:
        offset: TURN_OFFSET, in place.
        bias: b at rest, rad/m of the gyro's clock,
        variance: and its variance.
    """
    prior = offset.left[1]
    known = offset.before[1]
    if prior <= 0.0 or known > _INFORMS * prior:
        return
    apart = 1.0 / (1.0 / known - 1.0 / prior)
    in_motion = apart * (offset.before[0] / known - offset.left[0] / prior)
    by_metre = GYRO_PACE / max(offset.pace, 0.1)
    nu = (in_motion - bias) * by_metre + offset.mends
    s = (apart + variance + (_OF_BIAS / GYRO_PACE) ** 2) * by_metre * by_metre
    own = offset.own
    off = nu - own[0]
    for_it = math.log(offset.p) + log_density(off, own[1] + s)
    against = math.log(1.0 - offset.p) + log_density(nu, s)
    offset.p = 1.0 / (1.0 + math.exp(min(max(against - for_it, -20.0), 20.0)))
    gain = own[1] / (own[1] + s)
    own[0] += gain * off
    own[1] *= 1.0 - gain
    offset.mends = offset.p * own[0]
    offset.variance = offset.p * (own[1] + (1.0 - offset.p) * own[0] * own[0])


@kernel
def _loosen(belief: Belief, history: History) -> None:
    """Let b be another, by what is not known of the offset."""
    state = belief.state[0]
    offset = state.vetting.turn_offset
    q = offset.variance * (offset.pace / GYRO_PACE) ** 2
    for i in range(state.count):
        belief.hyp[i].cov[B, B] += q
    for k in range(COPIES):
        state.separation.reckoned[k].cov[B, B] += q
    if len(history.steps) > 0:
        still = Increment(0.0, 0.0, 0.0, 0.0, 0.0)
        accumulate_noise(history, still, Noise(0.0, 0.0, 0.0, 0.0, q, 0.0))
