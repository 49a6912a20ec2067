"""How far the map is off is learnt within the drive."""

import functools

import numpy as np
import pytest

from scenes import column, drive_along, epochs_of, gnss, localize, network, steps
from whichroad.filter.state import CLOCK, WHEELS
from whichroad.filter.summary.estimate import Output
from whichroad.settings import Settings

STREETS = [[[0.0, 0.0], [1500.0, 0.0]], [[1500.0, 0.0], [1500.0, 1500.0]],
           [[1500.0, 1500.0], [3000.0, 1500.0]], [[3000.0, 1500.0], [3000.0, 3000.0]]]  # fmt: skip
LINE = np.array([[100.0, 0.0], [1500.0, 0.0], [1500.0, 1500.0], [3000.0, 1500.0], [3000.0, 2900.0]])
DRIVE = drive_along(LINE + np.array([1.0, -1.75]))
EVERY = np.arange(0, len(DRIVE.time), 10)
FAR = EVERY[len(EVERY) // 2 :]  # epochs of the second half
REPORTED = 2.0  # m
FIXED = Settings().map_sigma


@functools.cache
def answer(off: float, under: float = 1.0, mode: int = WHEELS, smooth: bool = False) -> Output:
    """A drive on a map that is off by so much; errors are `under` times those reported."""
    roads = network([np.array(s) + off * np.array([0.6, 0.8]) for s in STREETS])
    fix = gnss(DRIVE, sigma=REPORTED * under, seed=3, constant=80.0)
    fix[:, 2:4] = REPORTED
    epochs = epochs_of(DRIVE, fix, EVERY)
    epochs = epochs[EVERY].copy() if mode == CLOCK else epochs
    found = localize(roads, epochs, mode=mode, lag="full" if smooth else None)
    return found.output


def nees(output: Output) -> float:
    """Mean squared error over its covariance, over the dimension, in the second half."""
    e = np.column_stack([output.rows.x - DRIVE.x, output.rows.y - DRIVE.y])[FAR]
    xx, xy, yy = (column(output, name)[FAR] for name in ("xx", "xy", "yy"))
    square = (yy * e[:, 0] ** 2 - 2 * xy * e[:, 0] * e[:, 1] + xx * e[:, 1] ** 2) / (
        xx * yy - xy**2
    )
    return float(square.mean() / 2.0)


def test_a_map_that_is_off_as_a_whole_is_found_to_be_so_and_pulls_nothing():
    output = answer(25.0)
    assert output.rows.map_scale[0] == 1.0
    assert 2.5 < output.rows.map_scale[-1] < 8.0
    assert nees(output) < 1.6
    far = np.hypot(output.rows.map_x - output.rows.x, output.rows.map_y - output.rows.y)[FAR]
    assert np.median(far) == pytest.approx(25.0, abs=6.0)


def test_a_good_map_is_believed_more_and_more():
    output = answer(0.0)
    scale = output.rows.map_scale
    assert (np.diff(scale[10:]) <= 1e-9).mean() > 0.95  # slowly, and hardly ever back
    assert 1.0 / FIXED <= scale[-1] < 0.7
    assert np.median(output.rows.protection_level[FAR]) < np.median(
        answer(25.0).rows.protection_level[FAR]
    )


def test_where_the_map_is_good_the_receiver_is_what_varies():
    """Its sigma is two times too small, and its error lasts too long for innovations to show it."""
    assert answer(0.0, 2.0).rows.gnss_scale[-1] > 1.3
    assert answer(0.0).rows.gnss_scale[-1] < 1.2


def test_an_offset_that_stays_is_the_maps_unless_the_receiver_varies_as_much():
    assert answer(4.0).rows.gnss_scale[-1] < 1.1
    assert answer(4.0, 2.0).rows.gnss_scale[-1] > 1.3


def test_of_a_receiver_alone_nothing_is_learnt():
    """A wrong road would explain itself by a bad map."""
    assert (answer(0.0, mode=CLOCK).rows.map_scale == 1.0).all()
    assert (answer(25.0, mode=CLOCK).rows.map_scale == 1.0).all()


def test_smoothing_knows_what_was_learnt():
    output = answer(25.0, smooth=True)
    assert nees(output) < 1.6
    assert output.rows.map_scale[-1] == answer(25.0).rows.map_scale[-1]


def bent(tilt: float) -> np.ndarray:
    """A line of 3 km that is turned to and fro by so much, over 300 m."""
    x = np.arange(0.0, 3001.0, 10.0)
    return np.column_stack([x, tilt * 300.0 / (2.0 * np.pi) * np.sin(2.0 * np.pi * x / 300.0)])


@functools.cache
def turned(tilt: float, spacing: float = 5.0) -> float:
    """The learnt factor on variances of headings, where the line is not driven as it is drawn."""
    drive = drive_along(np.array([[1.75, -400.0], [1.75, -1.75], [2980.0, -1.75]]))
    every = np.arange(0, len(drive.time), 10)
    epochs = epochs_of(drive, gnss(drive, sigma=REPORTED, seed=5, constant=80.0), every)
    roads = network([[[0.0, -420.0], [0.0, 0.0]], bent(tilt)])
    *_, (_, belief, _) = steps(roads, epochs, settings=Settings(map_spacing=spacing))
    return float(belief.state[0].map.heading_factor)


def test_headings_of_lines_that_are_turned_for_long_are_believed_less():
    assert turned(0.0) == 1.0
    assert turned(0.03) < 1.5
    assert turned(0.12) > 3.0


@pytest.mark.parametrize("spacing", [1.25, 10.0])
def test_how_far_lines_are_turned_does_not_depend_on_how_often_it_is_asked(spacing: float):
    assert turned(0.12, spacing) == pytest.approx(turned(0.12), rel=0.15)


def test_what_is_not_known_of_the_mean_lasts():
    """While it is learnt that the map is 25 m off, most of the variance is that of the mean."""
    roads = network([np.array(s) + 25.0 * np.array([0.6, 0.8]) for s in STREETS])
    fix = gnss(DRIVE, sigma=REPORTED, seed=3, constant=80.0)
    rate = [b.state[0].map.rate for _, b, _ in steps(roads, epochs_of(DRIVE, fix, EVERY))]
    assert rate[0] == 1.0
    assert min(rate) < 0.5


def test_of_odometry_that_has_not_turned_with_the_fixes_no_headings_are_learnt():
    drive = drive_along(np.array([[20.0, -1.75], [900.0, -1.75]]))
    every = np.arange(0, len(drive.time), 10)
    epochs = epochs_of(drive, gnss(drive, sigma=REPORTED, seed=5, constant=80.0), every)
    *_, (_, belief, _) = steps(network([bent(0.12)]), epochs)
    assert belief.state[0].map.heading_factor == 1.0
