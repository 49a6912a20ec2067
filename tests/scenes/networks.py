"""Small maps made by hand, in the tables that the kernels read."""

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from whichroad.graph.network import (
    AGAINST_ONE_WAY,
    EDGE,
    PLANE,
    TURN,
    U_TURN,
    VERTEX,
    Roads,
    records,
)
from whichroad.graph.route_costs import edge_costs, turn_costs
from whichroad.roadmap.cells import build

Line = NDArray[np.float64]

LANE = 1.75  # m right of the centre line
CELL = 64.0  # m


def _weight(turn: float, u_turn: bool) -> float:
    if u_turn:
        return 0.01
    size = abs(turn)
    return 1.0 if size < np.radians(34.0) else 0.5 if size < np.radians(120.0) else 0.1


def _heading(a: Line, b: Line) -> float:
    return float(np.arctan2(b[1] - a[1], b[0] - a[0]))


def _abscissae(line: Line, curvature: float) -> Line:
    """True metres from the line's start to each vertex."""
    middle = 0.5 * (line[1:] + line[:-1])
    scale = 1.0 + curvature * (middle**2).sum(axis=1)
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T) / scale)])


def _numbered(lines: Sequence[Line]) -> tuple[list[int], list[int]]:
    """Nodes at which lines begin and end; ends within a millimetre are one node."""
    number: dict[tuple[float, float], int] = {}
    ends = [
        [number.setdefault(tuple(np.round(line[k], 3).tolist()), len(number)) for line in lines]
        for k in (0, -1)
    ]
    return ends[0], ends[1]


def network(
    streets: Sequence[ArrayLike], *, one_way: Collection[int] = (), curvature: float = 0.0
) -> Roads:
    """Streets as directed edges: street i is edge 2i as drawn and edge 2i + 1 backwards.

    Args:
        streets: Polylines (n, 2), plane m; those whose ends meet are joined.
        one_way: Streets that may not be driven backwards.
        curvature: Of the plane's scale, 1/m².
    """
    lines = [np.asarray(s, float)[::step] for s in streets for step in (1, -1)]
    count = len(lines)
    begin, end = _numbered(lines)
    s = [_abscissae(line, curvature) for line in lines]
    first = np.cumsum([0] + [len(line) for line in lines]).astype(np.int32)
    x, y = np.ascontiguousarray(np.vstack(lines).T)
    rule = np.zeros(count, np.uint8)
    rule[[2 * i + 1 for i in one_way]] = AGAINST_ONE_WAY
    succ = [[f for f in range(count) if begin[f] == end[e]] for e in range(count)]
    pred = [[e for e in range(count) if end[e] == begin[f]] for f in range(count)]
    turn = [
        [_heading(*lines[f][:2]) - _heading(*lines[e][-2:]) for f in succ[e]] for e in range(count)
    ]
    turn = [[(t + np.pi) % (2 * np.pi) - np.pi for t in row] for row in turn]
    weight = [
        np.array(
            [
                _weight(t, f == e ^ 1) * (2e-4 if rule[f] else 1.0)
                for f, t in zip(succ[e], turn[e], strict=True)
            ]
        )
        for e in range(count)
    ]
    flat = np.array([f for row in succ for f in row], np.int32)
    origin = np.repeat(np.arange(count), [len(row) for row in succ])
    vertices = records(len(x), VERTEX)
    vertices.x, vertices.y, vertices.s = x, y, np.concatenate(s)
    turns = records(len(flat), TURN)
    turns.edge = flat
    turns.prior = np.concatenate([w / w.sum() if len(w) else w for w in weight])
    turns.angle = [t for row in turn for t in row]
    turns.rule = rule[flat] | np.where(flat == origin ^ 1, U_TURN, 0)
    edges = records(count, EDGE)
    edges.length, edges.speed = [row[-1] for row in s], 13.9
    edges.first_vertex, edges.last_vertex = first[:-1], first[1:] - 1
    edges.first_turn, edges.end_turn = _ranges(succ)
    edges.first_predecessor, edges.end_predecessor = _ranges(pred)
    edges.from_node, edges.to_node, edges.opposite = begin, end, np.arange(count) ^ 1
    edges.lane, edges.rule = LANE, rule
    edge_costs(edges, vertices)
    turn_costs(edges, turns)
    plane = records(1, PLANE)
    plane.cell_size, plane.curvature = CELL, curvature
    predecessors = np.array([e for row in pred for e in row], np.int32)
    return Roads(vertices, edges, turns, predecessors, *build(x, y, first, CELL), plane)


def _ranges(rows: Sequence[Sequence[int]]) -> tuple[Line, Line]:
    """Where each of some lists begins and ends when they lie one behind the other."""
    ends = np.cumsum([0] + [len(row) for row in rows])
    return ends[:-1], ends[1:]


def straight_road(length: float = 4000.0, pieces: int = 1) -> list[Line]:
    """One straight street along x, drawn in equal segments."""
    return [np.column_stack([np.linspace(0.0, length, pieces + 1), np.zeros(pieces + 1)])]


def parallel_roads(gap: float, length: float = 2000.0) -> list[Line]:
    """Two straight streets along x, the second one `gap` metres to the left."""
    return [np.array([[0.0, y], [length, y]]) for y in (0.0, gap)]


def grid_town(columns: int = 5, rows: int = 5, spacing: float = 120.0) -> list[Line]:
    """A slightly crooked grid: eastward streets row by row, then northward ones."""

    def place(i: int, j: int) -> tuple[float, float]:
        return i * spacing + 10.0 * np.sin(j), j * spacing + 8.0 * np.cos(i)

    east = [(place(i, j), place(i + 1, j)) for j in range(rows) for i in range(columns - 1)]
    north = [(place(i, j), place(i, j + 1)) for j in range(rows - 1) for i in range(columns)]
    return [np.array(line) for line in east + north]
