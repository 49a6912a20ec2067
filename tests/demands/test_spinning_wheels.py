"""Wheels that turn on the spot, and wheels that say nothing of a slow vehicle."""

from typing import NamedTuple

import numpy as np
import pytest

from online.avenue import PLANE, TOWN
from whichroad.observations import GeoFix, WheelSpeed
from whichroad.online import Localizer

SIGMA = 2.5  # m


class Answer(NamedTuple):
    """Beside each fix."""

    time: np.ndarray  # s
    error: np.ndarray  # m along the avenue
    level: np.ndarray
    wrong: int  # how often a place more than 30 m away was said to be on a road for sure
    named: list[str]


def phases(time: np.ndarray, *speeds: tuple[float, float]) -> np.ndarray:
    """Speeds from moments on, m/s, smoothed over a second."""
    at = np.zeros(len(time))
    for begin, speed in speeds:
        at[time >= begin] = speed
    return np.convolve(np.pad(at, 10, "edge"), np.full(21, 1 / 21), "valid")


def answered(
    true: np.ndarray, wheels: np.ndarray, seed: int, doppler: bool = True, holds: float = 0.0,
    told: np.ndarray | None = None,
) -> Answer:  # fmt: skip
    """A drive along the avenue: speeds at 10 Hz, and fixes each second.

    The receiver `holds` the place of a stop for so many metres, and may have `told` other speeds,
    with a sigma.
    """
    rng = np.random.default_rng(seed)
    time, way = 0.1 * np.arange(len(true)), 0.1 * np.cumsum(true) - 300.0
    stops = np.maximum.accumulate(np.where(true < 0.01, way, -np.inf))
    seen = np.where(way - stops < holds, stops, way)
    slow = np.zeros(2)
    localizer, rows = Localizer(TOWN), []
    for k, t in enumerate(time.tolist()):
        noise = rng.normal(0.0, 0.01, 2) * (wheels[k] > 0.05)
        localizer.take(WheelSpeed(t, *(wheels[k] + noise).tolist()))
        if k % 10:
            continue
        slow = 0.99 * slow + 0.14 * 1.2 * rng.standard_normal(2)
        x, y = np.array([seen[k], 0.0]) + slow + rng.normal(0.0, 1.0, 2)
        lat, lon = PLANE.to_geodetic(x, y)
        speed = abs(float(true[k] + rng.normal(0.0, 0.1))) if doppler else None
        sigma: dict[str, float] = {}
        if told is not None:
            speed, sigma = abs(float(told[k] + rng.normal(0.0, 0.08))), {"sigma_speed": 0.15}
        fix = GeoFix.with_sigma(t, float(lat), float(lon), SIGMA, speed=speed, **sigma)
        found = localizer.update(fix)
        if found.answered:
            off = abs(found.pose.x - way[k])
            rows.append((t, off, found.protection_level, found.p_road >= 0.999 and off > 30.0))
    table = np.array(rows)
    named = [one.what for one in localizer.diagnosis]
    return Answer(*table.T[:3], wrong=int(table[:, 3].sum()), named=named)


@pytest.mark.parametrize("speed", [1.5, 2.5])
@pytest.mark.parametrize("seed", [1, 2])
def test_wheels_that_turn_on_the_spot_carry_the_vehicle_nowhere(speed: float, seed: int):
    time = np.arange(0.0, 150.0, 0.1)
    true = phases(time, (0.0, 10.0), (40.0, 0.0), (110.0, 10.0))
    wheels = true + phases(time, (50.0, speed), (80.0, 0.0))
    found = answered(true, wheels, seed)
    assert np.mean(found.error > found.level) < 0.03
    assert np.max(found.error[(found.time > 70.0) & (found.time < 110.0)]) < 15.0
    assert found.wrong == 0
    assert "odometry: distance" in found.named


