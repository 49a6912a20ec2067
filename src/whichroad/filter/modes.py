"""From one way of moving to another: what the state means by κ and b changes with it."""

import math

from .._compile import Record, kernel
from ._simd import copy_record
from .creeping import creep
from .gnss.departure import p_departed
from .gnss.silence import FASTEST, hear, is_gap, is_pause, may_be_lost, may_have_moved
from .gyro import forget_offset, mend_turn, restart
from .lookback.history import History
from .motion import GYRO_PACE
from .state import CLOCK, DISTANCE, WHEELS, B, Belief, Context, H, K, X, Y, most_probable, redraw
from .vetting.drift_walk import forget_walk, learn_walk
from .vetting.facing import face_forward
from .vetting.latency import clear_latency
from .vetting.motion_sources import (
    AHEAD,
    ARC,
    COURSE,
    NONE,
    SPEED,
    TURN,
    TURNS,
    is_borne_out,
    is_possible,
)
from .vetting.repeats import is_repeated
from .vetting.scales import forget_scale
from .vetting.vet import mode_of, refuse_standing, vet
from .vetting.wheel_size import mend_scales
from .vetting.windows import BY_GYRO, BY_WHEELS, UNTURNED, is_alone

_IN_GAP = 0.3  # P(it has driven round corners unseen, or stopped) in a gap of all sensors
_LEAST_SPEED = 0.5  # m/s, error of a speed taken over,
_OF_SPEED = 0.1  # and share of it
_OF_ROAD = 0.1  # rad, by which a vehicle may head otherwise than its road
_UNSURE = 3.0  # s for which odometry that changed as cars seldom do counts as not measured
_LEAST_PACE = 3.0  # m/s
_DISPUTED = 30.0  # s after a misfit, for which odometry that is found impossible has caused it
_SMOOTHING = 0.1  # s, time constant of the odometer's speed
_DEPARTED = 0.5  # P that it has driven off while its odometer stood, from which on it starts anew
_ROLLS = 0.5  # m/s, from which on a vehicle does not stand
_BACKED = 5.0  # s since it may have backed up, for which clocks are not compared
_HEADED = 0.1  # rad², variance of a heading by which fixes and odometry are compared
_FAR = 5.0  # m beyond two sigmas, from which on a fix is not where the vehicle was thought


@kernel(inline=True)
def switch(belief: Belief, history: History, ctx: Context, mode: int) -> None:
    """Let the vehicle be moved by other sensors from now on.

    Without odometry κ is the speed, and what was learnt of the odometer is kept until it comes
    back.

    Args:
        belief: In place; its state has the mode until now.
        history: The link over this moment knows neither position nor rate.
        ctx: The drive's constants.
        mode: WHEELS, DISTANCE or CLOCK.
    """
    state = belief.state[0]
    par = ctx.par[0]
    before = state.mode
    state.mode = mode
    state.turn_rate[0] = state.turn_rate[1] = 0.0
    history.since[0].switched = 1
    if before != CLOCK:
        _store_scale(belief, before)
    if mode == CLOCK:
        speed = abs(state.vetting.sound * state.known_rate[0])
        if state.vetting.refused[ARC] == 1 and state.vetting.pace >= 0.0:
            speed = state.vetting.pace
        sigma = _LEAST_SPEED + _OF_SPEED * speed
        for i in range(state.count):
            redraw(belief.hyp[i], K, speed, sigma * sigma)
            redraw(belief.hyp[i], B, 0.0, 0.0)
        state.speed = speed
        if speed > _ROLLS:  # it was the odometer that stood
            state.standing = 0.0
        return
    rate = (1.0, par.scale_sigma**2)
    drift = (0.0, par.drift_sigma**2)
    if state.known_rate[1] > 0.0:
        rate = (state.known_rate[0], state.known_rate[1])
    if state.known_drift[1] > 0.0:
        drift = (state.known_drift[0], state.known_drift[1])
    if abs(state.vetting.drift - drift[0]) > 3.0 * math.sqrt(drift[1]):
        drift = (state.vetting.drift, (0.2 * state.vetting.drift) ** 2 + par.drift_sigma**2)
    if before == CLOCK:
        state.vetting.returned_at = state.vetting.windows.now.time
    for i in range(state.count):
        if before == CLOCK:
            redraw(belief.hyp[i], K, rate[0], rate[1])
            belief.hyp[i].cov[H, H] += _OF_ROAD**2
        if mode == WHEELS:
            redraw(belief.hyp[i], B, drift[0], drift[1])
        else:
            redraw(belief.hyp[i], B, 0.0, 0.0)


