"""Cold starts, and the way off the roads and back."""

import math

from ._jit import Vector, entry, kernel, part
from .angles import wrap
from .belief import (
    CAPACITY,
    GX,
    GY,
    MX,
    MY,
    OFF_ROAD,
    ORIGINS,
    B,
    Belief,
    D,
    H,
    K,
    N,
    Route,
    X,
    Y,
)
from .gaussian import normal_cdf
from .grid import near, vertex_at
from .network import AGAINST_ONE_WAY, NO_ACCESS, Roads, lane_sigma_of
from .segment import chord_heading, project
from .switching import Work, copy_hypothesis, rescale

_LEAVES = 0.02  # probability of a road that is worth leaving: the others leave next to nothing
_TURNS = 3e-4  # probability of turning round in a step that is worth a hypothesis
_HEADINGS = 8  # components of an off-road start whose heading is unknown


@kernel
def _fresh_state(
    belief: Belief, i: int, fix: Vector, slow: float, white: float, scale: float, lever: Vector,
    heading: float, heading_sigma: float, rate: float, rate_sigma: float,
    drift_sigma: float, lane: float, lane_sigma: float, map_sigma: float,
) -> None:  # fmt: skip
    """Fill row i with what one fix and a heading tell: p = z − R a − S γ − white."""
    mean = belief.mean[i]
    cov = belief.cov[i]
    for a in range(N):
        mean[a] = 0.0
        for b in range(N):
            cov[a, b] = 0.0
    ch = math.cos(heading)
    sh = math.sin(heading)
    lx = ch * lever[0] - sh * lever[1]
    ly = sh * lever[0] + ch * lever[1]
    mean[X] = fix[0] - scale * lx
    mean[Y] = fix[1] - scale * ly
    mean[H] = wrap(heading)
    mean[K] = rate
    mean[D] = lane
    c = math.cos(fix[4])
    s = math.sin(fix[4])
    rxx = fix[2] * c * c + fix[3] * s * s
    ryy = fix[2] * s * s + fix[3] * c * c
    rxy = (fix[2] - fix[3]) * c * s
    full = slow * slow + white * white
    cov[X, X] = full * (rxx * rxx + rxy * rxy)
    cov[Y, Y] = full * (ryy * ryy + rxy * rxy)
    cov[X, Y] = full * (rxx * rxy + rxy * ryy)
    cov[Y, X] = cov[X, Y]
    cov[X, GX] = -slow * rxx
    cov[X, GY] = -slow * rxy
    cov[Y, GX] = -slow * rxy
    cov[Y, GY] = -slow * ryy
    cov[GX, X] = -slow * rxx
    cov[GY, X] = -slow * rxy
    cov[GX, Y] = -slow * rxy
    cov[GY, Y] = -slow * ryy
    cov[GX, GX] = 1.0
    cov[GY, GY] = 1.0
    cov[H, H] = heading_sigma**2
    cov[K, K] = rate_sigma**2
    cov[B, B] = drift_sigma**2
    cov[D, D] = lane_sigma**2
    cov[MX, MX] = map_sigma**2
    cov[MY, MY] = map_sigma**2


