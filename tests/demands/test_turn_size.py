"""A track width that is wrong, beside fixes that report no speed."""

from functools import cache

import numpy as np
import pytest

import whichroad
from demands.town import PLANE, along, corners, roads
from whichroad.observations import GeoFix, Observation, WheelSpeed

SIGMA = 1.5  # m
ROUNDS = 4
TRUE_WIDTH = 1.5  # m


@cache
def ride() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, places and headings of a drive round blocks, to the left and to the right."""
    left, right = ["11", "12", "22", "21"], ["11", "10", "00", "01"]
    way = corners(*["20", "21"], *([*right, *left[:1], *left[1:]] * ROUNDS), "11")
    time, place = along(way, 9.0, 0.1)
    smooth = np.column_stack(
        [np.convolve(np.pad(p, 12, "edge"), np.ones(25) / 25, "valid") for p in place.T]
    )
    step = np.gradient(smooth, axis=0)
    return time, smooth, np.unwrap(np.arctan2(step[:, 1], step[:, 0]))


def readings(uneven: float = 0.0, lost: float = 0.0) -> list[Observation]:
    """Wheel speeds at 10 Hz, the right ones larger by a share, and fixes at 1 Hz.

    Another share is lost evenly from the beginning to the end, as the radius of a leaking tyre.
    """
    time, place, heading = ride()
    rng = np.random.default_rng(2)
    speed = np.hypot(*np.gradient(place, 0.1, axis=0).T)
    rate = np.gradient(heading, 0.1)
    half = 0.5 * TRUE_WIDTH
    shares = uneven + lost * time / time[-1]
    found: list[Observation] = [
        WheelSpeed(1.6e9 + float(t), float(v - half * w), float((v + half * w) * (1.0 + share)))
        for t, v, w, share in zip(time, speed, rate, shares, strict=True)
    ]
    slow = np.zeros(2)
    for k in range(0, len(time), 10):
        slow = np.exp(-1.0 / 80.0) * slow + rng.normal(0.0, 0.15, 2)
        lat, lon = PLANE.to_geodetic(*(place[k] + slow + rng.normal(0.0, 0.5, 2)))
        found.append(GeoFix.with_sigma(1.6e9 + float(time[k]), float(lat), float(lon), SIGMA))
    return sorted(found, key=lambda r: r.time)


def driven(width: float, uneven: float = 0.0, lost: float = 0.0) -> tuple[np.ndarray, list[str]]:
    """Time, error of the place and its level after each fix, and what is named."""
    place = ride()[1]
    online = whichroad.Localizer(roads(), vehicle=whichroad.Vehicle(track_width=width))
    places = np.column_stack(roads().plane.from_geodetic(*PLANE.to_geodetic(*place.T)))
    rows = []
    for reading in readings(uneven, lost):
        said = online.update(reading)
        if isinstance(reading, GeoFix) and said.answered:
            t = reading.time - 1.6e9
            x, y = places[min(round(10.0 * t), len(places) - 1)]
            rows.append((t, np.hypot(said.pose.x - x, said.pose.y - y), said.protection_level))
    return np.array(rows).T, [one.what for one in online.diagnosis]


@pytest.mark.parametrize("told", [1.25, 1.7])
def test_a_wrong_track_width_is_found_out_in_corners(told: float):
    (time, error, level), named = driven(told)
    assert named == ["wheels: track width"]
    late = time > 0.75 * time[-1]
    assert np.quantile(error[late], 0.95) < 4.0 * SIGMA
    assert np.mean(error > level) < 0.04


def test_a_right_track_width_is_not_blamed():
    (_, error, level), named = driven(TRUE_WIDTH)
    assert named == []
    assert (error < level).all()


@pytest.mark.parametrize("uneven", [-0.006, 0.006])
def test_wheels_of_two_sizes_are_no_track_width(uneven: float):
    """Three of four corners are to the left: turns are short of, or beyond, by as much in each."""
    (_, error, level), named = driven(TRUE_WIDTH, uneven)
    assert "wheels: track width" not in named
    assert (error < level).all()


@pytest.mark.parametrize("lost", [-0.01, 0.01])
def test_a_tyre_that_loses_air_is_followed(lost: float):
    (_, error, level), _ = driven(TRUE_WIDTH, lost=lost)
    assert (error < level).all()
    assert np.quantile(error, 0.95) < 6.0 * SIGMA


@pytest.mark.parametrize("told", [1.25, TRUE_WIDTH, 1.7])
def test_of_a_recorded_drive_the_track_width_is_known_from_the_beginning(told: float):
    car = whichroad.Vehicle(track_width=told)
    result = whichroad.match(readings(), roads(), vehicle=car)
    named = [one.what for one in result.diagnosis]
    assert named == ["wheels: track width"] * (told != TRUE_WIDTH)
    points, place = result.points, ride()[1]
    x, y = PLANE.from_geodetic(points.lat.to_numpy(), points.lon.to_numpy())
    seconds = (points.time - points.time.iloc[0]).dt.total_seconds()
    row = np.clip(np.round(10.0 * seconds).astype(int), 0, len(place) - 1)
    error = np.hypot(*(np.column_stack([x, y]) - place[row]).T)
    assert np.quantile(error, 0.95) < 3.0 * SIGMA
    assert (error < points.protection_level_m).all()