@kernel
def _store_scale(belief: Belief, mode: int) -> None:
    """Keep what was learnt of the odometer's scale, and of the drift."""
    state = belief.state[0]
    top = belief.hyp[most_probable(belief)]
    state.known_rate[0] = top.mu[K]
    state.known_rate[1] = top.cov[K, K]
    if mode == WHEELS:
        state.known_drift[0] = top.mu[B]
        state.known_drift[1] = top.cov[B, B]


@kernel
def is_elsewhere(belief: Belief, epoch: Record) -> bool:
    """Whether a fix is far from where the vehicle was thought to be."""
    state = belief.state[0]
    top = belief.hyp[most_probable(belief)]
    away = math.hypot(epoch.fix[0] - top.mu[X], epoch.fix[1] - top.mu[Y]) / state.scale
    variance = epoch.fix[2] ** 2 + top.cov[X, X] + top.cov[Y, Y]
    return bool(away > 2.0 * math.sqrt(variance) + _FAR)


@kernel
def _start_elsewhere(belief: Belief, par: Record, epoch: Record, surely: bool) -> None:
    """Start anew at a fix that is far away: what moved the vehicle until now was wrong.

    Args:
        belief: In place.
        par: The model's numbers.
        epoch: With the fix.
        surely: Whatever its distance: the vehicle has driven off, or clocks are put right.
    """
    state = belief.state[0]
    if surely or is_elsewhere(belief, epoch):
        state.misfits = par.lost_after
        state.gnss_factor = 0.0


@kernel
def _take_scale(belief: Belief, par: Record, epoch: Record) -> None:
    """Odometry is multiplied by another number from now on; where that has moved it, start anew."""
    state = belief.state[0]
    scale = state.vetting.wheel_size.scale
    scale.found = 0
    state.known_rate[0] = scale.rate
    state.known_rate[1] = scale.rate_variance
    state.vetting.windows.count = 0
    for i in range(state.count):
        redraw(belief.hyp[i], K, scale.rate, scale.rate_variance)
    _start_elsewhere(belief, par, epoch, False)


@kernel(inline=True)
def _heed_news(belief: Belief, par: Record, epoch: Record, departed: bool) -> None:
    """A source of motion that is not believed from this fix on may have led the vehicle astray."""
    vetting = belief.state[0].vetting
    if vetting.latency.found == 1:
        vetting.latency.found = 0
        forget_scale(vetting.wheel_size.scale)
        forget_scale(vetting.turn_size.scale)
        vetting.wheel_size.begun = vetting.turn_size.begun = 0
        _start_elsewhere(belief, par, epoch, True)
    if vetting.turn_size.scale.found == 1:
        vetting.turn_size.scale.found = 0
        vetting.windows.count = 0
        clear_latency(vetting.latency)  # wrong turns look like a delay
        _start_elsewhere(belief, par, epoch, vetting.latency.found == 1)
        vetting.latency.found = 0
    if vetting.wheel_size.scale.found == 1:
        _take_scale(belief, par, epoch)
    if vetting.exposed == 1:
        vetting.exposed = 0
        _start_elsewhere(belief, par, epoch, departed)
    if vetting.news == TURNS and is_elsewhere(belief, epoch):
        vetting.elsewhere = 1
    elif vetting.news != NONE:
        _start_elsewhere(belief, par, epoch, departed)


