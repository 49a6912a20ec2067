"""Wheels of another size than is said, beside fixes that report no speed."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

import whichroad
from demands.town import PLANE
from whichroad.observations import GeoFix, Observation, WheelSpeed
from whichroad.simulate import MapBuilder

SIGMA = 1.5  # m
SECONDS = 420.0
CHANGED = 200.0  # s


class Ride(NamedTuple):
    """A ride along the road, by time."""

    time: np.ndarray
    place: np.ndarray  # (n, 2) m
    heading: np.ndarray
    speed: np.ndarray


@cache
def ride() -> Ride:
    """Slower and faster along slow bends, with two stops."""
    time = np.arange(0.0, SECONDS, 0.1)
    stops = [140.0, 330.0]
    speed = 12.0 + 3.0 * np.sin(time / 11.0)
    for stop in stops:
        speed *= np.clip(np.abs(time - stop - 4.0) / 6.0 - 0.5, 0.0, 1.0)
    way = np.concatenate([[0.0], np.cumsum(0.1 * speed)])[:-1]
    heading = 0.5 * np.sin(way / 300.0)
    step = 0.1 * speed[:-1, None]
    middle = 0.5 * (heading[1:] + heading[:-1])
    place = np.cumsum(step * np.column_stack([np.cos(middle), np.sin(middle)]), axis=0)
    return Ride(time, np.vstack([[0.0, 0.0], place]), heading, speed)


@cache
def roads() -> whichroad.RoadMap:
    builder, place = MapBuilder(), ride().place
    bends = place[::20][np.r_[True, np.hypot(*np.diff(place[::20], axis=0).T) > 5.0]]
    ends = [bends[0] - [60.0, 0.0], *bends, bends[-1] + [200.0, 0.0]]
    for k, (x, y) in enumerate(ends):
        builder.node(f"{k}", float(x), float(y) + 1.7)
    builder.way([f"{k}" for k in range(len(ends))], "secondary", name="Road")
    return builder.compiled()


def readings(factor: np.ndarray, pulled: float = 0.0) -> list[Observation]:
    """Wheel speeds at 10 Hz, `factor` (n,) times what they should be, and fixes at 1 Hz.

    The receiver is pulled along at a speed, m/s, for a minute.
    """
    truth, rng = ride(), np.random.default_rng(3)
    rate = np.gradient(truth.heading, truth.time)
    rows = zip(truth.time, truth.speed, rate, factor, strict=True)
    found: list[Observation] = [
        WheelSpeed(1.6e9 + float(t), float(f * (v - 0.75 * w)), float(f * (v + 0.75 * w)))
        for t, v, w, f in rows
    ]
    slow = np.zeros(2)
    for k in range(0, len(truth.time), 10):
        slow = np.exp(-1.0 / 80.0) * slow + rng.normal(0.0, 0.15, 2)
        t = float(truth.time[k])
        along = pulled * (min(t, CHANGED + 60.0) - CHANGED) if t > CHANGED else 0.0
        seen = truth.place[k] + slow + rng.normal(0.0, 0.5, 2) + [along * (t < 290.0), 0.0]
        lat, lon = PLANE.to_geodetic(*seen)
        found.append(GeoFix.with_sigma(1.6e9 + t, float(lat), float(lon), SIGMA))
    return sorted(found, key=lambda r: r.time)


class Answer(NamedTuple):
    """Of each fix: s, error of the place and its protection level, m; and what is named."""

    time: np.ndarray
    error: np.ndarray
    level: np.ndarray
    named: list[str]


def driven(observed: list[Observation]) -> Answer:
    online = whichroad.Localizer(roads(), vehicle=whichroad.Vehicle(track_width=1.5))
    places = np.column_stack(roads().plane.from_geodetic(*PLANE.to_geodetic(*ride().place.T)))
    rows = []
    for reading in observed:
        said = online.update(reading)
        if isinstance(reading, GeoFix) and said.answered:
            t = reading.time - 1.6e9
            x, y = places[round(10.0 * t)]
            rows.append((t, np.hypot(said.pose.x - x, said.pose.y - y), said.protection_level))
    return Answer(*np.array(rows).T, [one.what for one in online.diagnosis])


@pytest.mark.parametrize("factor", [0.8, 1.1, 1.25])
def test_wheels_of_another_size_are_found_out(factor: float):
    answer = driven(readings(np.full(len(ride().time), factor)))
    assert answer.named == ["wheels: scale"]
    late = answer.time > 200.0
    assert np.quantile(answer.error[late], 0.95) < 3.0 * SIGMA
    assert np.mean(answer.error > answer.level) < 0.01


@pytest.mark.parametrize("factor", [0.95, 1.04, 1.15])
def test_wheels_that_change_their_size_on_the_way_are_found_out(factor: float):
    """They keep the vehicle from its fixes for two minutes at most, and the level covers these."""
    answer = driven(readings(np.where(ride().time < CHANGED, 1.0, factor)))
    assert answer.named == ["wheels: scale"]
    late = answer.time > CHANGED + 150.0
    assert np.quantile(answer.error[late], 0.95) < 3.0 * SIGMA
    assert np.mean(answer.error > answer.level) < 0.03


@pytest.mark.parametrize("pulled", [0.0, 1.0, 4.0])
def test_a_receiver_that_is_pulled_along_is_no_other_wheel(pulled: float):
    answer = driven(readings(np.ones(len(ride().time)), pulled))
    assert "wheels: scale" not in answer.named
    assert answer.error.max() < 6.0


@pytest.mark.parametrize("factor", [0.8, 1.0, 1.25])
def test_of_a_recorded_drive_the_size_is_known_from_the_beginning(factor: float):
    result = whichroad.match(
        readings(np.full(len(ride().time), factor)), roads(),
        vehicle=whichroad.Vehicle(track_width=1.5),
    )  # fmt: skip
    assert [one.what for one in result.diagnosis] == ["wheels: scale"] * (factor != 1.0)
    points = result.points
    x, y = PLANE.from_geodetic(points.lat.to_numpy(), points.lon.to_numpy())
    seconds = (points.time - points.time.iloc[0]).dt.total_seconds()
    row = np.clip(np.round(10.0 * seconds).astype(int), 0, len(ride().place) - 1)
    error = np.hypot(*(np.column_stack([x, y]) - ride().place[row]).T)
    assert np.quantile(error, 0.95) < 3.0 * SIGMA
    assert (error < points.protection_level_m).all()
