"""Odometry that pauses for a second or more while fixes of centimetres go on."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from online.avenue import CAR, PLANE, TOWN
from whichroad.observations import GeoFix, Observation, SpeedYaw, WheelSpeed, WheelTicks
from whichroad.online import Localizer
from whichroad.online.silence import learnt, lost_after, silent_after

BRAKES, PAUSE = 30.0, 1.9  # s


def speed(time: float) -> float:
    """It brakes from 6 to 2 m/s, just as the odometry pauses."""
    return max(6.0 - 2.0 * max(time - BRAKES, 0.0), 2.0)


def precise(x: float, time: float) -> GeoFix:
    lat, lon = PLANE.to_geodetic(x, -1.75)
    return GeoFix(time, lat, lon, 4e-4, 0.0, 4e-4)


def odometry(kind: type, time: float, way: float) -> Observation:
    if kind is WheelTicks:
        return WheelTicks(time, 100.0 * way, 100.0 * way)
    if kind is WheelSpeed:
        return WheelSpeed(time, speed(time), speed(time))
    return SpeedYaw(time, speed(time), 0.0)


def braking(kind: type, every: int = 2) -> Iterator[tuple[Observation, float]]:
    """Readings, and where the vehicle is: odometry each so many hundredths, fixes at 10 Hz."""
    noise, way = np.random.default_rng(3), 0.0
    for k in range(9000):
        time = 0.01 * k
        if k % every == 0 and not BRAKES <= time < BRAKES + PAUSE:
            yield odometry(kind, time, way), way
        if k % 10 == 5:
            yield precise(20.0 + way + noise.normal(0.0, 0.012), time), way
        way += 0.01 * speed(time)


@pytest.mark.parametrize("kind", [WheelSpeed, WheelTicks, SpeedYaw])
@pytest.mark.parametrize("every", [2, 10])
def test_motion_that_nobody_measured_does_not_win_against_precise_fixes(kind: type, every: int):
    online, errors, levels = Localizer(TOWN, vehicle=CAR), [], []
    for reading, way in braking(kind, every):
        said = online.update(reading)
        if isinstance(reading, GeoFix) and reading.time > 10.0:
            errors.append(abs(said.pose.x - 20.0 - way))
            levels.append(said.protection_level)
    assert max(errors) < 0.5
    assert np.all(np.less(errors, levels))
    assert levels[-1] < 1.0
    assert online.skipped == {}


def test_wheels_that_tell_speeds_again_tell_that_since_the_last_fix():
    """A fix at the end of the pause, and the first reading 20 ms later."""
    online = Localizer(TOWN, vehicle=CAR)
    for reading, _ in braking(WheelSpeed):
        if isinstance(reading, WheelSpeed) and reading.time >= BRAKES + PAUSE:
            break
        before = online.update(reading)
    after = online.update(reading)
    metres = after.pose.x - before.pose.x
    assert metres == pytest.approx(speed(reading.time) * (reading.time - before.time), abs=0.01)


def test_a_sensor_is_silent_after_some_of_its_own_intervals():
    assert 0.1 < silent_after(0.02) < 0.5
    assert 0.3 < silent_after(0.1) < 1.0  # two readings in a row may be lost
    assert silent_after(1.0) >= 2.5
    assert silent_after(0.0) == 2.0  # not known yet
    assert all(silent_after(0.01 * k) <= lost_after(0.01 * k) for k in range(500))


def test_a_silence_hardly_changes_what_is_usual_and_another_rate_is_learnt():
    usual = learnt(0.02, 300.0)
    for _ in range(20):
        usual = learnt(usual, 0.02)
    assert silent_after(usual) == silent_after(0.02)
    for _ in range(40):
        usual = learnt(usual, 10.0)
    assert silent_after(usual) > 10.0
    assert math.isclose(learnt(0.0, 5.0), 5.0)
