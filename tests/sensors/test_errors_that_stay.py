"""Errors of a further sensor that never change: antennas aslant, ranges that are all too long."""

import math

import numpy as np
import pyarrow as pa
import pytest

import whichroad
from whichroad import GeoFix, Localizer, WheelTicks, simulate_drive
from whichroad.evidence.sensed import Sensed
from whichroad.geodesy.angles import bearing_of
from whichroad.sensors import DualAntenna, Heading, LaneCamera, Range, Ranging, SensorReading

LONG_M = 1.5


@pytest.fixture(scope="module")
def ride(town):
    return simulate_drive(town, seed=3, length_m=3000.0)


def antennas(town, ride, off_deg: float, sigma_deg: float = 0.3) -> list[SensorReading]:
    """Once a second, all off by the same angle, clockwise."""
    t, rng = ride.truth, np.random.default_rng(1)
    k = np.arange(5, len(t), 10)
    bearing = bearing_of(t.heading[k], town.plane.convergence(t.x[k], t.y[k]))
    told = (bearing + off_deg + sigma_deg * rng.standard_normal(len(k))) % 360.0
    return [
        SensorReading(float(a), {"antennas_deg": float(b)}, "dual_antenna")
        for a, b in zip(t.time[k], told, strict=True)
    ]


def ranges(town, ride, too_long: float) -> tuple[Ranging, list[SensorReading]]:
    """To points beside the way, 20 to 50 m off, once a second."""
    t, rng = ride.truth, np.random.default_rng(2)
    points, told = {}, []
    for n, k in enumerate(range(5, len(t), 10)):
        angle, metres = rng.uniform(0.0, math.tau), rng.uniform(20.0, 50.0)
        away = metres * float(town.plane.scale(t.x[k], t.y[k]))
        x, y = t.x[k] + away * math.cos(angle), t.y[k] + away * math.sin(angle)
        points[n] = tuple(map(float, town.plane.to_geodetic(x, y)))
        seen = metres + too_long + 0.3 * rng.standard_normal()
        told.append(
            SensorReading(float(t.time[k]), {"range_to": n, "range_m": float(seen)}, "ranging")
        )
    return Ranging(points, sigma_m=0.3), told


def observations_of(ride, told) -> list:
    f, o = ride.drive.fixes, ride.drive.odometry
    made = [WheelTicks(*map(float, row)) for row in zip(o.time, o.left, o.right, strict=True)]
    fixes = zip(f.time, f.lat_deg, f.lon_deg, f.cov_ee, 0.0 * f.cov_ee, f.cov_ee, strict=True)
    made += [GeoFix(*map(float, row)) for row in fixes]
    return sorted([*made, *told], key=lambda one: one.time)


def table_of(observations) -> pa.Table:
    """One trip, a row for each observation."""
    names = {
        "time": "time", "lat_deg": "lat", "lon_deg": "lon", "cov_ee": "cov_ee", "cov_en": "cov_en",
        "cov_nn": "cov_nn", "left": "wheel_rl_ticks", "right": "wheel_rr_ticks",
    }  # fmt: skip
    rows = [
        {"time": one.time, **one.values} if isinstance(one, SensorReading)
        else {name: getattr(one, field) for field, name in names.items() if hasattr(one, field)}
        for one in observations
    ]  # fmt: skip
    return pa.Table.from_pylist(
        [{"drive_id": "a", **dict.fromkeys([*names.values(), "antennas_deg"]), **r} for r in rows]
    )


def away(town, result, ride) -> tuple[np.ndarray, np.ndarray]:
    """How far points are from the truth, and their level, m."""
    table, t = result.to_arrow(), ride.truth
    time = table["time"].to_numpy().astype("datetime64[ns]").astype(np.int64) / 1e9
    k = np.searchsorted(t.time, time - 1e-3).clip(0, len(t) - 1)
    x, y = town.plane.from_geodetic(table["lat"].to_numpy(), table["lon"].to_numpy())
    off = np.hypot(x - t.x[k], y - t.y[k]) / town.plane.scale(t.x[k], t.y[k])
    return off, table["protection_level_m"].to_numpy()


