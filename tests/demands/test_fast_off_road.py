"""A road that the map lacks, or a railway, driven fast by fixes far apart."""

import numpy as np
import pytest

import whichroad
from demands.town import PLANE, roads

SIGMA = 4.0  # m


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize(
    ("speed", "every"), [(25.0, 5.0), (25.0, 10.0), (40.0, 10.0), (25.0, 30.0)]
)
def test_a_vehicle_that_leaves_the_map_fast_is_at_its_fixes(speed, every, lag):
    """For ten fixes it drives in slow bends, away from the town."""
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 60.0 + 10.0 * every, every)
    slow = np.minimum(time, 60.0)
    way = np.maximum(time - 60.0, 0.0) * speed
    x = 600.0 + way + 2.0 * np.sin(way / 300.0)
    y = 10.0 * slow + 60.0 * (1.0 - np.cos(way / 400.0))
    truth = np.column_stack([x, y])
    seen = truth + rng.normal(0.0, 0.5 * SIGMA, truth.shape)
    lat, lon = PLANE.to_geodetic(*seen.T)
    sigma = np.full(len(time), SIGMA)
    table = {"time": 1.6e9 + time, "lat": lat, "lon": lon, "sigma_m": sigma}
    points = whichroad.match(table, roads(), lag=lag).points
    at = np.column_stack(PLANE.from_geodetic(points.lat, points.lon))
    error = np.hypot(*(at - truth).T)
    off = time > 60.0 + 2.0 * every  # once two fixes have shown that it has left the map
    assert error[off].max() < 4.0 * SIGMA
    assert (error < points.protection_level_m).all()
    assert (points.status[off] == "off_road").all()
    if every < 30.0:
        last = points.speed_mps.iloc[-3:]
        assert last.between(0.6 * speed, 1.2 * speed).all()
