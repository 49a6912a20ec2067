"""Speeds at which nobody drives on a road speak against it, once, and never exclude it."""

import math

import numpy as np
import pandas as pd
import pytest

import whichroad
from laws.public import degrees, road_map
from scenes import On, belief_on, context, network, parallel_roads
from whichroad.filter.haste import UNTOLD, haste_of, too_fast_from, weigh_haste
from whichroad.filter.state import OFF_ROAD, Belief
from whichroad.graph.network import Roads
from whichroad.roadmap.tags import CLASS_SPEED_KMH, DEFAULT_SPEED_KMH

KMH = 1.0 / 3.6
STREET = 30.0 * KMH


def drive(kmh: float, aside: float, begins: float, seconds: float = 1.0) -> pd.DataFrame:
    """Fixes along a street from (0, 0) to (3000, 0), some metres aside, with errors of 1 m."""
    x = np.arange(begins, 2400.0, kmh * KMH * seconds)
    error = np.random.default_rng(1).normal(0.0, 1.0, (2, len(x)))
    lon, lat = degrees(x + error[0], error[1] - aside)
    return pd.DataFrame({"time": 1.78e9 + seconds * np.arange(len(x)), "lat": lat, "lon": lon})


def street(**columns: object) -> whichroad.RoadMap:
    return road_map(
        [[[0.0, 0.0], [3000.0, 0.0]]], **{name: [value] for name, value in columns.items()}
    )


def p_road(frame: pd.DataFrame, roads: whichroad.RoadMap) -> np.ndarray:
    return whichroad.match(frame, roads).points.p_road.fillna(0.0).to_numpy(float)


@pytest.mark.parametrize("kmh", [75.0, 100.0])
def test_a_road_that_the_map_lacks_is_not_taken_for_a_slow_street_beside_it(kmh: float):
    roads = street(highway="residential", maxspeed=30)
    fast = p_road(drive(kmh, 12.0, -600.0), roads)
    slow = p_road(drive(30.0, 12.0, -600.0), roads)
    assert slow.max() > 0.999
    assert fast.max() < 0.99


@pytest.mark.parametrize("seconds", [1.0, 10.0])
def test_a_wrong_limit_costs_some_certainty_and_not_the_road(seconds: float):
    frame = drive(100.0, 0.0, 100.0, seconds)
    p = p_road(frame, street(highway="residential", maxspeed=30))[len(frame) // 4 :]
    assert p.min() > 0.8
    assert np.median(p) > 0.9


@pytest.mark.parametrize("kmh", [50.0, 90.0, 200.0])
def test_a_road_of_which_nothing_is_told_bears_any_speed(kmh: float):
    roads, told = street(), street(highway="motorway")
    frame = drive(kmh, 0.0, 100.0)
    np.testing.assert_allclose(p_road(frame, roads), p_road(frame, told), atol=1e-6)


def test_the_usual_speed_of_an_unknown_road_is_that_of_maps():
    assert abs(UNTOLD - DEFAULT_SPEED_KMH * KMH) < 0.01
    (usual,) = set(street().edges_table().speed_mps)
    assert too_fast_from(float(usual)) > 60.0


@pytest.mark.parametrize("usual", [*CLASS_SPEED_KMH.values(), 50.0, 70.0, 100.0, 130.0])
def test_usual_drives_are_never_too_fast(usual: float):
    assert haste_of(min(1.5 * usual, 200.0) * KMH, usual * KMH) == 0.0
    assert haste_of(100.0 * KMH, max(usual, 45.0) * KMH) == 0.0  # rural, without a limit
    assert haste_of(1e3, usual * KMH) == 1.0


def weighed(roads: Roads, speed: float, metres: float, steps: int) -> Belief:
    belief = belief_on(roads, [On(0, 100.0), On(2, 100.0), On(OFF_ROAD, 100.0)])
    belief.state[0].speed = belief.state[0].separation.unmapped.pace = speed
    roads.edges[2].speed = 100.0 * KMH
    roads.edges[0].speed = STREET
    for _ in range(steps):
        weigh_haste(belief, context(roads), metres / steps)
    return belief


@pytest.mark.parametrize("metres", [3.0, 40.0, 400.0])
@pytest.mark.parametrize("speed", [17.5, 25.0])
def test_a_way_says_the_same_in_one_step_and_in_many(metres: float, speed: float):
    roads = network(parallel_roads(20.0))
    before = belief_on(roads, [On(0, 100.0), On(2, 100.0), On(OFF_ROAD, 100.0)]).hyp.log_weight
    once, often = (weighed(roads, speed, metres, n).hyp.log_weight[:3] for n in (1, 40))
    np.testing.assert_allclose(once, often, atol=1e-9)
    said = once - before[:3]
    assert said[1] == said[2] == 0.0
    assert math.log(0.01) <= said[0] < -0.05
    assert metres < 400.0 or said[0] < -4.0


def test_below_60_kmh_nothing_is_said():
    roads = network(parallel_roads(20.0))
    before = belief_on(roads, [On(0, 100.0), On(2, 100.0), On(OFF_ROAD, 100.0)]).hyp.log_weight
    belief = weighed(roads, 16.0, 400.0, 4)
    np.testing.assert_array_equal(belief.hyp.log_weight[:3], before[:3])
    assert belief.state[0].separation.unmapped.haste[0] == 0.0
