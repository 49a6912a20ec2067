"""Where on the roads point objects are passed."""

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..filter.places.point_objects import CELL, PASSAGE, PLACE, Places, slot_of
from ..geodesy.angles import radians, wrap
from ..graph.index import cell_key
from ..graph.network import records
from ..roadmap import RoadMap
from .place_table import PlaceTable

BESIDE_M = 50.0  # from a road, at most, where a place is passed
_AT_NODE_M = 0.5  # from an end of an edge: at the junction
_SAME_WAY = radians(60.0)  # of a bearing, that traffic of this direction may have

Passage = tuple[int, float]  # edge, m from its start


class Snapped(NamedTuple):
    """Point objects on a map."""

    arrays: Places
    rows: NDArray[np.int64]  # (P,) of the table
    skipped: dict[str, int]  # rows without a place, by reason
    beside: dict[str, int]  # places that no road passes, by reason


def snap(table: PlaceTable, roads: RoadMap) -> Snapped:
    """Snap point objects to a map.

    A place is passed on the nearest road within 50 m, in both directions or in that of its
    bearing.  At a junction it is passed by all that come to it.

    Args:
        table: The places.
        roads: The map.

    Returns:
        Places with a position; a road may pass some of them nowhere.
    """
    skipped: Counter[str] = Counter()
    beside: Counter[str] = Counter()
    rows: list[int] = []
    place: list[tuple[float, float, float, bool]] = []
    passages: list[tuple[int, float, int]] = []
    here = np.isfinite(table.lat) & np.isfinite(table.lon)
    x, y = roads.plane.from_geodetic(np.where(here, table.lat, 0.0), np.where(here, table.lon, 0.0))
    for row, edge in enumerate(table.edge.tolist()):
        found: list[Passage] = []
        if edge >= 0:
            why = _why_not(roads, edge, float(table.offset[row]))
            if why is not None:
                skipped[why] += 1
                continue
            found = [(edge, float(table.offset[row]))]
            at = roads.at(*found[0])[:2]
        elif here[row]:
            at = float(x[row]), float(y[row])
            found = _passages(roads, at, float(table.bearing[row]), beside)
        else:
            skipped["without a position"] += 1
            continue
        passages += [(e, s, len(rows)) for e, s in found]
        rows.append(row)
        place.append((*at, float(table.sigma[row]), bool(table.on_map[row])))
    return Snapped(_arrays(place, passages), np.array(rows, np.int64), dict(skipped), dict(beside))


def _why_not(roads: RoadMap, edge: int, s: float) -> str | None:
    """Why a place on an edge is none."""
    if edge >= len(roads):
        return "on an edge that is not in the map"
    if not 0.0 <= s <= float(roads.arrays.edges.length[edge]):
        return "beyond the ends of its edge"
    return None


def _passages(
    roads: RoadMap, at: tuple[float, float], bearing: float, beside: Counter[str]
) -> list[Passage]:
    """Edges that pass a point, and where."""
    near = roads.near(*at, BESIDE_M)
    if not len(near.edge):
        beside[f"farther than {BESIDE_M:g} m from every road"] += 1
        return []
    heading = None if np.isnan(bearing) else float(roads.plane.heading(bearing, *at))
    for edge, s in zip(near.edge.tolist(), near.s.tolist(), strict=True):
        if heading is not None and not _is_along(roads, edge, s, heading):
            continue
        into = _into_node(roads, edge, s)
        if into is not None:
            ends = [(e, float(roads.arrays.edges.length[e])) for e in into]
            if heading is not None:
                ends = [one for one in ends if _is_along(roads, *one, heading)]
            return ends or [(edge, s)]
        back = int(roads.arrays.edges.opposite[edge])
        if heading is not None or back < 0:
            return [(edge, s)]
        return [(edge, s), (back, float(roads.arrays.edges.length[back]) - s)]
    beside["no road in the direction of its bearing"] += 1
    return []


def _is_along(roads: RoadMap, edge: int, s: float, heading: float) -> bool:
    return bool(abs(wrap(roads.at(edge, s)[2] - heading)) <= _SAME_WAY)


def _into_node(roads: RoadMap, edge: int, s: float) -> list[int] | None:
    """All edges into the junction at a place; None: there is none."""
    edges, turns = roads.arrays.edges, roads.arrays.turns
    leaving = edge
    if s > float(edges.length[edge]) - _AT_NODE_M:
        first = int(edges.first_turn[edge])
        if first == int(edges.end_turn[edge]):  # nothing follows
            return [edge]
        leaving = int(turns.edge[first])
    elif s >= _AT_NODE_M:
        return None
    first, end = int(edges.first_predecessor[leaving]), int(edges.end_predecessor[leaving])
    into: list[int] = roads.arrays.predecessors[first:end].tolist()
    return into or [edge]


def _arrays(
    place: list[tuple[float, float, float, bool]], passages: list[tuple[int, float, int]]
) -> Places:
    """Tables of the kernels: passages of an edge side by side, a hash table, a grid."""
    at = records(len(place), PLACE)
    at[:] = [tuple(one) for one in place]
    passage = records(len(passages), PASSAGE)
    passages.sort()
    others = _rings([number for _, _, number in passages])
    passage[:] = [(s, e, k, other) for (e, s, k), other in zip(passages, others, strict=True)]
    slots = 1 << max(2 * len(passages), 1).bit_length()
    slot = np.full(slots, -1, np.int32)
    before = -1
    for number, edge in enumerate(passage.edge.tolist()):
        if edge != before:
            k = slot_of(edge, slots)
            while slot[k] >= 0:
                k = (k + 1) & (slots - 1)
            slot[k] = number
        before = edge
    columns = np.floor(at.x / CELL).astype(np.int64)
    lines = np.floor(at.y / CELL).astype(np.int64)
    key = np.asarray(cell_key(columns, lines), np.int64)
    order = np.argsort(key, kind="stable")
    return Places(at, passage, slot, key[order], order.astype(np.int32))


def _rings(places: list[int]) -> list[int]:
    """For each passage another one of its place, so that they form rings."""
    other = list(range(len(places)))
    last: dict[int, int] = {}
    for k, place in enumerate(places):
        before = last.get(place, k)
        other[k], other[before] = other[before], k
        last[place] = k
    return other
