"""The on-line filter refuses openly what cannot be: readings, times, arguments."""

import math
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from online.avenue import CAR, PLANE, STRAIGHT, TOWN, driven_to, said, town_fix, wheels
from whichroad.epochs import build_timeline
from whichroad.errors import DriveError, MapError, ReadError, SettingError
from whichroad.observations import (
    Distance,
    Drive,
    GeoFix,
    SensorReading,
    SpeedYaw,
    WheelSpeed,
    WheelTicks,
)
from whichroad.online import Localizer
from whichroad.recorded import localize_recorded
from whichroad.sensors import Compass
from whichroad.sensors.validation import NO_VARIANCE, NOT_A_COVARIANCE, TOO_VAGUE
from whichroad.settings import Settings, to_toml


@pytest.mark.parametrize("time", [-100.0, 0.0, 20.0])
def test_a_prediction_before_the_last_observation_is_the_estimate_at_it(time: float):
    online = driven_to(205)
    last = online.predict(online.estimate().time)
    assert last.time == online.estimate().time > 20.0
    assert repr(online.predict(time)) == repr(last)


@pytest.mark.parametrize(
    ("time", "message"),
    [
        (math.nan, "time is nan; seconds since 1970 were expected; as datetime.timestamp"),
        (math.inf, "time is inf; seconds"),
        (-math.inf, "time is -inf; seconds"),
        (1.78e12, r"time is 1.78e\+12; .*are these milliseconds"),
        (1.78e15, r"time is 1.78e\+15; .*are these microseconds"),
        (1.78e18, r"time is 1.78e\+18; .*are these nanoseconds"),
        ("noon", "time is 'noon'; seconds"),
        (datetime(2026, 6, 1), "time is datetime.datetime"),
        (1.78e9, "20,602 days after the last observation; at most a year"),
    ],
)
def test_a_time_that_cannot_be_is_refused_by_a_prediction(time, message: str):
    online = driven_to(205)
    before = online.to_bytes()
    with pytest.raises(ReadError, match=f"predict: .*{message}"):
        online.predict(time)
    assert online.to_bytes() == before


@pytest.mark.parametrize("days", [1.0, 30.0, 365.0])
def test_a_prediction_far_ahead_knows_that_it_knows_nothing(days: float):
    far = driven_to(205).predict(86400.0 * days)
    assert np.linalg.eigvalsh(far.cov).min() > 0.0
    assert 1e4 < far.protection_level < math.inf
    assert far.level_along_m > 1e4


def test_a_time_that_cannot_be_wakes_nobody():
    online = driven_to(205)
    before = online.to_bytes()
    with pytest.raises(ReadError, match="wake: time is nan"):
        online.wake(math.nan)
    assert online.to_bytes() == before


def test_a_fix_more_than_a_second_late_is_refused_and_counted():
    online = driven_to(100)
    before = online.predict(10.0)
    after = online.update(town_fix(50.0, -1.75, 8.5))
    np.testing.assert_array_equal(said({0.0: after}), said({0.0: before}))
    assert online.skipped == {"late": 1}


@pytest.mark.parametrize("by", [-8.0, 86400.0])
@pytest.mark.parametrize("sensors", ["wheels and fixes", "fixes"])
def test_a_clock_that_was_set_back_or_one_wrong_time_is_outlived(by: float, sensors: str):
    """All clocks go back by 8 s; or one fix is stamped a day later, and the others are not."""
    online = driven_to(100)
    begin = STRAIGHT.time[101]
    if by > 0.0:
        online.update(town_fix(STRAIGHT.x[100], -1.75, begin + by))
    for k in range(101, 200):
        time = STRAIGHT.time[k] + min(by, 0.0)
        if sensors != "fixes":
            online.update(SpeedYaw(time, 10.0, 0.0))
        if k % 10 == 0:
            estimate = online.update(town_fix(STRAIGHT.x[k], -1.75, time))
    assert online.skipped["clock set back: started anew"] == 1
    assert estimate.answered
    assert estimate.time == pytest.approx(time, abs=1.0)
    assert estimate.status in ("on_road", "ambiguous")


