"""Speed and course of a receiver alone: late, and wrong at times."""

import math

import numpy as np
import pytest

from scenes import drive_along, epochs_of, gnss, grid_town, network, steps
from whichroad._compile import Records, jit
from whichroad.filter import reported_motion
from whichroad.filter.state import CLOCK, H, K

TOWN = network(grid_town())
BLOCKS = [(0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (3, 2), (3, 3), (4, 3), (4, 4)]
DRIVE = drive_along([(120 * i, 120 * j) for i, j in BLOCKS])
EVERY = np.arange(0, len(DRIVE.time), round(1.0 / (DRIVE.time[1] - DRIVE.time[0])))
latency_of = jit(reported_motion.latency_of)


def reports(late: float, sigma: float) -> Records:
    """Fixes with speed and course as they were `late` seconds ago."""
    epochs = epochs_of(DRIVE, gnss(DRIVE, sigma=2.0, seed=1), EVERY)[EVERY].copy()
    when = DRIVE.time[EVERY] - late
    heading = np.interp(when, DRIVE.time, np.unwrap(DRIVE.heading))
    epochs.course, epochs.course_sigma = np.angle(np.exp(1j * heading)), 0.05
    speed = np.gradient(DRIVE.s, DRIVE.time)
    epochs.speed, epochs.speed_sigma = np.interp(when, DRIVE.time, speed), sigma
    return epochs


@pytest.mark.parametrize("late", [0.0, 0.5, 1.0, 2.0])
def test_courses_in_turns_show_how_late_they_are(late: float):
    """A corner takes some seconds, so that two seconds show as one at least."""
    *_, (_, belief, _) = steps(TOWN, reports(late, 0.5), mode=CLOCK)
    assert min(late, 1.3) - 0.5 < latency_of(belief.state[0]) < late + 0.5


@pytest.mark.parametrize("late", [0.0, 1.0])
def test_late_courses_without_a_sigma_keep_the_road_that_is_driven(late: float):
    off = [
        math.hypot(output.rows.x[k] - DRIVE.x[EVERY[k]], output.rows.y[k] - DRIVE.y[EVERY[k]])
        for k, _, output in steps(TOWN, reports(late, 0.5), mode=CLOCK)
    ]
    assert np.sqrt(np.mean(np.square(off))) < 6.0


def test_a_zero_while_driving_stops_nobody():
    epochs = reports(0.0, 0.5)
    moving = np.flatnonzero(epochs.speed > 8.0)[5::10]
    epochs.speed[moving] = 0.0
    speed = {}
    for k, belief, _ in steps(TOWN, epochs, mode=CLOCK):
        top = belief.hyp[: belief.state[0].count]
        speed[k] = float(top["mu"][np.argmax(top.weight), K])
        assert np.isfinite(top["mu"][:, H]).all()
    assert min(speed[k] for k in moving) > 4.0
