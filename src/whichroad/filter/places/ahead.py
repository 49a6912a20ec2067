"""Which point objects the vehicle will come past, how far on, and how probably.

Along the road its abscissa is a Gaussian, cut where a decision has been made: a vehicle that is
on an edge has not left it, and has come to it.  From there every way on is followed, with the
product of the turn priors.
"""

import math
from typing import NamedTuple

from ..._compile import Record, entry, kernel
from ...graph.geometry import locate
from ...graph.index import vertex_at
from ...graph.network import Roads, backwards, onwards, plane_scale
from ..gaussian import normal_cdf, truncated_moments
from .point_objects import LEAST, REACH, Findings, Places, add, finish, first_passage

_NOTHING = 1e-3  # share of a Gaussian within its edge below which it is not cut
_DRAWN = 0.02  # m² a metre: a line as it is drawn is longer or shorter than what is driven
_BACK = 16  # edges behind, at most


class _Along(NamedTuple):
    """A stance along its road, in the map's frame, and the range to which it is cut."""

    p: float
    s: float  # m
    sigma: float
    world: float  # what to add to abscissae for places in the world, m
    world_sigma: float
    low: float
    high: float


@kernel
def _along(stance: Record, roads: Roads) -> _Along:
    """A stance along its road."""
    edge = int(stance.edge)
    scale = plane_scale(roads, stance.x, stance.y)
    _, _, _, tx, ty = locate(roads, edge, vertex_at(roads, edge, stance.s), stance.s)
    world = (tx * (stance.x - stance.map_x) + ty * (stance.y - stance.map_y)) / scale
    variance = tx * tx * stance.xx + 2.0 * tx * ty * stance.xy + ty * ty * stance.yy
    low = 0.0 if backwards(roads, edge) < 0 else -math.inf
    high = roads.edges[edge].length if onwards(roads, edge) < 0 else math.inf
    within = normal_cdf((high - stance.s) / stance.sigma)
    within -= normal_cdf((low - stance.s) / stance.sigma)
    if within < _NOTHING:  # the filter has not cut it yet
        low = -math.inf
        high = math.inf
    return _Along(
        stance.p, stance.s, stance.sigma, world, math.sqrt(max(variance, 1e-4)), low, high
    )


@kernel
def _ahead(along: _Along, place: Record, o: float, within: float) -> tuple[float, float, float]:
    """P that a place at an abscissa lies ahead, and mean and variance of its distance (m, m²)."""
    s = along.s
    sigma = along.sigma
    low = along.low
    high = along.high
    if place.on_map == 0:
        s += along.world
        low += along.world
        high += along.world
        sigma = along.world_sigma
    sigma = math.sqrt(sigma * sigma + place.sigma * place.sigma)
    mean = o - s
    least = max(0.0, o - high)
    most = min(within, o - low)
    if most <= least or mean + REACH * sigma < least or mean - REACH * sigma > most:
        return 0.0, 0.0, 0.0
    total = normal_cdf((high - s) / sigma) - normal_cdf((low - s) / sigma)
    inside = normal_cdf((most - mean) / sigma) - normal_cdf((least - mean) / sigma)
    if inside > 0.9999 * total and total > 0.9999:
        return 1.0, mean, sigma * sigma
    if inside <= 1e-6 or total <= 1e-6:
        return 0.0, 0.0, 0.0
    middle, variance = truncated_moments(mean, sigma, least, most)
    return min(inside / total, 1.0), middle, variance


@kernel
def _not_yet(along: _Along, places: Places, work: Findings, k: int, j: int) -> float:
    """P that a way has not come past the place of passage j before its last edge, k."""
    left = 1.0
    place = places.place[places.passage[j].place]
    up = int(work.way[k].parent)
    while up >= 0:
        edge = work.way[up].edge
        other = j
        while True:
            if places.passage[other].edge == edge:
                if up > 0:
                    return 0.0
                p, _, _ = _ahead(along, place, places.passage[other].s, math.inf)
                left = min(left, 1.0 - p)
            other = int(places.passage[other].other)
            if other == j:
                break
        up = int(work.way[up].parent)
    return left


@kernel
def _pass(along: _Along, places: Places, work: Findings, count: int, k: int, within: float) -> int:
    """Add what lies along way k; returns how many places are found."""
    way = work.way[k]
    j = int(way.passage)
    while 0 <= j < len(places.passage) and places.passage[j].edge == way.edge:
        place = int(places.passage[j].place)
        o = way.offset + places.passage[j].s
        p, mean, variance = _ahead(along, places.place[place], o, within)
        p *= along.p * way.prior
        if p > 0.0:
            p *= _not_yet(along, places, work, k, j)
        if p > 0.0:
            count = add(work, count, place, p, mean, variance + _DRAWN * mean)
        j += 1
    return count


@kernel
def _behind(
    along: _Along, edge: int, roads: Roads, places: Places, work: Findings, count: int,
    within: float,
) -> int:  # fmt: skip
    """Add what lies on the same road before the edge, as the vehicle may still be there."""
    sigma = max(along.sigma, along.world_sigma)
    way = work.way[0]
    offset = 0.0
    before = backwards(roads, edge)
    for _ in range(_BACK):
        if before < 0 or offset < along.s - abs(along.world) - REACH * sigma:
            break
        offset -= roads.edges[before].length
        way.offset = offset
        way.edge = before
        way.passage = first_passage(places, before)
        count = _pass(along, places, work, count, 0, within)
        before = backwards(roads, before)
    return count


@kernel
def _open(places: Places, work: Findings, k: int, edge: int, parent: int, offset: float) -> None:
    """Begin way k."""
    way = work.way[k]
    way.edge = edge
    way.parent = parent
    way.offset = offset
    way.passage = first_passage(places, edge)


@entry
def find_ahead(
    count: int, within: float, known: float, roads: Roads, places: Places, work: Findings
) -> int:  # fmt: skip
    """Find the places that the vehicle will come past within a distance.

    Every way on is followed until the distance, or its probability is below 0.001.  A way
    counts a place where it comes past it first.

    Args:
        count: Stances in the buffer.
        within: Distance, m.
        known: P(one of these is right).
        roads: The network.
        places: The places.
        work: `found` is filled: distance is that along the road, given that it is passed.

    Returns:
        How many were found, the nearest first.
    """
    found = 0
    for i in range(count):
        stance = work.stance[i]
        if stance.edge < 0 or stance.p < LEAST:
            continue
        along = _along(stance, roads)
        work.way[0].prior = 1.0
        work.way[0].parent = -1
        found = _behind(along, int(stance.edge), roads, places, work, found, within)
        _open(places, work, 0, int(stance.edge), -1, 0.0)
        ways = 1
        k = 0
        last = stance.s + abs(along.world) + REACH * max(along.sigma, along.world_sigma) + within
        while k < ways:
            way = work.way[k]
            found = _pass(along, places, work, found, k, within)
            end = way.offset + roads.edges[way.edge].length
            if end < last:
                road = roads.edges[way.edge]
                for t in range(road.first_turn, road.end_turn):
                    prior = way.prior * roads.turns[t].prior
                    if prior * along.p >= LEAST and ways < len(work.way):
                        work.way[ways].prior = prior
                        _open(places, work, ways, int(roads.turns[t].edge), k, end)
                        ways += 1
            k += 1
    return finish(work, found, known)
