"""Corners are cut: lanes lead past a node, and short links are never driven along."""

import math

import numpy as np
import pytest

from scenes import (
    On,
    belief_on,
    context,
    doubt_map,
    drive_along,
    epochs_of,
    gnss,
    localize,
    network,
)
from whichroad.filter.hypotheses.branching import branch
from whichroad.filter.hypotheses.corners import list_corners, turned_before_end
from whichroad.filter.state import NO_EDGE, H, new_path, normalise
from whichroad.graph.network import Roads

# eastwards, past a service road to the south, to a main road to the south
SERVICE, MAIN = 6, 8
MAIN_AT = 316.0  # m, of the main road's line; the service road's is at 300 m
ROADS = network(
    [
        [[0.0, 0.0], [300.0, 0.0]],
        [[300.0, 0.0], [MAIN_AT, 0.0]],
        [[MAIN_AT, 0.0], [600.0, 0.0]],
        [[300.0, 0.0], [300.0, -500.0]],
        [[MAIN_AT, 0.0], [MAIN_AT, -500.0]],
    ]
)
ROADS.edges.lane[[MAIN, MAIN + 1]] = 3.5  # m, the middle of two lanes a direction
ROADS.edges.lane_sigma[[MAIN, MAIN + 1]] = 1.8

# two carriageways, the one westwards north of the other; a link across, with a road in its middle
BACK = 4
TURNING = network(
    [
        [[0.0, 0.0], [300.0, 0.0]],
        [[300.0, 0.0], [600.0, 0.0]],
        [[300.0, 12.0], [0.0, 12.0]],
        [[600.0, 12.0], [300.0, 12.0]],
        [[300.0, 0.0], [300.0, 6.0]],
        [[300.0, 6.0], [300.0, 12.0]],
        [[300.0, 6.0], [340.0, 6.0]],
    ],
    one_way=(0, 1, 2, 3),
)


def answer(roads: Roads, corners: list[list[float]], radius: float, seed: int):
    """The filter's answer for a drive at 5 m/s with perfect wheels and fixes every second."""
    road = drive_along(corners, radius=radius, speed=5.0)
    fix = gnss(road, sigma=2.0, seed=seed)
    epochs = epochs_of(road, fix, np.arange(0, len(road.time), 10), course=0.05)
    return road, localize(roads, epochs).output.rows


@pytest.mark.parametrize("seed", range(6))
def test_who_turns_into_the_outer_lane_of_a_wide_road_is_not_on_the_road_before(seed: int):
    """The vehicle drives 5 m beside its road, and 11 m beside the service road."""
    lane = MAIN_AT - 5.0
    road, rows = answer(ROADS, [[50.0, -1.75], [lane, -1.75], [lane, -400.0]], 6.0, seed)
    at = road.y < -40.0
    assert (rows.edge[at] == MAIN).mean() > 0.9
    assert not ((rows.edge == SERVICE) & (rows.p_edge >= 0.999)).any()


@pytest.mark.parametrize("seed", range(6))
def test_the_service_road_is_found_too(seed: int):
    road, rows = answer(ROADS, [[50.0, -1.75], [298.25, -1.75], [298.25, -400.0]], 6.0, seed)
    assert (rows.edge[road.y < -40.0] == SERVICE).mean() > 0.9
    assert not ((rows.edge == MAIN) & (rows.p_edge >= 0.999)).any()


@pytest.mark.parametrize("seed", range(6))
def test_who_turns_round_by_a_short_link_is_on_the_other_carriageway(seed: int):
    """It passes the link 4 m before it."""
    corners = [[30.0, -1.75], [296.0, -1.75], [296.0, 9.0], [20.0, 9.0]]
    road, rows = answer(TURNING, corners, 5.0, seed)
    back = (np.cos(road.heading) < -0.9) & (road.x < 290.0)
    assert (rows.edge[back] == BACK).mean() > 0.95
    assert not ((rows.edge[back] != BACK) & (rows.p_edge[back] >= 0.999)).any()


def turned(degrees: float, along: float = 309.0, *, drove: bool = True):
    """A belief on the short edge before the main road, 16 m long, and its context."""
    belief, ctx = belief_on(ROADS, [On(2, along - 300.0, sigma=1.0)]), context(ROADS)
    doubt_map(belief, 1.0)
    normalise(belief)
    hyp = belief.hyp[0]
    hyp.tangent[:] = 1.0, 0.0
    hyp.along, hyp.along_sigma, hyp.p_not_passed = along - 300.0, 1.0, 1.0
    hyp["mu"][H] = math.radians(degrees)
    hyp.corner = 2 if drove else NO_EDGE
    return belief, ctx


def test_a_vehicle_that_goes_on_cuts_no_corner_and_is_known_to_drive_along_the_road():
    belief, _ = turned(-20.0, drove=False)
    assert turned_before_end(belief.hyp[0]) == 0.0
    assert belief.hyp[0].corner == 2


def test_a_vehicle_that_has_just_come_round_a_corner_is_yet_to_drive_along_the_road():
    belief, _ = turned(-60.0, drove=False)
    assert turned_before_end(belief.hyp[0]) == 0.0


def test_only_roads_that_turn_to_the_same_side_are_listed_with_a_mass():
    belief, ctx = turned(-60.0)
    angle = turned_before_end(belief.hyp[0])
    assert angle == pytest.approx(math.radians(-60.0))
    count = list_corners(belief, ctx, 0, angle)
    found = ctx.work.successor[:count]
    assert found.edge[found.mass > 0.0].tolist() == [MAIN]
    left = list_corners(belief, ctx, 0, -angle)
    assert not (ctx.work.successor[:left].mass > 0.0).any()


def test_what_is_given_to_a_corner_is_taken_from_the_road_and_given_once():
    belief, ctx = turned(-60.0)
    path = new_path(64)
    assert branch(belief, path, ctx, 0.5, 0.0)
    count = int(belief.state[0].count)
    weight = np.exp(belief.hyp.log_weight[:count])
    assert weight.sum() == pytest.approx(1.0)
    assert weight[belief.hyp.edge[:count] == MAIN].sum() > 0.05
    normalise(belief)
    before = weight[belief.hyp.edge[:count] == MAIN].sum()
    branch(belief, path, ctx, 0.01, 0.0)
    again = int(belief.state[0].count)
    after = np.exp(belief.hyp.log_weight[:again])[belief.hyp.edge[:again] == MAIN].sum()
    assert after == pytest.approx(before, rel=0.02)


def test_what_is_far_beyond_its_roads_end_cuts_no_corner():
    """All of it has passed the node, so that nothing is left to share out."""
    belief, ctx = turned(-60.0, 450.0)
    belief.hyp[0].p_not_passed = 0.0
    list_corners(belief, ctx, 0, math.radians(-60.0))
    assert (ctx.work.successor.mass == 0.0).all()
    branch(belief, new_path(64), ctx, 0.5, 0.0)
    assert np.isfinite(belief.hyp.log_weight[: belief.state[0].count]).all()
