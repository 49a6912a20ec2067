"""Odometry that comes after a fix of its own time says what it says before it, to the bit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from online.avenue import CAR, TOWN
from scenes import drive_along
from whichroad.live.reorder_buffer import ReorderBuffer
from whichroad.observations import (
    Distance,
    GeoFix,
    Observation,
    SensorReading,
    SpeedYaw,
    WheelSpeed,
    WheelTicks,
    YawRate,
)  # fmt: skip
from whichroad.online import Localizer
from whichroad.sensors import Compass

EVERY = 10  # of the drive's steps, between rows
BEND = drive_along([[20.0, -1.75], [700.0, -1.75], [700.0, 60.0]])


def odometry(kind: type) -> list[Observation]:
    """A reading each second."""
    out: list[Observation] = []
    for k in range(EVERY, len(BEND.time), EVERY):
        time, s, before = float(BEND.time[k]), float(BEND.s[k]), float(BEND.s[k - EVERY])
        rate = float(BEND.heading[k] - BEND.heading[k - EVERY])
        if kind is WheelTicks:
            half = 75.0 * float(BEND.heading[k] - BEND.heading[0])
            out.append(WheelTicks(time, 100.0 * s - half, 100.0 * s + half))
        elif kind is WheelSpeed:
            out.append(WheelSpeed(time, s - before - 0.75 * rate, s - before + 0.75 * rate))
        elif kind is SpeedYaw:
            out.append(SpeedYaw(time, s - before, rate))
        else:
            out.append(Distance(time, s))
    return out


def told() -> list[Observation]:
    """A fix at each reading of odometry."""
    rng, out = np.random.default_rng(4), []
    for k in range(EVERY, len(BEND.time), EVERY):
        x, y = BEND.x[k] + rng.normal(0.0, 2.0), BEND.y[k] + rng.normal(0.0, 2.0)
        lat, lon = TOWN.plane.to_geodetic(x, y)
        out.append(GeoFix(float(BEND.time[k]), lat, lon, cov_ee=4.0, cov_en=0.0, cov_nn=4.0))
    return out


def compass() -> list[Observation]:
    return [
        SensorReading(one.time, {"compass_deg": 90.0 - 5.0 * (one.time > 60.0)})
        for one in told()[::3]
    ]


def last_first(*streams: list[Observation]) -> list[Observation]:
    """All by time; of one time those of the last stream first."""
    numbered = [(one.time, -k, one) for k, stream in enumerate(streams) for one in stream]
    return [one for *_, one in sorted(numbered, key=lambda row: row[:2])]


def moments(online: Any, observations: list[Observation]) -> dict[float, str]:
    """What is known after all of each time."""
    said = {}
    for one in observations:
        online.take(one)
        lagged = repr(online.lagged()) if online.lag else ""
        said[one.time] = repr((online.estimate(), online.predict(one.time + 2.0), lagged))
    return said


@pytest.mark.parametrize("lag", [None, 5.0])
@pytest.mark.parametrize("kind", [WheelTicks, WheelSpeed, SpeedYaw, Distance])
def test_odometry_after_a_fix_of_its_time_says_what_it_says_before(kind: type, lag: float | None):
    first, second = (Localizer(TOWN, vehicle=CAR, lag=lag) for _ in range(2))
    wanted = moments(first, last_first(told(), odometry(kind)))
    assert moments(second, last_first(odometry(kind), told())) == wanted
    assert second.skipped == first.skipped
    assert [one.what for one in second.diagnosis] == [one.what for one in first.diagnosis]


def test_a_fix_is_answered_before_the_odometry_of_its_time():
    online = Localizer(TOWN, vehicle=CAR)
    for one in last_first(odometry(WheelTicks), told())[:60]:
        assert online.update(one).time == one.time


def test_several_sensors_before_the_odometry_of_their_time_are_as_after_it():
    """Two receivers and a compass before two kinds of odometry, with a gyro in between."""
    second_receiver = [replace(one, cov_ee=9.0, cov_nn=9.0) for one in told()[::2]]
    gyro = [YawRate(one.time, 0.0) for one in told()]
    sensed = [compass(), second_receiver, told()]
    moving = [odometry(Distance), odometry(WheelTicks)]
    first, second = (Localizer(TOWN, vehicle=CAR, sensors=[Compass()]) for _ in range(2))
    wanted = moments(first, last_first(*sensed, *moving, gyro))
    assert moments(second, last_first(*moving, gyro, *sensed)) == wanted
    assert second.skipped == first.skipped


@pytest.mark.parametrize("lag", [None, 5.0])
def test_odometry_goes_in_before_a_fix_out_of_bytes(lag: float | None):
    first, second = (Localizer(TOWN, vehicle=CAR, lag=lag, sensors=[Compass()]) for _ in range(2))
    wanted = moments(first, last_first(compass(), told(), odometry(WheelTicks)))
    said = {}
    for one in last_first(odometry(WheelTicks), compass(), told()):
        second.take(one)
        before = repr(second.estimate())
        again = Localizer.from_bytes(second.to_bytes(), TOWN, sensors=[Compass()])
        assert repr(again.estimate()) == before == repr(second.estimate())
        second = again if lag is None else second  # its past would begin anew
        said[one.time] = repr((second.estimate(), second.predict(one.time + 2.0)))[:-1]
    assert list(said) == list(wanted)
    assert all(wanted[time].startswith(one) for time, one in said.items())
    assert second.skipped == first.skipped


def test_late_fixes_leave_odometry_before_fixes_of_its_time():
    """Each third fix comes 0.7 s late, by way of the service's buffer."""
    late = {one.time for one in told()[3::3]}
    other = [replace(one, time=one.time - 0.4) for one in told()[1:]]
    arrivals = last_first(odometry(WheelTicks), told(), other)
    arrivals.sort(key=lambda one: one.time + 0.7 * (isinstance(one, GeoFix) and one.time in late))
    buffer, first = ReorderBuffer(Localizer(TOWN, vehicle=CAR)), Localizer(TOWN, vehicle=CAR)
    for one in arrivals:
        assert buffer.take(one)
    assert buffer.rewinds > 10
    moments(first, last_first(told(), odometry(WheelTicks), other))
    assert repr(buffer.localizer.estimate()) == repr(first.estimate())


def test_where_the_first_tie_comes_later_it_alone_differs():
    """Nothing is kept for ties before one was seen; the next ones are put in order."""
    fixes = [replace(one, time=one.time - 0.3 * (k < 20)) for k, one in enumerate(told())]
    online = Localizer(TOWN, vehicle=CAR)
    for one in last_first(odometry(WheelSpeed), fixes)[:42]:
        online.take(one)
    again = Localizer.from_bytes(online.to_bytes(), TOWN)
    rest = fixes[21:], odometry(WheelSpeed)[21:]
    wanted = moments(online, last_first(*rest))
    assert moments(again, last_first(*rest[::-1])) == wanted
