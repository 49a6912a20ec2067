"""Fixes of a hundred metres, seconds apart: more ways are likely than hypotheses follow."""

from functools import cache

import numpy as np
import pytest

import whichroad
from demands import town
from demands.town import PLANE, along, fixes
from whichroad.simulate import MapBuilder

BLOCK, SIDE = 70.0, 20  # m, crossings
TURNS = [(2, 9), (9, 9), (9, 5), (14, 5), (14, 12), (6, 12), (6, 16), (17, 16)]


@cache
def roads() -> whichroad.RoadMap:
    """Twenty by twenty crossings."""
    builder = MapBuilder()
    for r in range(SIDE):
        for c in range(SIDE):
            builder.node(f"{r} {c}", c * BLOCK, r * BLOCK)
    for k in range(SIDE):
        builder.way([f"{k} {c}" for c in range(SIDE)], "residential")
        builder.way([f"{r} {k}" for r in range(SIDE)], "residential")
    return builder.compiled()


@pytest.mark.parametrize("lag", [None, "full"])
def test_the_level_reaches_the_ways_that_are_not_followed(lag):
    way = np.array(TURNS) * BLOCK
    over, rows = 0, 0
    for seed in range(6):
        table = fixes(way, speed=8.0, every=10.0, sigma=100.0, seed=seed, white=True)
        _, place = along(way, 8.0, 10.0)
        points = whichroad.match(table, roads(), lag=lag).points
        x, y = PLANE.from_geodetic(points.lat.to_numpy(), points.lon.to_numpy())
        error = np.hypot(x - place[:, 0], y - place[:, 1])
        over += int((error > points.protection_level_m.to_numpy()).sum())
        rows += len(points)
    assert over <= 0.01 * rows


@pytest.mark.parametrize("lag", [None, "full"])
def test_what_was_dropped_is_forgotten_once_fine_fixes_come_often(lag):
    """Fixes of 100 m each 10 s, and from 150 s on of 4 m each second."""
    time, place = along(np.array(TURNS) * BLOCK, 8.0, 1.0)
    coarse = time < 150.0
    used = ~coarse | (np.arange(len(time)) % 10 == 0)
    sigma = np.where(coarse, 100.0, 4.0)
    random = np.random.default_rng(1)
    lat, lon = PLANE.to_geodetic(*(place + sigma[:, None] * random.normal(size=place.shape)).T)
    table = {"time": 1.6e9 + time, "lat": lat, "lon": lon, "sigma_m": sigma}
    points = whichroad.match({n: v[used] for n, v in table.items()}, roads(), lag=lag).points
    fine = points[-200:]
    assert fine.p_off_road.max() < 0.1
    assert fine.protection_level_m.median() < 40.0


@pytest.mark.parametrize(("lag", "least"), [(None, 0.85), ("full", 0.72)])
def test_ellipses_hold_a_vehicle_that_drives_on_by_fixes_of_two_hundred_metres(lag, least: float):
    """Who stands is on one road, who drives may be on any of hundreds: neither gains by that."""
    way = np.array(TURNS) * BLOCK
    inside = []
    for seed in range(8):
        table = fixes(way, speed=8.0, every=5.0, sigma=200.0, seed=seed, white=True)
        _, place = along(way, 8.0, 5.0)
        points = whichroad.match(table, roads(), lag=lag).points
        x, y = PLANE.from_geodetic(points.lat.to_numpy(), points.lon.to_numpy())
        dx, dy = np.array([x, y]) - place.T
        xx, xy, yy = points.cov_ee_m2, points.cov_en_m2, points.cov_nn_m2
        chi2 = (dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx) / (xx * yy - xy * xy)
        inside.append(chi2 < 5.99)
    assert np.mean(inside) > least


ROUND = [
    "00",
    "02",
    "22",
    "20",
    "40",
    "44",
    "24",
    "22",
    "02",
    "04",
    "44",
    "40",
    "10",
    "14",
    "34",
    "30",
    "00",
    "04",
    "24",
    "20",
    "40",
    "42",
    "12",
    "10",
    "30",
    "33",
    "03",
    "00",
]


@pytest.mark.parametrize("every", [1.0, 5.0, 10.0])
@pytest.mark.parametrize("sigma", [80.0, 150.0])
def test_places_are_surer_than_honest_fixes_of_a_hundred_metres(sigma: float, every: float):
    way = town.corners(*ROUND)
    _, place = along(way, 9.0, every)
    error, fix, inside = [], [], []
    for seed in range(4):
        table = fixes(way, speed=9.0, every=every, sigma=sigma, seed=seed, white=True)
        points = whichroad.match(table, town.roads()).points
        x, y = PLANE.from_geodetic(points.lat.to_numpy(), points.lon.to_numpy())
        dx, dy = np.array([x, y]) - place.T
        error.append(np.hypot(dx, dy))
        fix.append(np.hypot(*(np.array(PLANE.from_geodetic(table["lat"], table["lon"])) - place.T)))
        xx, xy, yy = points.cov_ee_m2, points.cov_en_m2, points.cov_nn_m2
        chi2 = (dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx) / (xx * yy - xy * xy)
        inside.append(chi2 < 5.99)
        assert (np.hypot(dx, dy) < points.protection_level_m).mean() > 0.995
    assert np.square(error).mean() < 0.7**2 * np.square(fix).mean()
    assert np.mean(inside) > 0.87


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("coarse", [60.0, 200.0])
def test_coarse_fixes_between_fine_ones_do_not_make_these_less_sure(coarse: float, lag):
    """A phone that tells its receiver's place and the network's by turns."""
    way = town.corners(*ROUND)
    time, place = along(way, 9.0, 1.0)
    sigma = np.where(np.arange(len(time)) % 2, coarse, 5.0)
    for seed in range(3):
        error = np.random.default_rng(seed).normal(size=place.shape) * sigma[:, None]
        lat, lon = PLANE.to_geodetic(*(place + error).T)
        table = {"time": 1.6e9 + time, "lat": lat, "lon": lon, "sigma_m": sigma}
        points = whichroad.match(table, town.roads(), lag=lag).points
        x, y = PLANE.from_geodetic(points.lat.to_numpy(), points.lon.to_numpy())
        off = np.hypot(x - place[:, 0], y - place[:, 1])
        assert np.median(off) < 5.0
        assert (off > points.protection_level_m).mean() < 0.005
        assert points.protection_level_m.median() < 50.0
