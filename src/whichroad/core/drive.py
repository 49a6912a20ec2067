"""The compiled loop over the epochs of a drive; on line it runs one epoch at a time."""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Bytes, Matrix, Vector, kernel
from .along import advance_along
from .belief import (
    GNSS_SCALE,
    LAST_FIX,
    LEARNT,
    MISFITS,
    MOVING,
    NOW,
    ODOMETER_SPEED,
    OFF_ROAD,
    PULL,
    QUICK_SCALE,
    SCALED_AT,
    SINCE_FIX,
    SINCE_LEFT,
    SLOW_SCALE,
    SPEED,
    STARTED,
    STOOD,
    TRAVELLED,
    TURN_RATE,
    WANDER_SCALE,
    Belief,
    H,
    K,
    Route,
    X,
    Y,
    normalise,
)
from .gnss import (
    adapt_scale,
    age_receiver,
    forward_only,
    gnss_root,
    observe_fix,
    observe_rate,
    observe_state,
)
from .motion import arc_chord, predict_free
from .network import Roads
from .output import Output, say
from .parameters import Parameters
from .reduction import reduce
from .road import observe_roads
from .start import cold_start, leave_and_return, turn_round, turn_with_heading
from .switching import Work, hand_over

WHEELS, DISTANCE, CLOCK = 0, 1, 2  # what moves the vehicle: wheels with turn, distance, time

_CORNER = math.pi / 2  # rad; the turn whose error is the turn noise times itself
_STEP = 6.0  # m, longest piece in which wheels are followed
_LEAVING = 25.0  # m between the births of off-road hypotheses, where none matters
_PRIOR = 5.0  # s of fixes that the first guess of the GNSS scale is worth
_SLOW, _SLOW_PRIOR = 300.0, 60.0  # s; the same from slow errors
_SMOOTHING = 15.0  # s, of the reported covariance that scales the slow GNSS error
_MOMENT = 0.1  # s, over which the odometer's speed is smoothed
_LATENCY = 0.15  # s, between that and the receiver's Doppler speed
_TURNING = 0.2  # rad/s, from which on the antenna's speed is not M's
_STANDING = 0.5  # m/s; a receiver that says less says that it stands
_RECENT = 10.0  # s; wheels vouch for the motion since a fix this long ago
_BLIND = 500.0  # times more merging without a heading sensor
_YOUNG = 30.0  # s of fixes, before which the belief may be as wrong as the receiver
_FAR = 20.0  # m; a jump that may be the truth, of which the belief knew nothing
_MOST_SECONDS = 25.0  # a pause longer than this, without odometry, starts anew


class Epochs(NamedTuple):
    """What the sensors said, one row an epoch, in time order.

    Odometry is pre-integrated since the epoch before, in M's frame at that epoch.
    """

    time: Vector  # (n,) s
    arc: Vector  # (n,) odometer metres
    turn: Vector  # (n,) rad
    forward: Vector  # (n,) m
    left: Vector  # (n,) m
    moved: Bytes  # (n,) 1: the odometer spoke
    has_fix: Bytes  # (n,)
    fix: Matrix  # (n, 5) x, y (plane), sigma_major, sigma_minor (m), heading of major (rad)
    speed: Vector  # (n,) m/s
    speed_sigma: Vector  # (n,) inf: not reported
    course: Vector  # (n,) heading over ground, rad
    course_sigma: Vector  # (n,) inf: not reported


def new_epochs(n: int) -> Epochs:
    """Empty epochs."""
    arc, turn, forward, left, speed, speed_sigma, course, course_sigma = np.zeros((8, n))
    moved, has_fix = np.zeros((2, n), np.uint8)
    return Epochs(
        np.zeros(n), arc, turn, forward, left, moved, has_fix, np.zeros((n, 5)), speed,
        speed_sigma, course, course_sigma,
    )  # fmt: skip


