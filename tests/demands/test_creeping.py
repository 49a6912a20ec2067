"""Odometry that reads 0 below 2 km/h: who creeps to each stop is not where it seems to stand."""

from typing import NamedTuple

import numpy as np
import pytest

from online.avenue import PLANE, TOWN
from whichroad.epochs import build_timeline
from whichroad.observations import Distance, GeoFix, Observation, SpeedYaw, WheelSpeed, YawRate
from whichroad.online import Localizer
from whichroad.readers.from_observations import drive_of_observations
from whichroad.recorded import localize_recorded
from whichroad.settings import Vehicle

LEAST = 2.0 / 3.6  # m/s
SIGMA = 2.5  # m
STEP = 0.05  # s between readings


class Answer(NamedTuple):
    """Beside each fix."""

    time: np.ndarray  # s
    error: np.ndarray  # m
    level: np.ndarray  # m
    named: list[str]


def creeping(seed: int, metres: tuple[float, float] = (3.0, 12.0)) -> np.ndarray:
    """Speeds of a drive that creeps for some metres before each stop, m/s."""
    rng = np.random.default_rng(seed)
    parts = [np.zeros(40)]
    for _ in range(8):
        creep = rng.uniform(*metres) / 0.38
        parts += [np.arange(0.0, 8.0, 1.4 * STEP), np.full(240, 8.0)]
        parts += [np.arange(8.0, 0.38, -1.8 * STEP), np.full(round(creep / STEP), 0.38)]
        parts += [np.zeros(rng.integers(80, 400))]
    return np.concatenate(parts)


def readings(
    true: np.ndarray, kind: str, seed: int, doppler: bool = True, least: float = LEAST
) -> list[Observation]:
    """A drive along the avenue, its odometry without what is below 2 km/h."""
    rng = np.random.default_rng(seed)
    time, way = STEP * np.arange(len(true)), STEP * np.cumsum(true) + 20.0
    read = np.where(true < least, 0.0, true)
    counted, slow, out = np.cumsum(read) * STEP, np.zeros(2), []
    for k, t in enumerate(time.tolist()):
        rate = 0.002 + rng.normal(0.0, 0.002)
        v = float(read[k])
        if kind == "wheels":
            noise = rng.normal(0.0, 0.01, 2) * (v > 0.0)
            out.append(WheelSpeed(t, v + float(noise[0]), v + float(noise[1])))
        elif kind == "yaw rate":
            out.append(SpeedYaw(t, v, rate))
        else:
            out += [Distance(t, float(counted[k])), YawRate(t, rate)]
        if k % 20 == 0:
            slow = 0.985 * slow + 0.17 * 1.5 * rng.standard_normal(2)
            x, y = np.array([way[k], -1.75]) + slow + rng.normal(0.0, 0.8, 2)
            lat, lon = PLANE.to_geodetic(x, y)
            noise = rng.normal(0.0, 0.1, 2)
            speed = float(np.hypot(true[k] + noise[0], noise[1]))
            said = {"speed": speed} if doppler else {}
            out.append(GeoFix.with_sigma(t, float(lat), float(lon), SIGMA, **said))
    return out


def on_line(given: list[Observation], true: np.ndarray, car: Vehicle) -> Answer:
    localizer, rows = Localizer(TOWN, vehicle=car), []
    way = STEP * np.cumsum(true) + 20.0
    for one in given:
        if not isinstance(one, GeoFix):
            localizer.take(one)
            continue
        found = localizer.update(one)
        if found.answered:
            off = float(found.pose.x - way[round(one.time / STEP)])
            rows.append((one.time, abs(off), found.protection_level))
    return Answer(*np.array(rows).T, named=[one.what for one in localizer.diagnosis])


@pytest.mark.parametrize("doppler", [True, False])
@pytest.mark.parametrize("kind", ["wheels", "yaw rate", "odometer"])
def test_who_creeps_before_stops_is_covered(kind: str, doppler: bool):
    for seed in (1, 2, 3):
        true = creeping(seed)
        found = on_line(readings(true, kind, seed, doppler), true, Vehicle(least_speed=LEAST))
        assert np.mean(found.error > found.level) < 0.002
        assert np.median(found.level) < 12.0
        assert not [name for name in found.named if name.startswith(("gyro", "odometry", "wheels"))]


@pytest.mark.parametrize("doppler", [True, False])
def test_it_is_found_and_named(doppler: bool):
    true = creeping(4)
    found = on_line(readings(true, "wheels", 4, doppler), true, Vehicle())
    assert "odometry: least speed" in found.named
    later = found.time > 0.5 * found.time[-1]
    assert np.mean((found.error > found.level)[later]) == 0.0


def test_of_a_recording_it_is_known_from_its_beginning():
    true = creeping(5)
    timeline = build_timeline(
        drive_of_observations(readings(true, "yaw rate", 5)), PLANE, Vehicle()
    )
    assert LEAST - 0.05 < timeline.least_speed < LEAST + 0.1
    answer = localize_recorded(TOWN, timeline)
    rows, way = answer.output.rows, STEP * np.cumsum(true) + 20.0
    error = np.abs(rows.x - way[np.round(timeline.epochs.time / STEP).astype(int)])
    assert np.mean(error > rows.protection_level) < 0.002
    assert [one.what for one in answer.diagnosis] == ["odometry: least speed"]


@pytest.mark.parametrize("doppler", [True, False])
def test_a_vehicle_that_stands_for_long_stays_there(doppler: bool):
    true = np.concatenate([np.full(600, 8.0), np.arange(8.0, 0.0, -1.8 * STEP), np.zeros(3600)])
    given = readings(true, "wheels", 6, doppler)
    found = on_line(given, true, Vehicle(least_speed=LEAST))
    assert np.max(found.level[found.time > 40.0]) < 15.0
    assert np.max(found.error[found.time > 40.0]) < 8.0


def test_a_full_sensor_has_no_least_speed():
    true = creeping(7)
    found = on_line(readings(true, "wheels", 7, least=0.0), true, Vehicle())
    assert np.mean(found.error > found.level) == 0.0
    assert found.named == []
