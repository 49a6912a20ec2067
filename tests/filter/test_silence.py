"""A pause of all sensors: nothing is known of the motion meanwhile, until a fix comes."""

import numpy as np
import pytest

import whichroad
from laws.public import CAR, WHEELS, geo_fixes, readings, road_map
from scenes import drive_along

HERE = drive_along([[0.0, 0.0], [600.0, 0.0]], margin=20.0)
THERE = drive_along([[0.0, 3000.0], [600.0, 3000.0]], margin=20.0)
ROADS = [[[-100.0, y - 1.75], [1300.0, y - 1.75]] for y in (0.0, 3000.0)]
LAST = float(HERE.time[-1])


def after_a_pause(pause: float, second, fixes_from: float):
    """Points of one drive, a pause and another drive, and the time of each after the pause, s."""
    begin = LAST + pause
    later = second._replace(time=second.time + begin)
    seen = []
    for truth, first in ((HERE, 0.0), (later, begin + fixes_from)):
        fix = np.column_stack([truth.x, truth.y, np.full((len(truth.x), 2), 3.0), 0.0 * truth.x])
        rows = np.arange(len(truth.time))
        seen += geo_fixes(truth, fix, rows[(rows % 10 == 0) & (truth.time >= first)])
        seen += readings(truth, WHEELS, rows >= 0)
    result = whichroad.match(sorted(seen, key=lambda o: o.time), road_map(ROADS), vehicle=CAR)
    points = result.to_arrow()
    seconds = points["time"].cast("int64").to_numpy() * 1e-6
    return points, seconds - seconds[0] - begin


@pytest.mark.parametrize("pause", [90.0, 36_000.0])
def test_who_was_carried_elsewhere_is_found_at_the_first_fixes(pause: float):
    points, since = after_a_pause(pause, THERE, 5.0)
    quiet = (since > 0.0) & (since < 4.9)
    assert quiet.any()
    assert points["p_road"].to_numpy()[quiet].max() < 0.8
    assert points["protection_level_m"].to_numpy()[quiet].min() > 3000.0
    found = since > 20.0
    error = np.abs(points["lat"].to_numpy()[found] - points["lat"].to_numpy()[-1]) * 111e3
    assert error.max() < 10.0
    assert points["p_road"].to_numpy()[found].min() > 0.99


def test_who_stayed_is_as_sure_as_before_at_the_first_fixes():
    stayed = HERE._replace(x=HERE.x + HERE.x[-1] - HERE.x[0])
    points, since = after_a_pause(3600.0, stayed, 1.0)
    again = since > 5.0
    assert points["p_road"].to_numpy()[again].min() > 0.95
    assert points["protection_level_m"].to_numpy()[again].max() < 60.0


def test_a_pause_shorter_than_a_minute_keeps_the_position():
    stayed = HERE._replace(x=HERE.x + HERE.x[-1] - HERE.x[0])
    points, since = after_a_pause(40.0, stayed, 5.0)
    quiet = (since > 0.0) & (since < 4.9)
    assert points["protection_level_m"].to_numpy()[quiet].max() < 1000.0
