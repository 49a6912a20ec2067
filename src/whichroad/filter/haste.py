"""Speeds at which nobody drives on a road: it is another one, or none that is mapped.

A train, or a car on a road that the map lacks, passes streets beside it.  They fit its fixes, and
not its speed.  Limits may be wrong, and some drivers keep to none.  That lasts for the whole road,
so that all of its way together says no more than how rare that is.
"""

import math

from .._compile import Record, entry, kernel
from .state import CLOCK, OFF_ROAD, Belief, Context, K

UNTOLD = 11.11  # m/s, usual speed of a road of which the map tells neither class nor limit
TOO_FAST = 16.7  # m/s, 60 km/h: up to it no speed is too high for any road
_SLOW, _TOWN, _FAST = 9.2, 13.8, 27.7  # m/s, usual: up to 20 mph; from 50; from 100 km/h on
_RURAL, _RACING = 30.6, 69.4  # m/s, from which on it is too high between the first two; on the last
_TIMES, _MORE = 1.8, 2.8  # of the usual speed, and m/s, from which on it is elsewhere
_FULL = 0.1  # share of it beyond, from which on a metre says all that it can:
_PER_METRE = 0.1  # nats
_USUAL_SIGMA = 3.0  # m/s, of a speed by fixes of each second: their errors cancel on the way
_LAWLESS = 0.01  # P(a limit is wrong, or the driver keeps to none)
_SMOOTHING = 2.0  # s, of speeds
_LEAST = 1e-3  # of what lately was, that is kept in mind
_MOST = 20.0  # nats, that are kept in mind
_FORGOTTEN = 2000.0  # m at usual speeds
_SHORTEST = 2.5  # s, between sparse fixes: of the way of who came back to a road between two


@kernel
def too_fast_from(usual: float) -> float:
    """The speed from which on a road of some usual speed is not driven, m/s.

    Where no limit is tagged the usual speed is that of the class, and rural roads of all classes
    are driven at 100 km/h.  Motorways may have no limit.  A map without classes tells nothing.
    """
    if usual >= _FAST or abs(usual - UNTOLD) < 0.02:
        return _RACING
    if usual <= _SLOW:
        return TOO_FAST
    return _RURAL if usual < _TOWN else _TIMES * usual + _MORE


@kernel
def haste_of(speed: float, usual: float) -> float:
    """How far a speed is beyond those of a road: 0, not at all, to 1, by 10 % or more."""
    if speed <= TOO_FAST:
        return 0.0
    return min(max((speed / too_fast_from(usual) - 1.0) / _FULL, 0.0), 1.0)


@kernel
def _unsure(hyp: Record) -> float:
    """By how much a speed counts as less, as fixes do not tell it well yet, m/s."""
    return 2.0 * max(math.sqrt(hyp.cov[K, K]) - _USUAL_SIGMA, 0.0)


@kernel
def _smooth(state: Record, metres: float) -> None:
    """Follow the speed over some seconds, as odometry may come in steps of some metres."""
    beside = state.separation.unmapped
    seconds = state.time - beside.paced_at
    beside.paced_at = state.time
    if seconds > 0.0:
        beside.pace += (metres - beside.pace * seconds) / (_SMOOTHING + seconds)


@kernel
def _speed(state: Record) -> float:
    """The speed, m/s, as far as that of the last seconds bears it out."""
    return min(float(state.separation.unmapped.pace), abs(float(state.speed)))


@kernel
def p_returns(state: Record, usual: float) -> float:
    """P of coming to a road of some usual speed (m/s) as fast as now, over that at this speed."""
    return 1.0 - (1.0 - _LAWLESS) * haste_of(_speed(state), usual)


@kernel
def _likelihood(haste: float) -> float:
    """What a way says of its road, nats, where limits may be wrong."""
    return math.log((1.0 - _LAWLESS) * math.exp(-haste) + _LAWLESS)


