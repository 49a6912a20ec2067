"""Odometry without a sign: a vehicle that backs up counts as one that drives on.

Wheel speeds, counters and odometers of many vehicles only count up.  Until one has counted down,
nobody knows whether it can.  So whenever the vehicle starts from rest, each hypothesis gets a twin
that backs up, with the prior

    P(backs up) = 1/10     at its first start, and after a long stop
                  1/200    where it has hardly driven since the last start: it manoeuvres
                  1/5      where it stands across its road, far from nodes; 1/50 off the roads
                  1/1000   elsewhere

and one that has backed up drives on with 9/10.  Fixes and roads decide between them.  Backing up
ends sooner or later, and is slow: with the speed v it costs 1/30 nats a metre times max(1, v²/9).
"""

import math

from ..._compile import Record, kernel
from ...graph.geometry import wrap
from ...graph.index import vertex_at
from ...graph.network import Roads
from ..motion import Increment
from ..records import COPIES
from ..state import (
    BESIDE_SIGMA,
    CAPACITY,
    CLOCK,
    NO_BOUND,
    NO_EDGE,
    OFF_ROAD,
    WHEELS,
    Belief,
    Context,
    D,
    H,
    K,
    X,
    Y,
    forget_course,
    heaviest,
    lane_mean,
    lane_sigma,
    move_row,
    redraw,
    rescale,
)
from ..vetting.windows import BY_WHEELS, UNTURNED

_PARKED, _MANOEUVRES, _USUALLY, _ENDS = 0.1, 5e-3, 1e-3, 0.9
_ACROSS, _OFF_ROADS = 0.2, 0.02  # the same across its road, and off the roads
_ATHWART = 0.7  # cosine of the angle to its road, below which it stands across it
_JUNCTION = 20.0  # m from a node, up to which it may be in the midst of a junction
_LONG_STOP = 60.0  # s
_SHORT_WAY, _SHORTEST = 30.0, 1.0  # m, since the last start; it has not stopped since
_TIME, _PAUSE = 0.15, 0.5  # s, time constant of the speed; without a count, that are a pause
_RESTS, _STARTS = 0.25, 0.05  # m/s, below which it has come to rest; m, beyond which it starts
_NOISE, _FAST = 0.1, 3.0  # m/s: it may still stand; it does not start from rest
_BACK, _DOWNS = 0.3, 3  # m counted down, and times in a row, from which on odometry has a sign
_HEARD = 10.0  # s without a fix, from which on only who was parked may back up
_SPLITS, _OF_PARKED = 0.01, 1e-3  # weight of a hypothesis that gets a twin
_ENDURES = 30.0  # m, on average, of backing up
_SLOW, _TOO_FAST, _AT_LEAST = 3.0, 6.0, 12.0  # m/s, m/s; and m since it started
_UNDECIDED = 30.0  # m, for which a twin may have little weight
_MAYBE = 0.05  # P of backing up, from which on odometry tells nothing of clocks
_HAS_SIGN = 1e-6  # weight left to who backs up on odometry that has a sign


@kernel
def mirrored(move: Increment, epoch: Record) -> Increment:
    """The motion of a vehicle that backs up, by odometry that has counted up.

    Both wheels have turned the other way, and so has the vehicle by them; a gyro has a sign.

    Args:
        move: As counted.
        epoch: What the sensors measured.
    """
    if epoch.gyro == BY_WHEELS or epoch.gyro == UNTURNED:
        return Increment(-move.arc, -move.turn, -move.forward, move.left, -move.clock)
    return Increment(-move.arc, move.turn, -move.forward, -move.left, move.clock)


@kernel
def own_arc(hyp: Record, arc: float) -> float:
    """A distance, m, as a hypothesis takes it."""
    return -arc if hyp.backs == 1 else arc


@kernel
def face_course(belief: Belief) -> None:
    """Turn the headings of those that back up: they are compared with courses; again: turn back."""
    state = belief.state[0]
    if state.direction.backing == 0:
        return
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.backs == 1:
            hyp.mu[H] = wrap(hyp.mu[H] + math.pi)


@kernel
def _may_turn(state: Record, roads: Roads, hyp: Record, share: float) -> float:
    """P(a hypothesis backs up), where it is `share` on a road that it drives along.

    Who waits in the midst of a junction stands across its road, too.
    """
    if state.mode != WHEELS or share == 0.0:
        return share
    if hyp.edge == OFF_ROAD:
        return max(share, _OFF_ROADS)
    if min(hyp.along, roads.edges[hyp.edge].length - hyp.along) < _JUNCTION:
        return share
    ahead = math.cos(hyp.mu[H]) * hyp.tangent[0] + math.sin(hyp.mu[H]) * hyp.tangent[1]
    return max(share, _ACROSS) if abs(ahead) < _ATHWART else share


@kernel
def _split(belief: Belief, roads: Roads, share: float, least: float, crept: float) -> None:
    """Give each hypothesis of weight a twin that drives the other way, `crept` m ago and on."""
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        part = _ENDS if hyp.backs == 1 else _may_turn(state, roads, hyp, share)
        if part == 0.0 or hyp.weight < least or state.count >= CAPACITY:
            continue
        move_row(belief, i, state.count)
        twin = belief.hyp[state.count]
        twin.backs = 1 - hyp.backs
        back = 2.0 * state.scale * twin.mu[K] * own_arc(twin, crept)
        twin.mu[X] += back * math.cos(twin.mu[H])
        twin.mu[Y] += back * math.sin(twin.mu[H])
        twin.grace = max(float(hyp.grace), _UNDECIDED)
        rescale(twin, part)
        rescale(hyp, 1.0 - part)
        state.count += 1
    state.direction.backing = 1
    state.changed = 1


