"""Hand-made maps: a jittered grid of two-way streets."""

from typing import NamedTuple

import numpy as np
import pytest

from whichroad.geodesy.plane import Plane
from whichroad.graph.network import EDGE, PLANE, SEGMENT, TURN, VERTEX, Roads, records


class HandMade(NamedTuple):
    """What the simulator asks of a map."""

    arrays: Roads
    plane: Plane


def roads_from_streets(nodes: np.ndarray, streets: list[tuple[int, int]]) -> Roads:
    """Two-way straight streets between nodes (n, 2), each with two extra vertices."""
    pairs = [p for a, b in streets for p in ((a, b), (b, a))]
    x, y, s, first, length = [], [], [], [0], []
    for a, b in pairs:
        f = np.array([0.0, 0.3, 0.7, 1.0])
        line = nodes[a] + f[:, None] * (nodes[b] - nodes[a])
        size = float(np.hypot(*(nodes[b] - nodes[a])))
        x.extend(line[:, 0])
        y.extend(line[:, 1])
        s.extend(f * size)
        length.append(size)
        first.append(len(x))
    opposite = np.arange(len(pairs)) ^ 1
    succ, prior, turn, succ_first = [], [], [], [0]
    for e, (a, b) in enumerate(pairs):
        here = np.arctan2(*(nodes[b] - nodes[a])[::-1])
        out = [k for k, (c, _) in enumerate(pairs) if c == b]
        w = []
        for k in out:
            c, d = pairs[k]
            bend = np.arctan2(*(nodes[d] - nodes[c])[::-1]) - here
            bend = (bend + np.pi) % (2 * np.pi) - np.pi
            turn.append(bend)
            w.append(0.01 if k == opposite[e] else 1.0 if abs(bend) < 0.6 else 0.5)
        succ.extend(out)
        prior.extend(np.array(w) / sum(w))
        succ_first.append(len(succ))
    vertices = records(len(x), VERTEX)
    vertices.x, vertices.y, vertices.s = x, y, s
    turns = records(len(succ), TURN)
    turns.edge, turns.prior, turns.angle = succ, prior, turn
    edges = records(len(pairs), EDGE)
    edges.length, edges.speed, edges.lane = length, 12.5, 1.75
    edges.first_vertex, edges.last_vertex = first[:-1], np.array(first[1:]) - 1
    edges.first_turn, edges.end_turn = succ_first[:-1], succ_first[1:]
    edges.from_node, edges.to_node = np.array(pairs).T
    edges.opposite = opposite
    plane = records(1, PLANE)
    plane.cell_size, plane.curvature = 50.0, 6.1e-15
    nothing = np.zeros(0, np.int32)
    return Roads(
        vertices, edges, turns, nothing, np.zeros(0, np.int64), np.zeros(1, np.int32),
        records(0, SEGMENT), plane,
    )  # fmt: skip


def grid_roads(rows: int = 6, columns: int = 6, spacing: float = 180.0) -> Roads:
    """A grid whose crossings are moved about by up to 15 m."""
    random = np.random.default_rng(5)
    place = np.array([(c, r) for r in range(rows) for c in range(columns)], dtype=float)
    nodes = place * spacing + random.uniform(-15, 15, (len(place), 2))
    east = [(k, k + 1) for k in range(len(place)) if (k + 1) % columns]
    north = [(k, k + columns) for k in range(len(place) - columns)]
    return roads_from_streets(nodes, east + north)


@pytest.fixture(scope="session")
def hand_made() -> HandMade:
    return HandMade(grid_roads(), Plane(49.41, 2.82))


@pytest.fixture(scope="session")
def one_street() -> HandMade:
    street = roads_from_streets(np.array([[0.0, 0.0], [800.0, 0.0]]), [(0, 1)])
    return HandMade(street, Plane(49.41, 2.82))