@kernel
def pass_calibration(belief: Belief, par: Record, gyro: int) -> None:
    """Tell the vetting what was learnt of the odometry's drift."""
    state = belief.state[0]
    if state.mode == WHEELS and state.count > 0:
        top = belief.hyp[most_probable(belief)]
        drift = top.mu[B]
        if gyro == BY_WHEELS:
            arc = state.vetting.windows.now.arc
            learn_walk(state.vetting.walk, drift, top.cov[B, B], arc, par.yaw_bias_noise**2)
        elif gyro == BY_GYRO:  # a metre of its clock is a time
            drift *= GYRO_PACE / max(abs(state.odometer_speed), _LEAST_PACE)
        state.vetting.drift = drift
    _pass_pose(belief, par)


@kernel
def _pass_pose(belief: Belief, par: Record) -> None:
    """Tell the latency which way the vehicle heads, and the odometer's scale."""
    state = belief.state[0]
    latency = state.vetting.latency
    scale = state.vetting.wheel_size.scale
    latency.heading[1] = math.inf
    scale.rate_variance = math.inf
    backs = state.time - state.direction.doubted < _BACKED
    if state.mode == CLOCK or state.count == 0 or backs:
        return
    top = belief.hyp[most_probable(belief)]
    if top.cov[H, H] > _HEADED:
        return
    latency.heading[0] = top.mu[H]
    latency.heading[1] = top.cov[H, H]
    latency.rate = top.mu[K]
    scale.rate = top.mu[K]
    scale.rate_variance = top.cov[K, K]
    latency.antenna[0] = par.lever[0]
    latency.antenna[1] = par.lever[1]


@kernel
def _heed_gyro(belief: Belief, history: History, par: Record, gyro: int) -> None:
    """Where another sensor measures the turn from now on, nothing is known of its drift."""
    state = belief.state[0]
    steered = BY_WHEELS if gyro == BY_WHEELS else BY_GYRO
    vetting = state.vetting
    if steered == vetting.steered:
        return
    vetting.steered = steered
    vetting.score[TURN] = 0.0
    vetting.refused[TURN] = 0
    vetting.turned = 0
    vetting.tried = 0
    vetting.reported[TURN] = 0.0
    vetting.seen[TURN] = 0.0
    vetting.drift = 0.0
    forget_walk(vetting.walk)
    vetting.windows.count = 0  # turns until now were those of the other one
    forget_scale(vetting.turn_size.scale)
    vetting.turn_size.begun = 0
    state.known_drift[0] = state.known_drift[1] = 0.0
    restart(vetting.turn_offset, 0.0, par.drift_sigma**2)
    if state.mode == WHEELS and state.count > 0:
        history.since[0].switched = 1
        for i in range(state.count):
            redraw(belief.hyp[i], B, 0.0, par.drift_sigma**2)


@kernel
def _heed_silence(
    belief: Belief, history: History, reading: Record, sensors: int, dt: float
) -> None:  # fmt: skip
    """After a long pause of all sensors nothing is known of the motion meanwhile.

    After a shorter one of sensors that measure turns the vehicle may have driven round corners.
    A gyro that turns the vehicle while its wheels are silent is no pause.
    """
    state = belief.state[0]
    quiet = reading.time - state.heard[0]
    rates = reading.gyro == BY_GYRO
    if sensors != CLOCK and state.count > 0 and is_pause(quiet, state.heard[1]):
        may_have_moved(state, reading.arc, quiet)
        if state.mode != CLOCK:
            _store_scale(belief, state.mode)
        history.since[0].switched = 1
        reading.arc = 0.0
        reading.turn = 0.0
        reading.forward = 0.0
        reading.left = 0.0
        state.vetting.missed = 0
        state.vetting.silent = 0.0
    elif sensors == WHEELS and state.count > 0 and is_gap(dt, state.heard[1], rates):
        may_be_lost(state, _IN_GAP, FASTEST * dt if rates else abs(reading.arc))
    if reading.has_fix or reading.odometry_valid == 1 or is_alone(reading):
        hear(state, reading.time)


