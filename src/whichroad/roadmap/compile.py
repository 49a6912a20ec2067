"""From streets to the kernels' tables: junctions, directed edges, lengths, pieces."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..errors import MapError
from ..geodesy.plane import Plane
from ..graph.network import AGAINST_ONE_WAY, EDGE, NO_ACCESS, PLANE, VERTEX, Roads, records
from ..graph.search import edge_costs, turn_costs
from ..observations import Array
from . import cells
from .bans import keys
from .chains import chains, end_headings
from .link import middle_plane
from .streets import Bytes, Column, Ints, Streets, Texts, take
from .tags import CLASS_SPEED_KMH
from .turns import Graph, successors

Ints32 = NDArray[np.int32]

CELL_SIZE = 64.0  # m: about two search radii, so that a query reads four cells
REACH = 2.0e6  # m from the origin, up to which the plane's scale is good to 1e-4
_LEAST = 1e-3  # m, shortest segment with a meaningful direction
_CHORD = 8.0  # m over which headings at a node are taken


class Pieces(NamedTuple):
    """Which street lies where along each edge.  P pieces."""

    first: Ints32  # (E+1,)
    way: Ints32  # (P,) street
    forward: Bytes  # (P,) 1 where it is driven as it was drawn
    start: Array  # (P,) along-track position at which it begins, true m
    offset: Array  # (P,) position there along the source as it was drawn, m
    whole: Array  # (P,) length of the source, m


@dataclass(frozen=True, slots=True)
class Network:
    """A compiled map, before it has a file."""

    roads: Roads
    plane: Plane
    pieces: Pieces
    way: Ints32  # (E,) the street of the longest piece
    node_id: Column  # (J,) source ids of the junctions
    dropped: dict[str, int]


def compile_streets(streets: Streets, where: str) -> Network:
    """Make the network of some streets.

    Args:
        streets: What a map reader gave.
        where: Name of the map, for errors.

    Returns:
        Tables, plane and sources.

    Raises:
        MapError: No street has a length, or the map is too wide for one plane.
    """
    plane = middle_plane(streets.lat_deg, streets.lon_deg)
    x, y = plane.lay(streets.lat_deg, streets.lon_deg)
    if np.hypot(x, y).max() > REACH:
        raise MapError(
            f"{where}: it reaches {np.hypot(x, y).max() / 1e3:,.0f} km from its middle; at most "
            f"{REACH / 1e3:,.0f} km were expected; cut it, or remove stray points"
        )
    half, dropped = _halves(streets, plane, x, y)
    half, twice = _drawn_once(half, _class_order(streets.highway), len(x))
    if twice:
        dropped["segments drawn twice"] = twice
    if len(half.tail) == 0:
        raise MapError(
            f"{where}: no street has a length; lines of at least two different points were "
            "expected; check the geometries and their coordinate system"
        )
    chain_first, chain_half = _chains(streets, half, len(x))
    return _network(streets, plane, x, y, half, chain_first, chain_half, dropped)


class _Halves(NamedTuple):
    """Both directions of every straight segment: half 2i along its first street, 2i + 1 back."""

    tail: Ints32  # (2M,) node
    head: Ints32
    way: Ints32  # street; of both directions the same, but where streets share the segment
    forward: Bytes  # 1 where it runs as its street was drawn
    rule: Bytes
    length: Array  # true m
    place: Array  # m along the source at which it begins
    whole: Array  # (W,) m, lengths of the sources of streets


def _halves(streets: Streets, plane: Plane, x: Array, y: Array) -> tuple[_Halves, dict[str, int]]:
    """The segments that have a length; nodes that coincide along a street become one."""
    count = np.diff(streets.first)
    way = np.repeat(np.arange(len(count)), count)
    inside = way[1:] == way[:-1]
    tail, head, way = streets.node[:-1][inside], streets.node[1:][inside], way[1:][inside]
    join = _joined(tail, head, x, y)
    tail, head = join[tail], join[head]
    long = tail != head
    tail, head, way = tail[long], head[long], way[long]
    length = _true_length(plane, x[tail], y[tail], x[head], y[head])
    twice = np.stack([tail, head], axis=1)
    rule = np.stack([streets.rule_forward[way], streets.rule_backward[way]], axis=1)
    begin, whole = _along_source(streets, way, length)
    return _Halves(
        twice.ravel().astype(np.int32),
        twice[:, ::-1].ravel().astype(np.int32),
        np.repeat(way, 2).astype(np.int32),
        np.tile(np.array([1, 0], np.uint8), len(way)),
        rule.ravel(),
        np.repeat(length, 2),
        np.stack([begin, begin + length], axis=1).ravel(),
        whole,
    ), {} if long.all() else {"segments without length": int((~long).sum())}


def _along_source(streets: Streets, way: Ints, length: Array) -> tuple[Array, Array]:
    """Where segments begin along their sources, m, and the lengths of the sources of streets.

    Args:
        streets: Parts of sources, or whole ones.
        way: (M,) ascending street of each segment.
        length: (M,) m.
    """
    count = len(streets.first) - 1
    total = np.concatenate([[0.0], np.cumsum(length)])
    begin = total[:-1] - total[np.searchsorted(way, np.arange(count))][way]
    own: Array = np.bincount(way, length, count).astype(np.float64)
    if streets.start is None or streets.whole is None:
        return begin, own
    whole = np.where(np.isfinite(streets.whole), streets.whole, own)
    return begin + streets.start[way], np.maximum(whole, streets.start + own)


def _joined(tail: Ints, head: Ints, x: Array, y: Array) -> Ints:
    """For each node the one that stands for it: that of the nodes with which it coincides."""
    join = np.arange(len(x))
    while True:
        a, b = join[tail], join[head]
        short = (a != b) & (np.hypot(x[a] - x[b], y[a] - y[b]) < _LEAST)
        if not short.any():
            return join
        low = np.arange(len(x))
        np.minimum.at(low, np.maximum(a, b)[short], np.minimum(a, b)[short])
        join = low[join]


def _class_order(highway: Texts) -> Ints:
    """Place of each street's class among the classes, from the highest down; unknown last."""
    place = {word: i for i, word in enumerate(CLASS_SPEED_KMH)}
    words = range(len(highway.offset) - 1)
    return np.array([place.get(highway.word(c), len(place)) for c in words])[highway.code]


