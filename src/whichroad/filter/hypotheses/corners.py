"""Corners are cut: a vehicle turns before its road's end.

The map draws a corner at a node.  A vehicle keeps to its lane, on both roads, and drives an arc.
With right-hand traffic one that turns right onto a wide road is beside that road's line before it
has reached the node, and never reaches it.  Its wheels know the place to a metre, so that it would
not have passed the node.  So who turns as a road behind the node does may be on it.
"""

import math

from ..._compile import kernel
from ...graph.geometry import angle_of
from ...graph.network import U_TURN
from ..gaussian import normal_cdf
from ..state import Belief, Context, D, H, lane_mean, lane_sigma
from .successors import driven_speed, speed_fit

BEFORE = 25.0  # m before a node, from which on a corner is cut at most
_TURNED = 0.6  # rad, by which the vehicle has turned then
_CORNER = 0.35  # rad, of a road that turns; less is a bend
_RADIUS = 8.0  # m, of the arc
_LONGEST = 15.0  # m before the corner, where the arc begins at most
_ROUGH, _OF_ARC = 2.0, 0.4  # m, and share of what is left of the arc: sigma of the node's place
_FLAT = 0.5  # least sine by which lanes move the place
_FARTHEST = 12.0  # m by which they do at most


@kernel
def _passed_at(
    angle: float, turned: float, lanes: tuple[float, float], variances: tuple[float, float]
) -> tuple[float, float]:
    """Where a vehicle that has turned so far is, along its road from the node, and variance.

        e = (b − a cos θ) / sin θ − r tan |θ|/2 + r sin |φ|

    The first term is where the lanes, a and b to the right of their roads, meet.

    Args:
        angle: θ, turn at the node, rad.
        turned: |φ|, that of the vehicle, rad.
        lanes: a and b, m.
        variances: Of a and b, m².

    Returns:
        e (m), variance (m²).
    """
    sine, cosine = math.sin(angle), math.cos(angle)
    flat = math.copysign(max(abs(sine), _FLAT), angle)
    meet = min(max((lanes[1] - lanes[0] * cosine) / flat, -_FARTHEST), _FARTHEST)
    arc = min(_RADIUS * math.tan(0.5 * min(abs(angle), 3.0)), _LONGEST)
    left = arc - _RADIUS * math.sin(min(turned, abs(angle), 0.5 * math.pi))
    variance = (variances[1] + cosine * cosine * variances[0]) / (flat * flat)
    return meet - left, variance + (_ROUGH + _OF_ARC * abs(left)) ** 2


@kernel
def list_corners(belief: Belief, ctx: Context, i: int) -> int:
    """List the roads that turn at the end of its edge as hypothesis i does before it.

    The mass of each is its turn prior, by the speed, times P(the vehicle has passed the node), less
    what it has passed already.

    Args:
        belief: The hypothesis is tracked on its edge.
        ctx: Its buffer of successors is filled.
        i: The hypothesis.

    Returns:
        How many.
    """
    hyp = belief.hyp[i]
    c, s = math.cos(hyp.mu[H]), math.sin(hyp.mu[H])
    tx, ty = hyp.tangent[0], hyp.tangent[1]
    turned = angle_of(tx * c + ty * s, tx * s - ty * c)
    if abs(turned) < _TURNED:
        return 0
    road = ctx.roads.edges[hyp.edge]
    driven = driven_speed(belief, hyp)
    found = ctx.work.successor
    count = 0
    total = 0.0
    for t in range(road.first_turn, road.end_turn):
        way = ctx.roads.turns[t]
        angle = float(way.angle)
        fit = float(way.prior) * speed_fit(float(road.speed), angle, driven)
        total += fit
        if abs(angle) < _CORNER or angle * turned < 0.0 or way.rule & U_TURN:
            continue
        if count >= len(found):
            continue
        lanes = hyp.mu[D], lane_mean(ctx, way.edge)
        place, variance = _passed_at(
            angle, abs(turned), lanes, (hyp.cov[D, D], lane_sigma(ctx, way.edge) ** 2)
        )
        z = (hyp.along - road.length - place) / math.sqrt(hyp.along_sigma**2 + variance)
        more = max(normal_cdf(z) - 1.0 + hyp.p_not_passed, 0.0) / hyp.p_not_passed
        new = found[count]
        new.edge, new.parent, new.turn = way.edge, -1, angle
        new.offset, new.prior = road.length, way.prior
        new.mass = fit * more
        count += 1
    for d in range(count):
        found[d].mass /= total
    return count