@kernel
def _withhold_repeats(vetting: Record, reading: Record, dt: float, sensors: int) -> None:
    """Take a fix that only repeats a place out of a reading."""
    measured = sensors != CLOCK and reading.odometry_valid > 0 and vetting.refused[ARC] == 0
    if is_repeated(vetting.repeats, reading, dt, measured):
        reading.has_fix = 0
        reading.speed_sigma = reading.course_sigma = math.inf


@kernel
def _withhold_reports(vetting: Record, reading: Record) -> None:
    """Take what the receiver reports of its motion out of a reading, where it is not believed."""
    if vetting.refused[SPEED] == 1 or vetting.odd > 0:
        reading.speed_sigma = math.inf
    if vetting.refused[COURSE] == 1 or not is_borne_out(vetting):
        reading.course_sigma = math.inf


@kernel
def _turn_about(belief: Belief, par: Record) -> None:
    """Start anew at this fix: the vehicle faces the other way."""
    state = belief.state[0]
    state.known_drift[0] = state.known_drift[1] = 0.0
    forget_offset(state.vetting.turn_offset)
    state.misfits = par.lost_after


@kernel(inline=True)
def believed(belief: Belief, history: History, ctx: Context, epoch: Record) -> Record:
    """Vet an epoch, and let the vehicle be moved by what is believed.

    Args:
        belief: In place.
        history: The link over a change knows neither position nor rate.
        ctx: The drive's constants.
        epoch: What the sensors measured.

    Returns:
        The epoch less what is withheld, a buffer of the context.
    """
    reading = ctx.work.reading[0]
    state = belief.state[0]
    par = ctx.par[0]
    copy_record(reading, epoch)
    mend_scales(state.vetting.wheel_size.scale, state.vetting.turn_size.scale, reading)
    if par.paper:
        state.mode = par.mode
        return reading
    vetting = state.vetting
    dt = epoch.time - state.time if vetting.begun == 1 else 0.0
    vetting.begun = 1
    creep(vetting, reading, dt)
    sensors = DISTANCE if par.mode == WHEELS and epoch.gyro == UNTURNED else par.mode
    _withhold_repeats(vetting, reading, dt, sensors)
    if reading.has_fix:
        pass_calibration(belief, par, epoch.gyro)
    if sensors == WHEELS:
        _heed_gyro(belief, history, par, epoch.gyro)
    if sensors != CLOCK and face_forward(vetting, reading, dt, sensors == WHEELS):
        _turn_about(belief, par)
    mend_turn(vetting.turn_offset, reading)
    vet(vetting, reading, dt, sensors, max(state.scale, 0.1))
    _heed_silence(belief, history, reading, sensors, dt)
    departed = p_departed(state) > _DEPARTED
    if departed and reading.has_fix:
        refuse_standing(vetting)
    _withhold_reports(vetting, reading)
    if epoch.time - vetting.suspect_at < _UNSURE and reading.odometry_valid != AHEAD:
        reading.odometry_valid = 0
    mode = mode_of(vetting, sensors)
    if state.count == 0:
        state.mode = mode
    elif mode != state.mode:
        disputed = epoch.time - vetting.forked_at < _DISPUTED
        if state.mode == WHEELS and disputed and not is_possible(vetting):
            vetting.exposed = 1
        switch(belief, history, ctx, mode)
    if reading.has_fix:
        _heed_news(belief, par, epoch, departed)
    return reading


@kernel
def follow_odometer(state: Record, arc: float, dt: float) -> None:
    """Speed and acceleration by the odometer, low-pass filtered, after `arc` metres in dt s."""
    behind = arc / dt - state.odometer_speed
    state.odometer_speed += behind * dt / (_SMOOTHING + dt)
    state.odometer_acceleration = behind / (_SMOOTHING + dt)
