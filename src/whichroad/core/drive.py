"""The compiled loop over the epochs of a drive; on line it runs one epoch at a time."""

import math

from ._jit import Vector, entry, kernel, part
from .along import advance_along, forward_only
from .belief import (
    MISFITS,
    MOVING,
    NOW,
    ODOMETER_SPEED,
    OFF_ROAD,
    PULL,
    SINCE_FIX,
    SINCE_LEFT,
    SPEED,
    STARTED,
    STOOD,
    TRAVELLED,
    TURN_RATE,
    Belief,
    K,
    Route,
    X,
    Y,
    normalise,
)
from .epoch import CLOCK, WHEELS, Epochs
from .fixes import begin_at, see_across, stand, take_fix
from .memory import GNSS_AGED, JUMPED, MAP_AGED, Memory, is_full, note_motion, remember
from .motion import arc_chord, predict_free
from .network import Roads
from .output import Output, say
from .parameters import Parameters
from .place import settle
from .reduction import reduce
from .road import observe_roads
from .start import leave_and_return, turn_round, turn_with_heading
from .switching import Work, hand_over
from .travel import travel

_CORNER = math.pi / 2  # rad; the turn whose error is the turn noise times itself
_STEP = 6.0  # m, longest piece in which wheels are followed
_LEAVING = 25.0  # m between the births of off-road hypotheses, where none matters
_MOMENT = 0.1  # s, over which the odometer's speed is smoothed
_STANDING = 0.5  # m/s; a receiver that says less says that it stands
_PASSED = 1e-3  # probability past the end of an edge before it is looked for there
_BLIND = 500.0  # times more merging without a heading sensor
SPARSE = 2.5  # s; fixes farther apart are joined by routes
_MOST_SECONDS = 1800.0  # a pause longer than this, without odometry, starts anew


@entry
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


@part
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
        par.lane_sigma, par.prune, _PASSED,
    )  # fmt: skip
    for i in range(belief.size[0]):
        if belief.edge[i] == OFF_ROAD:
            predict_free(
                belief.mean[i], belief.cov[i], odometer, 0.0, 0.0, odometer, scale,
                q_along, 0.25 * q_along, q_free, q_rate, 0.0,
            )  # fmt: skip
    weighed = mode == CLOCK and forward_only(belief, work.row, scale)
    return changed or turns or weighed


@part
def _odometer_speed(clock: Vector, arc: float, dt: float) -> None:
    """Smooth the odometer's speed, and see how fast it changes."""
    if dt > 1e-6:
        behind = arc / dt - clock[ODOMETER_SPEED]
        clock[ODOMETER_SPEED] += behind * dt / (_MOMENT + dt)
        clock[PULL] = behind / (_MOMENT + dt)


@part
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
def _off_road_matters(belief: Belief) -> bool:
    for i in range(belief.size[0]):
        if belief.edge[i] == OFF_ROAD and belief.probability[i] > 1e-3:
            return True
    return False


@part
def _speed(belief: Belief, epochs: Epochs, k: int, dt: float, mode: int) -> float:
    """Speed of M over ground, m/s, by the weighted κ."""
    rate = 0.0
    for i in range(belief.size[0]):
        rate += belief.probability[i] * belief.mean[i, K]
    if mode == CLOCK:
        return rate
    return float(rate * epochs.arc[k] / dt if dt > 1e-6 else belief.clock[SPEED])


@entry
def run(
    belief: Belief, roads: Roads, route: Route, work: Work, epochs: Epochs, output: Output,
    first: int, last: int, mode: int, side: float, lever: Vector, par: Parameters,
    outage_after: float, ambiguous_below: float, cut: bool, memory: Memory,
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
        memory: What is kept for looking back; of no length where nobody will.

    Returns:
        The epoch it stopped before: `last`, or earlier when the route tree or the memory
        is full.
    """
    clock = belief.clock
    remembers = len(memory.time) > 0
    for k in range(first, last):
        if len(route.edge) - route.size[0] < 2048 and len(route.edge) > 2048:
            return k
        if remembers and is_full(memory):
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
        sparse = mode == CLOCK and fix and dt > SPARSE and not begin and not stands
        with_heading = mode == WHEELS
        changed = begin
        chi2 = 0.0
        pieces = 1
        if begin:
            known = begin_at(belief, roads, route, work, scale, epochs, k, mode, side, lever, par)
            with_heading = known and mode != CLOCK
            dt = 0.0
        elif mode == WHEELS:
            pieces = max(1, math.ceil(abs(epochs.arc[k]) / _STEP))
        if remembers and not begin:
            note_motion(memory, epochs, k, 0.0 if stands else dt, clock[SPEED], mode)
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
                elif sparse:
                    moved = travel(belief, roads, route, work, scale, epochs.fix[k], dt, side, par)
                    if remembers:
                        memory.since[JUMPED] = 1.0
                        memory.since[MAP_AGED] += moved
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
                stand(belief, work, scale, epochs, k, mode, lever, par)
                see_fix = False
            if see_fix:
                if sparse:
                    normalise(belief)
                if remembers:
                    memory.since[GNSS_AGED] += clock[MOVING]
                chi2 = take_fix(
                    belief, roads, route, work, scale, epochs, k, mode, side, lever, par
                )  # fmt: skip
                changed = True
            if sparse:
                settle(belief, roads, scale)
                forward_only(belief, work.row, scale)
                clock[TRAVELLED] = 0.0
            if changed:
                normalise(belief)
            if sparse:
                see_across(belief, roads, epochs, k, scale, par)
                clock[SINCE_LEFT] = 0.0
            elif arc != 0.0 or see_fix:
                changed = (
                    hand_over(
                        belief, roads, route, work, scale, arc, side, par.lane_sigma, par.prune,
                        0.0 if mode == WHEELS else _PASSED, cut,
                    )
                    or changed
                )  # fmt: skip
            if done and (begin or clock[TRAVELLED] >= par.map_spacing):
                if not begin and (clock[SINCE_LEFT] >= _LEAVING or _off_road_matters(belief)):
                    leave_and_return(
                        belief, roads, work, scale, clock[SINCE_LEFT], par.off_road_leave,
                        par.off_road_return, side, par.lane_sigma, par.map_sigma,
                        par.search_radius, par.wrong_way, mode != WHEELS,
                    )  # fmt: skip
                    clock[SINCE_LEFT] = 0.0
                if mode == WHEELS and not begin:
                    turn_with_heading(belief, roads, side, par.lane_sigma)
                if remembers:
                    memory.since[MAP_AGED] += clock[TRAVELLED]
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
        if remembers:
            remember(belief, memory, k, changed, par.off_road_leave)
        say(
            belief,
            roads,
            output,
            k,
            scale,
            outage_after,
            ambiguous_below,
            par.protection_risk,
            par.unknown,
            chi2,
        )
    return last
