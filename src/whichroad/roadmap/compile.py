"""From streets to the kernels' tables: junctions, directed edges, lengths, pieces."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..errors import MapError
from ..geodesy.plane import Plane
from ..graph.network import AGAINST_ONE_WAY, EDGE, NO_ACCESS, PLANE, Roads, records
from ..graph.route_costs import edge_costs, turn_costs
from ..observations import Array
from .bans import keys
from .chains import chains
from .laid_out import BLOCK, Drawn, Halves, Pieces, lay_out
from .link import middle_plane
from .shelf import laid, release, stored, table
from .streets import Bytes, Column, Ints, Streets, Texts, take
from .tags import CLASS_SPEED_KMH
from .turns import Graph, Turns, successors

Ints32 = NDArray[np.int32]

CELL_SIZE = 64.0  # m: about two search radii, so that a query reads four cells
REACH = 2.0e6  # m from the origin, up to which the plane's scale is good to 1e-4
_AT_ONCE = 1 << 16  # edges
_LEAST = 1e-3  # m, shortest segment with a meaningful direction


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
    x, y = _laid_out(streets, plane, where)
    half, dropped = _halves(streets, plane, x, y)
    half, twice = _drawn_once(half, _class_order(streets.highway), len(x))
    if twice:
        dropped["segments drawn twice"] = twice
    if len(half.tail) == 0:
        raise MapError(
            f"{where}: no street has a length; lines of at least two different points were "
            "expected; check the geometries and their coordinate system"
        )
    release(streets.node, x, y, half.length, half.place)
    drawn = lay_out(streets, x, y, half, *_chains(streets, half, len(x)), CELL_SIZE)
    del x, y, half
    release(streets.node, *([] if isinstance(streets.node_id, Texts) else [streets.node_id]))
    return _network(streets, plane, drawn, dropped)


def _laid_out(streets: Streets, plane: Plane, where: str) -> tuple[Array, Array]:
    """The nodes in the plane, m.

    Raises:
        MapError: They reach too far.
    """
    n = len(streets.lat_deg)
    x, y = stored(n, np.float64), stored(n, np.float64)
    reach = 0.0
    for low in range(0, n, BLOCK):
        own = slice(low, low + BLOCK)
        x[own], y[own] = plane.lay(streets.lat_deg[own], streets.lon_deg[own])
        reach = max(reach, float(np.hypot(x[own], y[own]).max()))
    if reach > REACH:
        raise MapError(
            f"{where}: it reaches {reach / 1e3:,.0f} km from its middle; at most "
            f"{REACH / 1e3:,.0f} km were expected; cut it, or remove stray points"
        )
    release(streets.lat_deg, streets.lon_deg)
    return x, y


def _halves(streets: Streets, plane: Plane, x: Array, y: Array) -> tuple[Halves, dict[str, int]]:
    """The segments that have a length; nodes that coincide along a street become one."""
    count = np.diff(streets.first)
    way = np.repeat(np.arange(len(count), dtype=np.int32), count)
    inside = way[1:] == way[:-1]
    tail, head = (
        part[inside].astype(np.int32) for part in (streets.node[:-1], streets.node[1:])
    )  # fmt: skip
    way = way[1:][inside]
    join = _joined(tail, head, x, y)
    tail, head = join[tail], join[head]
    long = tail != head
    tail, head, way = tail[long], head[long], way[long]
    del inside, join
    length = np.empty(len(way))
    for low in range(0, len(way), BLOCK):
        own = slice(low, low + BLOCK)
        a, b = tail[own], head[own]
        length[own] = _true_length(plane, x[a], y[a], x[b], y[b])
    release(x, y)
    begin, whole = _along_source(streets, way, length)
    place = laid(np.stack([begin, begin + length], axis=1).ravel())
    del begin
    length = laid(length)
    rule = np.stack([streets.rule_forward[way], streets.rule_backward[way]], axis=1)
    return Halves(
        np.stack([tail, head], axis=1).ravel(),
        np.stack([head, tail], axis=1).ravel(),
        np.repeat(way, 2),
        np.tile(np.array([1, 0], np.uint8), len(way)),
        rule.ravel(),
        length,
        place,
        whole,
    ), {} if long.all() else {"segments without length": int((~long).sum())}


def _along_source(streets: Streets, way: Ints32, length: Array) -> tuple[Array, Array]:
    """Where segments begin along their sources, m, and the lengths of the sources of streets.

    Args:
        streets: Parts of sources, or whole ones.
        way: (M,) ascending street of each segment.
        length: (M,) m.
    """
    count = len(streets.first) - 1
    total = np.concatenate([[0.0], np.cumsum(length)])
    begin = total[:-1] - total[np.searchsorted(way, np.arange(count, dtype=np.int32))][way]
    own: Array = np.bincount(way, length, count).astype(np.float64)
    if streets.start is None or streets.whole is None:
        return begin, own
    whole = np.where(np.isfinite(streets.whole), streets.whole, own)
    return begin + streets.start[way], np.maximum(whole, streets.start + own)


def _joined(tail: Ints32, head: Ints32, x: Array, y: Array) -> Ints32:
    """For each node the one that stands for it: that of the nodes with which it coincides."""
    join = np.arange(len(x), dtype=np.int32)
    while True:
        short = np.zeros(len(tail), bool)
        for low in range(0, len(tail), BLOCK):
            own = slice(low, low + BLOCK)
            a, b = join[tail[own]], join[head[own]]
            short[own] = (a != b) & (np.hypot(x[a] - x[b], y[a] - y[b]) < _LEAST)
        if not short.any():
            return join
        a, b = join[tail[short]], join[head[short]]
        least = np.arange(len(x), dtype=np.int32)
        np.minimum.at(least, np.maximum(a, b), np.minimum(a, b))
        join = least[join]


def _class_order(highway: Texts) -> Ints:
    """Place of each street's class among the classes, from the highest down; unknown last."""
    place = {word: i for i, word in enumerate(CLASS_SPEED_KMH)}
    words = range(len(highway.offset) - 1)
    return np.array([place.get(highway.word(c), len(place)) for c in words])[highway.code]


