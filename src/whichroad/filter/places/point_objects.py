"""Point objects about the vehicle: records, and what is found of them.

A *stance* is a hypothesis as places see it.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np

from ..._compile import Array, Ints, Ints32, Records, entry, kernel
from ...graph.network import records
from ..state import MX, MY, Belief, X, Y

CELL = 100.0  # plane m, of the grid of places
WAYS = 4096  # edges that all ways on from one hypothesis may have
FOUND = 2048  # places that one question may find
LEAST = 1e-3  # probability of a way below which it is not followed, and of a place
REACH = 4.5  # sigmas beyond which a place is not

_MIX = 2654435769  # of the hash of an edge

STANCE = np.dtype(
    [
        ("p", "f8"),
        ("s", "f8"),  # abscissa on its edge, in the map's frame, m
        ("sigma", "f8"),  # m
        ("x", "f8"),  # m, plane, world
        ("y", "f8"),
        ("xx", "f8"),  # m²
        ("xy", "f8"),
        ("yy", "f8"),
        ("map_x", "f8"),  # the same in the map's frame
        ("map_y", "f8"),
        ("map_xx", "f8"),
        ("map_xy", "f8"),
        ("map_yy", "f8"),
        ("edge", "i8"),  # OFF_ROAD: none
    ],
    align=True,
)

PLACE = np.dtype(
    [
        ("x", "f8"),  # m, plane
        ("y", "f8"),
        ("sigma", "f8"),  # of its position, m
        ("on_map", "i8"),  # 1: it shares the map's error; 0: it is a place in the world
    ],
    align=True,
)

PASSAGE = np.dtype(
    [
        ("s", "f8"),  # abscissa at which it is passed, m
        ("edge", "i4"),
        ("place", "i4"),
        ("other", "i4"),  # another passage of this place, in a ring
    ],
    align=True,
)

WAY = np.dtype(
    [
        ("offset", "f8"),  # abscissa of the edge's start, from the first edge's, m
        ("prior", "f8"),  # product of turn priors
        ("edge", "i4"),
        ("parent", "i4"),  # way that it was reached from, -1: none
        ("passage", "i4"),  # first passage on it, -1: none
    ],
    align=True,
)

FINDING = np.dtype(
    [
        ("place", "i8"),
        ("distance", "f8"),  # m, mean
        ("sigma", "f8"),  # m
        ("p", "f8"),
    ],
    align=True,
)

Stances = Annotated[Records, Array(STANCE, 1)]


class Places(NamedTuple):
    """Point objects, where they are passed, and a grid."""

    place: Annotated[Records, Array(PLACE, 1)]  # (P,)
    passage: Annotated[Records, Array(PASSAGE, 1)]  # (n,) those of an edge side by side, by s
    slot: Ints32  # (a power of 2,) hash table from edges to their first passage, -1: empty
    key: Ints  # (P,) sorted keys of cells,
    in_cell: Ints32  # (P,) and the places


class Findings(NamedTuple):
    """Buffers of one thread."""

    stance: Stances  # (C,)
    way: Annotated[Records, Array(WAY, 1)]  # (WAYS,)
    found: Annotated[Records, Array(FINDING, 1)]  # (FOUND,)
    at: Ints32  # (P,) row in `found` of each place, if that row is of this place


def new_findings(places: int, stances: int) -> Findings:
    """Buffers for so many places and hypotheses."""
    return Findings(
        records(stances, STANCE), records(WAYS, WAY), records(FOUND, FINDING),
        np.zeros(places, np.int32),
    )  # fmt: skip


@kernel
def slot_of(edge: int, slots: int) -> int:
    """Where the search for an edge begins in a hash table of a power of two of slots."""
    return ((edge * _MIX) >> 15) & (slots - 1)


@entry
def take_stances(belief: Belief, stances: Stances) -> int:
    """Write the living hypotheses as stances; returns how many."""
    scale = belief.state[0].scale
    count = min(int(belief.state[0].count), len(stances))
    for i in range(count):
        hyp = belief.hyp[i]
        cov = hyp.cov
        one = stances[i]
        one.p = hyp.weight
        one.s = hyp.along
        one.sigma = hyp.along_sigma
        one.edge = hyp.edge
        one.x = hyp.mu[X]
        one.y = hyp.mu[Y]
        one.xx = cov[X, X]
        one.xy = cov[X, Y]
        one.yy = cov[Y, Y]
        one.map_x = hyp.mu[X] + scale * hyp.mu[MX]
        one.map_y = hyp.mu[Y] + scale * hyp.mu[MY]
        one.map_xx = cov[X, X] + 2.0 * cov[X, MX] + cov[MX, MX]
        one.map_xy = cov[X, Y] + cov[X, MY] + cov[Y, MX] + cov[MX, MY]
        one.map_yy = cov[Y, Y] + 2.0 * cov[Y, MY] + cov[MY, MY]
    return count


@kernel
def first_passage(places: Places, edge: int) -> int:
    """The first passage on an edge, or -1."""
    slots = len(places.slot)
    at = slot_of(edge, slots)
    while places.slot[at] >= 0:
        if places.passage[places.slot[at]].edge == edge:
            return int(places.slot[at])
        at = (at + 1) & (slots - 1)
    return -1


@kernel
def add(work: Findings, count: int, place: int, p: float, mean: float, variance: float) -> int:
    """Add a probability and its moments to what was found of a place; returns how many there are.

    `distance` and `sigma` are sums of p d and p d² until `finish`.
    """
    k = int(work.at[place])
    if k >= count or work.found[k].place != place:
        if count >= len(work.found):
            return count
        k = count
        work.at[place] = k
        new = work.found[k]
        new.place = place
        new.distance = 0.0
        new.sigma = 0.0
        new.p = 0.0
        count += 1
    one = work.found[k]
    one.p += p
    one.distance += p * mean
    one.sigma += p * (variance + mean * mean)
    return count


@kernel
def finish(work: Findings, count: int, known: float) -> int:
    """Turn sums into moments, sort by distance, and drop what is hardly possible.

    Args:
        work: `found` is finished.
        count: How many there are.
        known: What probabilities are multiplied by.

    Returns:
        How many are left.
    """
    left = 0
    for k in range(count):
        one = work.found[k]
        if one.p < LEAST:
            continue
        mean = one.distance / one.p
        sigma = math.sqrt(max(one.sigma / one.p - mean * mean, 0.0))
        place, p = one.place, known * min(one.p, 1.0)
        at = left
        while at > 0 and work.found[at - 1].distance > mean:
            before = work.found[at - 1]
            new = work.found[at]
            new.place, new.distance = before.place, before.distance
            new.sigma, new.p = before.sigma, before.p
            at -= 1
        new = work.found[at]
        new.place = place
        new.distance = mean
        new.sigma = sigma
        new.p = p
        left += 1
    return left