@kernel
def _weigh(belief: Belief, arc: float, speed: float) -> None:
    """Let backing up end, and note whether any does; the likeliest one that does has no copies."""
    state = belief.state[0]
    cost = abs(arc) / _ENDURES * max(1.0, (speed / _SLOW) ** 2)
    found = False
    p = 0.0
    for i in range(state.count):
        if belief.hyp[i].backs == 1:
            found = True
            p += belief.hyp[i].weight
            rescale(belief.hyp[i], math.exp(-cost))
    state.direction.backing = 1 if found else 0
    state.changed |= state.direction.backing  # weights are yet to be normalised
    if p > _MAYBE:
        state.direction.doubted = state.time
    if found and belief.hyp[heaviest(belief)].backs == 1:
        state.vetting.windows.count = 0
        for k in range(COPIES):
            state.separation.reckoned[k].live = 0
            state.separation.reckoned[k].p = 0.0


@kernel
def _face_about(belief: Belief, ctx: Context) -> None:
    """Nobody backs up so fast: those that do face the other way, and drive on.

    They are on the opposite edge, or where there is none on no road.
    """
    roads = ctx.roads
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.backs == 0:
            continue
        hyp.backs = 0
        hyp.mu[H] = wrap(hyp.mu[H] + math.pi)
        if hyp.edge == OFF_ROAD:
            continue
        other = roads.edges[hyp.edge].opposite
        if other >= 0:
            at = min(max(roads.edges[other].length - hyp.along, 0.0), roads.edges[other].length)
            hyp.segment = vertex_at(roads, other, at)
            redraw(hyp, D, lane_mean(ctx, other), lane_sigma(ctx, other) ** 2)
        else:
            redraw(hyp, D, 0.0, BESIDE_SIGMA**2)
        hyp.edge = other if other >= 0 else OFF_ROAD
        hyp.before, hyp.corner, hyp.bound = NO_EDGE, NO_EDGE, NO_BOUND
        hyp.p_not_passed, hyp.new_edge = 1.0, 1
        forget_course(hyp)


@kernel
def _counts_down(way: Record, arc: float) -> bool:
    """Whether odometry has counted down.

    Once may be an extrapolated way that is put right.
    """
    if arc > 0.0:
        way.back = 0.0
        way.downs = 0
    elif arc < 0.0:
        way.back -= arc
        way.downs += 1
    return bool(way.back > _BACK and way.downs >= _DOWNS)


@kernel
def _follow(way: Record, arc: float, dt: float) -> None:
    """Low-pass the speed: odometers count in steps, and epochs may be short."""
    way.speed += (abs(arc) - way.speed * dt) / (dt + _TIME)
    way.metres += abs(arc)
    if abs(arc) > _NOISE * dt:
        way.crept += arc
        way.paused = 0.0
        return
    way.paused += dt
    if way.paused > _PAUSE:
        way.crept = 0.0


@kernel
def _forget(belief: Belief, factor: float) -> None:
    """Nobody backs up unseen from now on; those that did keep a part of their weight."""
    state = belief.state[0]
    for i in range(state.count):
        if belief.hyp[i].backs == 1:
            belief.hyp[i].backs = 0
            rescale(belief.hyp[i], factor)
    state.direction.backing = 0
    state.changed = 1


@kernel
def _start(belief: Belief, roads: Roads, crept: float) -> None:
    """Let the vehicle start from rest, which it has left by `crept` m."""
    state = belief.state[0]
    way = state.direction
    parked = way.starts == 0 or way.rested > _LONG_STOP
    share = _MANOEUVRES if way.metres < _SHORT_WAY else _USUALLY
    if state.time - state.last_fix > _HEARD:
        share = 0.0
    if parked:
        share = _PARKED
    _split(belief, roads, share, _OF_PARKED if parked else _SPLITS, crept)


@kernel
def consider_backing(belief: Belief, ctx: Context, epoch: Record, dt: float) -> None:
    """Before an epoch's motion: where the vehicle starts from rest it may back up.

    Args:
        belief: Normalised; hypotheses are added, with their share of the weight.
        ctx: The drive's constants.
        epoch: What the sensors measured.
        dt: Since the epoch before, s.
    """
    state = belief.state[0]
    way = state.direction
    if state.mode == CLOCK or way.has_sign == 1:
        if way.backing == 1:
            _forget(belief, 1.0 if state.mode == CLOCK else _HAS_SIGN)
        return
    if dt <= 1e-3:
        return
    if _counts_down(way, float(epoch.arc)):
        way.has_sign = 1
        return
    if way.heard == 0:
        way.heard = 1
        way.speed = abs(epoch.arc) / dt
    before = way.speed
    _follow(way, float(epoch.arc), dt)
    stands = way.crept < _STARTS if way.rests == 1 else way.speed < _RESTS
    if stands:
        if way.rests == 0:  # it may roll on, slowly
            way.crept = 0.0
        way.rests = 1
        way.rested += dt
    elif way.starts == 0 or (way.rests == 1 and way.metres > _SHORTEST):
        if before < _FAST:
            _start(belief, ctx.roads, float(way.crept - epoch.arc))
        way.starts, way.rests = 1, 0
        way.rested, way.metres = 0.0, float(way.crept)
    else:
        way.rests = 0
    if way.backing == 1:
        _weigh(belief, float(epoch.arc), float(way.speed))
    if way.backing == 1 and way.speed > _TOO_FAST and way.metres > _AT_LEAST:
        _face_about(belief, ctx)
        way.backing = 0
