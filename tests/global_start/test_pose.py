"""A start pose whose bearing is wrong."""

import numpy as np
import pytest

from scenes import Town, drive_along, epochs_of, gnss, grid_town, network
from whichroad.epochs import Timeline
from whichroad.filter.state import WHEELS
from whichroad.observations import StartPose
from whichroad.recorded import localize_recorded

from .wheels import PLANE

TURNED = drive_along([[230.0, 198.25], [401.75, 198.25], [401.75, 320.0]])


def started(bearing_deg: float, *, fixes: bool) -> np.recarray:
    """The drive from its start, with a pose of that bearing; it goes to the east at first."""
    roads = network(grid_town(7, 7, 100.0), curvature=PLANE.curvature)
    at = np.arange(0, len(TURNED.time), 10)
    epochs = epochs_of(TURNED, gnss(TURNED, sigma=3.0, seed=1), at)
    epochs.has_fix &= fixes
    lat, lon = PLANE.to_geodetic(float(TURNED.x[0]), float(TURNED.y[0]))
    return localize_recorded(
        Town(roads, PLANE), Timeline(epochs, WHEELS, 0),
        start=StartPose(float(lat), float(lon), bearing_deg),
    ).output.rows  # fmt: skip


def error(rows: np.recarray) -> np.ndarray:
    return np.hypot(rows.x - TURNED.x, rows.y - TURNED.y)


@pytest.mark.parametrize("bearing_deg", [0.0, 135.0, 270.0])
def test_with_fixes_a_wrong_bearing_is_found_out_soon(bearing_deg: float):
    rows = started(bearing_deg, fixes=True)
    assert error(rows)[TURNED.s > 60.0].max() < 15.0
    assert (np.cos(rows.heading - TURNED.heading)[TURNED.s > 60.0] > 0.9).all()


def test_a_right_bearing_is_believed():
    rows = started(90.0, fixes=False)
    assert error(rows).max() < 15.0
    assert rows.p_edge[5] > 0.95


def test_its_doubt_is_that_of_one_bearing_in_fifty():
    rows = started(90.0, fixes=False)
    assert 0.005 < 1.0 - rows.p_edge[5] < 0.03