@kernel
def _roll(
    belief: Belief, scale: float, epochs: Epochs, k: int, pieces: int, par: Parameters
) -> None:
    """Wheels (equation 1): everything moves in the plane by one of equal pieces of the arc."""
    part = 1.0 / pieces
    turn = epochs.turn[k] * part
    forward = epochs.forward[k]
    left = epochs.left[k]
    if pieces > 1:  # the same circle
        forward, left = arc_chord(epochs.arc[k] * part, turn)
    metres = abs(epochs.arc[k]) * part
    q_heading = par.heading_noise**2 * metres + par.turn_noise**2 * _CORNER * abs(turn)
    q_along = par.along_noise**2 * metres
    if epochs.moved[k] == 0:  # nobody measured it
        q_along += 0.04 * metres * metres
        q_heading += 0.01 * metres
    for i in range(belief.size[0]):
        predict_free(
            belief.mean[i], belief.cov[i], forward, left, turn, epochs.arc[k] * part, scale,
            q_along, par.lateral_noise**2 * metres, q_heading, 1e-10 * metres,
            par.yaw_bias_noise**2 * metres,
        )  # fmt: skip


@kernel
def _move_along(
    belief: Belief, roads: Roads, route: Route, work: Work, scale: float, epochs: Epochs,
    k: int, dt: float, mode: int, side: float, par: Parameters,
) -> bool:  # fmt: skip
    """Distance or time alone: roads tell the turn; off the roads, straight on."""
    if mode == CLOCK:
        odometer = dt
        q_rate = par.acceleration_noise**2 * dt
        q_along = q_rate * dt * dt / 3.0 + 0.01 * dt
        q_cross = q_rate * dt / 2.0
        q_free = 0.09 * dt
    else:
        odometer = epochs.arc[k]
        metres = abs(odometer)
        q_rate = 1e-10 * metres
        q_along = (3.0 * par.along_noise) ** 2 * metres
        q_cross = 0.0
        q_free = 0.0025 * metres
    turns = turn_round(
        belief, roads, par.u_turn_rate * dt, 3.0 + par.acceleration_noise * dt, mode == CLOCK,
        side, par.lane_sigma,
    )  # fmt: skip
    changed = advance_along(
        belief, roads, route, work, scale, odometer, q_along, q_rate, q_cross,
        par.edge_heading_sigma**2, par.node_radius, par.node_heading_sigma**2, side,
        par.lane_sigma, par.prune,
    )  # fmt: skip
    for i in range(belief.size[0]):
        if belief.edge[i] == OFF_ROAD:
            predict_free(
                belief.mean[i], belief.cov[i], odometer, 0.0, 0.0, odometer, scale,
                q_along, 0.25 * q_along, q_free, q_rate, 0.0,
            )  # fmt: skip
    if mode == CLOCK:
        forward_only(belief, work.row, scale)
    return changed or turns