@entry
def cold_start(
    belief: Belief, roads: Roads, route: Route, work: Work, total: float, fix: Vector,
    slow: float, white: float, scale: float, lever: Vector, heading: float,
    heading_sigma: float, rate: float, rate_sigma: float, drift_sigma: float, side: float,
    lane_sigma: float, map_sigma: float, search_radius: float, off_road: float, wrong_way: float,
) -> int:  # fmt: skip
    """Begin with every road near a position, both directions, and with none of them.

    Or, for a belief that stands, add all of these as one more possibility.

    A road's prior is the Gaussian mass of the position along it, so that cutting a
    road into pieces changes nothing (the paper draws equal chances per segment).

    Args:
        belief: Normalised where it stands; replaced or added to.
        roads: The network.
        route: The tree of edges entered; the new roots follow the best old node.
        work: Scratch.
        total: Probability of this beginning; 1 replaces what was believed.
        fix: x, y (plane), sigma_major, sigma_minor (m), heading of the major axis.
        slow: Sigma of the slow error over the reported one.
        white: White sigma over reported sigma.
        scale: Local scale of the plane.
        lever: Antenna ahead and left of M, m; zero when a pose of M is given.
        heading: Of the vehicle, rad.
        heading_sigma: Infinite when unknown: roads tell theirs.
        rate: κ, and
        rate_sigma: its spread.
        drift_sigma: Of b.
        side: 1 where one drives on the right, −1 on the left.
        lane_sigma: Of the lane offset, m.
        map_sigma: Of the map's error per axis, m.
        search_radius: At least this far (the paper's 30 m); more where sigma asks.
        off_road: Probability of being on no road.
        wrong_way: Weight of driving against a one-way.

    Returns:
        How many roads are near.
    """
    best = -1
    for i in range(belief.size[0]):
        if best < 0 or belief.log_weight[i] > belief.log_weight[best]:
            best = i
    parent = belief.node[best] if best >= 0 else -1
    sigma = math.sqrt(fix[2] ** 2 * (slow * slow + white * white) + map_sigma**2)
    radius = max(search_radius, 4.5 * sigma + lane_sigma)
    found = near(
        roads, fix[0], fix[1], radius, work.near_edge, work.near_s, work.near_lateral,
        work.near_distance,
    )  # fmt: skip
    known = heading_sigma < 10.0
    towards = 0.0  # of the nearest road
    kept = 0
    if total < 1.0:
        kept = belief.size[0]
        for i in range(kept):
            rescale(belief, i, 1.0 - total)
    n = kept
    for c in range(found):
        edge = work.near_edge[c]
        segment, s, _, _, _ = project(
            roads, edge, vertex_at(roads, edge, work.near_s[c]), fix[0], fix[1]
        )
        length = roads.length[edge]
        mass = normal_cdf((length - s) / sigma) - normal_cdf(-s / sigma)
        if roads.rule[edge] & AGAINST_ONE_WAY:
            mass *= wrong_way
        if roads.rule[edge] & NO_ACCESS:
            mass *= 0.1
        if roads.service[edge]:
            mass *= 0.5
        along = chord_heading(roads, edge, segment, min(max(s, 0.0), length), 6.0)
        if c == 0:
            towards = along
        if mass < 1e-9 or n >= CAPACITY - 64:
            continue
        if known and abs(wrap(along - heading)) > 4.0 * heading_sigma + 0.6:
            continue
        _fresh_state(
            belief, n, fix, slow, white, scale, lever, heading if known else along,
            heading_sigma if known else 0.12, rate, rate_sigma, drift_sigma,
            side * roads.lane[edge], lane_sigma_of(roads, edge, lane_sigma), map_sigma,
        )  # fmt: skip
        belief.edge[n] = edge
        belief.segment[n] = segment
        belief.stay[n] = max(normal_cdf((length - s) / sigma), 1e-6)
        belief.log_weight[n] = math.log(mass)
        n += 1
    mass = 0.0
    for i in range(kept, n):
        mass += math.exp(belief.log_weight[i])
    share = math.log(total * (1.0 - off_road) / mass) if mass > 0.0 else 0.0
    for i in range(kept, n):
        belief.log_weight[i] += share
    free = 1 if known else _HEADINGS
    free_share = math.log(total * (off_road if mass > 0.0 else 1.0) / free)
    for a in range(min(free, CAPACITY - n)):
        at = heading if known else wrap(towards + 2.0 * math.pi * a / free)
        _fresh_state(
            belief, n, fix, slow, white, scale, lever, at, heading_sigma if known else 0.3, rate,
            rate_sigma, drift_sigma, 0.0, lane_sigma, map_sigma,
        )  # fmt: skip
        belief.edge[n] = OFF_ROAD
        belief.log_weight[n] = free_share
        n += 1
    for i in range(kept, n):
        belief.fresh[i] = 1
        belief.node[i] = parent
        for a in range(int(belief.clock[ORIGINS])):
            belief.share[i, a] = 0.0
    belief.size[0] = n
    return found