def _drawn_once(half: _Halves, order: Ints, nodes: int) -> tuple[_Halves, int]:
    """One segment where several join the same two nodes.

    Each of its directions is that of the best street: one that is legal there, else open,
    then of the highest class, then the earliest.  Two one-way streets drawn on each other in
    opposite directions so become one that is driven in both directions, by two names.

    Args:
        half: All segments.
        order: (W,) place of each street's class, 0 the highest.
        nodes: Number of nodes.

    Returns:
        The segments, and how many were left out in a direction in which they can be driven.
    """
    key = half.tail.astype(np.int64) * nodes + half.head
    against = half.rule & AGAINST_ONE_WAY > 0
    worse = (2 * against + (half.rule & NO_ACCESS > 0)) * (order.max(initial=0) + 1)
    ranked = np.lexsort((worse + order[half.way], key))
    new = np.ones(len(key), bool)
    new[1:] = np.diff(key[ranked]) != 0
    if new.all():
        return half, 0
    best = np.empty(len(key), np.int64)
    best[ranked] = ranked[new][np.cumsum(new) - 1]
    repeats = ((best != np.arange(len(key))) & ~against).reshape(-1, 2).any(axis=1)
    _, first = np.unique(np.minimum(key[0::2], key[1::2]), return_index=True)
    kept = (2 * np.sort(first)[:, None] + [0, 1]).ravel()
    kept_of = (half.way, half.forward, half.rule, half.place)
    way, forward, rule, place = (column[best[kept]] for column in kept_of)
    tail, head, length = half.tail[kept], half.head[kept], half.length[kept]
    return _Halves(tail, head, way, forward, rule, length, place, half.whole), int(repeats.sum())


def _true_length(plane: Plane, ax: Array, ay: Array, bx: Array, by: Array) -> Array:
    """Lengths on the ground: the plane's over its scale, by Simpson's rule."""
    scale = (
        1.0 / plane.scale(ax, ay)
        + 4.0 / plane.scale(0.5 * (ax + bx), 0.5 * (ay + by))
        + 1.0 / plane.scale(bx, by)
    )
    length: Array = np.hypot(bx - ax, by - ay) * scale / 6.0
    return length


def _chains(streets: Streets, half: _Halves, nodes: int) -> tuple[Ints32, Ints32]:
    """Directed edges as lists of halves, from junction to junction."""
    out = np.argsort(half.tail, kind="stable").astype(np.int32)
    degree = np.bincount(half.tail, minlength=nodes)
    out_first = np.concatenate([[0], np.cumsum(degree)]).astype(np.int32)
    cut = (degree != 2).astype(np.uint8)
    through = np.flatnonzero(degree == 2)
    one, two = out[out_first[through]], out[out_first[through] + 1]
    kind = streets.highway.code[half.way]
    differs = (
        (kind[one ^ 1] != kind[two])
        | (kind[two ^ 1] != kind[one])
        | (half.rule[one ^ 1] != half.rule[two])
        | (half.rule[two ^ 1] != half.rule[one])
    )
    cut[through[differs]] = 1
    named = streets.node_id.code if isinstance(streets.node_id, Texts) else streets.node_id
    via = [r.via for r in streets.restrictions if r.via >= 0]
    cut[np.isin(named, np.concatenate([streets.blocked, via]))] = 1
    over = [way for r in streets.restrictions if r.over for way in (*r.origin, *r.over, *r.target)]
    if over:  # an edge is of one of them
        inside = np.flatnonzero(np.isin(keys(streets.columns["source_id"]), over))
        ends = np.concatenate([streets.first[inside], streets.first[inside + 1] - 1])
        cut[streets.node[ends]] = 1
    return chains(half.head, cut, out_first, out)


