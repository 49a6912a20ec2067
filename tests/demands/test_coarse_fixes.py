"""Fixes of a hundred metres, seconds apart: more ways are likely than hypotheses follow."""

from functools import cache

import numpy as np
import pytest

import whichroad
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