def test_antennas_aslant_are_learnt_and_do_no_harm(town, ride):
    sensor = DualAntenna(sigma_deg=0.3)
    told = observations_of(ride, antennas(town, ride, 6.0))
    straight = observations_of(ride, antennas(town, ride, 0.0))
    aslant = whichroad.match(told, town, vehicle=ride.vehicle, sensors=[sensor])
    sound = whichroad.match(straight, town, vehicle=ride.vehicle, sensors=[sensor])
    (off, level), (usual, _) = away(town, aslant, ride), away(town, sound, ride)
    assert not np.any(off > level)
    assert np.median(off) < 1.2 * np.median(usual)
    (named,) = [one for one in aslant.diagnosis if one.what == "sensor dual_antenna: bias"]
    assert named.statistic == pytest.approx(6.0, abs=0.5)
    assert not [one for one in sound.diagnosis if one.what.startswith("sensor")]
    trips = whichroad.match_many(table_of(told), town, vehicle=ride.vehicle, sensors=[sensor])
    assert named.note in trips.drives["notes"].to_pylist()[0]


def test_on_line_the_angle_is_told_with_its_sigma_and_kept(town, ride):
    sensor = DualAntenna(sigma_deg=0.3)
    localizer = Localizer(town, vehicle=ride.vehicle, sensors=[sensor])
    for one in observations_of(ride, antennas(town, ride, -3.0)):
        localizer.take(one)
    (learnt,) = localizer.sensor_states[-1].learnt
    assert (learnt.what, learnt.unit) == ("bias", "deg")
    assert abs(learnt.value + 3.0) < 3.0 * learnt.sigma < 1.5
    again = Localizer.from_bytes(localizer.to_bytes(), town, sensors=[sensor])
    late = SensorReading(one.time + 0.1, {"antennas_deg": 10.0}, "dual_antenna")
    assert np.array_equal(again.update(late).cov, localizer.update(late).cov)
    assert again.sensor_states == localizer.sensor_states


def test_ranges_that_are_all_too_long_are_learnt(town, ride):
    sensor, told = ranges(town, ride, LONG_M)
    result = whichroad.match(
        observations_of(ride, told), town, vehicle=ride.vehicle, sensors=[sensor]
    )
    off, _ = away(town, result, ride)
    assert np.median(off[-1000:]) < 0.5
    (named,) = [one for one in result.diagnosis if one.what == "sensor ranging: bias"]
    assert named.statistic == pytest.approx(LONG_M, abs=0.2)
    assert "too much" in named.advice


def test_of_a_second_sensor_the_error_that_stays_makes_the_one_that_lasts_larger(town):
    sensed = Sensed([DualAntenna(), Ranging({1: (49.4, 8.7)}, bias_sigma_m=0.4, sigma_m=0.3)], town)
    place = (0.0, 0.0)
    (heading,) = sensed.rows(SensorReading(0.0, {"antennas_deg": 10.0}), 0.0, place)
    readings = [SensorReading(t, {"range_to": 1.0, "range_m": 20.0}) for t in (0.0, 300.0)]
    first, second = (row for one in readings for row in sensed.rows(one, 0.0, place))
    variance, bias, share = 3, 4, 5  # fields of EVIDENCE
    assert heading[bias] == pytest.approx(math.radians(2.0) ** 2)
    assert first[bias] == 0.0
    assert first[variance] == pytest.approx((0.25, 0.25))
    assert first[share] == 1.0
    assert second[share] == pytest.approx(math.tanh(0.25))


def test_kinds_say_what_stays_and_impossible_sigmas_are_counted(town):
    assert Heading(10.0, 1.0).bias_sigma == Range(49.4, 8.7, 10.0, 1.0).bias_sigma == 0.0
    sensed = Sensed([LaneCamera(bias_sigma_m=-0.2)], town)
    assert sensed.rows(SensorReading(0.0, {"lane_offset_m": 0.1}), 0.0, (0.0, 0.0)) == []
    assert sensed.skipped == {"lane_camera: impossible value or sigma": 1}
