"""Fixes with true times that come late: the odometry has gone on meanwhile."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from online.avenue import PLANE, TOWN
from whichroad.observations import Distance, GeoFix, Observation, WheelTicks, YawRate
from whichroad.online import Localizer
from whichroad.settings import Vehicle

CAR = Vehicle(
    track_width=1.5, metres_per_tick_left=0.01, metres_per_tick_right=0.01, antenna_forward=1.5,
    antenna_left=0.4,
)  # fmt: skip
SIGMA = 0.03  # m


class Bends(NamedTuple):
    """A way of bends, by time."""

    time: np.ndarray
    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    way: np.ndarray


def bends() -> Bends:
    """90 s of bends to either side, faster and slower."""
    time = np.arange(0.0, 90.0, 0.05)
    heading = 1.2 * np.sin(2 * np.pi * time / 17.0)
    way = np.concatenate([[0.0], np.cumsum(0.05 * (8.0 + 3.0 * np.sin(time / 5.0)))])[:-1]
    step, middle = np.diff(way), 0.5 * (heading[1:] + heading[:-1])
    x = np.concatenate([[0.0], np.cumsum(step * np.cos(middle))])
    y = np.concatenate([[0.0], np.cumsum(step * np.sin(middle))])
    return Bends(time, x, y, heading, way)


def odometry(truth: Bends, gyro: bool) -> list[Observation]:
    time, way = (v.tolist() for v in (truth.time, truth.way))
    if gyro:
        rate = np.gradient(truth.heading, truth.time).tolist()
        turns = [YawRate(t, w) for t, w in zip(time, rate, strict=True)]
        return [*turns, *(Distance(t, s) for t, s in zip(time, way, strict=True))]
    half = 0.75 * truth.heading
    left, right = (100.0 * (truth.way - half)).tolist(), (100.0 * (truth.way + half)).tolist()
    return [WheelTicks(*row) for row in zip(time, left, right, strict=True)]


def fixes(truth: Bends) -> list[GeoFix]:
    noise = np.random.default_rng(1).normal(0.0, 0.3 * SIGMA, (2, len(truth.time)))
    c, s = np.cos(truth.heading), np.sin(truth.heading)
    x = truth.x + 1.5 * c - 0.4 * s + noise[0]
    y = truth.y + 1.5 * s + 0.4 * c + noise[1]
    lat, lon = PLANE.to_geodetic(x, y)
    rows = zip(truth.time, lat, lon, strict=True)
    return [GeoFix.with_sigma(float(t), float(a), float(b), SIGMA) for t, a, b in rows][::4]


def errors(late: float, gyro: bool) -> np.ndarray:
    """Of the place after each fix of the last minute, m."""
    truth = bends()
    arrivals = [(r.time, r) for r in odometry(truth, gyro)]
    arrivals += [(fix.time + late, fix) for fix in fixes(truth)]
    online, found = Localizer(TOWN, vehicle=CAR), []
    for _, reading in sorted(arrivals, key=lambda a: a[0]):
        said = online.update(reading)
        if isinstance(reading, GeoFix) and reading.time > 30.0:
            row = round(said.time / 0.05)
            found.append(math.hypot(said.pose.x - truth.x[row], said.pose.y - truth.y[row]))
    return np.array(found)


@pytest.mark.parametrize("gyro", [False, True])
@pytest.mark.parametrize("late", [0.07, 0.4])
def test_a_late_fix_is_moved_on_as_the_vehicle_has_moved(late: float, gyro: bool):
    in_time, behind = errors(0.0, gyro), errors(late, gyro)
    assert np.quantile(in_time, 0.95) < SIGMA
    assert behind.max() < 4.0 * SIGMA


@pytest.mark.parametrize("late", [0.5, 0.9])
def test_beside_an_odometer_alone_a_late_fix_is_moved_on_by_it_and_is_less_sure(late: float):
    rng = np.random.default_rng(2)
    time = np.arange(0.0, 120.0, 0.1)
    speed = 9.0 + 6.0 * np.sin(2 * np.pi * time / 14.0)  # up to 2.7 m/s²
    way = np.concatenate([[0.0], np.cumsum(0.1 * speed[:-1])])
    lat, lon = PLANE.to_geodetic(way + rng.normal(0.0, 0.01, len(time)), 0.0 * way)
    arrivals = [(t, Distance(t, s)) for t, s in zip(time.tolist(), way.tolist(), strict=True)]
    rows = list(zip(time.tolist(), lat.tolist(), lon.tolist(), strict=True))[::2]
    arrivals += [(t + late, GeoFix.with_sigma(t, a, b, SIGMA)) for t, a, b in rows]
    online, found, above = Localizer(TOWN), [], 0
    for _, reading in sorted(arrivals, key=lambda a: a[0]):
        said = online.update(reading)
        if isinstance(reading, GeoFix) and reading.time > 30.0:
            there = float(np.interp(said.time, time, way))
            found.append(math.hypot(said.pose.x - there, said.pose.y))
            above += found[-1] > said.protection_level
    assert np.quantile(found, 0.95) < 0.3 * late
    assert above == 0