def _drawn_once(half: Halves, order: Ints, nodes: int) -> tuple[Halves, int]:
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
    segments = _with_twins(half, nodes)
    if not len(segments):
        return half, 0
    halves = (2 * segments[:, None] + [0, 1]).ravel()
    key = half.tail[halves].astype(np.int64) * nodes + half.head[halves]
    rules = half.rule[halves]
    against = rules & AGAINST_ONE_WAY > 0
    worse = (2 * against + (rules & NO_ACCESS > 0)) * (order.max(initial=0) + 1)
    ranked = np.lexsort((worse + order[half.way[halves]], key))
    new = np.ones(len(key), bool)
    new[1:] = np.diff(key[ranked]) != 0
    best = np.empty(len(key), np.int64)
    best[ranked] = ranked[new][np.cumsum(new) - 1]
    repeats = ((best != np.arange(len(key))) & ~against).reshape(-1, 2).any(axis=1)
    for column in (half.way, half.forward, half.rule, half.place):
        column[halves] = column[halves][best]
    _, first = np.unique(np.minimum(key[0::2], key[1::2]), return_index=True)
    kept = np.ones(len(half.length), bool)
    kept[segments] = False
    kept[segments[first]] = True
    both = np.repeat(kept, 2)
    tail, head, way, forward, rule = (column[both] for column in half[:5])
    length, place = laid(half.length[kept]), laid(half.place[both])
    return Halves(tail, head, way, forward, rule, length, place, half.whole), int(repeats.sum())


def _with_twins(half: Halves, nodes: int) -> Ints:
    """The segments between two nodes that others join too, ascending."""
    a, b = half.tail[0::2], half.head[0::2]
    key = np.minimum(a, b).astype(np.int64)
    key *= nodes
    key += np.maximum(a, b)
    ranked = np.sort(key)
    twins = ranked[1:][ranked[1:] == ranked[:-1]]
    return np.flatnonzero(np.isin(key, twins)) if len(twins) else np.empty(0, np.int64)


