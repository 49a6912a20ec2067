"""Where to drive: legal random routes along the road graph."""

import heapq
import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..errors import MapError
from ..graph.network import Roads
from ..roadmap.reached import reached

Edges = NDArray[np.int64]

_ATTEMPTS = 40
_SERVICE = 0.05  # weight of turning into a service road
_AGAIN = 0.25  # weight of an edge for each time it was driven before
_BACK = 1e-3  # weight of turning back by two turns in a row
_SHORT_LINK_M = 18.0  # the edge between such turns
_SHORTEST_M = 50.0
_SHARPEST = 2.3  # rad, turns at a junction that a car cannot take in one go are not taken


def _legal_turns(roads: Roads) -> tuple[Edges, Edges]:
    """Turns that break no rule and can be steered, as (from, to) edges."""
    edges, turns = roads.edges, roads.turns
    origin = np.repeat(np.arange(len(edges)), edges.end_turn - edges.first_turn)
    ok = (turns.rule == 0) & (edges.rule[turns.edge] == 0) & (edges.rule[origin] == 0)
    ok &= (turns.edge != edges.opposite[origin]) & (np.abs(turns.angle) < _SHARPEST)
    return origin[ok], turns.edge[ok].astype(np.int64)


def drivable(roads: Roads, random: np.random.Generator) -> NDArray[np.bool_]:
    """Edges among which one can legally drive on for ever.

    The largest of a few strongly connected parts, each found as what one edge reaches
    and is reached from.  On a map without any circuit: all legal edges.

    Args:
        roads: The network.
        random: Which edges are tried.

    Returns:
        (E,) True for the edges.
    """
    count = len(roads.edges)
    origin, target = _legal_turns(roads)
    bounds = np.arange(count + 1)
    order = np.argsort(target, kind="stable")
    forward = np.searchsorted(origin, bounds)
    backward = np.searchsorted(target[order], bounds)
    best = np.zeros(count, dtype=bool)
    for edge in random.permutation(np.flatnonzero(roads.edges.rule == 0))[:_ATTEMPTS]:
        if best[edge]:
            continue
        part = reached(edge, forward, target) & reached(edge, backward, origin[order])
        if part.sum() > max(1, best.sum()):
            best = part
        if best.sum() > 0.4 * count:
            break
    return best if best.any() else roads.edges.rule == 0


def _turns_of(roads: Roads, edge: int) -> Records:
    """The turns out of an edge."""
    row = roads.edges[edge]
    return roads.turns[row["first_turn"] : row["end_turn"]]


def _walk(
    roads: Roads, allowed: NDArray[np.bool_], length_m: float, random: np.random.Generator
) -> list[int]:
    """One random drive of at least `length_m`, or until no legal turn is left."""
    edges = roads.edges
    length, service, opposite = edges.length, edges.service, edges.opposite
    starts = np.flatnonzero(allowed)
    weight = length[starts] * np.where(service[starts] > 0, _SERVICE, 1.0)
    edge = int(random.choice(starts, p=weight / weight.sum()))
    route, driven, visits = [edge], float(length[edge]), {edge: 1}
    before = 0.0  # rad turned just now
    while driven < length_m:
        turns = _turns_of(roads, edge)
        successors = turns.edge
        p = turns.prior * np.where(service[successors] > 0, _SERVICE, 1.0)
        p *= (turns.rule == 0) & allowed[successors] & (successors != opposite[edge])
        bend = turns.angle.astype(float)
        p *= np.abs(bend) < _SHARPEST
        p *= np.where(np.abs(bend + before) < _SHARPEST, 1.0, _BACK)
        p = p * np.array([_AGAIN ** visits.get(int(e), 0) for e in successors])
        if not p.sum() > 0:
            break
        pick = int(random.choice(len(successors), p=p / p.sum()))
        edge = int(successors[pick])
        before = float(bend[pick]) if length[edge] < _SHORT_LINK_M else 0.0
        visits[edge] = visits.get(edge, 0) + 1
        route.append(edge)
        driven += float(length[edge])
    return route


def random_route(
    roads: Roads,
    length_m: float,
    random: np.random.Generator,
    allowed: NDArray[np.bool_] | None = None,
) -> Edges:
    """Draw a legal, connected route without turning round.

    Turns follow the map's own priors, seldom into service roads, and rather where one
    has not been yet.

    Args:
        roads: The network.
        length_m: How far to drive, true m; the route is a little longer where it can be.
        random: Source of chance.
        allowed: (E,) from `drivable`, to draw many routes on one map; None: found here.

    Returns:
        (n,) edges in driving order.

    Raises:
        MapError: No legal drive of 50 m exists.
    """
    if allowed is None:
        allowed = drivable(roads, random)
    best: list[int] = []
    if allowed.any():
        for _ in range(_ATTEMPTS):
            route = _walk(roads, allowed, length_m, random)
            best = max(best, route, key=lambda edges: float(roads.edges.length[edges].sum()))
            if roads.edges.length[best].sum() >= length_m:
                break
    if roads.edges.length[best].sum() < _SHORTEST_M:
        raise MapError(
            f"map of {len(roads.edges)} directed edges: no legal drive of {_SHORTEST_M:g} m; "
            "roads that may be driven were expected; simulate on another map"
        )
    return np.array(best, dtype=np.int64)


def shortest_route(roads: Roads, nodes: Sequence[int]) -> Edges:
    """The shortest legal drive through junctions, without turning round.

    Args:
        roads: The network.
        nodes: Junctions in the order in which they are passed, as in `roads.edges.from_node`.

    Returns:
        (n,) edges in driving order.

    Raises:
        MapError: One cannot legally be reached from the one before.
    """
    route: list[int] = []
    for begin, end in itertools.pairwise(nodes):
        if route:
            starts = _turns(roads, route[-1])
        else:
            starts = np.flatnonzero(
                (roads.edges.from_node == begin) & (roads.edges.rule == 0)
            ).tolist()
        edges = _shortest_route(roads, starts, end)
        if not edges:
            raise MapError(
                f"map of {len(roads.edges)} directed edges: no legal route from junction {begin} "
                f"to {end}; a connected pair was expected; choose other places"
            )
        route += edges
    return np.array(route, dtype=np.int64)


def _turns(roads: Roads, edge: int) -> list[int]:
    """Edges that may legally follow, turning back not among them."""
    turns = _turns_of(roads, edge)
    successors = turns.edge
    ok = (turns.rule == 0) & (roads.edges.rule[successors] == 0)
    found: list[int] = successors[ok & (successors != roads.edges.opposite[edge])].tolist()
    return found


def _shortest_route(roads: Roads, starts: Sequence[int], end: int) -> list[int]:
    """Shortest run of edges from one of `starts` to one that ends at junction `end`."""
    length_of, to_node = roads.edges.length, roads.edges.to_node
    queue = [(float(length_of[e]), e, -1) for e in starts]
    heapq.heapify(queue)
    came_from: dict[int, int] = {}
    while queue:
        length, edge, before = heapq.heappop(queue)
        if edge in came_from:
            continue
        came_from[edge] = before
        if to_node[edge] == end:
            edges = []
            while edge >= 0:
                edges.append(edge)
                edge = came_from[edge]
            return edges[::-1]
        for successor in _turns(roads, edge):
            if successor not in came_from:
                heapq.heappush(queue, (length + float(length_of[successor]), successor, edge))
    return []
