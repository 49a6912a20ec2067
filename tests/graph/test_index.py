"""The spatial index against the obvious loop over everything."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.graph import index
from whichroad.graph.index import CANDIDATE
from whichroad.graph.network import EDGE, PLANE, TURN, VERTEX, Roads, records
from whichroad.roadmap.cells import build


def network(lines, size=10.0, curvature=0.0):
    """Roads of some polylines, without topology."""
    vertices, edges = records(sum(map(len, lines)), VERTEX), records(len(lines), EDGE)
    vertices.x, vertices.y = np.array([p for line in lines for p in line], dtype=float).T
    vertices.s = np.concatenate(
        [np.cumsum([0, *(math.dist(a, b) for a, b in itertools.pairwise(p))]) for p in lines]
    )
    first = np.cumsum([0, *map(len, lines)]).astype(np.int32)
    edges.first_vertex, edges.last_vertex = first[:-1], first[1:] - 1
    edges.length, edges.speed = vertices.s[first[1:] - 1], 1.0
    plane = records(1, PLANE)
    plane.cell_size, plane.curvature = size, curvature
    grid = build(vertices.x.copy(), vertices.y.copy(), first, size)
    return Roads(vertices, edges, records(0, TURN), np.empty(0, np.int32), *grid, plane)


def near(roads, x, y, radius, room=500):
    found = records(room, CANDIDATE)
    n = index.near(roads, x, y, radius, found)
    return found[:n][["edge", "s", "lateral", "distance"]].tolist()


def line_of(roads, edge):
    """Vertices of an edge, (n, 2)."""
    at = slice(roads.edges.first_vertex[edge], roads.edges.last_vertex[edge] + 1)
    return np.column_stack([roads.vertices.x[at], roads.vertices.y[at]])


def closest(roads, edge, x, y):
    """Plane distance to an edge."""
    best = math.inf
    for a, b in itertools.pairwise(line_of(roads, edge)):
        along = b - a
        t = min(max(np.dot([x, y] - a, along) / np.dot(along, along), 0.0), 1.0)
        best = min(best, math.dist((x, y), a + t * along))
    return best


points = st.tuples(st.integers(-60, 60), st.integers(-60, 60))
polylines = st.lists(points, min_size=2, max_size=6).map(
    lambda p: [a for a, b in zip(p, [None, *p], strict=False) if a != b]
)
networks = st.lists(polylines.filter(lambda p: len(p) > 1), min_size=1, max_size=12)


@given(
    networks, st.floats(-90, 90), st.floats(-90, 90), st.floats(0, 150),
    st.sampled_from([3.0, 10.0, 64.0]), st.sampled_from([0.0, 1e-5]),
)  # fmt: skip
def test_the_grid_finds_what_a_loop_over_everything_finds(lines, x, y, radius, size, curvature):
    roads = network(lines, size, curvature)
    scale = 1 + curvature * (x * x + y * y)
    found = {
        edge: (s, lateral, distance) for edge, s, lateral, distance in near(roads, x, y, radius)
    }
    for edge in range(len(lines)):
        expected = closest(roads, edge, x, y)
        if edge not in found:
            assert expected / scale > radius - 1e-6
            continue
        s, lateral, distance = found[edge]
        assert distance == pytest.approx(expected / scale, abs=1e-6)
        assert distance <= radius * (1 + 1e-12)
        assert abs(lateral) == distance
        assert math.dist(position(roads, edge, s), (x, y)) == pytest.approx(expected, abs=1e-6)


def position(roads, edge, s):
    low, high = roads.edges.first_vertex[edge], roads.edges.last_vertex[edge] + 1
    return [np.interp(s, roads.vertices.s[low:high], c) for c in line_of(roads, edge).T]


@given(networks, points, st.integers(0, 20))
def test_too_little_room_keeps_the_closest_in_order(lines, point, room):
    roads = network(lines)
    everything = near(roads, *map(float, point), 200.0)
    assert everything == sorted(everything, key=lambda f: (f[3], f[0]))
    assert len(everything) == len({f[0] for f in everything})
    assert near(roads, *map(float, point), 200.0, room) == everything[:room]


@given(
    networks, points, st.integers(1, 6), st.floats(0, 90), st.floats(0, 40),
    st.sampled_from([3.0, 10.0, 64.0]), st.sampled_from([0.0, 1e-5]),
)  # fmt: skip
def test_the_closest_few_are_the_first_of_all(lines, point, most, radius, farther, size, curvature):
    roads = network(lines, size, curvature)
    x, y = map(float, point)
    everything, few = records(500, CANDIDATE), records(most, CANDIDATE)
    expected = everything[: min(index.closest(roads, x, y, radius, everything), most)]
    if len(expected):
        expected = expected[expected.distance <= expected.distance[0] + farther]
    found = few[: index.closest_few(roads, x, y, radius, farther, few)]
    for name in ("edge", "s", "distance"):
        assert found[name].tolist() == expected[name].tolist()


@given(networks, points, st.integers(-500, 500), st.integers(-500, 500))
def test_shifting_the_world_shifts_nothing_but_the_world(lines, point, dx, dy):
    roads = network(lines)
    moved = network([[(x + dx, y + dy) for x, y in line] for line in lines])
    x, y = map(float, point)
    assert near(roads, x, y, 50.0) == near(moved, x + dx, y + dy, 50.0)


@given(networks, points)
def test_driving_the_other_way_swaps_the_sides(lines, point):
    x, y = map(float, point)
    there = {f[0]: f for f in near(network(lines), x, y, 100.0)}
    back = {f[0]: f for f in near(network([line[::-1] for line in lines]), x, y, 100.0)}
    assert there.keys() == back.keys()
    for edge, (_, _, lateral, distance) in there.items():
        assert back[edge][3] == pytest.approx(distance, abs=1e-9)
        if roundoff_free(lines[edge], x, y):
            assert back[edge][2] == pytest.approx(-lateral, abs=1e-9)


def roundoff_free(line, x, y):
    """Whether the point lies clearly on one side of a straight line."""
    if len(line) > 2:
        return False
    (ax, ay), (bx, by) = line
    return (bx - ax) * (y - ay) != (by - ay) * (x - ax)


def test_the_radius_is_inclusive():
    roads = network([[(0, 0), (100, 0)]], 64.0)
    assert [f[3] for f in near(roads, 50.0, 30.0, 30.0)] == [30.0]
    assert near(roads, 50.0, 30.0, math.nextafter(30.0, 0)) == []
    assert [f[3] for f in near(roads, -3.0, 4.0, 5.0)] == [5.0]
    assert [f[3] for f in near(roads, 64.0, 0.0, 0.0)] == [0.0]


def test_a_point_beyond_an_end_is_measured_from_that_end():
    roads = network([[(0, 0), (10, 0)]])
    [(_, s, lateral, distance)] = near(roads, -3.0, 4.0, 20.0)
    assert (s, lateral, distance) == (0.0, -5.0, 5.0)
    [(_, s, lateral, distance)] = near(roads, 13.0, -4.0, 20.0)
    assert (s, lateral, distance) == (10.0, 5.0, 5.0)


def test_right_is_positive():
    roads = network([[(0, 0), (0, 10)]])
    assert near(roads, 2.0, 5.0, 20.0)[0][2] == 2.0
    assert near(roads, -2.0, 5.0, 20.0)[0][2] == -2.0


def test_outside_a_sharp_bend_the_side_is_that_of_the_bend():
    # the second piece turns back on the left: everything beyond the tip is on the right
    roads = network([[(0, 0), (10, 0), (0, 2)]])
    for dx, dy in [(1.0, 0.3), (1.0, 0.0), (1.0, -0.3), (0.1, 0.4)]:
        [(_, s, lateral, _)] = near(roads, 10.0 + dx, dy, 20.0)
        assert s == 10.0
        assert lateral > 0


def test_distances_are_true_metres():
    roads = network([[(1000, 0), (1000, 500)]], curvature=1e-7)
    [(_, _, lateral, distance)] = near(roads, 1010.0, 250.0, 20.0)
    assert distance == pytest.approx(10 / (1 + 1e-7 * (1010.0**2 + 250.0**2)), rel=1e-12)
    assert lateral == distance


@pytest.mark.parametrize("point", [(1e12, 0.0), (-1e300, 1e300), (5e6, -5e6)])
def test_far_from_the_map_there_is_nothing(point):
    roads = network([[(0, 0), (10, 0)]])
    assert near(roads, *point, 30.0) == []


def test_a_radius_beyond_the_map_finds_everything():
    roads = network([[(0, 0), (10, 0)], [(0, 50), (10, 50)]])
    assert [f[0] for f in near(roads, 0.0, 0.0, 1e9)] == [0, 1]
    assert near(roads, 0.0, 0.0, -1.0) == []
    assert near(roads, 0.0, 0.0, math.nan) == []


def test_a_long_segment_is_found_all_along():
    roads = network([[(-1e5, -3.3e4), (1e5, 3.3e4)]], 64.0)
    for t in np.linspace(0, 1, 200):
        x, y = -1e5 + 2e5 * t, -3.3e4 + 6.6e4 * t
        assert len(near(roads, x, y, 1e-3)) == 1


def test_keys_of_cells_grow_with_the_column_and_fit_into_64_bits():
    """Plain Python has no limit: its keys are those of the compiled kernels only within it."""
    far = 2**31 - 1
    cells = [(c, r) for c in (-far, -309, -1, 0, 1, 309, far) for r in (-far, -57, 0, 57, far)]
    keys = [index.cell_key(c, r) for c, r in cells]
    assert keys == sorted(set(keys))
    assert keys[0] >= -(2**63)
    assert keys[-1] < 2**63
