"""Corners are cut: a vehicle turns before its road's end.

The map draws a corner at a node.  A vehicle keeps to its lane, on both roads, and drives an arc.
With right-hand traffic one that turns right onto a wide road is beside that road's line before it
has reached the node, and never reaches it.  Its wheels know the place to a metre, so that it would
not have passed the node.  So who turns as a road behind the node does may be on it.
"""

import math

from ..._compile import Record, kernel
from ...graph.geometry import angle_of
from ...graph.network import U_TURN
from ..gaussian import normal_cdf
from ..state import SUCCESSORS, Belief, Context, D, H, lane_mean, lane_sigma
from .successors import driven_speed, normalise_turns, speed_fit

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
def turned_before_end(hyp: Record) -> float:
    """By how much a hypothesis has turned off its road, rad, since it drove along it; else 0.

    A vehicle that has just come round a corner is yet to drive along the road.
    """
    c, s = math.cos(hyp.mu[H]), math.sin(hyp.mu[H])
    tx, ty = hyp.tangent[0], hyp.tangent[1]
    turned = angle_of(tx * c + ty * s, tx * s - ty * c)
    if abs(turned) < _TURNED:
        hyp.corner = hyp.edge
        return 0.0
    return turned if hyp.corner == hyp.edge else 0.0


@kernel
def list_corners(belief: Belief, ctx: Context, i: int, turned: float) -> int:
    """List the roads that turn behind its edge's end as hypothesis i does before it.

    Roads that run straight on are passed, as far as corners are cut.  The mass of each is its
    turn prior, by the speed, times P(the vehicle has passed the node), less what it has passed
    already.

    Args:
        belief: The hypothesis is tracked on its edge.
        ctx: Its buffer of successors is filled; those that are passed have no mass.
        i: The hypothesis.
        turned: By how much it has turned, rad, counter-clockwise.

    Returns:
        How many.
    """
    hyp = belief.hyp[i]
    driven = driven_speed(belief, hyp)
    found = ctx.work.successor
    count = _add_turns(hyp, ctx, -1, 0, turned, driven)
    k = 0
    while k < count:
        end = found[k].offset + ctx.roads.edges[found[k].edge].length
        if abs(found[k].turn) < _CORNER and end < hyp.along + BEFORE:
            count = _add_turns(hyp, ctx, k, count, turned, driven)
        k += 1
    return count


@kernel
def _add_turns(
    hyp: Record, ctx: Context, k: int, count: int, turned: float, driven: tuple[float, float]
) -> int:
    """Add the turns at the end of the hypothesis' edge, or of listed k >= 0; returns how many."""
    found = ctx.work.successor
    edge, end, prior, weight, bent = int(hyp.edge), 0.0, 1.0, 1.0, 0.0
    if k >= 0:
        edge, end, bent = int(found[k].edge), float(found[k].offset), float(found[k].turn)
        prior, weight = float(found[k].prior), float(found[k].weight)
    road = ctx.roads.edges[edge]
    end += float(road.length)
    first, total = count, 0.0
    for t in range(road.first_turn, road.end_turn):
        way = ctx.roads.turns[t]
        fit = float(way.prior) * speed_fit(float(road.speed), float(way.angle), driven)
        total += fit
        angle = bent + float(way.angle)
        turns = abs(angle) >= _CORNER
        if way.rule & U_TURN or count >= SUCCESSORS or (turns and angle * turned < 0.0):
            continue
        new = found[count]
        new.edge, new.parent, new.turn, new.offset = way.edge, k, angle, end
        new.prior, new.weight, new.mass = prior * float(way.prior), weight * fit, 0.0
        if turns:
            new.mass = new.weight * _more_passed(hyp, ctx, way.edge, end, angle, turned)
        count += 1
    normalise_turns(found, first, count, total)
    return count


@kernel
def _more_passed(
    hyp: Record, ctx: Context, edge: int, end: float, angle: float, turned: float
) -> float:
    """P(it has passed the node at `end` onto an edge), beyond what it has passed already."""
    lanes = hyp.mu[D], lane_mean(ctx, edge)
    variances = hyp.cov[D, D], lane_sigma(ctx, edge) ** 2
    place, variance = _passed_at(angle, abs(turned), lanes, variances)
    passed = normal_cdf((hyp.along - end - place) / math.sqrt(hyp.along_sigma**2 + variance))
    more = passed - 1.0 + hyp.p_not_passed
    return float(more / hyp.p_not_passed) if more > 0.0 else 0.0
