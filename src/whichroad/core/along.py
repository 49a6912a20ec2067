"""Hypotheses move along their roads when nothing measures the heading."""

import math

from ._jit import Vector, part
from .angles import angle_of, wrap
from .belief import (
    CAPACITY,
    MX,
    MY,
    OFF_ROAD,
    Belief,
    H,
    K,
    N,
    Route,
    X,
    Y,
)
from .gaussian import normal_cdf, reshape_along, reshape_on_map, truncated_moments
from .motion import predict_along
from .network import Roads
from .road import track
from .segment import locate
from .switching import MOSTLY, Work, adopt, destinations, leave_map, rescale

_CORNER = 0.15  # rad in one step; less is a bend that the map has drawn round
_CORNER_RADIUS = 15.0  # m
_CORNER_DOUBT = 3.0  # m/rad
_ACROSS = 0.015  # m²/m; nobody follows the line of a map to the inch


@part
def _move_to(
    belief: Belief, roads: Roads, i: int, edge: int, s: float, sigma: float,
    lateral: float, tx: float, ty: float, low: float, high: float, odometer: float,
    scale: float, q_along: float, q_rate: float, q_cross: float, heading_variance: float,
    node_radius: float, node_variance: float,
) -> None:  # fmt: skip
    """Put hypothesis i at abscissa s of an edge, cut to [low, high], by its road's shape.

    In bends and about junctions the vehicle's heading is on its way from one to the other.
    """
    mean = belief.mean[i]
    cov = belief.cov[i]
    cut, variance = truncated_moments(s, sigma, low, high)
    shift = cut - s
    shrink = variance / (sigma * sigma)
    segment, cx, cy, nx, ny = locate(roads, edge, belief.segment[i], cut)
    heading = math.atan2(ny, nx)
    across = tx * ny - ty * nx
    onwards = tx * nx + ty * ny
    turn = angle_of(onwards, across)
    bent = min(abs(turn), 1.6)
    if bent > _CORNER:  # a corner on the map is an arc on the ground, and shorter
        cut += _CORNER_RADIUS * (2.0 * math.tan(0.5 * bent) - bent)
        segment, cx, cy, nx, ny = locate(roads, edge, segment, cut)
    doubt = (_CORNER_DOUBT * bent) ** 2
    variance += doubt
    if roads.first[edge + 1] - roads.first[edge] > 2:
        _, _, _, ax, ay = locate(roads, edge, segment, cut - 4.0)
        _, _, _, bx, by = locate(roads, edge, segment, cut + 4.0)
        heading_variance += (0.5 * (ax * by - ay * bx)) ** 2
    if min(cut, roads.length[edge] - cut) < node_radius:
        heading_variance += node_variance
    predict_along(
        mean, cov, odometer, turn, heading, nx, ny, q_along + doubt, q_rate, q_cross,
        heading_variance,
    )  # fmt: skip
    aside = _ACROSS * abs(odometer * mean[K])
    cov[X, X] += aside * ny * ny
    cov[Y, Y] += aside * nx * nx
    cov[X, Y] -= aside * nx * ny
    cov[Y, X] = cov[X, Y]
    if shrink < 0.9999:
        reshape_on_map(mean, cov, nx, ny, shift, shrink, scale)
    mean[X] = cx + scale * (lateral * ny - mean[MX])
    mean[Y] = cy + scale * (-lateral * nx - mean[MY])
    belief.segment[i] = segment
    belief.abscissa[i] = cut
    belief.spread[i] = math.sqrt(variance)
    room = (roads.length[edge] - cut) / belief.spread[i]
    belief.stay[i] = 1.0 if room > 6.0 else max(normal_cdf(room), 1e-6)


