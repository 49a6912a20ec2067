"""Odometry of a recorded drive that is wrong throughout, as strangers' tables are."""

from functools import partial

import numpy as np
import pytest

from whichroad.geodesy.plane import Plane
from whichroad.observations import Fixes
from whichroad.sensors.odometry import Motion
from whichroad.sensors.whole_columns import BACKWARDS, STANDS, TURNLESS, less_wrong

N = 600
checked = partial(less_wrong, plane=Plane(49.4, 8.7))


def fixes_of(metres: float, bends: float = 0.0) -> Fixes:
    """A fix a second, along a meridian or to and fro beside it, with errors of some metres."""
    random = np.random.default_rng(1)
    time = np.arange(float(N))
    lat = 49.4 + (metres * time / N + random.normal(0.0, 3.0, N)) / 111_000.0
    lon = 8.7 + bends * np.abs((time / N * 4.0) % 2.0 - 1.0) / 72_000.0
    nan = np.full(N, np.nan)
    cov = np.full(N, 9.0)
    return Fixes(time, lat, lon, cov, 0.0 * cov, cov, nan, nan, nan, nan, np.zeros(N, np.uint8))


def motion_of(metres: float, turned: float = 1.0) -> Motion:
    """As far, with bends."""
    time = np.arange(float(N))
    return Motion(time, metres * time / N, turned * np.sin(time / 20.0))


@pytest.mark.parametrize("metres", [0.0, 3000.0])
def test_sound_odometry_stays_as_it_is(metres: float):
    motion = motion_of(metres)
    assert checked(motion, fixes_of(metres)) == (motion, ())


def test_odometry_that_is_0_while_the_fixes_move_is_left_out():
    assert checked(motion_of(0.0, 0.0), fixes_of(3000.0)) == (None, (STANDS,))


@pytest.mark.parametrize("fixes", [None, fixes_of(0.0), fixes_of(100.0)])
def test_without_fixes_that_move_nothing_is_known(fixes: Fixes | None):
    motion = motion_of(0.0, 0.0)
    assert checked(motion, fixes) == (motion, ())


def test_odometry_of_a_stop_alone_says_nothing_of_what_was_driven_before():
    stop = Motion(np.arange(600.0, 700.0), np.zeros(100), np.zeros(100))
    assert checked(stop, fixes_of(3000.0)) == (stop, ())


def test_distances_that_count_backwards_are_turned_about():
    right = motion_of(3000.0)
    motion, wrong = checked(motion_of(-3000.0), fixes_of(3000.0))
    assert wrong == (BACKWARDS,)
    assert motion is not None
    assert np.array_equal(motion.distance, right.distance)
    assert np.array_equal(motion.turn, right.turn)  # a gyro's is right; wheels' are looked at


def test_who_backs_for_a_part_of_the_drive_does_so():
    motion = motion_of(3000.0)
    way = np.interp(motion.time, [0.0, 100.0, 599.0], [0.0, -150.0, 2500.0])
    motion = motion._replace(distance=way)
    assert checked(motion, fixes_of(3000.0)) == (motion, ())


def test_turns_that_are_never_measured_are_no_turns():
    motion, wrong = checked(motion_of(-3000.0, 0.0), fixes_of(3000.0, 700.0))
    assert wrong == (BACKWARDS, TURNLESS)
    assert motion is not None
    assert motion.turn is None
    assert checked(motion_of(3000.0, 0.0), fixes_of(3000.0))[1] == ()  # there are no bends


def test_a_receiver_that_jumps_away_and_back_has_not_turned():
    fixes = fixes_of(3000.0)
    fixes.lon_deg[200:300] += 200.0 / 72_000.0
    motion = motion_of(3000.0, 0.0)
    assert checked(motion, fixes) == (motion, ())
