"""Where one is on the road of the source: metres and share from its start, as it was drawn."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..observations import Array
from .streets import Ints

if TYPE_CHECKING:
    from .roadmap import RoadMap


class SourcePlace(NamedTuple):
    """Places on OpenStreetMap's ways, GERS segments or rows of a table, (n,) each."""

    m: Array  # from the start of the road as it was drawn
    share: Array  # of its length, 0 to 1


def on_source(roads: "RoadMap", edge: Ints, piece: Ints, s: Array) -> SourcePlace:
    """Places on the roads of (n,) `pieces`, of these edges, at along-track positions s, m.

    Positions beyond a piece are those of its ends.
    """
    pieces = roads.pieces
    forward = pieces.forward[piece] > 0
    after = np.minimum(piece + 1, len(pieces.start) - 1)
    last = piece + 1 == pieces.first[edge + 1]
    end = np.where(last, roads.arrays.edges["length"][edge], pieces.start[after])
    driven = np.clip(s, pieces.start[piece], end) - pieces.start[piece]
    place = pieces.offset[piece] + np.where(forward, driven, -driven)
    whole = pieces.whole[piece]
    if "paired" in roads.ways:  # against it the road is the row drawn the other way
        paired = np.asarray(roads.ways["paired"])[pieces.way[piece]] > 0
        place = np.where(paired & ~forward, whole - place, place)
    place = np.clip(place, 0.0, whole)
    return SourcePlace(place, place / whole)