@part
def advance_along(
    belief: Belief, roads: Roads, route: Route, work: Work, scale: float, odometer: float,
    q_along: float, q_rate: float, q_cross: float, heading_variance: float,
    node_radius: float, node_variance: float, side: float, lane_sigma: float, prune: float,
    passed: float,
) -> bool:  # fmt: skip
    """Move the hypotheses on roads by κ δ along them, branching where roads branch.

    For vehicles without a heading sensor: the road tells the turn.  Off-road
    hypotheses are left alone.

    Args:
        belief: In place; children are appended.
        roads: The network.
        route: The tree of edges entered.
        work: Scratch.
        scale: Local scale of the plane.
        odometer: δ, odometer metres, or seconds where κ is a speed.
        q_along: Variance added along the road, m².
        q_rate: Variance added to κ.
        q_cross: Covariance added between them.
        heading_variance: Of the vehicle's heading about the road's.
        node_radius: Within this of a junction, m, it is more by
        node_variance: this, rad².
        side: 1 where one drives on the right, −1 on the left.
        lane_sigma: Spread of the lane offset, m.
        prune: Probability below which a hypothesis is not worth its while.
        passed: Probability that has to have passed an end, or most of it, before it branches.

    Returns:
        Whether anything branched.
    """
    n = belief.size[0]
    changed = False
    for i in range(n):
        edge = belief.edge[i]
        if edge == OFF_ROAD:
            continue
        lateral, tx, ty = track(belief, roads, i, scale)
        cov = belief.cov[i]
        s = belief.abscissa[i] + odometer * belief.mean[i, K]
        cross = tx * (cov[X, K] + cov[MX, K]) + ty * (cov[Y, K] + cov[MY, K])
        variance = belief.spread[i] ** 2 + odometer * (2.0 * cross + odometer * cov[K, K])
        sigma = math.sqrt(max(variance + q_along, 1e-4))
        length = roads.length[edge]
        now = normal_cdf((length - s) / sigma) if s + 6.0 * sigma > length else 1.0
        share = 1.0 - min(1.0, now / max(belief.stay[i], 1e-6))
        p = belief.probability[i]
        end = 1e9
        owed = belief.stay[i]
        enough = share * p >= 0.3 * prune and share >= min(passed / p, MOSTLY)
        if enough and belief.size[0] < CAPACITY:
            owed = 0.0
            changed = True
            end = length
            given = 0.0
            count, total = destinations(roads, work, edge, s, sigma, share * p, prune)
            if total <= 0.0:
                leave_map(belief, i, belief.size[0], share)
                belief.size[0] += 1
                given = share
            for d in range(count):
                part = share * work.mass[d] / total if total > 0.0 else 0.0
                if part * p < 0.3 * prune or belief.size[0] >= CAPACITY:
                    continue  # too little, or no room: it stays where it was
                given += part
                child = belief.size[0]
                adopt(belief, roads, route, work, i, child, d, part, side, lane_sigma)
                belief.size[0] = child + 1
                f = work.edge[d]
                _move_to(
                    belief, roads, child, f, s - work.offset[d], sigma, lateral, tx, ty,
                    0.0, roads.length[f], odometer, scale, q_along, q_rate, q_cross,
                    heading_variance, node_radius, node_variance,
                )  # fmt: skip
            rescale(belief, i, 1.0 - given)
        _move_to(
            belief, roads, i, edge, s, sigma, lateral, tx, ty, -1e9, end, odometer,
            scale, q_along, q_rate, q_cross, heading_variance, node_radius, node_variance,
        )  # fmt: skip
        belief.stay[i] = max(belief.stay[i], owed)
    return changed


@part
def forward_only(belief: Belief, row: Vector, scale: float) -> bool:
    """Without odometry a vehicle drives forwards.

    The speed is cut to what is above −0.5 m/s, and the hypothesis weighed by how much
    that was.  Off the roads a negative speed is first told as the other heading.

    Returns:
        Whether any weight was changed; probabilities are yet to be made to sum to one.
    """
    weighed = False
    for i in range(belief.size[0]):
        mean = belief.mean[i]
        cov = belief.cov[i]
        if belief.edge[i] == OFF_ROAD and mean[K] < -0.5:
            mean[K] = -mean[K]
            mean[H] = wrap(mean[H] + math.pi)
            for j in range(N):
                cov[K, j] = -cov[K, j]
            for j in range(N):
                cov[j, K] = -cov[j, K]
        sigma = math.sqrt(cov[K, K])
        z = (mean[K] + 0.5) / sigma
        if z < 2.5:
            weighed = True
            rescale(belief, i, max(min(2.0 * normal_cdf(z), 1.0), 1e-12))
            cut, variance = truncated_moments(mean[K], sigma, -0.5, 1e9)
            for j in range(N):
                row[j] = 0.0
            row[K] = 1.0
            reshape_along(mean, cov, row, cut - mean[K], variance / (sigma * sigma), scale)
    return weighed
