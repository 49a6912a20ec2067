"""What an epoch's GNSS does to the belief: begin, observe, learn what it is worth, doubt."""

import math

from ._jit import Vector, kernel, part
from .angles import wrap
from .belief import (
    ACROSS,
    BEFORE,
    GNSS_SCALE,
    LAST_FIX,
    LEARNT,
    MISFITS,
    MOVING,
    NOW,
    ODOMETER_SPEED,
    OFF_ROAD,
    ON_ROAD_AT,
    PULL,
    QUICK_SCALE,
    SCALED_AT,
    SINCE_FIX,
    SLOW_SCALE,
    SPEED,
    STARTED,
    STOOD,
    TRAVELLED,
    TURN_RATE,
    WANDER_SCALE,
    WHITE,
    Belief,
    H,
    K,
    Route,
    X,
    Y,
    normalise,
)
from .epoch import CLOCK, WHEELS, Epochs
from .gnss import adapt_scale, age_receiver, gnss_root, observe_fix, observe_rate, observe_state
from .network import Roads
from .parameters import Parameters
from .segment import project
from .start import cold_start
from .switching import Work

_PRIOR = 5.0  # s of fixes that the first guess of the GNSS scale is worth
_SLOW, _SLOW_PRIOR = 300.0, 60.0  # s; the same from slow errors
_SMOOTHING = 15.0  # s, of the reported covariance that scales the slow GNSS error
_LATENCY = 0.15  # s, between that and the receiver's Doppler speed
_TURNING = 0.2  # rad/s, from which on the antenna's speed is not M's
_NEXT = 2.5  # s, between fixes whose second difference is noise
_STRAIGHT = 0.35  # rad; less than this two roads turn, across which noise is compared
_SURE = 0.8  # P of the road across which it is compared
_UNTOLD = 0.5  # of the reported variance is new with every fix, of fixes far apart, until seen;
_FEW = 4.0  # differences of fixes that this is worth,
_REMEMBERED = 15.0  # and so many are remembered at least
_LASTS = 0.1  # of the variance of fixes is slow at least
_RECENT = 10.0  # s; wheels vouch for the motion since a fix this long ago
_YOUNG = 30.0  # s of fixes, before which the belief may be as wrong as the receiver
_REFUTED = 0.3  # of what is pruned; a fix that leaves a road less is not taken in by it
_FAR = 20.0  # m; a fix so far away may be the truth, of which the belief knew nothing
_ASTRAY = 5.0  # s off the roads, from which on a fix far away is doubted less than the belief


@part
def begin_at(
    belief: Belief, roads: Roads, route: Route, work: Work, scale: float, epochs: Epochs,
    k: int, mode: int, side: float, lever: Vector, par: Parameters,
) -> bool:  # fmt: skip
    """Start, or start anew, from the fix of epoch k; returns whether the heading is known."""
    heading = epochs.course[k]
    heading_sigma = math.inf
    if epochs.course_sigma[k] < 0.5 and (epochs.speed_sigma[k] > 1e6 or epochs.speed[k] > 2.0):
        heading_sigma = epochs.course_sigma[k] + 0.03
    rate = 1.0
    rate_sigma = par.scale_sigma
    if mode == CLOCK:
        rate = epochs.speed[k] if epochs.speed_sigma[k] < 10.0 else 6.0
        rate_sigma = min(epochs.speed_sigma[k], 8.0)
    if belief.clock[GNSS_SCALE] == 0.0:
        least = 1.0 / (1.0 + par.gnss_white_ratio**2)
        belief.clock[GNSS_SCALE] = least * par.gnss_start**2
        belief.clock[QUICK_SCALE] = least * par.gnss_start**2
        belief.clock[WANDER_SCALE] = least
        belief.clock[SLOW_SCALE] = least
    factor = math.sqrt(belief.clock[GNSS_SCALE])
    cold_start(
        belief, roads, route, work, 1.0, epochs.fix[k], factor,
        factor * par.gnss_white_ratio, scale, lever, heading, heading_sigma, rate, rate_sigma,
        par.drift_sigma if mode == WHEELS else 0.0, side, par.lane_sigma,
        par.map_sigma, par.search_radius, par.off_road_start, par.wrong_way,
    )  # fmt: skip
    clock = belief.clock
    clock[STARTED] = 1.0
    clock[MISFITS] = 0.0
    clock[TRAVELLED] = 0.0
    clock[MOVING] = 0.0
    clock[SINCE_FIX] = 0.0
    clock[LAST_FIX] = epochs.time[k]
    clock[SCALED_AT] = epochs.time[k]
    clock[ON_ROAD_AT] = epochs.time[k]
    clock[LEARNT] = 0.0
    clock[BEFORE + 2] = -math.inf
    clock[BEFORE + 5] = -math.inf
    clock[ACROSS + 2] = -math.inf
    gnss_root(belief, epochs.fix[k], factor * factor, -1.0, _SMOOTHING, work.root)
    return heading_sigma < 10.0


