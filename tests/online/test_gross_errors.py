"""A receiver that reports centimetres and is wrong by metres for a while: wrong integers."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from online.avenue import PLANE, TOWN
from online.test_late_fixes import CAR, SIGMA, bends, fixes, odometry
from whichroad.observations import GeoFix, WheelTicks
from whichroad.online import Localizer

WRONG = (50.0, 72.0)  # s
STEP = 0.05  # s
FLOAT = 0.5  # m, reported


class Answer(NamedTuple):
    """Beside each fix from the first wrong one on."""

    time: np.ndarray
    error: np.ndarray  # m
    level: np.ndarray


def answers(off_m: float, lost_m: float = 0.0, floats: bool = False) -> Answer:
    """Fixes are off for a while; wheels lose so much of the way at its beginning.

    Before that, the receiver may have lost its integers for 15 s, and tells so.
    """
    truth = bends()
    readings = list(odometry(truth, False))
    for k, one in enumerate(readings):
        assert isinstance(one, WheelTicks)
        lost = 100.0 * lost_m * min(max(one.time - WRONG[0], 0.0), 1.0)
        readings[k] = replace(one, left=one.left - lost, right=one.right - lost)
    for one in fixes(truth):
        moved = one
        if WRONG[0] <= one.time < WRONG[1]:
            x, y = PLANE.from_geodetic(one.lat_deg, one.lon_deg)
            lat, lon = PLANE.to_geodetic(x + 0.8 * off_m, y + 0.6 * off_m)
            moved = GeoFix.with_sigma(one.time, float(lat), float(lon), SIGMA)
        elif floats and WRONG[0] - 15.0 <= one.time < WRONG[0]:
            x, y = PLANE.from_geodetic(one.lat_deg, one.lon_deg)
            off = 0.4 * math.sin(0.1 * one.time)
            lat, lon = PLANE.to_geodetic(x + off, y - 0.5 * off)
            moved = GeoFix.with_sigma(one.time, float(lat), float(lon), FLOAT)
        readings.append(moved)
    localizer, rows = Localizer(TOWN, vehicle=CAR), []
    for reading in sorted(readings, key=lambda one: one.time):
        found = localizer.update(reading)
        if isinstance(reading, GeoFix) and reading.time >= WRONG[0]:
            row = round(found.time / STEP)
            off = math.hypot(found.pose.x - truth.x[row], found.pose.y - truth.y[row])
            rows.append((found.time, off, found.protection_level))
    return Answer(*np.array(rows).T)


@pytest.mark.parametrize("off_m", [0.5, 1.0, 3.0])
def test_fixes_that_jump_and_jump_back_move_the_place_little_and_are_covered(off_m: float):
    found = answers(off_m)
    assert not np.any(found.error > found.level)
    assert np.quantile(found.error, 0.9) < 0.3 * off_m
    after = found.time > WRONG[1] + 5.0
    assert np.max(found.error[after]) < 0.3
    assert np.median(found.level[after]) < 2.0


@pytest.mark.parametrize("off_m", [1.0, 2.0, 5.0])
def test_integers_that_are_fixed_wrongly_after_a_float_phase_are_covered(off_m: float):
    found = answers(off_m, floats=True)
    assert not np.any(found.error > found.level)
    assert np.max(found.error[found.time > WRONG[1] + 5.0]) < 0.3


def test_integers_that_are_fixed_rightly_after_a_float_phase_count_at_once():
    found = answers(0.0, floats=True)
    assert np.max(found.error) < 0.1
    assert np.median(found.level) < 1.0


def test_wheels_that_lose_some_of_the_way_are_covered_and_fixes_win_in_time():
    found = answers(0.0, lost_m=6.0)
    assert not np.any(found.error > found.level)
    assert np.max(found.error[found.time > WRONG[0] + 20.0]) < 0.3