def _true_length(plane: Plane, ax: Array, ay: Array, bx: Array, by: Array) -> Array:
    """Lengths on the ground: the plane's over its scale, by Simpson's rule."""
    scale = (
        1.0 / plane.scale(ax, ay)
        + 4.0 / plane.scale(0.5 * (ax + bx), 0.5 * (ay + by))
        + 1.0 / plane.scale(bx, by)
    )
    length: Array = np.hypot(bx - ax, by - ay) * scale / 6.0
    return length


def _chains(streets: Streets, half: Halves, nodes: int) -> tuple[Ints32, Ints32]:
    """Directed edges as lists of halves, from junction to junction."""
    out = np.argsort(half.tail, kind="stable").astype(np.int32)
    degree = np.bincount(half.tail, minlength=nodes)
    out_first = np.concatenate([[0], np.cumsum(degree)]).astype(np.int32)
    return chains(half.head, _cuts(streets, half, degree, out_first, out), out_first, out)


def _cuts(streets: Streets, half: Halves, degree: Ints, out_first: Ints32, out: Ints32) -> Bytes:
    """(N,) 1 for nodes at which edges end."""
    cut: Bytes = (degree != 2).astype(np.uint8)
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
    return cut


def _network(streets: Streets, plane: Plane, drawn: Drawn, dropped: dict[str, int]) -> Network:
    """Tables of the edges, their turns and what else a map holds."""
    way, rule = drawn.way, drawn.rule
    graph = Graph(
        drawn.from_node, drawn.to_node, drawn.opposite, drawn.heading_out, drawn.heading_in,
        streets.service[way], rule, drawn.length, drawn.first_way, drawn.last_way,
        drawn.first_forward, drawn.last_forward,
    )  # fmt: skip
    node_id = take(streets.node_id, drawn.places)
    turns = successors(graph, streets, node_id)
    edges = table(len(way), EDGE)
    for low in range(0, len(way), _AT_ONCE):
        own = slice(low, min(low + _AT_ONCE, len(way)))
        _fill(edges[own], drawn, streets, turns, own)
        edge_costs(edges[own], drawn.vertices)
        _turn_costs(edges[own], turns)
        release(drawn.vertices, edges, turns.table)
    roads = Roads(
        drawn.vertices, edges, turns.table, turns.predecessors, *drawn.grid,
        plane_record(plane.curvature, CELL_SIZE),
    )  # fmt: skip
    return Network(roads, plane, drawn.pieces, way, node_id, {**dropped, **turns.dropped})


def _turn_costs(edges: Records, turns: Turns) -> None:
    """The costs of the turns out of some edges."""
    begin, end = int(edges.first_turn[0]), int(edges.end_turn[-1])
    own = edges.copy()
    own.first_turn -= begin
    own.end_turn -= begin
    turn_costs(own, turns.table[begin:end])


def _fill(edges: Records, drawn: Drawn, streets: Streets, turns: Turns, own: slice) -> None:
    """The columns of some edges, without costs."""
    way, rule = drawn.way[own], drawn.rule[own]
    after = slice(own.start + 1, own.stop + 1)
    edges.length, edges.speed = drawn.length[own], drawn.length[own] / drawn.time[own]
    edges.first_vertex, edges.last_vertex = drawn.first[own], drawn.first[after] - 1
    edges.first_turn, edges.end_turn = turns.first[own], turns.first[after]
    edges.first_predecessor = turns.first_predecessor[own]
    edges.end_predecessor = turns.first_predecessor[after]
    edges.from_node, edges.to_node = drawn.from_node[own], drawn.to_node[own]
    edges.opposite = drawn.opposite[own]
    edges.lane = np.where(rule & AGAINST_ONE_WAY, 0.0, streets.lane[way])
    edges.lane_sigma = streets.lane_sigma[way]
    edges.rule, edges.service = rule, streets.service[way]


def plane_record(curvature: float, cell_size: float) -> Records:
    """The numbers of the plane and the grid, (1,) PLANE."""
    plane = records(1, PLANE)
    plane.curvature, plane.cell_size = curvature, cell_size
    return plane
