"""What is not measured while odometry is silent: it costs certainty, by time and way alone."""

import numpy as np
import pytest

import whichroad
from laws.public import CAR, DISTANCE, START, WHEELS, geo_fixes, readings, road_map
from scenes import drive_along

TRUTH = drive_along([[0.0, 0.0], [700.0, 0.0]], margin=20.0)
SILENT = (20.0, 45.0)  # s after the start
IN_STREET = [[[-100.0, 1.75], [900.0, 1.75]]]
IN_A_FIELD = [[[0.0, 5000.0], [100.0, 5000.0]]]  # nothing but dead reckoning
FIVE_PERCENT = 0.05


def sigmas(lines: list, mode: str, every: int, *, silent: bool = True) -> dict[str, np.ndarray]:
    """Sigma of the position eastwards and of the bearing at every second without GNSS.

    Args:
        lines: Streets.
        mode: The odometry.
        every: Epochs of 0.1 s from one epoch of the filter to the next, in the silence.
        silent: Whether the odometry is silent; else it is read at every such epoch.
    """
    n = len(TRUTH.time)
    quiet = (TRUTH.time > SILENT[0]) & (TRUTH.time < SILENT[1])
    beat = np.arange(n) % every == 0
    fix = np.column_stack([TRUTH.x, TRUTH.y, np.full((n, 2), 3.0), np.zeros(n)])
    at = np.flatnonzero(np.where(quiet, beat, np.arange(n) % 10 == 0))
    observed = geo_fixes(TRUTH, fix, at)
    observed += readings(TRUTH, mode, ~quiet if silent else ~quiet | beat)
    # fixes that are withheld are epochs of the filter, at which nothing is observed
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


@pytest.mark.xfail(
    strict=True, reason="its variance is a square of the metres of every epoch, added up"
)
@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("lines", [IN_STREET, IN_A_FIELD])
def test_unmeasured_distance_costs_the_same_however_often_it_is_asked_for(lines, every: int):
    often, seldom = (sigmas(lines, WHEELS, n)["east"] for n in (every, 10))
    np.testing.assert_allclose(often, seldom, rtol=FIVE_PERCENT)


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
@pytest.mark.parametrize("every", [1, 2])
def test_unmeasured_turns_cost_the_same_however_often_they_are_asked_for(mode, every: int):
    often, seldom = (sigmas(IN_A_FIELD, mode, n)["bearing"] for n in (every, 10))
    np.testing.assert_allclose(often, seldom, rtol=FIVE_PERCENT)


@pytest.mark.parametrize("every", [1, 2])
def test_measured_motion_costs_the_same_however_often_it_is_read(every: int):
    often, seldom = (sigmas(IN_A_FIELD, WHEELS, n, silent=False) for n in (every, 10))
    for name, value in often.items():
        np.testing.assert_allclose(value, seldom[name], rtol=FIVE_PERCENT)


@pytest.mark.parametrize(
    "mode",
    [
        WHEELS,
        pytest.param(DISTANCE, marks=pytest.mark.xfail(
            strict=True, reason="an odometer's distance counts as measured where it was bridged"
        )),
    ],
)  # fmt: skip
def test_unmeasured_distance_costs_more_than_measured(mode: str):
    silent, heard = (sigmas(IN_A_FIELD, mode, 10, silent=quiet)["east"] for quiet in (True, False))
    assert (silent[5:] > 1.2 * heard[5:]).all()