@part
def leave_and_return(
    belief: Belief, roads: Roads, work: Work, scale: float, travelled: float,
    leave: float, back: float, side: float, lane_sigma: float, map_sigma: float,
    search_radius: float, wrong_way: float, follows_road: bool,
) -> None:  # fmt: skip
    """Off the roads at a small rate per metre, and back on to those near at a larger one.

    Args:
        belief: In place; children are appended.
        roads: The network.
        work: Scratch.
        scale: Local scale of the plane.
        travelled: Since the last call, m.
        leave: Rate of leaving the mapped roads, 1/m.
        back: Rate of returning to one, 1/m.
        side: 1 where one drives on the right, −1 on the left.
        lane_sigma: Spread of the lane offset, m.
        map_sigma: Of the map's error per axis, m.
        search_radius: Smallest candidate radius, m.
        wrong_way: Weight of entering against a one-way.
        follows_road: Whether headings are the roads' (no heading sensor).
    """
    n = belief.size[0]
    for i in range(n):
        p = belief.probability[i]
        if belief.edge[i] != OFF_ROAD:
            if p > _LEAVES and belief.size[0] < CAPACITY:
                child = belief.size[0]
                copy_hypothesis(belief, i, child)
                belief.edge[child] = OFF_ROAD
                belief.fresh[child] = 1
                share = min(leave * travelled, 0.5)
                rescale(belief, child, share)
                rescale(belief, i, 1.0 - share)
                if follows_road:
                    belief.cov[child, H, H] += 0.04
                belief.size[0] = child + 1
        elif p > 1e-3:
            _return(
                belief, roads, work, i, scale, min(back * travelled, 0.5), side, lane_sigma,
                map_sigma, search_radius, wrong_way, p,
            )  # fmt: skip


@part
def _return(
    belief: Belief, roads: Roads, work: Work, i: int, scale: float, share: float, side: float,
    lane_sigma: float, map_sigma: float, search_radius: float, wrong_way: float, p: float,
) -> None:  # fmt: skip
    mean = belief.mean[i]
    cov = belief.cov[i]
    half = 0.5 * (cov[X, X] - cov[Y, Y])
    worst = 0.5 * (cov[X, X] + cov[Y, Y]) + math.sqrt(half * half + cov[X, Y] ** 2)
    sigma = math.sqrt(worst + 2.0 * lane_sigma**2)
    radius = min(max(search_radius, 2.5 * sigma), 150.0)
    qx = mean[X] + scale * mean[MX]
    qy = mean[Y] + scale * mean[MY]
    found = near(
        roads, qx, qy, radius, work.near_edge, work.near_s, work.near_lateral, work.near_distance
    )
    spread = math.sqrt(cov[H, H] + 0.15)
    count = 0
    for c in range(found):
        edge = work.near_edge[c]
        s = work.near_s[c]
        along = chord_heading(roads, edge, vertex_at(roads, edge, s), s, 6.0)
        turned = abs(wrap(along - mean[H]))
        _, foot, _, _, _ = project(roads, edge, vertex_at(roads, edge, s), qx, qy)
        beside = -3.0 < foot < roads.length[edge] + 3.0
        fits = beside and turned < min(2.5 * spread, 1.6)
        if fits and work.near_distance[c] < 3.0 * sigma + 5.0:
            work.near_edge[count] = edge
            work.near_s[count] = s
            count += 1
    count = min(count, 12)
    given = 0.0
    for c in range(count):
        if belief.size[0] >= CAPACITY:
            break
        edge = work.near_edge[c]
        part = share / count
        if roads.rule[edge] & AGAINST_ONE_WAY:
            part *= max(wrong_way, 1e-6)
        if part * p < 1e-6:
            continue
        given += part
        child = belief.size[0]
        copy_hypothesis(belief, i, child)
        belief.edge[child] = edge
        belief.segment[child] = vertex_at(roads, edge, work.near_s[c])
        belief.stay[child] = 1.0
        belief.fresh[child] = 1
        rescale(belief, child, part)
        for j in range(N):
            belief.cov[child, D, j] = 0.0
            belief.cov[child, j, D] = 0.0
        belief.cov[child, D, D] = lane_sigma_of(roads, edge, lane_sigma) ** 2
        belief.mean[child, D] = side * roads.lane[edge]
        belief.size[0] = child + 1
    if given > 0.0:
        rescale(belief, i, 1.0 - given)


