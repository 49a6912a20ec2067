"""Small maps made by hand, in the arrays that the kernels read."""

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from whichroad.core.hops import hops, turn_costs
from whichroad.core.network import AGAINST_ONE_WAY, U_TURN, Roads
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
    cells = build(x, y, first, CELL)
    prior = np.concatenate([w / w.sum() if len(w) else w for w in weight])
    lengths = np.array([row[-1] for row in s])
    speed = np.full(count, 13.9, np.float32)
    succ_first = np.cumsum([0] + [len(row) for row in succ]).astype(np.int32)
    return Roads(
        x=x,
        y=y,
        s=np.concatenate(s),
        first=first,
        length=lengths,
        from_node=np.array(begin, np.int32),
        to_node=np.array(end, np.int32),
        opposite=(np.arange(count) ^ 1).astype(np.int32),
        lane=np.full(count, LANE, np.float32),
        lane_spread=np.zeros(count, np.float32),
        speed=speed,
        service=np.zeros(count, np.uint8),
        rule=rule,
        succ_first=succ_first,
        succ=flat,
        succ_prior=prior.astype(np.float32),
        succ_turn=np.array([t for row in turn for t in row], np.float32),
        succ_rule=(rule[flat] | np.where(flat == origin ^ 1, U_TURN, 0)).astype(np.uint8),
        pred_first=np.cumsum([0] + [len(row) for row in pred]).astype(np.int32),
        pred=np.array([e for row in pred for e in row], np.int32),
        cell_size=CELL,
        cell_key=cells[0],
        cell_first=cells[1],
        cell_edge=cells[2],
        cell_vertex=cells[3],
        curvature=curvature,
        hop=hops(x, y, first, lengths, speed),
        succ_cost=turn_costs(succ_first, prior.astype(np.float32)),
    )


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
