"""Observations as a caller writes them: what is refused, and with which hint."""

import inspect
import pickle
from dataclasses import fields

import numpy as np
import pytest

from whichroad.errors import SettingError
from whichroad.observations import (
    Distance,
    GeoFix,
    SensorReading,
    SpeedYaw,
    StartPose,
    WheelSpeed,
    WheelTicks,
    YawRate,
)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: GeoFix(1.0, 49.0, 8.0, quality=4),
            "GeoFix: quality .*; GeoFix.with_sigma.*metres",
        ),
        (lambda: GeoFix(1.0, 49.0, 8.0, sigma_m=0.02), "GeoFix: sigma_m .*; GeoFix.with_sigma"),
        (lambda: GeoFix(time=1.0, lat=49.0, lon=8.0), "GeoFix: lat .* mean lat_deg"),
        (lambda: GeoFix(time=1.0), r"GeoFix: time=1.0 was given; .*help\(whichroad.GeoFix\)"),
        (lambda: GeoFix(), "GeoFix: nothing was given"),
        (lambda: WheelTicks(1.0, left_ticks=2, right=3), "WheelTicks: left_ticks .* mean left"),
        (lambda: WheelSpeed(1.0, 2.0), "WheelSpeed: 1.0, 2.0 was given"),
        (lambda: Distance(1.0, distance_m=3.0), "Distance: distance_m .* mean distance"),
        (lambda: SpeedYaw(1.0, 2.0, yawrate=0.1), "SpeedYaw: yawrate .* mean yaw_rate"),
        (lambda: YawRate(1.0, rate=0.1), "YawRate: rate .* mean yaw_rate"),
        (lambda: SensorReading(1.0, value={}), "SensorReading: value .* mean values"),
        (lambda: StartPose(49.0, 8.0, bearing=1.0), "StartPose: bearing .* mean .*bearing_deg"),
    ],
)
def test_an_observation_of_unknown_or_missing_fields_is_refused_with_a_hint(make, message: str):
    with pytest.raises(SettingError, match=message):
        make()


def test_a_fix_is_made_of_a_sigma_in_metres():
    fix = GeoFix.with_sigma(1.0, 49.0, 8.0, 0.02, speed=3.0)
    assert fix == GeoFix(1.0, 49.0, 8.0, cov_ee=0.02**2, cov_nn=0.02**2, speed=3.0)
    assert np.isinf(GeoFix.with_sigma(1.0, 49.0, 8.0, np.inf).cov_ee)  # not known
    for wrong in (0.0, -1.0, np.nan, "0.02"):
        with pytest.raises(SettingError, match=r"GeoFix: sigma_m is .*metres, more than 0"):
            GeoFix.with_sigma(1.0, 49.0, 8.0, wrong)
    with pytest.raises(SettingError, match=r"GeoFix: bearing .* mean .*bearing_deg"):
        GeoFix.with_sigma(1.0, 49.0, 8.0, 0.02, bearing=3.0)


@pytest.mark.parametrize("kind", [GeoFix, WheelTicks, SensorReading, StartPose])
def test_observations_show_their_fields_to_who_asks_and_can_be_pickled(kind):
    names = list(inspect.signature(kind).parameters)
    assert names == [f.name for f in fields(kind)]
    one = kind(*range(1, 4))
    assert pickle.loads(pickle.dumps(one)) == one