@kernel
def _turned(
    belief: Belief, roads: Roads, i: int, share: float, speed: bool, side: float,
    lane_sigma: float,
) -> None:  # fmt: skip
    """Append a child of hypothesis i on the opposite edge."""
    other = roads.opposite[belief.edge[i]]
    child = belief.size[0]
    copy_hypothesis(belief, i, child)
    rescale(belief, child, share)
    rescale(belief, i, 1.0 - share)
    belief.edge[child] = other
    belief.segment[child] = vertex_at(roads, other, roads.length[other] - belief.abscissa[i])
    belief.stay[child] = 1.0
    belief.fresh[child] = 1
    mean = belief.mean[child]
    cov = belief.cov[child]
    for j in range(N):
        cov[D, j] = 0.0
        cov[j, D] = 0.0
    cov[D, D] = lane_sigma_of(roads, other, lane_sigma) ** 2
    mean[D] = side * roads.lane[other]
    cov[X, X] += 4.0
    cov[Y, Y] += 4.0
    if speed:
        for j in range(N):
            cov[K, j] = 0.0
            cov[j, K] = 0.0
        cov[K, K] = 16.0
        mean[K] = 3.0
        mean[H] = wrap(mean[H] + math.pi)
    belief.size[0] = child + 1


@part
def turn_round(
    belief: Belief, roads: Roads, share: float, slow: float, clock: bool, side: float,
    lane_sigma: float,
) -> bool:  # fmt: skip
    """Without a heading sensor: turning round between junctions, mostly when slow.

    Args:
        belief: In place; children are appended.
        roads: The network.
        share: Probability of turning round now, standing.
        slow: Speed at which it is less by exp(−½), m/s.
        clock: Whether κ is a speed.
        side: 1 where one drives on the right, −1 on the left.
        lane_sigma: Spread of the lane offset, m.

    Returns:
        Whether any turned.
    """
    changed = False
    for i in range(belief.size[0]):
        edge = belief.edge[i]
        if edge == OFF_ROAD or belief.probability[i] < 0.01 or roads.opposite[edge] < 0:
            continue
        part = share
        if part * belief.probability[i] <= _TURNS:
            continue
        if clock:
            part *= math.exp(-0.5 * (belief.mean[i, K] / slow) ** 2)
        if roads.rule[roads.opposite[edge]] & AGAINST_ONE_WAY:
            part *= 0.01
        part = min(part, 0.2)
        if part * belief.probability[i] > _TURNS and belief.size[0] < CAPACITY:
            _turned(belief, roads, i, part, clock, side, lane_sigma)
            changed = True
    return changed


@part
def turn_with_heading(belief: Belief, roads: Roads, side: float, lane_sigma: float) -> None:
    """With a heading sensor: a vehicle athwart its road may be turning round."""
    for i in range(belief.size[0]):
        edge = belief.edge[i]
        if edge == OFF_ROAD or belief.probability[i] < 1e-4 or roads.opposite[edge] < 0:
            continue
        s = min(max(belief.abscissa[i], 0.0), roads.length[edge])
        along = chord_heading(roads, edge, belief.segment[i], s, 6.0)
        if abs(wrap(along - belief.mean[i, H])) > 1.3 and belief.size[0] < CAPACITY:
            _turned(belief, roads, i, 0.1, False, side, lane_sigma)
