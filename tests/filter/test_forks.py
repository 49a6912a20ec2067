"""Roads that fork off: drawn from the middle of the road that is left, driven from its lane."""

import math

import numpy as np
import pytest

from scenes import On, belief_on, drive_along, epochs_of, gnss, localize, network
from whichroad.filter.hypotheses.lane_offset import kept_lane
from whichroad.filter.road import leaves_late
from whichroad.filter.state import H
from whichroad.graph.network import Roads

# an exit of a motorway: drawn at 18 degrees for 20 m, then almost beside it
MOTORWAY, EXIT = 2, 4
AT = 300.0  # m, of the node
ROADS = network(
    [
        [[0.0, 0.0], [AT, 0.0]],
        [[AT, 0.0], [AT + 83.0, -3.1], [AT + 400.0, -24.0]],
        [[AT, 0.0], [AT + 19.0, -6.0], [AT + 30.0, -7.3], [AT + 400.0, -49.0]],
    ],
    one_way=(0, 1, 2),
)


OWN = math.atan2(-6.0, 19.0)  # of the exit's first metres, rad


def late(roads: Roads, before: int, edge: int, s: float, heading: float) -> bool:
    """Whether a vehicle of some heading (rad) drives as the road before."""
    belief = belief_on(roads, [On(edge, s, sigma=1.0)])
    hyp = belief.hyp[0]
    hyp.edge, hyp.before, hyp.along, hyp["mu"][H] = edge, before, s, heading
    hyp.segment = roads.edges[edge].first_vertex
    found, value = leaves_late(roads, hyp, OWN)
    assert not found or value == pytest.approx(0.0)  # eastwards
    return bool(found)


@pytest.mark.parametrize("s", [0.5, 12.0, 25.0])
def test_near_a_fork_a_vehicle_drives_as_either_road_does(s: float):
    assert late(ROADS, 0, EXIT, s, 0.1)
    assert late(ROADS, 0, EXIT, s, 0.4 * OWN)
    assert not late(ROADS, 0, EXIT, s, 0.6 * OWN)
    assert not late(ROADS, 0, EXIT, s, 2.0 * OWN)


def test_where_the_roads_have_parted_each_has_its_own_heading():
    assert not late(ROADS, 0, EXIT, 45.0, 0.0)


def test_a_road_that_runs_on_forks_off_nowhere():
    assert not late(ROADS, 0, MOTORWAY, 3.0, 0.0)


def test_a_corner_is_none_of_a_fork():
    roads = network([[[0.0, 0.0], [100.0, 0.0]], [[100.0, 0.0], [200.0, 60.0]]])
    assert not late(roads, 0, 2, 3.0, 0.0)


def bend_of(degrees: float, *others: list) -> Roads:
    """A road that turns by some degrees, and others that leave its node."""
    a = math.radians(degrees)
    turned = [[100.0, 0.0], [100.0 + 90.0 * math.cos(a), -90.0 * math.sin(a)]]
    return network([[[0.0, 0.0], [100.0, 0.0]], turned, *others])


AHEAD = [[100.0, 0.0], [200.0, 0.0]]


def with_lanes(roads: Roads, edge: int) -> Roads:
    """The same, where an edge has two lanes."""
    roads = roads._replace(edges=roads.edges.copy())
    roads.edges.lane_sigma[edge] = 1.65
    return roads


@pytest.mark.parametrize(("degrees", "of_one", "of_two"), [
    (5.0, False, False), (10.0, False, True), (20.0, True, True),
])  # fmt: skip
def test_a_shallow_exit_is_left_late_from_a_road_of_several_lanes(degrees, of_one, of_two):
    roads = bend_of(degrees, AHEAD)
    assert late(roads, 0, 2, 3.0, 0.0) == of_one
    assert late(with_lanes(roads, 0), 0, 2, 3.0, 0.0) == of_two


@pytest.mark.parametrize("degrees", [10.0, 20.0])
def test_a_road_that_alone_goes_on_is_a_bend(degrees):
    assert not late(bend_of(degrees), 0, 2, 3.0, 0.0)


def test_the_lane_is_kept_straight_on_and_drawn_anew_at_a_fork():
    assert kept_lane(0.0) == kept_lane(0.19) == kept_lane(-0.19) == 1.0
    assert kept_lane(0.25) == kept_lane(-0.25) == pytest.approx(0.5)
    assert kept_lane(0.31) == kept_lane(-0.31) == kept_lane(2.0) == 0.0


@pytest.mark.parametrize("metres", [8.0, 15.0])
def test_who_leaves_by_an_exit_later_than_it_is_drawn_is_seldom_put_on_the_motorway(metres: float):
    """The vehicle drives in the right one of two lanes, and 2 m left of where the exit is drawn."""
    roads = with_lanes(with_lanes(ROADS, 0), MOTORWAY)
    begin = AT + metres
    corners = [
        [20.0, -2.0],
        [begin, -2.0],
        [begin + 17.0, -3.9],
        [begin + 27.0, -3.9],
        [680.0, -44.7],
    ]
    road = drive_along(corners, radius=60.0, speed=14.0)
    after, at_last = road.x > AT + 2.0, road.x > AT + 200.0
    declared, on_exit = 0, []
    for seed in range(12):
        fix = gnss(road, sigma=2.0, seed=seed)
        epochs = epochs_of(road, fix, np.arange(0, len(road.time), 10), course=0.05)
        rows = localize(roads, epochs).output.rows
        declared += ((rows.edge == MOTORWAY) & (rows.p_edge >= 0.999))[after].any()
        on_exit.append((rows.edge[at_last] == EXIT).mean())
    assert declared <= 1
    assert np.mean(on_exit) > 0.9