@kernel
def _vouched(epochs: Epochs, k: int, mode: int) -> bool:
    """Whether something else than positions tells the motion in the plane: wheels, or Doppler."""
    return bool(mode == WHEELS or epochs.speed_sigma[k] < 1.0)


@part
def _learn_scale(
    belief: Belief, work: Work, scale: float, epochs: Epochs, k: int, mode: int, lever: Vector,
    par: Parameters, white: float, moving: float,
) -> None:  # fmt: skip
    """From the fix of epoch k, the vehicle having moved for so many seconds since the last."""
    clock = belief.clock
    since = min(max(epochs.time[k] - clock[SCALED_AT], 0.0), _RECENT)
    clock[SCALED_AT] = epochs.time[k]
    clock[LEARNT] += since
    if par.gnss_adapt_time > 1e9:
        return
    gain = since / (_PRIOR + clock[LEARNT])
    gain = max(gain, 1.0 - math.exp(-since / par.gnss_adapt_time))
    if not _vouched(epochs, k, mode):
        clock[QUICK_SCALE] += gain * (1.0 - clock[QUICK_SCALE])
        clock[GNSS_SCALE] = max(clock[QUICK_SCALE], 1.0)
        return
    moving = min(moving, _RECENT)
    slow_gain = max(moving / (_SLOW_PRIOR + clock[LEARNT]), 1.0 - math.exp(-moving / _SLOW))
    adapt_scale(
        belief, epochs.fix[k], work.root, white,
        1.0 - math.exp(-2.0 * clock[STOOD] / par.gnss_time), scale, lever, gain,
        slow_gain, 1.0 / (1.0 + par.gnss_white_ratio**2), work.row,
    )  # fmt: skip


@part
def stand(
    belief: Belief, work: Work, scale: float, epochs: Epochs, k: int, mode: int, lever: Vector,
    par: Parameters,
) -> None:  # fmt: skip
    """Standing still teaches nothing of the position, but of what the receiver is worth."""
    clock = belief.clock
    interval = max(epochs.time[k] - clock[LAST_FIX], 0.0)
    gnss_root(belief, epochs.fix[k], clock[GNSS_SCALE], interval, _SMOOTHING, work.root)
    white = math.sqrt(clock[GNSS_SCALE]) * par.gnss_white_ratio
    _learn_scale(belief, work, scale, epochs, k, mode, lever, par, white, 0.0)
    clock[LAST_FIX] = epochs.time[k]


@part
def _astray(belief: Belief, now: float) -> bool:
    """Whether the belief has been off the roads for a while; then it counts anew.

    A fix seldom misfits for long: what the receiver is worth and the slow error adapt to it.
    Roads do not; a belief that left them with a wrong position would stay wrong.
    """
    off = 0.0
    for i in range(belief.size[0]):
        if belief.edge[i] == OFF_ROAD:
            off += belief.probability[i]
    clock = belief.clock
    astray = now > clock[ON_ROAD_AT] + _ASTRAY
    if off < 0.5 or astray:
        clock[ON_ROAD_AT] = now
    return off >= 0.5 and astray