@kernel
def _weigh(hyp: Record, haste: float, metres: float) -> None:
    """Weigh a hypothesis by some metres at a haste.

        log w += log(0.99 exp(−A) + 0.01),    A = ∫ 0.1 nats/m · haste

    less what was added for A before.  So it does not matter in how many steps it is asked.
    """
    leg = hyp.leg
    if haste > 0.0:
        before = _likelihood(leg.haste)
        leg.haste = min(leg.haste + _PER_METRE * metres * haste, _MOST)
        hyp.log_weight += _likelihood(leg.haste) - before
    elif leg.haste > 0.0:
        leg.haste *= math.exp(-metres / _FORGOTTEN)


@entry
def weigh_haste(belief: Belief, ctx: Context, metres: float) -> None:
    """Weigh every road by the speed at which it was driven, where that is too high for it.

    `haste` becomes how far it is too high for the roads on average, now and lately: who follows a
    road by chance pays 0.1 nats/m, at speeds that fit it.

    Args:
        belief: In place; weights are to be normalised afterwards.
        ctx: The drive's constants.
        metres: Driven since it was last asked.
    """
    state = belief.state[0]
    mean = state.separation.unmapped.haste
    lately = mean[1] * math.exp(-_PER_METRE * metres) if mean[1] > _LEAST else 0.0
    mean[0], mean[1] = 0.0, lately
    _smooth(state, metres)
    driven = _speed(state)
    if driven <= TOO_FAST:
        return
    on = 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            hyp.leg.haste = 0.0
            continue
        speed = driven - _unsure(hyp) if state.mode == CLOCK else driven
        haste = haste_of(speed, float(ctx.roads.edges[hyp.edge].speed))
        _weigh(hyp, haste, metres)
        on += hyp.weight
        mean[0] += hyp.weight * haste
    mean[0] /= max(on, 1e-300)
    mean[1] = max(mean[0], lately)


@kernel
def weigh_legs(belief: Belief, ctx: Context) -> None:
    """The same by the routes to a sparse fix, after it: by their mean speeds, and usual ones.

    Args:
        belief: In place; weights are to be normalised afterwards.
        ctx: The drive's constants.
    """
    state = belief.state[0]
    mean = state.separation.unmapped.haste
    mean[0] = 0.0
    on = 0.0
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            hyp.leg.haste = 0.0
            continue
        leg = hyp.leg
        speed, seconds = hyp.mu[K] - _unsure(hyp), _SHORTEST
        usual = float(ctx.roads.edges[hyp.edge].speed)
        if leg.seconds > 0.0 and abs(leg.at - state.time) < 1e-3:
            seconds, usual = float(leg.seconds), float(leg.free)
            ends = math.sqrt(leg.variance + hyp.along_sigma**2)
            speed = (leg.length + hyp.along - ends) / seconds
        haste = haste_of(speed, usual)
        _weigh(hyp, haste, max(speed, 0.0) * seconds)
        on += hyp.weight
        mean[0] += hyp.weight * haste
    mean[0] /= max(on, 1e-300)
    mean[1] = mean[0]


@kernel
def watch_haste(belief: Belief, ctx: Context) -> None:
    """P(the vehicle is on a road that nobody follows), as it is too fast for all that are.

    What no hypothesis knows has the prior `unknown`, and any speed fits it.  So its odds grow by
    what the roads pay.

    Args:
        belief: Normalised.
        ctx: The drive's constants.
    """
    beside = belief.state[0].separation.unmapped
    beside.hasty = 0.0
    lately = beside.haste[1]
    if lately == 0.0:
        return
    unknown = ctx.par[0].unknown
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge != OFF_ROAD and hyp.leg.haste > 0.0:
            gain = math.exp(-_likelihood(hyp.leg.haste)) - 1.0
            odds = unknown * (1.0 + lately * gain) / (1.0 - unknown)
            beside.hasty += hyp.weight * odds / (1.0 + odds)
