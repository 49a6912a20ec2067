"""Corners as vehicles drive them: rounded, slowly, with courses that turn on the way."""

import numpy as np

import whichroad
from laws.public import CAR, DISTANCE, GNSS, geo_fixes, readings, road_map
from scenes import drive_along, gnss

TOWN = road_map(
    [[(0, 150 * k), (600, 150 * k)] for k in range(4)]
    + [[(150 * k, 0), (150 * k, 450)] for k in range(5)]
)
ROUND = [(60, 0), (150, 0), (150, 150), (300, 150), (300, 300), (450, 300), (450, 150), (600, 150)]


def off_the_roads(mode: str) -> float:
    """Mean of P(off the roads) over some drives at 4 m/s, after the start; fixes at 5 Hz."""
    truth = drive_along(ROUND, radius=6.0, speed=4.0)
    off = []
    for seed in range(6):
        fix = gnss(truth, sigma=2.5, seed=seed)
        seen = geo_fixes(truth, fix, np.arange(0, len(truth.time), 2), doppler=True)
        result = whichroad.match([*readings(truth, mode), *seen], TOWN, vehicle=CAR, lag=None)
        off.append(result.to_arrow()["p_off_road"].to_numpy()[50:])
    return float(np.concatenate(off).mean())


def test_a_sound_odometer_drives_nobody_off_the_roads_in_corners():
    """With an odometer the heading turns as fast as without."""
    assert off_the_roads(DISTANCE) < off_the_roads(GNSS) < 0.1