@part
def _doubt(
    belief: Belief, roads: Roads, route: Route, work: Work, scale: float, epochs: Epochs,
    k: int, side: float, lever: Vector, white: float, par: Parameters, astray: bool,
) -> None:  # fmt: skip
    """A fix far away: perhaps it is right, and all that was believed is wrong.

    Beginnings at the fix are added with a small probability; what roads and fixes say from
    here on decides between them and a receiver that has lost its way.  A belief that has gone
    astray does not know its heading either: the car may have been carried.
    """
    normalise(belief)
    top = 0
    for i in range(belief.size[0]):
        if belief.probability[i] > belief.probability[top]:
            top = i
    mean = belief.mean[top]
    cov = belief.cov[top]
    away = math.hypot(epochs.fix[k, 0] - mean[X], epochs.fix[k, 1] - mean[Y]) / scale
    if away > _FAR:
        cold_start(
            belief, roads, route, work, par.gnss_lost, epochs.fix[k],
            math.sqrt(belief.clock[GNSS_SCALE]), white, scale, lever, mean[H],
            math.inf if astray else math.sqrt(cov[H, H]) + 0.03, mean[K],
            math.sqrt(cov[K, K]), par.drift_sigma, side, par.lane_sigma, par.map_sigma,
            par.search_radius, par.off_road_start, par.wrong_way,
        )  # fmt: skip


@part
def _see_white(belief: Belief, epochs: Epochs, k: int, scale: float, par: Parameters) -> None:
    """What changes from fix to fix, from second differences of positions: nothing drives so.

        e = z_k - (1 + a) z_k-1 + a z_k-2,    a = (t_k - t_k-1) / (t_k-1 - t_k-2)

    has the variance (1 + (1 + a)^2 + a^2) white^2 on each axis, and the acceleration's, which
    is little between fixes a second or two apart.
    """
    clock = belief.clock
    x = epochs.fix[k, 0]
    y = epochs.fix[k, 1]
    t = epochs.time[k]
    last = t - clock[BEFORE + 2]
    first = clock[BEFORE + 2] - clock[BEFORE + 5]
    if 0.05 < last < _NEXT and 0.05 < first < _NEXT:
        a = last / first
        ex = (x - (1.0 + a) * clock[BEFORE] + a * clock[BEFORE + 3]) / scale
        ey = (y - (1.0 + a) * clock[BEFORE + 1] + a * clock[BEFORE + 4]) / scale
        seen = (ex * ex + ey * ey) / (2.0 * (1.0 + (1.0 + a) ** 2 + a * a))
        usual = max(clock[WHITE], par.gnss_white_ratio**2)
        seen = min(seen / (epochs.fix[k, 2] * epochs.fix[k, 3]), 4.0 * usual)
        gain = max(last / (_PRIOR + clock[LEARNT]), 1.0 - math.exp(-last / par.gnss_adapt_time))
        clock[WHITE] += min(gain, 1.0) * (seen - clock[WHITE])
    for i in range(3):
        clock[BEFORE + 3 + i] = clock[BEFORE + i]
    clock[BEFORE] = x
    clock[BEFORE + 1] = y
    clock[BEFORE + 2] = t


@part
def see_across(
    belief: Belief, roads: Roads, epochs: Epochs, k: int, scale: float, par: Parameters
) -> None:
    """What changes between fixes far apart, from their offsets across a road.

    Along the road it may have been driven in any way; across it the difference of two
    offsets has twice the variance of what does not last from one to the other.
    """
    clock = belief.clock
    if clock[WHITE] == 0.0:
        clock[WHITE] = _UNTOLD
    top = 0
    for i in range(belief.size[0]):
        if belief.probability[i] > belief.probability[top]:
            top = i
    edge = belief.edge[top]
    if edge == OFF_ROAD:
        clock[ACROSS + 2] = -math.inf
        return
    p = 0.0
    for i in range(belief.size[0]):
        if belief.edge[i] == edge:
            p += belief.probability[i]
    _, _, across, tx, ty = project(
        roads, edge, belief.segment[top], epochs.fix[k, 0], epochs.fix[k, 1]
    )
    across /= scale
    heading = math.atan2(ty, tx)
    last = clock[NOW] - clock[ACROSS + 2]
    if p > _SURE and last < 100.0 and abs(wrap(heading - clock[ACROSS + 1])) < _STRAIGHT:
        usual = max(clock[WHITE], par.gnss_white_ratio**2)
        seen = 0.5 * (across - clock[ACROSS]) ** 2 / (epochs.fix[k, 2] * epochs.fix[k, 3])
        count = clock[LEARNT] / min(last, _RECENT)
        forgets = max(par.gnss_adapt_time, _REMEMBERED * last)
        gain = max(1.0 / (_FEW + count), 1.0 - math.exp(-last / forgets))
        clock[WHITE] += min(gain, 1.0) * (min(seen, 4.0 * usual) - clock[WHITE])
    clock[ACROSS] = across
    clock[ACROSS + 1] = heading
    clock[ACROSS + 2] = clock[NOW] if p > _SURE else -math.inf


