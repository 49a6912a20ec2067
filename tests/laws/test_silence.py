"""Process noise of unmeasured motion depends on distance and time, not on the epoch rate."""

import numpy as np
import pytest

import whichroad
from laws.public import CAR, DISTANCE, START, WHEELS, geo_fixes, readings, road_map
from scenes import drive_along

TRUTH = drive_along([[0.0, 0.0], [700.0, 0.0]], margin=20.0)
SILENT = (20.0, 45.0)  # s after the start
IN_STREET = [[[-100.0, 1.75], [900.0, 1.75]]]
IN_A_FIELD = [[[0.0, 900.0], [100.0, 900.0]]]  # dead reckoning only
FIVE_PERCENT = 0.05


def sigmas(lines: list, mode: str, every: int, *, silent: bool = True) -> dict[str, np.ndarray]:
    """Sigma of the position eastwards and of the bearing at every second without GNSS.

    Args:
        lines: Streets.
        mode: The odometry.
        every: Interval between epochs of the filter during the outage, units of 0.1 s.
        silent: Whether odometry is missing during the outage; else it is read at every epoch.
    """
    n = len(TRUTH.time)
    quiet = (TRUTH.time > SILENT[0]) & (TRUTH.time < SILENT[1])
    beat = np.arange(n) % every == 0
    fix = np.column_stack([TRUTH.x, TRUTH.y, np.full((n, 2), 3.0), np.zeros(n)])
    at = np.flatnonzero(np.where(quiet, beat, np.arange(n) % 10 == 0))
    observed = geo_fixes(TRUTH, fix, at)
    observed += readings(TRUTH, mode, ~quiet if silent else ~quiet | beat)
    # masked fixes are epochs of the filter without an observation
    result = whichroad.match(
        observed, road_map(lines), vehicle=CAR, mask=[(SILENT[0] + 0.05, SILENT[1] - 0.05)]
    )
    points = result.to_arrow()
    seconds = points["time"].cast("int64").to_numpy() * 1e-6 - START
    row = np.searchsorted(seconds, np.arange(SILENT[0] + 1.0, SILENT[1]) - 1e-3)
    return {
        "east": np.sqrt(points["cov_ee_m2"].to_numpy()[row]),
        "bearing": points["sigma_bearing_deg"].to_numpy()[row],
    }


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("lines", [IN_STREET, IN_A_FIELD])
def test_noise_of_unmeasured_distance_does_not_depend_on_the_epoch_rate(lines, every: int):
    often, seldom = (sigmas(lines, WHEELS, n)["east"] for n in (every, 10))
    np.testing.assert_allclose(often, seldom, rtol=FIVE_PERCENT)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@pytest.mark.parametrize("every", [1, 2])
def test_noise_of_unmeasured_turns_does_not_depend_on_the_epoch_rate(mode, every: int):
    often, seldom = (sigmas(IN_A_FIELD, mode, n)["bearing"] for n in (every, 10))
    np.testing.assert_allclose(often, seldom, rtol=FIVE_PERCENT)


@pytest.mark.parametrize("every", [1, 2])
def test_noise_of_measured_motion_does_not_depend_on_the_odometry_rate(every: int):
    often, seldom = (sigmas(IN_A_FIELD, WHEELS, n, silent=False) for n in (every, 10))
    for name, value in often.items():
        np.testing.assert_allclose(value, seldom[name], rtol=FIVE_PERCENT)


def test_unmeasured_distance_adds_more_noise_than_measured_distance():
    silent, heard = (
        sigmas(IN_A_FIELD, WHEELS, 10, silent=quiet)["east"] for quiet in (True, False)
    )
    assert (silent[5:] > 1.2 * heard[5:]).all()


def test_an_odometer_that_is_read_again_has_measured_the_distance_in_between():
    silent, heard = (
        sigmas(IN_A_FIELD, DISTANCE, 10, silent=quiet)["east"] for quiet in (True, False)
    )
    np.testing.assert_allclose(silent, heard, rtol=FIVE_PERCENT)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
def test_dead_reckoning_off_the_roads_is_an_outage_and_with_fixes_off_road(mode: str):
    fix = np.column_stack(
        [TRUTH.x, TRUTH.y, np.full((len(TRUTH.time), 2), 3.0), np.zeros(len(TRUTH.time))]
    )
    observed = geo_fixes(TRUTH, fix, np.arange(0, len(TRUTH.time), 10))
    observed += readings(TRUTH, mode)
    result = whichroad.match(observed, road_map(IN_A_FIELD), vehicle=CAR, mask=[SILENT])
    points = result.to_arrow()
    seconds = points["time"].cast("int64").to_numpy() * 1e-6 - START
    status = np.array(points["status"].to_pylist())
    assert (points["p_off_road"].to_numpy() > 0.99).all()
    silent = (seconds > SILENT[0] + 5.0) & (seconds < SILENT[1])
    heard = (seconds > 5.0) & (seconds < SILENT[0])
    assert set(status[silent]) == {"outage"}
    assert set(status[heard]) == {"off_road"}
