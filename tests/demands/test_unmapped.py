"""A road that the map lacks leaves a mapped one by a few degrees: nothing turns, and fixes tell."""

from functools import cache

import numpy as np
import pytest

import whichroad
from demands.town import PLANE, fixes
from whichroad.simulate import MapBuilder

LENGTH, FORK, ON = 2400.0, 900.0, 1200.0  # m of the road, to where it is left, and from there on
SLOPE = np.deg2rad(4.0)


@cache
def road() -> whichroad.RoadMap:
    """A straight road eastwards, with side streets southwards."""
    builder = MapBuilder()
    names = []
    for k in range(7):
        names.append(f"{k}")
        builder.node(f"{k}", k * LENGTH / 6.0, 0.0)
    builder.way(names, "secondary", name="Road")
    for k in (1, 3, 5):
        builder.node(f"south {k}", k * LENGTH / 6.0, -300.0)
        builder.way([f"{k}", f"south {k}"], "residential", name=f"Street {k}")
    return builder.compiled()


def left(seed: int, doppler: bool) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """A drive along the road and off it; true places (n,), m, plane."""
    end = FORK + ON * np.cos(SLOPE), ON * np.sin(SLOPE)
    line = [[20.0, -1.7], [FORK, -1.7], end]
    table = fixes(line, speed=14.0, sigma=2.5, seed=seed)
    way = 14.0 * (table["time"] - table["time"][0])
    beyond = np.maximum(way - (FORK - 20.0), 0.0)
    if doppler:
        table["speed_mps"] = np.full(len(way), 14.0)
        table["speed_sigma_mps"] = np.full(len(way), 0.2)
        table["course_deg"] = 90.0 - np.where(beyond > 0.0, 4.0, 0.0)
    x = 20.0 + np.minimum(way, FORK - 20.0) + beyond * np.cos(SLOPE)
    return table, x, -1.7 + beyond * np.sin(SLOPE)


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("doppler", [True, False], ids=["doppler", "positions"])
def test_who_is_drawn_to_a_mapped_road_is_not_sure_of_it_and_covered_by_the_level(lag, doppler):
    """The map and the receiver may err by so much; as likely the map lacks the road."""
    for seed in range(3):
        table, x, y = left(seed, doppler)
        points = whichroad.match(table, road(), lag=lag).points
        px, py = PLANE.from_geodetic(points.lat.to_numpy(), points.lon.to_numpy())
        error = np.hypot(px - x, py - y)
        over = error > points.protection_level_m.to_numpy()
        assert over.mean() <= 0.02, seed
        assert np.median(error[y > 60.0]) < 15.0, seed
        far = y > 30.0
        assert points.p_road.to_numpy()[far].max() < 0.99, seed
        assert np.median(points.p_off_road.to_numpy()[y > 45.0]) > 0.5, seed
        assert np.median(points.p_road.to_numpy()[(x > 200.0) & (x < FORK)]) > 0.99, seed