@part
def take_fix(
    belief: Belief, roads: Roads, route: Route, work: Work, scale: float, epochs: Epochs,
    k: int, mode: int, side: float, lever: Vector, par: Parameters,
) -> float:  # fmt: skip
    """GNSS position, course and speed of epoch k."""
    clock = belief.clock
    interval = epochs.time[k] - clock[LAST_FIX]
    if mode == CLOCK:
        interval *= min(1.0, max(clock[SPEED], 0.25))
    age_receiver(belief, clock[MOVING], par.gnss_time, par.gnss_fault_time)
    factor = clock[GNSS_SCALE]
    white = math.sqrt(factor) * par.gnss_white_ratio
    if mode == CLOCK:
        _see_white(belief, epochs, k, scale, par)
        more = clock[WHITE] - white * white
        if more > 0.0 and par.gnss_adapt_time < 1e9:  # less of the error lasts
            factor = max(factor - more, _LASTS * factor)
            white = math.sqrt(clock[WHITE])
    gnss_root(belief, epochs.fix[k], factor, max(interval, 0.0), _SMOOTHING, work.root)
    since = epochs.time[k] - clock[LAST_FIX]
    _learn_scale(belief, work, scale, epochs, k, mode, lever, par, white, clock[MOVING])
    clock[MOVING] = 0.0
    clock[SINCE_FIX] = 0.0
    clock[LAST_FIX] = epochs.time[k]
    thin = max(1.0, 1.0 / max(interval, 0.01))
    chi2 = observe_fix(
        belief, epochs.fix[k], work.root, interval, scale, lever, white, par.gnss_gate,
        _vouched(epochs, k, mode) and since < _RECENT and clock[LEARNT] > _YOUNG, work.row,
        _REFUTED * par.prune,
    )  # fmt: skip
    misfit = chi2 > 4.0 * par.gnss_gate
    astray = mode == WHEELS and _astray(belief, epochs.time[k])
    if mode == WHEELS and par.gnss_lost > 0.0 and (astray or misfit):
        _doubt(belief, roads, route, work, scale, epochs, k, side, lever, white, par, astray)
    moving = epochs.speed_sigma[k] > 1e6 or epochs.speed[k] > 2.0
    if epochs.course_sigma[k] < 1.0 and moving and clock[SPEED] > -0.5:
        swing = clock[TURN_RATE] * lever[0] / max(abs(clock[SPEED]), 2.0)  # the antenna's own
        variance = (epochs.course_sigma[k] ** 2 + 0.0025) * thin
        observe_state(belief, H, epochs.course[k] - swing, variance, scale, work.row)
    if mode == WHEELS and epochs.speed_sigma[k] < 5.0 and abs(clock[TURN_RATE]) < _TURNING:
        odometer_speed = abs(clock[ODOMETER_SPEED])
        if min(epochs.speed[k], odometer_speed) > 2.0:
            late = _LATENCY * clock[PULL]
            variance = (epochs.speed_sigma[k] ** 2 + 0.04 + late * late) * thin
            observe_rate(
                belief, odometer_speed, epochs.speed[k], variance, par.gnss_gate, scale, work.row
            )
    if mode == CLOCK and epochs.speed_sigma[k] < 20.0:
        observe_state(
            belief, K, epochs.speed[k], (epochs.speed_sigma[k] ** 2 + 0.04) * thin, scale,
            work.row,
        )  # fmt: skip
    if misfit:
        clock[MISFITS] += 1.0
    else:
        clock[MISFITS] = 0.0
    return chi2
