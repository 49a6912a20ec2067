"""A slow road beside a fast one, by fixes seconds apart: how fast it drives tells neither."""

from functools import cache

import numpy as np
import pytest

import whichroad
from demands.town import PLANE
from whichroad.simulate import MapBuilder

GAP, SIGMA, EVERY = 15.0, 8.0, 10.0  # m, m, s
LENGTH, SPEED = 8000.0, 13.0  # m, m/s


@cache
def roads() -> whichroad.RoadMap:
    """A motorway eastwards, and a road beside it with which it is joined every 2 km."""
    builder = MapBuilder()
    names = [f"{k}" for k in range(5)]
    for k, name in enumerate(names):
        builder.node(f"fast {name}", k * LENGTH / 4, 0.0)
        builder.node(f"slow {name}", k * LENGTH / 4 + 300.0, -GAP)
        builder.node(f"south {name}", k * LENGTH / 4 + 300.0, -300.0)
        builder.way([f"slow {name}", f"south {name}"], "residential", maxspeed="30")
        builder.way([f"fast {name}", f"slow {name}"], "motorway_link", maxspeed="60", oneway="yes")
    builder.way([f"fast {n}" for n in names], "motorway", maxspeed="100", oneway="yes", name="Fast")
    builder.way([f"slow {n}" for n in names], "tertiary", maxspeed="50", name="Slow")
    return builder.compiled()


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("road", ["Fast", "Slow"])
def test_fixes_decide_between_a_jammed_motorway_and_the_road_beside_it(road, lag):
    """For 150 s fixes are 12 m beside the vehicle, towards the other road; then they are exact."""
    time = np.arange(0.0, 540.0, EVERY)
    x = 800.0 + SPEED * time
    off = np.where(time < 150.0, 12.0, 0.0)
    y = -off - 1.7 if road == "Fast" else off - GAP - 1.7
    lat, lon = PLANE.to_geodetic(x, y)
    sigma = np.full(len(time), SIGMA)
    table = {"time": 1.6e9 + time, "lat": lat, "lon": lon, "sigma_m": sigma}
    points = whichroad.match(table, roads(), lag=lag).points
    names = np.array([roads().attributes(int(e)).get("name") for e in points.edge_id])
    assert (names[-5:] == road).all()
    assert (points.p_road[-5:] > 0.8).all()
    assert not (points.p_road[names != road] >= 0.99).any()
