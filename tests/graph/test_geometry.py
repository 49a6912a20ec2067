"""Angles; positions on an edge: the foot is the closest point, and points come back."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from scenes import network
from strategies import angles, bent_lines, seeds
from whichroad.graph.geometry import (
    angle_of,
    chord_heading,
    is_straight,
    locate,
    project,
    wrap,
)
from whichroad.graph.index import CANDIDATE, near, vertex_at
from whichroad.graph.network import Roads, records

just_beyond = math.nextafter(math.pi, 4.0)
just_below = math.nextafter(math.pi, 0.0)  # half a turn more rounds to a whole one


@given(angles)
@example(math.pi)
@example(-math.pi)
@example(just_beyond)
@example(-just_beyond)
@example(just_below)
@example(3.0 * math.pi)
@example(-1e-300)
def test_a_wrapped_angle_lies_in_the_half_open_turn_and_points_the_same_way(angle: float):
    wrapped = wrap(angle)
    assert -math.pi < wrapped <= math.pi
    assert (
        math.hypot(math.cos(wrapped) - math.cos(angle), math.sin(wrapped) - math.sin(angle)) < 1e-13
    )


@given(angles)
@example(math.pi)
@example(just_beyond)
@example(-just_beyond)
@example(just_below)
def test_wrapping_twice_is_wrapping_once(angle: float):
    assert wrap(wrap(angle)) == wrap(angle)


@given(st.floats(-3.0, 3.0), st.integers(-20, 20))
def test_whole_turns_do_not_matter(angle: float, turns: int):
    assert math.isclose(wrap(angle + turns * 2.0 * math.pi), angle, abs_tol=1e-13)


lengths = st.floats(-1e3, 1e3)


@given(lengths, lengths, st.floats(-0.2, 0.2))
@example(0.0, 0.0, 0.0)
@example(-1.0, 0.0, -0.0)
@example(1.0, 0.0, 0.1)
def test_the_angle_of_a_vector_is_its_arc_tangent_to_the_last_bits(x: float, y: float, tilt: float):
    assert abs(angle_of(x, y) - math.atan2(y, x)) <= 1e-15
    assert abs(angle_of(x, tilt * x) - math.atan2(tilt * x, x)) <= 1e-15


def closest(line: np.ndarray, p: np.ndarray) -> float:
    """Distance from a point to a polyline, segment by segment."""
    a, d = line[:-1], np.diff(line, axis=0)
    t = np.clip(((p - a) * d).sum(axis=1) / (d * d).sum(axis=1), 0.0, 1.0)
    return float(np.hypot(*(p - a - t[:, None] * d).T).min())


def near_abscissa(roads: Roads, p: np.ndarray) -> float:
    """Abscissa on edge 0 of the point that the grid finds closest."""
    found = records(4, CANDIDATE)
    n = near(roads, *p, 100.0, found)
    return float(found.s[:n][found.edge[:n] == 0][0])


def beside(roads: Roads, s: float, right: float) -> np.ndarray:
    """The point `right` metres right of abscissa s on edge 0."""
    _, x, y, tx, ty = locate(roads, 0, 0, s)
    return np.array([x + right * ty, y - right * tx])


@given(bent_lines(), st.floats(0.0, 1.0), st.floats(-30.0, 30.0))
def test_the_foot_from_the_right_segment_is_the_closest_point(line, part, right):
    roads = network([line])
    p = beside(roads, part * roads.edges.length[0], right)
    start = vertex_at(roads, 0, near_abscissa(roads, p))
    segment, s, _, _, _ = project(roads, 0, start, *p)
    _, x, y, _, _ = locate(roads, 0, segment, min(max(s, 0.0), roads.edges.length[0]))
    assert math.hypot(p[0] - x, p[1] - y) == pytest.approx(closest(line, p), abs=1e-7)


@given(bent_lines(), seeds, st.integers(-2, 12))
def test_the_foot_from_any_segment_is_not_farther_than_the_ends_of_that_segment(line, seed, start):
    roads = network([line])
    p = beside(
        roads, *np.random.default_rng(seed).uniform([0.0, -60.0], [roads.edges.length[0], 60.0])
    )
    segment, s, _, _, _ = project(roads, 0, start, *p)
    _, x, y, _, _ = locate(roads, 0, segment, s)
    first = min(max(start, 0), len(line) - 2)
    ends = np.hypot(*(line[first : first + 2] - p).T)
    assert math.hypot(p[0] - x, p[1] - y) <= ends.min() + 1e-9


@given(bent_lines(), st.floats(-40.0, 0.0), st.booleans())
def test_beyond_its_ends_an_edge_goes_on_straight(line, before, at_end):
    roads = network([line])
    s = roads.edges.length[0] - before if at_end else before
    _, x, y, tx, ty = locate(roads, 0, 0, s)
    a, b = (line[-2], line[-1]) if at_end else (line[1], line[0])
    out = (b - a) / math.hypot(*(b - a))
    np.testing.assert_allclose([x, y], b - before * out, atol=1e-9)
    _, back, across, _, _ = project(roads, 0, len(line) if at_end else 0, x, y)
    assert back == pytest.approx(s, abs=1e-7)
    assert across == pytest.approx(0.0, abs=1e-7)
    assert math.hypot(tx, ty) == pytest.approx(1.0)


@given(bent_lines(), st.floats(0.0, 1.0), st.floats(-3.0, 3.0))
def test_abscissa_and_offset_of_a_point_near_its_road_come_back(line, part, right):
    roads = network([line])
    steps = np.diff(roads.vertices.s[: len(line)])
    k = min(int(part * len(steps)), len(steps) - 1)
    s = roads.vertices.s[k] + 0.5 * steps[k]  # amid a segment: no bend is nearer
    if steps[k] < 12.0:
        return
    p = beside(roads, s, right)
    segment, back, across, _, _ = project(roads, 0, k, *p)
    assert segment == k
    assert back == pytest.approx(s, abs=1e-7)
    assert across == pytest.approx(right, abs=1e-7)


@given(bent_lines(), st.floats(0.0, 1.0))
def test_the_two_directions_of_a_street_are_one_line(line, part):
    roads = network([line])
    length = roads.edges.length[0]
    _, x, y, _, _ = locate(roads, 0, 0, part * length)
    _, u, v, _, _ = locate(roads, 1, len(line), length - part * length)
    assert math.hypot(x - u, y - v) < 1e-7
    forward = chord_heading(roads, 0, 0, part * length, 6.0)
    backward = chord_heading(roads, 1, len(line), length - part * length, 6.0)
    if math.hypot(*(line[-1] - line[0])) > 1.0:
        assert abs(wrap(forward - backward - math.pi)) < 1e-6


@given(bent_lines(), st.floats(0.0, 1.0))
def test_points_drawn_in_straight_pieces_move_neither_chord_nor_foot(line, part):
    """Re-digitising: a vertex more on every segment."""
    fine = np.insert(line, np.arange(1, len(line)), 0.3 * line[:-1] + 0.7 * line[1:], axis=0)
    coarse, finer = network([line]), network([fine])
    s = part * coarse.edges.length[0]
    a, b = chord_heading(coarse, 0, 0, s, 6.0), chord_heading(finer, 0, 0, s, 6.0)
    assert abs(wrap(a - b)) < 1e-6
    p = beside(coarse, s, 1.0)
    k = vertex_at(coarse, 0, s)
    foot = project(coarse, 0, k, *p)
    finer_foot = project(finer, 0, vertex_at(finer, 0, s), *p)
    assert foot[1] == pytest.approx(finer_foot[1], abs=1e-6)


@given(bent_lines())
def test_an_edge_of_one_segment_is_straight(line):
    assert is_straight(network([line]), 0) == (len(line) == 2)
