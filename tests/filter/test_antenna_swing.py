"""An antenna ahead of the axle swings in a turn; counters in whole ticks must not swing it."""

import numpy as np

import whichroad
from laws.public import CAR, START, geo_fixes, road_map
from scenes import drive_along

TICK = 0.04  # m
FIELD = drive_along([[0.0, 0.0], [400.0, 30.0], [500.0, 330.0]], radius=40.0, speed=3.0)
ROADS = [[[0.0, -400.0], [500.0, -400.0]]]  # far away


def heading_error(ahead: float) -> float:
    """RMS error of the heading (rad) of a car whose antenna is so far ahead (m)."""
    car = whichroad.Vehicle(
        track_width=CAR.track_width, metres_per_tick_left=TICK, metres_per_tick_right=TICK,
        antenna_forward=ahead,
    )  # fmt: skip
    c, s, n = np.cos(FIELD.heading), np.sin(FIELD.heading), len(FIELD.time)
    place = [FIELD.x + ahead * c, FIELD.y + ahead * s, np.full((n, 2), 2.0), np.zeros(n)]
    swing = np.arctan(ahead * np.gradient(FIELD.heading, FIELD.s))
    seen = geo_fixes(
        FIELD._replace(heading=FIELD.heading + swing), np.column_stack(place),
        np.arange(0, n, 10), doppler=True,
    )  # fmt: skip
    half = 0.5 * CAR.track_width * (FIELD.heading - FIELD.heading[0])
    left, right = (np.floor((FIELD.s + side) / TICK + 0.37) for side in (-half, half))
    ticks = [whichroad.WheelTicks(START + FIELD.time[k], left[k], right[k]) for k in range(n)]
    drive = sorted([*seen, *ticks], key=lambda o: (o.time, isinstance(o, whichroad.GeoFix)))
    points = whichroad.match(drive, road_map(ROADS), vehicle=car).to_arrow()
    seconds = points["time"].cast("int64").to_numpy() * 1e-6 - START
    told = np.radians(90.0 - points["bearing_deg"].to_numpy())
    error = told - np.interp(seconds, FIELD.time, FIELD.heading)
    error = np.arctan2(np.sin(error), np.cos(error))[seconds > 10.0]
    return float(np.sqrt((error**2).mean()))


def test_whole_ticks_do_not_swing_an_antenna_far_ahead():
    assert heading_error(6.0) < 1.25 * heading_error(0.0)
