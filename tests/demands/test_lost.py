"""A vehicle that is lost: the fixes that are not believed may be right, and the level says so."""

import numpy as np
import pytest

from demands.town import PLANE, corners, fixes, roads
from whichroad import match


@pytest.mark.parametrize("lag", [None, "full"])
def test_the_level_of_who_is_lost_reaches_to_the_fix_that_is_not_believed(lag):
    """Six fixes are 500 m away, those after them on the way of before."""
    table = fixes(corners("20", "24", "34", "30"), speed=8.0)
    x, y = PLANE.from_geodetic(table["lat"], table["lon"])
    away = np.zeros(len(x))
    away[len(x) // 2 :][:6] = 1.0
    x, y = x + 400.0 * away, y - 300.0 * away
    table["lat"], table["lon"] = PLANE.to_geodetic(x, y)
    points = match(table, roads(), lag=lag).points
    px, py = PLANE.from_geodetic(points.lat.to_numpy(), points.lon.to_numpy())
    lost = (points.status == "lost").to_numpy()
    assert lost.sum() >= 2
    far = np.hypot(px - x, py - y)[lost]
    assert far.max() > 100.0
    assert (points.protection_level_m.to_numpy()[lost] > far).all()
