"""A stop before a crossing, looked back at: the vehicle stands where it stood."""

from functools import cache

import numpy as np
import pytest

from demands.town import PLANE, corners, roads
from whichroad import match

STOP = 288.0  # m from the start, 12 m before a crossing
STANDS, BRAKES = 60.0, 2.0  # s, m/s²
SIGMA = 3.0


@cache
def stopped(
    lag: str | float | None, seed: int, doppler: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Of the epochs of the stop: m ahead of it, speed, whether "stopped", P(edge before it)."""
    cruise, dt = 10.0, 0.1
    s, v, time, rows, left = 0.0, cruise, 0.0, [], STANDS
    while s < 590.0:
        if left > 0.0 and s >= STOP - v * v / (2.0 * BRAKES) - 1e-6:
            v = max(v - BRAKES * dt, 0.0)
            left -= dt if v == 0.0 else 0.0
        elif left <= 0.0:
            v = min(v + BRAKES * dt, cruise)
        rows.append((time, s, v))
        s, time = s + v * dt, time + dt
    time, s, v = np.array(rows)[::10].T
    line = corners("20", "24")
    rng = np.random.default_rng(seed)
    place = line[0] + np.column_stack([s, 0.0 * s]) + rng.normal(0.0, SIGMA, (len(s), 2))
    lat, lon = PLANE.to_geodetic(*place.T)
    table = {"time": 1.6e9 + time, "lat": lat, "lon": lon, "sigma_m": np.full(len(time), SIGMA)}
    if doppler:
        moves = np.maximum(v + rng.normal(0.0, 0.05, len(v)), 0.0)
        table["speed_mps"] = np.where(v == 0.0, 0.0, moves)
    points = match(table, roads(), lag=lag).points
    at = v == 0.0
    x, _ = PLANE.from_geodetic(points.lat.to_numpy()[at], points.lon.to_numpy()[at])
    truth = line[0][0] + s[at]
    before = (points.matched_lon[at] < PLANE.to_geodetic(*corners("22")[0])[1]).to_numpy()
    speed = points.speed_mps.to_numpy()[at]
    return x - truth, speed, (points.status[at] == "stopped").to_numpy(), before


@pytest.mark.parametrize("lag", [None, 10.0, "full"])
def test_a_stop_stays_before_the_crossing(lag):
    """Where it drove off from is no reason to stand farther on."""
    ahead = np.array([stopped(lag, seed)[0][-40:].mean() for seed in range(16)])
    assert abs(ahead.mean()) < 2.5


@pytest.mark.parametrize("lag", [10.0, "full"])
def test_who_is_said_to_stand_has_no_speed(lag):
    for seed in range(16):
        _, speed, stands, _ = stopped(lag, seed)
        assert stands.sum() > 20
        assert (speed[stands] < 1.0).all()


def test_what_came_later_does_not_carry_a_stop_over_the_crossing():
    filtered, smoothed = (
        np.mean([stopped(lag, seed)[3].mean() for seed in range(16)]) for lag in (None, "full")
    )
    assert smoothed >= filtered - 0.02


@pytest.mark.parametrize("lag", [None, 10.0, "full"])
def test_a_receiver_whose_speed_is_zero_is_said_to_stand_and_has_no_speed(lag):
    for seed in range(4):
        _, speed, stands, _ = stopped(lag, seed, True)
        assert stands.mean() > 0.9
        assert (abs(speed[3:]) < 0.3).all()