@pytest.mark.parametrize("ahead", [0.4, 18.0, 3600.0])
@pytest.mark.parametrize("first", [0, 101])
def test_a_further_sensor_whose_clock_is_ahead_shuts_nobody_out(ahead: float, first: int):
    """It moves nothing, and does not decide which time it is."""
    online = Localizer(TOWN, vehicle=CAR, sensors=[Compass()])
    for k in range(300):
        time = STRAIGHT.time[k]
        if k >= first and k % 2 == 0:
            online.update(SensorReading(time + ahead, {"compass_deg": 90.0}))
        online.update(SpeedYaw(time, 10.0, 0.0))
        if k % 10 == 0:
            estimate = online.update(town_fix(STRAIGHT.x[k], -1.75, time))
    assert estimate.answered
    x, _ = TOWN.plane.from_geodetic(np.array([estimate.pose.lat]), np.array([estimate.pose.lon]))
    assert abs(x[0] - STRAIGHT.x[290]) < 15.0
    assert online.skipped["late"] < 20
    assert [finding.what for finding in online.diagnosis] == ["readings: clock"]


def test_an_old_reading_among_others_begins_nothing_anew():
    online = driven_to(100)
    for k in range(101, 150):
        online.update(town_fix(STRAIGHT.x[k], -1.75, STRAIGHT.time[k]))
        online.update(town_fix(STRAIGHT.x[k], -1.75, STRAIGHT.time[k] - 5.0))
    assert online.skipped == {"late": 49}


def test_readings_that_were_late_before_it_was_taken_back_begin_nothing_anew():
    online = driven_to(100)
    state = online.state()
    for k in (20, 30, 40):
        if k == 40:
            online.restore(state)
        online.update(town_fix(STRAIGHT.x[k], -1.75, STRAIGHT.time[k]))
    assert online.skipped == {"late": 3}


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"lat_deg": math.nan}, "impossible position"),
        ({"lat_deg": 91.0}, "impossible position"),
        ({"lon_deg": math.inf}, "impossible position"),
        ({"lat_deg": 0.0, "lon_deg": 0.0}, "impossible position"),
        ({"cov_ee": 9999.0**2, "cov_nn": 4.0}, TOO_VAGUE),
        ({"time": math.nan}, "no time"),
        ({"time": math.inf}, "no time"),
        ({"cov_ee": math.nan, "cov_nn": 1.0}, NOT_A_COVARIANCE),
        ({"cov_ee": 1.0, "cov_nn": 1.0, "cov_en": 2.0}, NOT_A_COVARIANCE),
        ({"cov_ee": 0.0, "cov_nn": 0.0}, NO_VARIANCE),
        ({"cov_ee": -1.0, "cov_nn": 1.0}, NO_VARIANCE),
        ({"speed": math.nan, "sigma_speed": 0.3}, "impossible speed (not used)"),
        ({"speed": math.nan, "sigma_speed": None}, "impossible speed (not used)"),
        ({"speed": -1.0, "sigma_speed": None}, "impossible speed (not used)"),
        ({"bearing_deg": math.nan, "sigma_bearing_deg": 3.0}, "impossible course (not used)"),
    ],
)
def test_a_fix_that_cannot_be_is_counted_and_spoils_nothing(wrong, reason: str):
    online, unaware = driven_to(100), driven_to(100)
    fix = town_fix(STRAIGHT.x[100], STRAIGHT.y[100], float(STRAIGHT.time[100]))
    online.update(replace(fix, **wrong))
    assert online.skipped == {reason: 1}
    a = online.predict(float(STRAIGHT.time[100]) + 1.0)
    assert a.status == "on_road"
    b = unaware.predict(a.time)
    assert math.hypot(a.pose.x - b.pose.x, a.pose.y - b.pose.y) < 3.0  # m, one sigma of a fix


@pytest.mark.parametrize(
    ("reading", "reason"),
    [
        (WheelSpeed(10.2, math.nan, 10.0), "missing wheel speed"),
        (WheelSpeed(10.2, 10.0, math.nan), "missing wheel speed"),
        (SpeedYaw(10.2, math.nan, 0.0), "missing speed"),
        (SpeedYaw(10.2, 10.0, math.nan), "missing yaw rate"),
        (WheelSpeed(10.2, 1e9, 1e9), "wheel speed beyond 90 m/s"),
        (SpeedYaw(10.2, math.inf, 0.0), "speed beyond 90 m/s"),
        (SpeedYaw(10.2, 10.0, 1e9), "yaw rate beyond 10 rad/s"),
        (WheelTicks(10.2, math.nan, 0.0), "missing wheel count"),
        (Distance(10.2, math.inf), "no distance"),
    ],
)
def test_a_reading_of_wheels_that_cannot_be_is_counted_and_changes_nothing(reading, reason: str):
    online = driven_to(100)
    before = online.estimate()
    after = online.update(reading)
    np.testing.assert_array_equal(said({0.0: after}), said({0.0: before}))
    assert online.skipped == {reason: 1}


