"""The most probable route as a connected list of edges with times."""

from itertools import pairwise

import numpy as np
import pytest

from scenes import drive_along, epochs_of, gnss, grid_town, localize, network
from whichroad._compile import Record, Records
from whichroad.filter.state import CLOCK, DISTANCE, OFF_ROAD, WHEELS
from whichroad.graph.network import Roads
from whichroad.lookback.traversals import traversals
from whichroad.recorded import Recorded

ROADS = network(grid_town())
NODES = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (3, 2), (4, 2), (4, 3), (4, 4)]
CORNERS = np.array([(i * 120 + 10 * np.sin(j), j * 120 + 8 * np.cos(i)) for i, j in NODES])
TRUTH = drive_along(CORNERS)


def true_edges() -> list[int]:
    """The edge between each two corners."""
    found = []
    for a, b in pairwise(CORNERS):
        places = (ROADS.vertices[v] for v in (ROADS.edges.first_vertex, ROADS.edges.last_vertex))
        ends = np.column_stack([column for v in places for column in (v.x, v.y)])
        found.append(int(np.abs(ends - [*a, *b]).sum(axis=1).argmin()))
    return found


def rows_of(epochs: Records, recorded: Recorded, roads: Roads) -> list[Record]:
    return list(traversals(epochs, recorded.output, recorded.chain, roads))


def driven(mode: int = WHEELS, seed: int = 0) -> list[Record]:
    fix = gnss(TRUTH, seed=seed)
    epochs = epochs_of(TRUTH, fix, np.arange(0, len(TRUTH.time), 10), course=0.1)
    return rows_of(epochs, localize(ROADS, epochs, mode=mode), ROADS)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@pytest.mark.parametrize("seed", range(3))
def test_the_route_is_what_was_driven(mode: int, seed: int):
    assert [r.edge for r in driven(mode, seed)] == true_edges()


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@pytest.mark.parametrize("seed", range(3))
def test_each_edge_follows_from_the_one_before_without_a_gap_in_space_or_time(mode, seed):
    rows = driven(mode, seed)
    assert not any(r.gap for r in rows)
    for a, b in pairwise(rows):
        edge = ROADS.edges[a.edge]
        assert edge.to_node == ROADS.edges.from_node[b.edge]
        assert b.edge in ROADS.turns.edge[edge.first_turn : edge.end_turn]
        assert a.exit_time == b.enter_time
        assert a.exit_m == edge.length
        assert b.enter_m == 0.0
    assert all(r.enter_time <= r.exit_time and r.enter_m <= r.exit_m for r in rows)


@pytest.mark.parametrize("seed", range(3))
def test_the_lengths_add_up_to_the_way_driven(seed: int):
    """Along the lines, less the 5 m left out at either end, which fixes of 3 m tell to 3 sigma."""
    total = sum(r.exit_m - r.enter_m for r in driven(seed=seed))
    lines = np.hypot(*np.diff(CORNERS, axis=0).T).sum()
    assert total == pytest.approx(lines - 10.0, abs=3.0 * np.hypot(3.0, 3.0))


@pytest.mark.parametrize("seed", range(3))
def test_nodes_are_passed_when_the_vehicle_passes_them(seed: int):
    """Position errors of 3 m, to three sigma, are 0.9 s at 10 m/s."""
    rows = driven(seed=seed)
    for r, node in zip(rows[1:], CORNERS[1:-1], strict=True):
        nearest = np.hypot(TRUTH.x - node[0], TRUTH.y - node[1]).argmin()
        assert r.enter_time == pytest.approx(TRUTH.time[nearest], abs=0.9)


def test_probabilities_of_edges_are_those_said_while_they_were_driven():
    for r in driven():
        assert 0.5 < r.p <= 1.0


def test_edges_between_fixes_far_apart_are_as_probable_as_the_route_around_them():
    time = np.arange(0, len(TRUTH.time), 200)
    epochs = epochs_of(TRUTH, gnss(TRUTH, seed=1), time)[time]
    found = localize(ROADS, epochs, mode=CLOCK)
    rows = rows_of(epochs, found, ROADS)
    said = set(found.output.rows.edge.tolist())
    between = [r for r in rows if r.edge not in said]
    assert len(between) > 1
    first, *others = between  # of which the first fix did not know the direction
    assert 0.1 < first.p < 0.6
    assert all(0.9 < r.p <= 1.0 for r in others)


def test_a_route_across_unmapped_ground_says_that_it_has_a_gap():
    """Two streets that do not meet, and a drive from one to the other over a field."""
    roads = network([[[0.0, 0.0], [400.0, 0.0]], [[400.0, 250.0], [900.0, 250.0]]])
    truth = drive_along([[50.0, -1.75], [370.0, -1.75], [560.0, 248.25], [850.0, 248.25]])
    epochs = epochs_of(truth, gnss(truth), np.arange(0, len(truth.time), 10), course=0.1)
    recorded = localize(roads, epochs)
    assert OFF_ROAD in recorded.chain.edge
    rows = rows_of(epochs, recorded, roads)
    assert [r.edge for r in rows] == [0, 2]
    assert [r.gap for r in rows] == [False, True]
    assert rows[0].exit_m < 400.0
    assert rows[1].enter_m > 50.0
    assert rows[0].exit_time <= rows[1].enter_time


def test_nothing_localized_is_no_route():
    epochs = epochs_of(TRUTH, gnss(TRUTH), np.arange(0, 10, 10))
    epochs.fix[:, 0] += 9e3
    assert rows_of(epochs, localize(ROADS, epochs), ROADS) == []