@pytest.mark.parametrize("seed", [1, 2])
def test_wheels_that_miss_a_slow_vehicle_are_withheld(seed: int):
    time = np.arange(0.0, 220.0, 0.1)
    true = phases(time, (0.0, 10.0), (40.0, 0.6), (160.0, 10.0))
    found = answered(true, np.where(true < 0.7, 0.0, true), seed)
    assert np.mean(found.error > found.level) < 0.02
    assert np.max(found.error[found.time > 60.0]) < 20.0


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_vehicle_that_stands_or_creeps_has_sound_wheels(seed: int):
    time = np.arange(0.0, 400.0, 0.1)
    true = phases(time, (0.0, 10.0), (40.0, 0.0), (200.0, 0.5), (260.0, 0.0), (300.0, 10.0))
    found = answered(true, true, seed)
    assert np.mean(found.error > found.level) == 0.0
    assert not [name for name in found.named if "odometry" in name]


@pytest.mark.parametrize(("speed", "lasts"), [(1.4, 30.0), (8.0, 20.0), (8.0, 60.0)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_wheels_on_rollers_are_found_by_positions_alone(speed: float, lasts: float, seed: int):
    time = np.arange(0.0, 180.0, 0.1)
    true = phases(time, (0.0, 10.0), (40.0, 0.0), (130.0, 10.0))
    turn = np.clip(np.minimum(time - 50.0, 50.0 + lasts - time), 0.0, speed)
    found = answered(true, true + turn, seed, doppler=False)
    assert np.mean(found.error > found.level) < 0.01
    assert np.max(found.error[(found.time > 115.0) & (found.time < 130.0)]) < 15.0
    assert np.max(found.error[found.time > 140.0]) < 20.0
    assert found.wrong == 0
    assert "odometry: distance" in found.named
    assert "wheels: scale" not in found.named


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_receiver_that_holds_the_place_of_a_stop_has_sound_wheels(seed: int):
    time = np.arange(0.0, 200.0, 0.1)
    creep = [(70.0 + 40.0 * k + begin, v) for k in range(3) for begin, v in ((0, 1.2), (14, 0.0))]
    true = phases(time, (0.0, 10.0), (40.0, 0.0), *creep, (185.0, 10.0))
    found = answered(true, true, seed, doppler=False, holds=19.0)
    assert np.mean(found.error > found.level) == 0.0
    assert not [name for name in found.named if "odometry" in name]


def braking() -> tuple[np.ndarray, np.ndarray]:
    """Times, and speeds of a drive that brakes and gains speed."""
    time = np.arange(0.0, 170.0, 0.1)
    knots = [0.0, 6.0, 30.0, 36.0, 46.0, 52.0, 80.0, 86.0, 96.0, 102.0, 130.0, 136.0, 140.0, 148.0]
    speeds = [0.0, 11.0, 11.0, 3.0, 3.0, 11.0, 11.0, 2.0, 2.0, 11.0, 11.0, 0.0, 0.0, 11.0]
    return time, np.interp(time, knots, speeds)


@pytest.mark.parametrize(("factor", "lasts"), [(0.1, 3.0), (1.6, 3.0), (1.4, 6.0)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_wheels_that_slip_smoothly_are_found_by_the_receivers_speed(
    factor: float, lasts: float, seed: int
):
    time, true = braking()
    slips = np.zeros(len(time))
    for begin in (65.0, 115.0):
        slips[(time >= begin) & (time < begin + lasts)] = 1.0
    near = np.exp(-0.5 * (np.arange(-12, 13) / 3.0) ** 2)
    slips = np.convolve(slips, near / near.sum(), "same")
    found = answered(true, true * (1.0 + (factor - 1.0) * slips), seed, told=true)
    assert np.mean(found.error > found.level) == 0.0
    assert np.max(found.error[found.time > 60.0]) < 15.0
    assert np.max(found.error[found.time > 100.0]) < 15.0
    assert found.wrong == 0
    assert "odometry: slips" in found.named
    assert not {"clock", "wheels: scale"} & set(found.named)


@pytest.mark.parametrize("late", [0, 5, 10, 20])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_receivers_speed_that_lags_names_no_sound_wheels(late: int, seed: int):
    time, true = braking()
    found = answered(true, true, seed, told=np.concatenate([np.zeros(late), true])[: len(time)])
    assert np.mean(found.error > found.level) == 0.0
    assert "odometry: slips" not in found.named
