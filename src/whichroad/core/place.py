"""After a fix far from the last one: which part of its edge a vehicle may be on."""

import math

from ._jit import kernel, part
from .belief import OFF_ROAD, Belief
from .gaussian import normal_cdf, truncated_moments
from .network import Roads
from .road import track
from .switching import move_along

_STANDS = 30.0  # m of road on which as many drive as stand before a junction
_QUEUE = 6.0  # m before it, and as much more or less


@kernel
def place_on_edge(
    s: float, sigma: float, length: float, is_junction: bool, drove: float
) -> tuple[float, float, float]:
    """A Gaussian abscissa cut to an edge, before whose end vehicles also stand.

        p(u) ~ N(u; s, sigma²) (1 on [0, length] + S N(u; length - Q, Q²)) / (1 + S h)
        h = max(1 / length, N(s; length - Q, Q² + drove))

    Wherever it drives it is as likely on one metre as on the next; who stands, stands in the
    queue before a junction: S = 30 m, less on edges inside one, Q = 6 m.  The division is by
    what was known of it before the fix, so that neither roads of many junctions nor a
    vehicle whose way was foreseen are more probable for it.

    Args:
        s: Mean, m.
        sigma: Standard deviation, m.
        length: Of the edge, m.
        is_junction: Whether the road forks at its end.
        drove: Variance of the distance driven since the last fix, m².

    Returns:
        Mass, mean (m) and variance (m²).
    """
    mass = normal_cdf((length - s) / sigma) - normal_cdf(-s / sigma)
    mean, variance = s, sigma * sigma
    if mass < 0.999:
        mean, variance = truncated_moments(s, sigma, 0.0, length)
    if not is_junction:
        return mass, mean, variance
    away = length - _QUEUE - s
    stands = _STANDS * min(1.0, length / (2.0 * _QUEUE))
    here = max(1.0 / length, _density(away, _QUEUE * _QUEUE + drove))
    even = 1.0 / (1.0 + stands * here)
    both = sigma * sigma + _QUEUE * _QUEUE
    queue = stands * _density(away, both)
    if queue < 1e-3:
        return even * mass, mean, variance
    gain = sigma * sigma / both
    share = queue / (mass + queue)
    off = s + gain * away - mean
    variance += share * (gain * _QUEUE * _QUEUE - variance + (1.0 - share) * off * off)
    return even * (mass + queue), mean + share * off, variance


@kernel
def _density(off: float, variance: float) -> float:
    return math.exp(-0.5 * off * off / variance) / math.sqrt(2.0 * math.pi * variance)


@kernel
def forks(roads: Roads, edge: int) -> bool:
    """Whether more than one way leads on from an edge, those back not counted."""
    ways = 0
    for t in range(roads.succ_first[edge], roads.succ_first[edge + 1]):
        if roads.succ[t] != roads.opposite[edge]:
            ways += 1
    return ways > 1


@part
def settle(belief: Belief, roads: Roads, scale: float) -> None:
    """After the fix: what lies beyond the ends of an edge was not there, who stands is before one.

    The weight is multiplied by the mass on the edge, and the Gaussian gets the moments there.
    Who stood since the last fix was placed before a junction then.
    """
    for i in range(belief.size[0]):
        edge = belief.edge[i]
        if edge == OFF_ROAD:
            continue
        _, tx, ty = track(belief, roads, i, scale)
        s = belief.abscissa[i]
        sigma = belief.spread[i]
        length = roads.length[edge]
        drove = belief.drove[i]
        junction = drove > 0.0 and forks(roads, edge)
        mass, mean, variance = place_on_edge(s, sigma, length, junction, drove)
        if abs(mass - 1.0) > 1e-3:
            belief.log_weight[i] += math.log(max(mass, 1e-12))
        if mean != s:
            move_along(belief, i, tx, ty, mean - s, variance / (sigma * sigma), scale)
            track(belief, roads, i, scale)
        room = (length - belief.abscissa[i]) / belief.spread[i]
        belief.stay[i] = max(normal_cdf(room), 1e-6)
