"""A drive that is on no road of the map, and one that leaves it."""

import importlib
import math

import numpy as np
import pytest

import whichroad
from scenes import Town, drive_along, network, straight_road
from whichroad.global_start.elsewhere import behind_ends, gain_of, leaving, turn_cost
from whichroad.recorded import localize_recorded
from whichroad.settings import Settings, Vehicle

from .wheels import PLANE, wheels_of


def test_straight_on_costs_little_and_a_corner_more():
    straight, bend, corner = (turn_cost(turn, 5.0) for turn in (0.0, 0.3, 1.5))
    assert 0.0 < straight < 0.5 * bend < bend < corner
    assert turn_cost(-1.5, 5.0) == corner
    assert turn_cost(3.0, 5.0) == pytest.approx(corner, rel=1e-2)  # any corner is as likely


def test_the_cost_of_a_bend_does_not_depend_on_how_it_is_cut():
    assert turn_cost(0.4, 10.0) == pytest.approx(2.0 * turn_cost(0.2, 5.0))
    assert turn_cost(0.4, 0.0) == 0.0


def test_a_bend_that_goes_on_costs_less_than_its_begin():
    assert turn_cost(0.6, 5.0, before=0.6 / 5.0) < 0.5 * turn_cost(0.6, 5.0)
    assert turn_cost(0.6, 5.0, before=-0.6 / 5.0) > turn_cost(0.6, 5.0)


def test_its_own_road_fits_as_the_best_ones_here_do_and_at_least_as_a_right_one():
    before, least = np.log([0.5, 0.5]), -2.0 + 0.175 * 5.0
    chance = np.array([-30.0, -50.0])
    assert gain_of(before, np.array([1.0, -50.0]), -2.0, 5.0, 0.0) == pytest.approx(1.0)
    assert gain_of(before, chance, -2.0, 5.0, 0.0) == pytest.approx(least)
    assert gain_of(before[:0], before[:0], -2.0, 5.0, 0.0) == pytest.approx(least)
    assert gain_of(before, chance, -2.0, 5.0, 1.5) == -2.0  # in a corner no road fits well


def test_half_of_those_who_turn_round_where_a_road_ends_drive_on():
    roads = network([[[0.0, 0.0], [100.0, 0.0]], [[100.0, 0.0], [100.0, 100.0]]])
    assert behind_ends(roads).tolist() == [True, False, False, True]
    edge, new = np.array([0, 0, 1, -1], np.int32), np.array([True, False, True, True])
    share = leaving(edge, new, behind_ends(roads))
    assert share.tolist() == [0.5, 0.0, 0.0, 0.0]


def test_who_is_elsewhere_does_not_leave_the_roads_of_this_map_for_its_yards():
    """Else each corner, which a yard does not pay for, would begin the search anew."""
    search = importlib.import_module("whichroad.global_start.search")
    town = Town(network(straight_road(), curvature=PLANE.curvature), PLANE)
    timeline = wheels_of(drive_along([[500.0, -1.75], [600.0, -1.75]]))
    shares = []
    for row in (1, 2):  # elsewhere; on a road
        begun = search._Search(town, Vehicle(), Settings(), None, timeline)
        begun.column("log_weight")[:] = -60.0
        begun.column("log_weight")[row] = 0.0
        begun._exchange_off_road(5.0)
        shares.append(np.exp(begun.column("log_weight")[:2]))
    assert shares[0][0] < 1e-12
    assert shares[1] == pytest.approx([0.5 * 1e-4, 0.5 * 1e-4], rel=1e-3)


def test_a_drive_on_a_map_without_it_is_known_to_be_elsewhere(town: whichroad.RoadMap):
    """Bends and corners of 60 and 120 degrees, which the town does not have."""
    turns = np.radians([60, -120, 60, 120, -60, -120, 60, 60, -120, 60])
    heading = np.cumsum(turns)
    steps = np.array([100, 70, 120, 90, 110, 60, 130, 80, 100, 90])[:, None]
    line = np.cumsum(steps * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    rows = localize_recorded(town, wheels_of(drive_along(line)), start="map").output.rows
    assert rows.p_off_road[-1] > 0.9
    assert rows.p_edge.max() < 0.95


def test_until_it_knows_the_pose_is_that_of_one_hypothesis():
    """Two equal roads: their middle is a place where nobody is."""
    roads = network([*straight_road(), [[0.0, 800.0], [2000.0, 800.0]]], curvature=PLANE.curvature)
    truth = drive_along([[500.0, -1.75], [600.0, -1.75]])
    rows = localize_recorded(Town(roads, PLANE), wheels_of(truth), start="map").output.rows
    assert (np.minimum(abs(rows.y), abs(rows.y - 800.0)) < 10.0).all()
    assert math.sqrt(rows.cov[-1, 3]) > 300.0
    assert rows.protection_level[-1] > 700.0
