"""A receiver alone: how much larger than reported its errors are taken to be."""

import math

import numpy as np
import pytest

from scenes import column, drive_along, epochs_of, gnss, localize, network, parallel_roads
from whichroad._compile import Records
from whichroad.filter.state import CLOCK, DISTANCE, WHEELS
from whichroad.filter.summary.estimate import Output
from whichroad.settings import Settings

ROADS = network(parallel_roads(60.0, 5000.0))
DRIVE = drive_along([[200.0, -1.75], [4200.0, -1.75]])
EVERY = np.arange(0, len(DRIVE.time), round(1.0 / (DRIVE.time[1] - DRIVE.time[0])))
REPORTED = 3.0  # m
WIDE = Settings(gnss_inflation=2.5)


def fixes(under: float, seed: int, mode: int = CLOCK) -> Records:
    """A drive along the lower one of two roads; errors are `under` times those reported."""
    fix = gnss(DRIVE, sigma=REPORTED * under, seed=seed, constant=30.0)
    fix[:, 2:4] = REPORTED
    epochs = epochs_of(DRIVE, fix, EVERY)
    return epochs[EVERY].copy() if mode == CLOCK else epochs


def share_inside(output: Output) -> float:
    """Share of the epochs whose 95 % ellipse holds the vehicle."""
    ex, ey = output.rows.x - DRIVE.x[EVERY], output.rows.y - DRIVE.y[EVERY]
    xx, xy, yy = (column(output, name) for name in ("xx", "xy", "yy"))
    nees = (yy * ex**2 - 2.0 * xy * ex * ey + xx * ey**2) / (xx * yy - xy**2)
    return float(np.mean(nees[30:] < 5.99))


def test_it_begins_inflated_and_only_roads_make_the_factor_smaller():
    last = {}
    for under in (1.0, 2.5):
        scale = [
            localize(ROADS, fixes(under, seed), settings=WIDE, mode=CLOCK).output.rows.gnss_scale
            for seed in range(12)
        ]
        for drive in scale:
            assert drive[0] == pytest.approx(WIDE.gnss_inflation)
            assert drive.max() <= WIDE.gnss_inflation + 1e-9
        last[under] = float(np.mean([drive[len(drive) // 2 :] for drive in scale]))
    assert last[1.0] < 1.6
    assert last[2.5] > last[1.0] + 0.5


def test_errors_twice_as_large_as_reported_are_inside_of_the_ellipse():
    """Twelve drives each; a receiver that is taken at its word leaves a third outside."""
    inside = {}
    for inflation in (1.0, 2.5):
        settings = Settings(gnss_inflation=inflation)
        inside[inflation] = np.mean(
            [
                share_inside(localize(ROADS, fixes(2.0, k), settings=settings, mode=CLOCK).output)
                for k in range(12)
            ]
        )
    assert inside[1.0] < 0.75
    assert inside[2.5] > 0.9


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
def test_with_odometry_it_says_nothing(mode: int):
    settings = (Settings(gnss_inflation=1.0), Settings(gnss_inflation=10.0))
    answers = [localize(ROADS, fixes(1.0, 0, mode), settings=s, mode=mode).output for s in settings]
    np.testing.assert_array_equal(answers[0].rows.x, answers[1].rows.x)
    np.testing.assert_array_equal(answers[0].rows.gnss_scale, answers[1].rows.gnss_scale)


def test_whoever_was_led_onto_the_wrong_road_finds_back():
    """For 40 s the fixes are on the other road, 60 m away: twenty times what is reported."""
    epochs = fixes(1.0, 1)
    epochs.fix[60:100, 1] += 60.0
    output = localize(ROADS, epochs, settings=WIDE, mode=CLOCK).output
    off = np.abs(output.rows.y - DRIVE.y[EVERY])
    assert off[95] > 30.0
    assert (off[140:] < 15.0).all()


def test_what_roads_showed_is_forgotten_where_the_receiver_gets_worse():
    """Half an hour under open sky, then a street canyon."""
    drive = drive_along([[200.0, -1.75], [19_800.0, -1.75]])
    every = np.arange(0, len(drive.time), round(1.0 / (drive.time[1] - drive.time[0])))
    fix = gnss(drive, sigma=REPORTED, seed=5, constant=30.0)
    worse = drive.time > 0.6 * drive.time[-1]
    fix[worse, :2] += 3.0 * (fix[worse, :2] - np.column_stack([drive.x, drive.y])[worse])
    fix[:, 2:4] = REPORTED
    epochs = epochs_of(drive, fix, every)[every].copy()
    roads = network(parallel_roads(60.0, 20_000.0))
    scale = localize(roads, epochs, settings=WIDE, mode=CLOCK).output.rows.gnss_scale
    before = scale[int(0.59 * len(scale))]
    assert before < 1.5
    assert scale[-1] > 1.3 * before
    assert math.isfinite(scale[-1])
