"""Chains of straight pieces as edges: vertices, lengths, headings, streets, the grid.

Edges are laid out some at a time, and their tables are on disk.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..graph.network import VERTEX
from ..observations import Array
from .cells import Grid
from .chains import end_headings
from .shelf import joined, release, table
from .streets import Bytes, Ints, Streets

Ints32 = NDArray[np.int32]

BLOCK = 1 << 18  # halves, edges or nodes that are worked on at once
_CHORD = 8.0  # m over which headings at a node are taken


class Pieces(NamedTuple):
    """Which street lies where along each edge.  P pieces."""

    first: Ints32  # (E+1,)
    way: Ints32  # (P,) street
    forward: Bytes  # (P,) 1 where it is driven as it was drawn
    start: Array  # (P,) along-track position at which it begins, true m
    offset: Array  # (P,) position there along the source as it was drawn, m
    whole: Array  # (P,) length of the source, m


class Halves(NamedTuple):
    """Both directions of every straight segment: half 2i along its first street, 2i + 1 back."""

    tail: Ints32  # (2M,) node
    head: Ints32
    way: Ints32  # street; of both directions the same, but where streets share the segment
    forward: Bytes  # 1 where it runs as its street was drawn
    rule: Bytes
    length: Array  # (M,) true m
    place: Array  # (2M,) m along the source at which it begins
    whole: Array  # (W,) m, lengths of the sources of streets


class Drawn(NamedTuple):
    """Directed edges without their turns.  E edges, V vertices, J junctions."""

    places: Ints32  # (J,) nodes of the junctions
    from_node: Ints32  # (E,) junction
    to_node: Ints32
    opposite: Ints32
    first: Ints32  # (E+1,) first vertex
    vertices: Records  # (V,)
    grid: tuple[Ints, Ints32, Records]
    pieces: Pieces
    way: Ints32  # (E,) street of the longest piece
    length: Array  # true m
    time: Array  # s
    heading_out: Array  # rad, away from the start
    heading_in: Array  # rad, into the end
    rule: Bytes
    first_way: Ints32  # street on which the edge begins
    last_way: Ints32
    first_forward: Bytes
    last_forward: Bytes


def lay_out(
    streets: Streets, x: Array, y: Array, half: Halves, chain_first: Ints32, chain: Ints32,
    cell_size: float,
) -> Drawn:  # fmt: skip
    """Lay chains out as edges.

    Args:
        streets: For their speeds.
        x: (N,) m, nodes in the plane.
        y: (N,)
        half: Straight pieces in both directions.
        chain_first: (E+1,) first place of each edge in `chain`.
        chain: (2M,) halves in driving order.
        cell_size: Of the grid, plane m.
    """
    begin, end = chain[chain_first[:-1]], chain[chain_first[1:] - 1]
    joints = _joints(half, begin, end, len(chain), len(x))
    # each edge has one vertex more than halves
    first = (chain_first + np.arange(len(chain_first))).astype(np.int32)
    vertices = table(int(first[-1]), VERTEX)
    way = np.empty(len(begin), np.int32)
    length, time, out, into = (np.empty(len(begin)) for _ in range(4))
    grid, parts = Grid(cell_size), _PieceParts()
    for low, high in _blocks(chain_first):
        own = chain[chain_first[low] : chain_first[high]]
        begins = chain_first[low : high + 1] - chain_first[low]
        v = vertices[first[low] : first[high]]
        at, node, s = _shape(half, begins, own)
        v.x, v.y, v.s = x[node], y[node], s
        pieces = _pieces(half, own, begins, s[~_last(at)])
        edges = slice(low, high)
        length[edges] = s[at[1:] - 1]
        way[edges] = _longest(pieces, length[edges])
        seconds = half.length[own >> 1] / streets.speed[half.way[own]]
        time[edges] = np.add.reduceat(seconds, begins[:-1])
        out[edges], into[edges] = end_headings(v.x, v.y, s, at, _CHORD)
        grid.add(v.x, v.y, at, low, int(first[low]))
        parts.add(pieces)
        release(vertices, x, y, half.length, half.place)
    return Drawn(
        *joints, first, vertices, grid.done(), parts.done(), way, length, time, out, into,
        half.rule[begin], half.way[begin], half.way[end], half.forward[begin], half.forward[end],
    )  # fmt: skip


def _joints(
    half: Halves, begin: Ints32, end: Ints32, halves: int, nodes: int
) -> tuple[Ints32, Ints32, Ints32, Ints32]:
    """Nodes of the junctions; of each edge its first and last junction and its opposite."""
    starting = np.empty(halves, np.int32)
    starting[begin] = np.arange(len(begin), dtype=np.int32)
    opposite = starting[end ^ 1]  # it begins with the last half, driven back
    del starting
    places = np.unique(np.concatenate([half.tail[begin], half.head[end]]))
    number = np.empty(nodes, np.int32)
    number[places] = np.arange(len(places), dtype=np.int32)
    return places, number[half.tail[begin]], number[half.head[end]], opposite


def _blocks(first: Ints32) -> list[tuple[int, int]]:
    """Consecutive chains with about `BLOCK` halves together: the first, and that behind."""
    bounds = np.searchsorted(first, np.arange(0, first[-1], BLOCK))
    bounds = np.unique(np.append(bounds, len(first) - 1))
    return list(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True))


class _PieceParts:
    """Pieces of consecutive edges."""

    def __init__(self) -> None:
        self._count = [np.zeros(1, np.int32)]  # of each edge
        self._parts: list[list[NDArray[Any]]] = [[], [], [], [], []]

    def add(self, pieces: Pieces) -> None:
        """Those of the next edges."""
        self._count.append(np.diff(pieces.first))
        columns: tuple[NDArray[Any], ...] = (
            pieces.way,
            pieces.forward,
            pieces.start,
            pieces.offset,
            pieces.whole,
        )
        for part, column in zip(self._parts, columns, strict=True):
            part.append(column)

    def done(self) -> Pieces:
        """All of them."""
        first = np.cumsum(np.concatenate(self._count), dtype=np.int32)
        return Pieces(first, *map(joined, self._parts))


def _shape(half: Halves, chain_first: Ints32, chain: Ints32) -> tuple[Ints32, Ints32, Array]:
    """First vertices of the edges, the nodes that are their vertices, their positions along.

    Each edge has one vertex more than halves: their heads, after the tail of the first.
    """
    first = (chain_first + np.arange(len(chain_first))).astype(np.int32)
    rest = np.ones(first[-1], bool)
    rest[first[:-1]] = False
    node = np.empty(first[-1], np.int32)
    node[~rest], node[rest] = half.tail[chain[chain_first[:-1]]], half.head[chain]
    total = np.concatenate([[0.0], np.cumsum(half.length[chain >> 1])])
    s = np.zeros(first[-1])
    s[rest] = total[1:] - np.repeat(total[chain_first[:-1]], np.diff(chain_first))
    return first, node, s


def _last(first: Ints32) -> NDArray[np.bool_]:
    """Which vertices are the last of their edge."""
    last = np.zeros(first[-1], bool)
    last[first[1:] - 1] = True
    return last


def _pieces(half: Halves, chain: Ints32, chain_first: Ints32, start: Array) -> Pieces:
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
