"""Where a road just runs on."""

import math

import numpy as np
import pytest

from scenes import network
from whichroad.graph.network import backwards, is_at_node, onwards

AHEAD, BACK = 0, 1  # directed edges of the first line


def lines(bend: float, *more: list[list[float]]) -> list[list[list[float]]]:
    """A road of 100 m, and one of 100 m on from its end, turned by `bend` (rad)."""
    end = [100.0 + 100.0 * math.cos(bend), 100.0 * math.sin(bend)]
    return [[[0.0, 0.0], [100.0, 0.0]], [[100.0, 0.0], end], *more]


@pytest.mark.parametrize(("bend", "runs"), [(0.0, True), (0.05, True), (-0.05, True), (0.2, False)])
def test_a_road_runs_on_where_it_is_hardly_bent(bend: float, runs: bool):
    roads = network(lines(bend))
    assert (onwards(roads, 0), backwards(roads, 2)) == ((2, 0) if runs else (-1, -1))
    assert (onwards(roads, 3), backwards(roads, 1)) == ((1, 3) if runs else (-1, -1))
    for edge, s in ((0, 95.0), (2, 5.0), (3, 95.0), (1, 5.0)):
        assert is_at_node(roads, edge, s, 12.0) != runs


def test_no_road_runs_on_at_a_crossing_or_a_dead_end():
    roads = network(lines(0.0, [[100.0, 0.0], [100.0, 30.0]]))
    assert onwards(roads, 0) == backwards(roads, 2) == -1
    assert onwards(roads, 2) == -1  # nothing follows
    assert is_at_node(roads, 0, 95.0, 12.0)
    assert is_at_node(roads, 2, 95.0, 12.0)


@pytest.mark.parametrize("edge", [0, 2])
def test_half_way_along_a_road_there_is_no_node(edge: int):
    roads = network(lines(0.0))
    assert not any(is_at_node(roads, edge, s, 12.0) for s in np.linspace(13.0, 87.0, 9))


def test_where_two_roads_merge_neither_just_runs_on():
    """One way in, two arms."""
    roads = network(lines(0.0, [[0.0, -20.0], [100.0, 0.0]]))
    assert onwards(roads, 0) == -1
    assert backwards(roads, 2) == -1
