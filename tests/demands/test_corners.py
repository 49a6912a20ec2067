"""Corners as vehicles drive them: rounded, slowly, with courses that turn on the way."""

from itertools import pairwise
from typing import Any

import numpy as np

import whichroad
from demands.town import BLOCK, PLANE, along, roads

RADIUS = 6.0  # m
EVERY = 0.2  # s


def rounded() -> np.ndarray:
    """A polyline through the town, turning left and right, with round corners."""
    line = [(0.4 * BLOCK, 0.0)]
    corners = [(1, 0), (1, 1), (2, 1), (2, 2), (3, 2), (3, 1), (4, 1)]
    places = [*corners, (4, 0)]
    heading = np.array([1.0, 0.0])
    for here, after in pairwise(places):
        node = BLOCK * np.array(here, float)
        onwards = BLOCK * np.array(after, float) - node
        onwards /= np.hypot(*onwards)
        middle = node + RADIUS * (onwards - heading)
        if heading @ onwards > 0.5:  # straight on
            continue
        for angle in np.linspace(0.0, 0.5 * np.pi, 12):
            line.append(middle + RADIUS * (np.sin(angle) * heading - np.cos(angle) * onwards))
        heading = onwards
    return np.array([*line, BLOCK * np.array(places[-1], float)])


def table(seed: int, *, odometer: bool) -> dict[str, Any]:
    """Fixes at 5 Hz with speed and course, of a vehicle of 4 m/s; with an odometer or without."""
    time, place = along(rounded(), 4.0, EVERY)
    rng = np.random.default_rng(seed)
    error = rng.normal(0.0, 2.5, 2) + rng.normal(0.0, 0.4, place.shape)
    lat, lon = PLANE.to_geodetic(*(place + error).T)
    step = np.diff(place, axis=0)
    course = np.degrees(np.arctan2(step[:, 0], step[:, 1]))
    course = np.append(course, course[-1]) + rng.normal(0.0, 1.5, len(time))
    driven = np.append(0.0, np.cumsum(np.hypot(*step.T)))
    return {
        "time": 1.6e9 + time,
        "lat": lat,
        "lon": lon,
        "sigma_m": np.full(len(time), 2.5),
        "speed_mps": np.full(len(time), 4.0) + rng.normal(0.0, 0.1, len(time)),
        "bearing_deg": course % 360.0,
        **({"odometer_m": driven} if odometer else {}),
    }


def off_the_roads(odometer: bool) -> float:
    """Mean of P(off the roads) over some drives, after the start."""
    off = []
    for seed in range(6):
        result = whichroad.match(table(seed, odometer=odometer), roads(), lag=None)
        off.append(result.to_arrow()["p_off_road"].to_numpy()[25:])
    return float(np.concatenate(off).mean())


def test_a_sound_odometer_drives_nobody_off_the_roads_in_corners():
    """With an odometer the heading turns as fast as without."""
    assert off_the_roads(odometer=True) < off_the_roads(odometer=False) < 0.004
