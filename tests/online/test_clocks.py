"""Odometry that is behind all fixes, in the order in which readings come."""

from dataclasses import replace

from online.avenue import CAR, PLANE, STRAIGHT, TOWN, ticks, wheels
from whichroad.observations import GeoFix
from whichroad.online import Localizer


def driven(behind: float) -> Localizer:
    """After 20 s of wheels and fixes at 10 Hz as they come; wheels are stamped too early."""
    online = Localizer(TOWN, vehicle=CAR)
    for k, reading in enumerate(ticks(wheels(STRAIGHT))[:200]):
        lat, lon = PLANE.to_geodetic(STRAIGHT.x[k], -1.75)
        online.update(GeoFix(reading.time, lat, lon, 4e-4, 0.0, 4e-4))
        online.update(replace(reading, time=reading.time + 0.03 - behind))
    return online


def test_odometry_that_is_behind_all_fixes_is_named_within_ten_seconds():
    online = driven(0.15)
    assert online.skipped["late"] > 150
    (named,) = [found for found in online.diagnosis if found.what == "odometry: clock"]
    assert named.level == "warning"
    assert 0.1 < named.statistic < 0.15
    assert "refused" in named.advice


def test_odometry_in_time_is_not_named():
    online = driven(0.0)
    assert online.skipped == {}
    assert "odometry: clock" not in [found.what for found in online.diagnosis]


def test_one_late_reading_before_the_wheels_fall_silent_names_no_clock():
    online = Localizer(TOWN, vehicle=CAR)
    for k, reading in enumerate(ticks(wheels(STRAIGHT))[:300]):
        lat, lon = PLANE.to_geodetic(STRAIGHT.x[k], -1.75)
        online.update(GeoFix(reading.time, lat, lon, 4e-4, 0.0, 4e-4))
        if k <= 100:
            online.update(replace(reading, time=reading.time + (0.03 if k < 100 else -0.15)))
    assert online.skipped["late"] == 1
    assert "odometry: clock" not in [found.what for found in online.diagnosis]
