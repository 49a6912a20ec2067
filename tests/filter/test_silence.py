"""A pause of all sensors: nothing is known of the motion meanwhile, until a fix comes."""

from typing import Any

import numpy as np
import pytest

import whichroad
from laws.public import CAR, DISTANCE, GNSS, WHEELS, geo_fixes, metres, readings, road_map
from scenes import On, Truth, belief_on, brake, drive_along, network, straight_road
from whichroad.filter.gnss.silence import stands
from whichroad.filter.state import CLOCK, new_epochs

HERE = drive_along([[0.0, 0.0], [600.0, 0.0]], margin=20.0)
THERE = drive_along([[0.0, 3000.0], [600.0, 3000.0]], margin=20.0)
ROADS = [[[-100.0, y - 1.75], [1300.0, y - 1.75]] for y in (0.0, 3000.0)]


def after_a_pause(
    pause: float,
    second: Truth,
    fixes_from: float,
    mode: str = WHEELS,
    lag: Any = None,
    first: Truth = HERE,
) -> tuple[Any, Any]:
    """Points of one drive, a pause and another drive, and the time of each after the pause, s."""
    begin = float(first.time[-1]) + pause
    later = second._replace(time=second.time + begin, s=second.s - second.s[0] + first.s[-1])
    seen: list[Any] = []
    for truth, fixes in ((first, 0.0), (later, begin + fixes_from)):
        fix = np.column_stack([truth.x, truth.y, np.full((len(truth.x), 2), 3.0), 0.0 * truth.x])
        rows = np.arange(len(truth.time))
        at = rows[(rows % 10 == 0) & (truth.time >= fixes)]
        seen += geo_fixes(truth, fix, at, doppler=mode == GNSS)
        seen += readings(truth, mode, rows >= 0)
    drive = sorted(seen, key=lambda o: o.time)
    points = whichroad.match(drive, road_map(ROADS), vehicle=CAR, lag=lag).to_arrow()
    seconds = points["time"].cast("int64").to_numpy() * 1e-6
    return points, seconds - seconds[0] - begin


@pytest.mark.parametrize(
    ("pause", "mode"),
    [(90.0, WHEELS), (36_000.0, WHEELS), (90.0, DISTANCE), (36_000.0, DISTANCE)],
)
def test_who_was_carried_elsewhere_is_found_at_the_first_fixes(pause: float, mode: str):
    points, since = after_a_pause(pause, THERE, 5.0, mode)
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


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
def test_what_came_later_tells_where_the_vehicle_was_before_its_first_fix(mode: str):
    points, since = after_a_pause(600.0, THERE, 20.0, mode, "full")
    quiet = (since > 0.0) & (since < 19.9)
    error = np.abs(points["lat"].to_numpy()[quiet] - points["lat"].to_numpy()[-1]) * 111e3
    assert (error < points["protection_level_m"].to_numpy()[quiet]).all()


@pytest.mark.parametrize("mode", [WHEELS, DISTANCE])
def test_readings_that_always_come_minutes_apart_are_no_pause(mode: str):
    slow = drive_along([[0.0, 0.0], [9000.0, 0.0]], margin=20.0)
    fix = np.column_stack([slow.x, slow.y, np.full((len(slow.x), 2), 3.0), 0.0 * slow.x])
    rows = np.arange(len(slow.time)) % 900 == 0  # 90 s
    seen = geo_fixes(slow, fix, np.flatnonzero(rows)) + readings(slow, mode, rows)
    roads = road_map([[[-100.0, y], [9100.0, y]] for y in (0.0, 200.0)])
    points = whichroad.match(sorted(seen, key=lambda o: o.time), roads, vehicle=CAR).to_arrow()
    assert points["p_road"].to_numpy()[2:].min() > 0.95
    assert points["protection_level_m"].to_numpy()[2:].max() < 200.0


@pytest.mark.parametrize(("east", "north"), [(-100.0, 0.0), (50.0, 0.0), (0.0, 3000.0)])
def test_a_receiver_that_stands_before_and_after_a_pause_may_have_moved(east: float, north: float):
    stopped, _ = brake(HERE, len(HERE.time) - 1, 200)
    x, y, heading, s = (values[-200:] for values in stopped[1:])
    there = Truth(stopped.time[:200], x + east, y + north, heading, s)
    points, since = after_a_pause(600.0, there, 0.0, GNSS, first=stopped)
    found = since > -0.1
    place = np.column_stack(metres(points["lon"].to_numpy(), points["lat"].to_numpy()))[found]
    assert np.hypot(*(place - [there.x[0], there.y[0]]).T).max() < 10.0


@pytest.mark.parametrize("rested", [False, True])
@pytest.mark.parametrize("since", [0.4, 2.4, 2.6])
def test_between_fixes_a_vehicle_stands_as_its_last_fix_said(rested: bool, since: float):
    """Odometry that is withheld goes on to be heard, and has no speed of the receiver.

    A fix that came with a newer reading has no duration; what it said counts.  So it does for no
    longer than fixes are close together.
    """
    belief = belief_on(network(straight_road()), [On(0, 500.0)])
    state, epoch = belief.state[0], new_epochs(1)[0]
    state.mode, state.speed, state.standing = CLOCK, 0.2, 3.0
    state.vetting.windows.speed, state.vetting.windows.speed_time = 0.1, 100.0
    state.last_fix, state.still.at_rest = 100.0 - since, rested
    epoch.time, epoch.speed, epoch.speed_sigma = 100.0, 0.0, 0.3
    assert stands(belief, epoch, 0.1) == (rested and since < 2.5)
