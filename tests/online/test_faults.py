"""Faults on line: a fix is an epoch of its own there, and nothing is known of the whole drive."""

import math

import numpy as np
import pytest

from online.avenue import CAR, STRAIGHT, TOWN, fixes, records, town_fix, wheels
from scenes import drive_along, gnss
from whichroad.observations import Observation, SpeedYaw, WheelCounts, WheelTicks
from whichroad.online import Localizer


@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_on_line_counters_that_count_backwards_are_turned_about(delay: float):
    """Fixes come with a reading of the wheels, or between two."""
    log = wheels(STRAIGHT)
    wrong = WheelCounts(log.time, -log.left, -log.right)
    received = fixes(STRAIGHT, np.arange(0, len(STRAIGHT.time), 10), delay)
    backwards, right = (
        [online.update(reading) for reading in records(counters, received)]
        for counters, online in ((c, Localizer(TOWN, vehicle=CAR)) for c in (wrong, log))
    )
    late = slice(300, None)  # 27 s
    assert {e.edge for e in backwards[late]} == {e.edge for e in right[late]}  # none opposite


def test_hypotheses_are_no_surer_than_the_road_where_counters_may_stand_still():
    """Fixes run away from wheels and a receiver's speed that both say 0."""
    online = Localizer(TOWN, vehicle=CAR)
    for second in range(30):
        for tenth in range(10):
            online.update(WheelTicks(1e9 + second + 0.1 * tenth, 0.0, 0.0))
        fix = town_fix(20.0 + 10.0 * second, -1.75, 1e9 + second + 0.9, sigma_speed=0.3)
        said = online.update(fix)
    assert said.p_off_road > 0.2
    on_roads = sum(one.p for one in said.hypotheses if one.edge is not None)
    assert on_roads == pytest.approx(1.0 - said.p_off_road, abs=1e-9)


def test_a_gyro_that_never_turns_is_none_before_the_first_bend():
    bend = drive_along([[20.0, -1.75], [398.25, -1.75], [398.25, -95.0]])
    speed = np.gradient(bend.s, bend.time).tolist()
    place = dict(zip(bend.time.tolist(), zip(bend.x, bend.y, strict=True), strict=True))
    readings: list[Observation] = [
        SpeedYaw(t, v, 0.0) for t, v in zip(bend.time.tolist(), speed, strict=True)
    ]
    rows = gnss(bend, sigma=2.0)[::10]
    readings += [
        town_fix(x, y, t) for t, (x, y, *_) in zip(bend.time[::10].tolist(), rows, strict=True)
    ]
    online = Localizer(TOWN, vehicle=CAR)
    for reading in sorted(readings, key=lambda r: r.time):
        said = online.update(reading)
        x, y = place[reading.time]
        if said.answered:
            assert math.hypot(said.pose.x - x, said.pose.y - y) < said.protection_level
    assert said.pose.y < -60.0