def _network(
    streets: Streets, plane: Plane, x: Array, y: Array, half: _Halves,
    chain_first: Ints32, chain: Ints32, dropped: dict[str, int],
) -> Network:  # fmt: skip
    """Lay the chains out as tables."""
    count = len(chain_first) - 1
    begin, end = chain[chain_first[:-1]], chain[chain_first[1:] - 1]
    starting = np.empty(len(chain), np.int32)
    starting[begin] = np.arange(count)
    opposite = starting[end ^ 1]  # it begins with the last half, driven back
    places = np.unique(np.concatenate([half.tail[begin], half.head[end]]))
    number = np.empty(len(x), np.int32)
    number[places] = np.arange(len(places))
    from_node, to_node = number[half.tail[begin]], number[half.head[end]]

    first, node, s = _shape(half, chain_first, chain)
    vertices = records(len(node), VERTEX)
    vertices.x, vertices.y, vertices.s = x[node], y[node], s
    found = cells.build(vertices.x, vertices.y, first, CELL_SIZE)  # while there is little else
    pieces = _pieces(half, chain, chain_first, s[~_last(first)])
    length = s[first[1:] - 1]
    way = _longest(pieces, length)
    heading_out, heading_in = end_headings(vertices.x, vertices.y, s, first, _CHORD)
    rule = half.rule[begin]
    service = streets.service[way]
    node_id = take(streets.node_id, places)
    graph = Graph(
        from_node, to_node, opposite, heading_out, heading_in, service, rule, length,
        half.way[begin], half.way[end], half.forward[begin], half.forward[end],
    )  # fmt: skip
    turns = successors(graph, streets, node_id)
    time = np.add.reduceat(half.length[chain] / streets.speed[half.way[chain]], chain_first[:-1])
    edges = records(count, EDGE)
    edges.length, edges.speed = length, length / time
    edges.first_vertex, edges.last_vertex = first[:-1], first[1:] - 1
    edges.first_turn, edges.end_turn = turns.first[:-1], turns.first[1:]
    edges.first_predecessor, edges.end_predecessor = (
        turns.first_predecessor[:-1], turns.first_predecessor[1:]
    )  # fmt: skip
    edges.from_node, edges.to_node, edges.opposite = from_node, to_node, opposite
    edges.lane = np.where(rule & AGAINST_ONE_WAY, 0.0, streets.lane[way])
    edges.lane_sigma = streets.lane_sigma[way]
    edges.rule, edges.service = rule, service
    edge_costs(edges, vertices)
    turn_costs(edges, turns.table)
    roads = Roads(
        vertices, edges, turns.table, turns.predecessors, *found,
        plane_record(plane.curvature, CELL_SIZE),
    )  # fmt: skip
    return Network(roads, plane, pieces, way, node_id, {**dropped, **turns.dropped})


def plane_record(curvature: float, cell_size: float) -> Records:
    """The numbers of the plane and the grid, (1,) PLANE."""
    plane = records(1, PLANE)
    plane.curvature, plane.cell_size = curvature, cell_size
    return plane


def _shape(half: _Halves, chain_first: Ints32, chain: Ints32) -> tuple[Ints32, Ints32, Array]:
    """First vertices of the edges, the nodes that are their vertices, their positions along.

    Each edge has one vertex more than halves: their heads, after the tail of the first.
    """
    first = (chain_first + np.arange(len(chain_first))).astype(np.int32)
    rest = np.ones(first[-1], bool)
    rest[first[:-1]] = False
    node = np.empty(first[-1], np.int32)
    node[~rest], node[rest] = half.tail[chain[chain_first[:-1]]], half.head[chain]
    total = np.concatenate([[0.0], np.cumsum(half.length[chain])])
    s = np.zeros(first[-1])
    s[rest] = total[1:] - np.repeat(total[chain_first[:-1]], np.diff(chain_first))
    return first, node, s


def _last(first: Ints32) -> NDArray[np.bool_]:
    """Which vertices are the last of their edge."""
    last = np.zeros(first[-1], bool)
    last[first[1:] - 1] = True
    return last


def _pieces(half: _Halves, chain: Ints32, chain_first: Ints32, start: Array) -> Pieces:
    """Runs of halves of one street in one direction."""
    way, forward = half.way[chain], half.forward[chain]
    new = np.ones(len(way), bool)
    new[1:] = (way[1:] != way[:-1]) | (forward[1:] != forward[:-1])
    new[chain_first[:-1]] = True
    before = np.concatenate([[0], np.cumsum(new)])[chain_first].astype(np.int32)
    way, place = way[new], half.place[chain][new]
    return Pieces(before, way, forward[new], start[new], place, half.whole[way])


def _longest(pieces: Pieces, length: Array) -> Ints32:
    """The street of each edge's longest piece, the earliest of equals."""
    end = np.append(pieces.start[1:], 0.0)
    end[pieces.first[1:] - 1] = length
    edge = np.repeat(np.arange(len(length)), np.diff(pieces.first))
    # rounded, so that both directions of an edge choose alike but for true ties
    order = np.lexsort((pieces.way, -np.round(end - pieces.start, 6), edge))
    return pieces.way[order[pieces.first[:-1]]]
