"""Initial probabilities depend on the roads about the first fix, not on how they are digitised."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import whichroad
from laws.public import CAR, DISTANCE, START, degrees, geo_fixes, readings, road_map
from scenes import drive_along
from whichroad.sensors import Compass, SensorReading

LENGTH = 2000.0  # m
# no pruning, no merging, no probability for unknown causes
PLAIN = whichroad.Settings(unknown=0.0, prune=0.0, merge=0.0, components=8)
ALONG = [[0.0, 0.0], [LENGTH, 0.0]]


def beside(gap: float) -> list[list[float]]:
    return [[0.0, gap], [LENGTH, gap]]


def cut(line: Sequence[Any], count: int) -> list[np.ndarray]:
    """A street cut into streets of equal length."""
    cuts = np.linspace(line[0], line[1], count + 1)
    return [cuts[k : k + 2] for k in range(count)]


def first(
    roads: whichroad.RoadMap, x: float, y: float, *, sigma: float = 3.0,
    settings: whichroad.Settings = PLAIN, bearing: float | None = None,
    sensors: Sequence[Any] = (),
) -> whichroad.Localizer:  # fmt: skip
    """The filter after a fix."""
    lon, lat = degrees(x, y)
    course = {} if bearing is None else {"bearing_deg": bearing, "sigma_bearing_deg": 5.0}
    online = whichroad.Localizer(roads, vehicle=CAR, settings=settings, sensors=sensors)
    online.update(
        whichroad.GeoFix(START, float(lat), float(lon), sigma**2, 0.0, sigma**2, **course)
    )
    return online


def shares(online: whichroad.Localizer) -> dict[tuple[int, bool] | None, float]:
    """P of each street in each direction, as drawn or not; None: off the roads."""
    table = online.roads.edges_table()
    names = list(zip(table.source_id.astype(int), table.forward.astype(bool), strict=True))
    total: dict[tuple[int, bool] | None, float] = {}
    for h in online.estimate().hypotheses:
        name = None if h.edge is None else names[h.edge]
        total[name] = total.get(name, 0.0) + h.p
    return total


def of_street(online: whichroad.Localizer, ids: Sequence[int]) -> float:
    return sum(p for name, p in shares(online).items() if name is not None and name[0] in ids)


@pytest.mark.parametrize("sigma", [3.0, 10.0, 25.0])
@pytest.mark.parametrize("count", [2, 10, 67])
def test_cutting_a_road_into_pieces_does_not_change_its_probability(sigma: float, count: int):
    whole = first(road_map([ALONG, beside(12.0)]), 1003.0, 5.0, sigma=sigma)
    pieces = first(road_map([*cut(ALONG, count), beside(12.0)]), 1003.0, 5.0, sigma=sigma)
    assert of_street(pieces, range(count)) == pytest.approx(of_street(whole, [0]), abs=1e-6)


def test_a_road_that_ends_beside_the_fix_has_half_the_probability_of_one_that_goes_on():
    roads = road_map([[[0.0, 0.0], [500.0, 0.0]], [[0.0, 9.0], [1000.0, 9.0]]])
    online = first(roads, 500.0, 4.5)
    assert of_street(online, [0]) / of_street(online, [1]) == pytest.approx(0.5, rel=1e-6)


def test_both_directions_are_equal_and_off_road_has_its_prior():
    settings = whichroad.Settings(unknown=0.0, off_road_start=0.2, gnss_inflation=1.0)
    found = shares(first(road_map([ALONG, beside(12.0)]), 1000.0, 0.0, settings=settings))
    assert found[0, True] == pytest.approx(found[0, False], rel=1e-6)
    assert found[None] == pytest.approx(0.2, abs=0.02)  # changed by the map observation
    assert sum(found.values()) == pytest.approx(1.0, abs=1e-12)


def test_driving_against_a_one_way_street_has_its_prior():
    roads = road_map([ALONG, beside(12.0)], oneway=["yes", "no"])
    found = shares(first(roads, 1000.0, 0.0))
    assert found[0, False] / found[0, True] == pytest.approx(PLAIN.wrong_way, rel=1e-6)


def test_without_odometry_a_known_course_may_be_an_old_one():
    online = first(road_map([ALONG, beside(12.0)]), 1000.0, 5.0, bearing=85.0)
    found = shares(online)
    for street in (0, 1):  # 0.02, and what the heading of the road says of a fitting course
        assert 0.015 < found[street, False] / found[street, True] < 0.04
    assert online.estimate().pose.bearing_deg == pytest.approx(85.0, abs=5.0)


@pytest.mark.parametrize("bearing", [90.0, 270.0])
def test_a_compass_says_no_more_against_a_direction_than_that_it_is_mistaken(bearing: float):
    """At a start nothing else tells the direction, and a compass may be mounted backwards."""
    online = first(road_map([ALONG]), 1000.0, 0.0, sensors=[Compass(sigma_deg=1.0, lasts_m=0.0)])
    online.update(SensorReading(START + 0.01, {"compass_deg": bearing}, "compass"))
    found = shares(online)
    assert found[0, bearing > 180.0] / found[0, bearing < 180.0] == pytest.approx(0.02, rel=0.1)


def test_far_from_every_road_a_vehicle_is_and_stays_off_road():
    roads = road_map([ALONG, beside(12.0)])
    assert shares(first(roads, 1000.0, 900.0)) == pytest.approx({None: 1.0})
    truth = drive_along([[500.0, 900.0], [1500.0, 900.0]])
    fix = np.column_stack([truth.x, truth.y, np.full((len(truth.x), 2), 3.0), 0.0 * truth.x])
    seen = geo_fixes(truth, fix, np.arange(0, len(truth.x), 10)) + readings(truth, DISTANCE)
    points = whichroad.match(seen, roads, vehicle=CAR).to_arrow()
    assert min(points["p_off_road"].to_pylist()) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("x", [280.0, 295.0, 300.0, 306.0])
def test_the_first_centimetre_after_a_start_beside_a_node_moves_no_probability_past_it(x: float):
    """The initial P(not past the end) already holds what lies beyond the node."""
    stub = [[300.0, 0.0], [300.0, -200.0]]  # makes the node a junction
    online = first(road_map([*cut([[0.0, 0.0], [600.0, 0.0]], 2), stub]), x, -1.75, bearing=90.0)
    before = shares(online)
    for k in range(2):
        online.update(whichroad.Distance(START + 0.01 * (k + 1), 0.01 * k))
    assert shares(online)[0, True] == pytest.approx(before[0, True], abs=0.01)