@pytest.mark.parametrize("counts", [0.0, -500.0])
def test_a_counter_that_began_anew_in_a_silence_does_not_take_the_vehicle_back(counts: float):
    online = driven_to(100)
    before = online.estimate()
    at = float(STRAIGHT.time[100]) + 5.0
    a = online.update(WheelTicks(at, counts, counts))
    assert online.skipped == {"odometry jumped (bridged)": 1}
    assert a.pose.x > before.pose.x + 20.0
    assert a.protection_level > before.protection_level + 10.0


def test_a_wheel_counter_that_jumps_on_line_is_bridged_at_the_speed_before_and_counted():
    online, unaware = driven_to(100), driven_to(100)
    at = float(STRAIGHT.time[100])
    log = wheels(STRAIGHT)
    a = online.update(WheelTicks(at, log.left[100] - 65536.0, log.right[100]))
    b = unaware.update(WheelTicks(at, log.left[100], log.right[100]))
    assert online.skipped == {"odometry jumped (bridged)": 1}
    np.testing.assert_allclose(said({0.0: a}), said({0.0: b}), atol=1e-6)


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ((0.0, 49.4, 8.7), "a GeoFix, WheelTicks"),
        (None, "a GeoFix, WheelTicks"),
        (GeoFix(datetime(2026, 6, 1), 49.4, 8.7), "datetime.timestamp"),
        (GeoFix(1.78e12, 49.4, 8.7), "milliseconds"),
    ],
)
def test_what_is_no_observation_is_refused_with_what_was_expected(told, message: str):
    with pytest.raises(ReadError, match=message):
        Localizer(TOWN).update(told)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"cov_ee": np.eye(2)}, r"GeoFix\(cov_ee='\[\[1. 0"),
        ({"cov_ee": 4.0, "cov_nn": "4"}, r"GeoFix\(cov_nn='4'\)"),
    ],
)
def test_a_field_that_is_no_number_is_refused_by_its_name(wrong, message: str):
    with pytest.raises(ReadError, match=message):
        Localizer(TOWN).update(GeoFix(0.0, 49.4, 8.7, **wrong))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"settings": {}}, "settings is a dict; whichroad.Settings"),
        ({"settings": {"map_sigma": 3.0}}, "settings is a dict; whichroad.Settings"),
        ({"vehicle": {"track_width": 1.5}}, "vehicle is a dict; whichroad.Vehicle"),
        ({"start": (49.4, 8.7)}, r"start is \(49.4, 8.7\); a StartPose or"),
        ({"start": (49.4, 8.7, "north")}, "start is .*north.*; a StartPose or"),
        ({"start": 90.0}, "start is 90.0; a StartPose or"),
    ],
)
def test_an_argument_of_another_kind_is_refused(given, message: str):
    with pytest.raises(SettingError, match=message):
        Localizer(TOWN, **given)


def test_the_car_may_be_the_path_of_its_file_and_overrides_settings(tmp_path):
    car, file = replace(CAR, noise={"gnss_time": 50.0}), tmp_path / "vehicle.toml"
    file.write_text(to_toml(car), "utf-8")
    online, usual = Localizer(TOWN, vehicle=file), Settings(map_sigma=3.0)
    assert online.vehicle == car
    assert online.settings == Settings(gnss_time=50.0)
    again = Localizer.from_bytes(online.to_bytes(), TOWN, vehicle=str(file), settings=usual)
    assert again.vehicle == car
    assert again.settings == Settings(gnss_time=50.0, map_sigma=3.0)
    with pytest.raises(ReadError, match=r"none\.toml: "):
        Localizer(TOWN, vehicle=tmp_path / "none.toml")


def test_on_line_a_map_that_is_none_is_refused():
    with pytest.raises(MapError, match="NoneType was given; a RoadMap"):
        Localizer(None)


def test_a_recorded_drive_that_nothing_can_start_is_refused():
    timeline = build_timeline(Drive("d", None, wheels(STRAIGHT)), PLANE, CAR)
    with pytest.raises(DriveError, match="no usable GNSS fix"):
        localize_recorded(TOWN, timeline, vehicle=CAR)
