"""Where odometry was nonsense for a minute without fixes, the first fix tells where to begin."""

import numpy as np
import pytest

import whichroad
from laws.public import START, degrees, metres, road_map
from scenes import drive_along, grid_town

TOWN = road_map(grid_town(9, 9, 110.0))
GAP = 40.0, 110.0  # s
ROUTE = np.array([[0, 0], [3, 0], [3, 3], [6, 3], [6, 6], [8, 6]], float) * 110.0
CAR = whichroad.Vehicle(track_width=1.5)


def wild(seed: int) -> list[whichroad.GeoFix | whichroad.WheelSpeed]:
    """A drive whose wheels say anything in the gap."""
    rng = np.random.default_rng(seed)
    truth = drive_along(ROUTE, speed=9.0)
    readings: list[whichroad.GeoFix | whichroad.WheelSpeed] = []
    lon, lat = degrees(truth.x, truth.y)
    slow = rng.normal(0.0, 1.0, 2)
    turn = 0.5 * CAR.track_width * np.gradient(truth.heading, truth.time)
    for k, time in enumerate(truth.time):
        inside = GAP[0] < time < GAP[1]
        left, right = rng.uniform(0.0, 40.0, 2) if inside else (9.0 - turn[k], 9.0 + turn[k])
        readings.append(whichroad.WheelSpeed(START + time, left, right))
        if k % 10 == 0 and not inside:
            east, north = slow + rng.normal(0.0, 0.7, 2)
            readings.append(
                whichroad.GeoFix(
                    START + time, lat[k] + north / 111_200.0,
                    lon[k] + east / (111_200.0 * np.cos(np.radians(lat[k]))), 2.0, 0.0, 2.0,
                )
            )  # fmt: skip
    return readings


@pytest.mark.parametrize("seed", range(4))
def test_two_seconds_behind_a_minute_of_nonsense_the_place_is_known(seed: int):
    truth = drive_along(ROUTE, speed=9.0)
    localizer = whichroad.Localizer(TOWN, vehicle=CAR)
    away = []
    for reading in wild(seed):
        estimate = localizer.update(reading)
        time = reading.time - START
        if time > GAP[1] + 2.0:
            x, y = metres(estimate.pose.lon, estimate.pose.lat)
            at = [np.interp(time, truth.time, values) for values in (truth.x, truth.y)]
            away.append(np.hypot(x - at[0], y - at[1]))
            assert away[-1] < estimate.protection_level
    assert max(away) < 15.0
