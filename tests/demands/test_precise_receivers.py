"""Receivers of centimetres without odometry: parked, creeping, in corners, after a coarse start."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.manoeuvres import How, one, scenes
from benchmarks.manoeuvres.cases import Case, of_sigma
from benchmarks.manoeuvres.sensors import Heard

from whichroad import GeoFix, match

from .test_trackers import M, off, road_map, rows

STREET = {"street": [(-300.0, 0.0), (300.0, 0.0)]}


def noisy(x: np.ndarray, y: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    white = np.random.default_rng(3).normal(0.0, 0.5 * sigma, (2, len(x)))
    return x + white[0], y + white[1]


@pytest.mark.parametrize("every", [0.1, 1.0])
@pytest.mark.parametrize("sigma", [0.02, 0.5])
def test_who_is_parked_off_the_roads_does_not_come_to_be_on_one_by_standing(every, sigma):
    n = round(10.0 / every)
    x, y = noisy(np.zeros(n), np.full(n, 20.0), sigma)
    points = match(rows(x, y, every, sigma), road_map(STREET)).points
    assert points.p_off_road.iloc[0] > 0.9
    assert points.p_off_road.min() > 0.3


@pytest.mark.parametrize("every", [0.1, 1.0])
@pytest.mark.parametrize("sigma_speed", [0.05, 0.3])
def test_who_creeps_is_followed_by_a_fine_receiver(every: float, sigma_speed: float):
    time = np.arange(0.0, 120.0, every)
    speed = np.where((time > 30.0) & (time < 90.0), 0.4, 4.0)
    x = -200.0 + np.cumsum(speed * every)
    said = np.abs(speed + np.random.default_rng(4).normal(0.0, 0.02, len(x)))
    places = zip(*noisy(x, 0.0 * x, 0.02), strict=True)
    fixes = [
        GeoFix.with_sigma(t, b * M, a * M, 0.02, speed=v, sigma_speed=sigma_speed)
        for t, v, (a, b) in zip(1.7e9 + time, said, places, strict=True)
    ]
    points = match(fixes, road_map(STREET)).points
    error = off(points, x, 0.0 * x)[time > 20.0]
    held = 0.3 + 4.0 * 0.02  # m, up to which its place is held at first, where speeds are coarse
    assert (error < points.protection_level_m[time > 20.0] + held * (sigma_speed > 0.1)).all()
    assert error.max() < 1.2


def test_a_fine_fix_at_rest_mends_a_coarse_start():
    n = 20
    x = np.where(np.arange(n) < 5, 12.0, 0.0)
    sigma = np.where(np.arange(n) < 5, 10.0, 0.02)
    table = rows(*noisy(x, 0.0 * x, 0.02), 1.0, sigma, speed_mps=np.zeros(n))
    points = match(table, road_map(STREET)).points
    assert (off(points, 0.0, 0.0)[8:] < 0.5).all()
    assert (points.protection_level_m[12:] < 5.0).all()


@pytest.mark.parametrize("suite", ["odometer", "odometer and Doppler", "Doppler", "fixes"])
@pytest.mark.parametrize("draw", [scenes.town, scenes.gaps])
def test_corners_and_gaps_are_not_the_receiver_s_error(draw, suite: str):
    found = one("fine", Case("0.02 m", draw, (suite,), of_sigma(0.02)), suite, 1000, How())
    assert found.declared > 80
    assert found.wrong == 0
    assert found.pose.exceeded <= 0.01 * found.pose.epochs
    assert found.pose.level < 3.0


@pytest.mark.parametrize(
    ("suite", "sigma", "seed"),
    [
        ("fixes", 0.02, 1003),
        ("fixes", 0.08, 1001),
        ("Doppler", 0.02, 1004),
        ("Doppler", 0.08, 1003),
    ],
)  # fmt: skip
def test_ten_fine_fixes_a_second_are_followed_and_not_the_line_of_a_road(
    suite: str, sigma: float, seed: int
):
    case = Case(f"{sigma} m", scenes.town, (suite,), of_sigma(sigma, 0.1))
    found = one("fine", case, suite, seed, How())
    assert found.declared > 2000
    assert found.wrong <= 1
    assert found.pose.exceeded <= 1


@pytest.mark.parametrize("begin", [20.0, 20.3])
def test_a_stop_is_where_a_fine_receiver_says(begin: float):
    """It rolls on for some decimetres after it seems to stand."""
    time = np.arange(0.0, 60.0, 1.0)
    fine = np.arange(0.0, 60.0, 0.01)
    speed = np.interp(fine, [begin, begin + 5.0, begin + 9.0], [6.0, 0.5, 0.0])
    x = np.interp(time, fine, -200.0 + np.cumsum(speed * 0.01))
    said = np.abs(np.interp(time, fine, speed) + np.random.default_rng(4).normal(0.0, 0.1, 60))
    places = zip(*noisy(x, 0.0 * x, 0.02), strict=True)
    fixes = [
        GeoFix.with_sigma(t, b * M, a * M, 0.02, speed=v)
        for t, v, (a, b) in zip(1.7e9 + time, said, places, strict=True)
    ]
    points = match(fixes, road_map(STREET)).points
    assert off(points, x, 0.0 * x)[time > begin + 10.0].max() < 0.25


def jolted(heard: list[Heard], moment: float) -> list[Heard]:
    """Each fiftieth fix is wrong by 5 to 100 m."""
    random = np.random.default_rng(6)
    changed = []
    for each in heard:
        if isinstance(each.reading, GeoFix) and random.random() < 0.02:
            off, way = np.exp(random.uniform(np.log(5.0), np.log(100.0))), random.uniform(0.0, 6.28)
            place = each.reading
            place = replace(
                place, lat_deg=place.lat_deg + off * M * np.sin(way),
                lon_deg=place.lon_deg + off * M * np.cos(way) / np.cos(np.radians(place.lat_deg)),
            )  # fmt: skip
            each = each._replace(reading=place)
        changed.append(each)
    return changed


@pytest.mark.parametrize("suite", ["fixes", "odometer"])
def test_a_wrong_fix_does_not_leave_the_pose_where_it_was(suite: str):
    case = Case("jolted", scenes.town, (suite,), of_sigma(0.02, 0.2), clock=jolted)
    found = one("fine", case, suite, 1000, How())
    assert found.pose.exceeded <= 0.01 * found.pose.epochs
    assert found.pose.inside >= 0.975 * found.pose.epochs


def test_by_positions_alone_the_level_covers_fixes_that_leave_the_road():
    """Into a street that the map lacks, where the likeliest hypothesis goes straight on."""
    case = Case("unmapped", scenes.side_street, ("fixes",), of_sigma(0.7, 0.2))
    found = one("fine", case, "fixes", 1000, How())
    assert found.pose.exceeded == 0


@pytest.mark.parametrize(
    ("suite", "every", "seed"),
    [("fixes", 0.05, 1004), ("fixes", 0.2, 1003), ("odometer", 0.2, 1004)],
)  # fmt: skip
def test_however_often_fine_fixes_come_roads_that_are_driven_are_not_left(
    suite: str, every: float, seed: int
):
    """The arc of a corner is no line of a road, and each fix shows another decimetre of it."""
    case = Case("often", scenes.town, (suite,), of_sigma(0.02, every))
    found = one("fine", case, suite, seed, How())
    assert found.declared > 1000
    assert found.wrong == 0
    assert found.pose.right >= 0.995 * found.pose.roads
    assert found.pose.exceeded <= 1
