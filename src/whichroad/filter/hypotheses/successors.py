"""The edges that a hypothesis may have passed on to: turn priors, and the speed in a turn.

A corner is driven at a speed that its turn allows.  At junctions of real drives the median speed
is 5.5 m/s over the root of the turn in radians, from 0.15 rad to 2 rad, and 95 % are below 10 m/s
over it.  Straight on it is 16 m/s.  So who has not braked goes straight on, and who has will
rather turn.
"""

import math

from ..._compile import Record, Records, kernel
from ..gaussian import normal_cdf
from ..state import CLOCK, RARE, RARE_FLOOR, SUCCESSORS, Belief, Context, K

REACH = 3.5  # sigma of the abscissa beyond which mass is neglected
_CORNER = 10.0  # m/s √rad, of the speed that a turn allows
_FAST = 1.6  # usual speeds of the road, that nobody exceeds
_ALLOWED_SIGMA = 0.3  # relative, of the speed that a turn allows
_LEAST_FIT = 0.1  # as the map may draw a corner where there is a bend
_TOO_FAST = 1.3  # sigmas; Φ(−1.3) is less than that
_SIGMA = 0.5  # m/s, of an odometer's speed
_ON = 0.2  # P(who comes to the end of a road finds another one that the map lacks)
_STANDS = 0.5  # m/s, below which a vehicle waits, and may turn to anywhere


@kernel
def speed_fit(usual: float, angle: float, driven: tuple[float, float]) -> float:
    """Likelihood of a speed at a node, for the turn there, s/m; 1 for one that stands.

        p(v | turn α) = Φ((u − v) / σ) / u,    u = 10 m/s / √α

    with the relative spread of u in σ, and u at most what the road is driven at.

    Args:
        usual: Speed of the road, m/s.
        angle: α, rad.
        driven: v and its standard deviation, m/s.
    """
    speed, sigma = driven
    if speed < _STANDS:
        return 1.0
    most = max(_FAST * usual, speed)
    allowed = most
    if abs(angle) * most * most > _CORNER * _CORNER:
        allowed = math.sqrt(_CORNER * _CORNER / abs(angle))
    if speed - allowed > _TOO_FAST * (_ALLOWED_SIGMA * allowed + sigma):
        return _LEAST_FIT / allowed
    wide = _ALLOWED_SIGMA * allowed
    z = (allowed - speed) / math.sqrt(wide * wide + sigma * sigma)
    return float(max(normal_cdf(z), _LEAST_FIT) / allowed)


@kernel
def normalise_turns(found: Records, first: int, end: int, total: float) -> None:
    """Divide the weights of some successors by the sum over all turns at their node."""
    for d in range(first, end):
        found[d].weight /= total
        found[d].mass /= total


@kernel
def _list(
    ctx: Context, edge: int, s: float, sigma: float, least: float, bound: float,
    driven: tuple[float, float],
) -> int:  # fmt: skip
    """List the edges on which a vehicle that left `edge` may be.

    Breadth first over the successors; an edge's mass is its turn priors' product, by the speed,
    times the Gaussian mass of the abscissa on it.

    Args:
        ctx: Its buffer of successors is filled.
        edge: The origin.
        s: Mean abscissa, from the origin's start, m.
        sigma: Its standard deviation, m.
        least: Priors below this are not followed.
        bound: Abscissa beyond which there is nothing, m.
        driven: The speed and its standard deviation, m/s.

    Returns:
        How many.
    """
    roads = ctx.roads
    found = ctx.work.successor
    count = 0
    end = roads.edges[edge].length
    k = -1
    current = edge
    prior, weight, turn = 1.0, 1.0, 0.0
    whole = normal_cdf((bound - s) / sigma)
    while True:
        low = min(normal_cdf((end - s) / sigma), whole)
        origin = roads.edges[current]
        first, total = count, 0.0
        for t in range(origin.first_turn, origin.end_turn):
            way = roads.turns[t]
            p = prior * float(way.prior)
            fit = float(way.prior) * speed_fit(float(origin.speed), float(way.angle), driven)
            total += fit
            if p < (least if p >= RARE else RARE_FLOOR * least) or count >= SUCCESSORS:
                continue
            new = found[count]
            new.edge = way.edge
            high = min(normal_cdf((end + roads.edges[new.edge].length - s) / sigma), whole)
            new.parent = k
            new.offset = end
            new.prior = p
            new.weight = weight * fit
            new.mass = new.weight * (high - low)
            new.turn = turn + float(way.angle)
            count += 1
        normalise_turns(found, first, count, total)
        k += 1
        while k < count and found[k].offset + roads.edges[found[k].edge].length > s + REACH * sigma:
            k += 1
        if k >= count:
            return count
        current = found[k].edge
        end = found[k].offset + roads.edges[current].length
        prior = found[k].prior
        weight = found[k].weight
        turn = found[k].turn


@kernel
def driven_speed(belief: Belief, hyp: Record) -> tuple[float, float]:
    """Speed of a hypothesis and its standard deviation, m/s."""
    if belief.state[0].mode == CLOCK:
        return max(hyp.mu[K], 0.0), math.sqrt(hyp.cov[K, K])
    return abs(belief.state[0].odometer_speed * hyp.mu[K]), _SIGMA


@kernel
def p_drives_on(belief: Belief, ctx: Context, hyp: Record) -> float:
    """P(a vehicle at the end of its road drives on where the map has none); 0 where one follows.

    Maps have gaps of metres, and lack yards.  Else it turns round there, which takes a low speed.
    """
    origin = ctx.roads.edges[hyp.edge]
    if origin.end_turn - origin.first_turn != 1:
        return 0.0
    way = ctx.roads.turns[origin.first_turn]
    if way.edge != origin.opposite:
        return 0.0
    driven = driven_speed(belief, hyp)
    on = _ON * speed_fit(float(origin.speed), 0.0, driven)
    back = (1.0 - _ON) * speed_fit(float(origin.speed), math.pi, driven)
    return float(on / (on + back))


@kernel
def successors(
    belief: Belief, ctx: Context, i: int, s: float, sigma: float, weight: float, bound: float
) -> tuple[int, float]:
    """List the edges that a part of a hypothesis may have passed on to.

    Args:
        belief: The hypotheses.
        ctx: Its buffer of successors is filled.
        i: The hypothesis.
        s: Its abscissa, beyond its edge's end, m.
        sigma: m.
        weight: Of the part.
        bound: Abscissa beyond which there is nothing, m.

    Returns:
        How many, and the mass on them altogether.
    """
    hyp = belief.hyp[i]
    prune = ctx.par[0].prune
    least = min(0.1 * prune / max(weight, prune), 0.05)
    count = _list(ctx, hyp.edge, s, sigma, least, bound, driven_speed(belief, hyp))
    found = ctx.work.successor
    total = 0.0
    for d in range(count):
        total += found[d].mass
    if total <= 1e-12 and count > 0:  # all mass before the end: the nearest edges take it
        total = 0.0
        for d in range(count):
            found[d].mass = found[d].weight if found[d].parent < 0 else 0.0
            total += found[d].mass
    return count, total