@kernel
def _begin(
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
        belief, roads, route, work, 1.0, epochs.fix[k], factor, factor * par.gnss_white_ratio, scale, lever, heading, heading_sigma, rate,
        rate_sigma, par.drift_sigma if mode == WHEELS else 0.0, side, par.lane_sigma,
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
    clock[LEARNT] = 0.0
    gnss_root(belief, epochs.fix[k], factor * factor, -1.0, _SMOOTHING, work.root)
    return heading_sigma < 10.0


@kernel
def _odometer_speed(clock: Vector, arc: float, dt: float) -> None:
    """Smooth the odometer's speed, and see how fast it changes."""
    if dt > 1e-6:
        behind = arc / dt - clock[ODOMETER_SPEED]
        clock[ODOMETER_SPEED] += behind * dt / (_MOMENT + dt)
        clock[PULL] = behind / (_MOMENT + dt)


@kernel
def _count_motion(clock: Vector, moved: float, dt: float) -> None:
    """Distances and times that slow states and the map's spacing are measured by."""
    clock[TRAVELLED] += moved
    clock[SINCE_FIX] += moved
    clock[SINCE_LEFT] += moved
    if moved > 0.05 * dt:
        clock[MOVING] += dt
        clock[STOOD] = 0.0
    else:
        clock[STOOD] += dt


@kernel
def _vouched(epochs: Epochs, k: int, mode: int) -> bool:
    """Whether something else than positions tells the motion: an odometer, or Doppler."""
    return bool(mode != CLOCK or epochs.speed_sigma[k] < 1.0)


@kernel
def _learn_scale(
    belief: Belief, work: Work, scale: float, epochs: Epochs, k: int, mode: int, lever: Vector,
    par: Parameters, white: float, moving: float,
) -> None:  # fmt: skip
    """From the fix of epoch k, the vehicle having moved for so many seconds since the last."""
    clock = belief.clock
    since = min(max(epochs.time[k] - clock[SCALED_AT], 0.0), _RECENT)
    clock[SCALED_AT] = epochs.time[k]
    clock[LEARNT] += since
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


@kernel
def _stand(
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


@kernel
def _doubt(
    belief: Belief, roads: Roads, route: Route, work: Work, scale: float, epochs: Epochs,
    k: int, side: float, lever: Vector, white: float, par: Parameters,
) -> None:  # fmt: skip
    """A fix far away: perhaps it is right, and all that was believed is wrong.

    Beginnings at the fix are added with a small probability; what roads and fixes say from
    here on decides between them and a receiver that has lost its way.
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
            math.sqrt(cov[H, H]) + 0.03, mean[K], math.sqrt(cov[K, K]), par.drift_sigma, side,
            par.lane_sigma, par.map_sigma, par.search_radius, par.off_road_start, par.wrong_way,
        )  # fmt: skip


@kernel
def _take_fix(
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
    gnss_root(belief, epochs.fix[k], factor, max(interval, 0.0), _SMOOTHING, work.root)
    since = epochs.time[k] - clock[LAST_FIX]
    white = math.sqrt(factor) * par.gnss_white_ratio
    _learn_scale(belief, work, scale, epochs, k, mode, lever, par, white, clock[MOVING])
    clock[MOVING] = 0.0
    clock[SINCE_FIX] = 0.0
    clock[LAST_FIX] = epochs.time[k]
    thin = max(1.0, 1.0 / max(interval, 0.01))
    chi2 = observe_fix(
        belief, epochs.fix[k], work.root, interval, scale, lever, white, par.gnss_gate,
        _vouched(epochs, k, mode) and since < _RECENT and clock[LEARNT] > _YOUNG, work.row,
    )  # fmt: skip
    if mode == WHEELS and chi2 > 4.0 * par.gnss_gate and par.gnss_lost > 0.0:
        _doubt(belief, roads, route, work, scale, epochs, k, side, lever, white, par)
    moving = epochs.speed_sigma[k] > 1e6 or epochs.speed[k] > 2.0
    if epochs.course_sigma[k] < 1.0 and moving and clock[SPEED] > -0.5:
        swing = clock[TURN_RATE] * lever[0] / max(abs(clock[SPEED]), 2.0)  # the antenna's own
        variance = (epochs.course_sigma[k] ** 2 + 0.0025) * thin
        observe_state(belief, H, epochs.course[k] - swing, variance, scale, work.row)
    if mode != CLOCK and epochs.speed_sigma[k] < 5.0 and abs(clock[TURN_RATE]) < _TURNING:
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
    if chi2 > 4.0 * par.gnss_gate:
        clock[MISFITS] += 1.0
    else:
        clock[MISFITS] = 0.0
    return chi2


@kernel
def _off_road_matters(belief: Belief) -> bool:
    for i in range(belief.size[0]):
        if belief.edge[i] == OFF_ROAD and belief.probability[i] > 1e-3:
            return True
    return False


@kernel
def _speed(belief: Belief, epochs: Epochs, k: int, dt: float, mode: int) -> float:
    """Speed of M over ground, m/s, by the weighted κ."""
    rate = 0.0
    for i in range(belief.size[0]):
        rate += belief.probability[i] * belief.mean[i, K]
    if mode == CLOCK:
        return rate
    return float(rate * epochs.arc[k] / dt if dt > 1e-6 else belief.clock[SPEED])


@kernel
def run(
    belief: Belief, roads: Roads, route: Route, work: Work, epochs: Epochs, output: Output,
    first: int, last: int, mode: int, side: float, lever: Vector, par: Parameters,
    outage_after: float, ambiguous_below: float, cut: bool,
) -> int:  # fmt: skip
    """Localize over epochs first … last − 1: the paper's Figure 7, once per epoch.

    predict – observe GNSS – branch along the roads – observe the map – weigh – merge –
    prune – say.

    Args:
        belief: The state of the filter, in place; empty before the first fix.
        roads: The network.
        route: Tree of edges entered.
        work: Scratch.
        epochs: What the sensors said.
        output: Filled for the same rows.
        first: First epoch.
        last: One past the last.
        mode: WHEELS, DISTANCE or CLOCK.
        side: 1 where one drives on the right, −1 on the left.
        lever: Antenna ahead and left of M, m, (2,).
        par: The settings.
        outage_after: Seconds without a fix that make an outage.
        ambiguous_below: P(edge) below which the road is ambiguous.
        cut: Whether Gaussians are cut at the ends of edges.

    Returns:
        The epoch it stopped before: `last`, or earlier when the route tree is full.
    """
    clock = belief.clock
    for k in range(first, last):
        if len(route.edge) - route.size[0] < 2048 and len(route.edge) > 2048:
            return k
        fix = epochs.has_fix[k] == 1
        dt = epochs.time[k] - clock[NOW]
        clock[NOW] = epochs.time[k]
        if clock[STARTED] == 0.0 and not fix:
            continue
        x = belief.mean[0, X] if clock[STARTED] else epochs.fix[k, 0]
        y = belief.mean[0, Y] if clock[STARTED] else epochs.fix[k, 1]
        scale = 1.0 + roads.curvature * (x * x + y * y)
        begin = fix and (
            clock[STARTED] == 0.0
            or clock[MISFITS] >= par.lost_after
            or (mode == CLOCK and dt > _MOST_SECONDS)
        )
        stands = (
            mode == CLOCK
            and epochs.speed_sigma[k] < 1.0
            and epochs.speed[k] < _STANDING
            and clock[SPEED] < 3.0 * _STANDING
        )
        with_heading = mode == WHEELS
        changed = begin
        chi2 = 0.0
        pieces = 1
        if begin:
            known = _begin(belief, roads, route, work, scale, epochs, k, mode, side, lever, par)
            with_heading = known and mode != CLOCK
            dt = 0.0
        elif mode == WHEELS:
            pieces = max(1, math.ceil(abs(epochs.arc[k]) / _STEP))
        for piece in range(pieces):
            done = piece == pieces - 1
            arc = 0.0
            if not begin:
                if mode == WHEELS:
                    arc = epochs.arc[k] / pieces
                    moved = abs(arc)
                    _roll(belief, scale, epochs, k, pieces, par)
                    if dt > 1e-6:
                        clock[TURN_RATE] = epochs.turn[k] / dt
                elif stands:
                    moved = 0.0
                else:
                    moved = abs(clock[SPEED]) * dt if mode == CLOCK else abs(epochs.arc[k])
                    changed = _move_along(
                        belief, roads, route, work, scale, epochs, k, dt, mode, side, par
                    )
                _count_motion(clock, moved, dt / pieces)
            if done and mode != CLOCK:
                _odometer_speed(clock, epochs.arc[k], dt)
            see_fix = fix and done and not begin
            if see_fix and (stands or (mode != CLOCK and clock[SINCE_FIX] <= 0.3)):
                _stand(belief, work, scale, epochs, k, mode, lever, par)
                see_fix = False
            if see_fix:
                normalise(belief)
                chi2 = _take_fix(
                    belief, roads, route, work, scale, epochs, k, mode, side, lever, par
                )  # fmt: skip
                changed = True
            if changed:
                normalise(belief)
            if arc != 0.0 or see_fix:
                changed = (
                    hand_over(
                        belief, roads, route, work, scale, arc, side, par.lane_sigma, par.prune,
                        cut,
                    )
                    or changed
                )  # fmt: skip
            if done and (begin or clock[TRAVELLED] >= par.map_spacing):
                if changed:
                    normalise(belief)
                if not begin and (clock[SINCE_LEFT] >= _LEAVING or _off_road_matters(belief)):
                    leave_and_return(
                        belief, roads, work, scale, clock[SINCE_LEFT], par.off_road_leave,
                        par.off_road_return, side, par.lane_sigma, par.map_sigma,
                        par.search_radius, par.wrong_way, mode != WHEELS,
                    )  # fmt: skip
                    clock[SINCE_LEFT] = 0.0
                if mode == WHEELS and not begin:
                    turn_with_heading(belief, roads, side, par.lane_sigma)
                observe_roads(
                    belief, roads, scale, side, with_heading, par.relative_sigma,
                    par.edge_heading_sigma, par.node_radius, par.node_sigma,
                    par.node_heading_sigma, par.lane_sigma, par.lane_length, par.map_sigma,
                    par.map_length, par.off_road_cost, work.row,
                )  # fmt: skip
                clock[TRAVELLED] = 0.0
                changed = True
            if changed:
                limit = par.merge
                most = int(par.components)
                if mode != WHEELS:  # without a heading there is less to keep apart
                    limit *= _BLIND
                    most = (most + 1) // 2
                reduce(belief, route, scale, par.prune, limit, most)
        clock[SPEED] = _speed(belief, epochs, k, dt, mode)
        say(belief, roads, output, k, scale, outage_after, ambiguous_below, par.protection_risk, chi2)
    return last
