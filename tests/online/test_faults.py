"""Faults on line: a fix is an epoch of its own there, and nothing is known of the whole drive."""

import math

import numpy as np
import pytest

from online.avenue import CAR, STRAIGHT, TOWN, fixes, records, town_fix, wheels
from scenes import drive_along, gnss
from whichroad.observations import (
    Distance,
    GeoFix,
    Observation,
    SpeedYaw,
    WheelCounts,
    WheelTicks,
)
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


@pytest.mark.parametrize("hz", [1, 10])
def test_a_distance_in_steps_of_5_m_is_not_impossible(hz: int):
    online = Localizer(TOWN, vehicle=CAR)
    for tenth in range(0, 600, 10 // hz):
        online.take(Distance(1e9 + 0.1 * tenth, 5.0 * (0.8 * tenth // 5.0)))
        if tenth % 10 == 0:
            said = online.update(town_fix(20.0 + 0.8 * tenth, -1.75, 1e9 + 0.1 * tenth + 0.05))
            assert tenth < 100 or abs(said.pose.x - 20.4 - 0.8 * tenth) < 5.0
            assert tenth < 200 or abs(said.speed - 8.0) < 2.5
    assert not online.diagnosis


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


def stop_and_go(stops: list[float], end: float) -> tuple[np.ndarray, np.ndarray]:
    """Seconds, a tenth each, and m driven: 12 m/s, with stops of 20 s at some metres."""
    s, v, way, left = 0.0, 12.0, [], dict.fromkeys(stops, 20.0)
    while s < end:
        ahead = next((at for at in stops if left[at] > 0.0), math.inf)
        if s >= ahead - 0.5 * v * v / 2.5 - 0.01:
            v = max(v - 0.25, 0.0)
            left[ahead] -= 0.1 if v == 0.0 else 0.0
        else:
            v = min(v + 0.25, 12.0)
        way.append(s)
        s += 0.1 * v
    return 1e9 + 0.1 * np.arange(len(way)), np.array(way)


def driven(
    time: np.ndarray, s: np.ndarray, counted: np.ndarray, every: int, late: float, until: float
) -> list[tuple[float, float]]:
    """Errors and levels, m, of a drive along the avenue whose fixes come so late, s."""
    rng = np.random.default_rng(1)
    weaves = 0.75 * 0.03 * np.sin(2.0 * math.pi * counted / 150.0)  # by wheels that measure turns
    left, right = (100.0 * (counted + side * weaves) for side in (-1.0, 1.0))
    readings: list[tuple[float, Observation]] = [
        (t, WheelTicks(t, a, b))
        for t, a, b in zip(time.tolist(), left.tolist(), right.tolist(), strict=True)
    ]
    speed = np.gradient(s, time)
    for k in range(0, len(time), every):
        if time[k] < until:
            x, y = rng.normal([20.0 + s[k], -1.75], 1.0)
            fix = town_fix(x, y, float(time[k]), speed=float(speed[k]), sigma_speed=0.3)
            readings.append((time[k] + late, fix))
    online, found = Localizer(TOWN, vehicle=CAR), []
    for _, reading in sorted(readings, key=lambda r: r[0]):
        said = online.update(reading)
        if said.answered and isinstance(reading, WheelTicks):
            place = 20.0 + np.interp(said.time, time, s)
            error = math.hypot(said.pose.x - place, said.pose.y + 1.75)
            found.append((error, said.protection_level))
    return found


@pytest.mark.parametrize("late", [0.0, 0.03])
def test_who_drives_off_while_the_counters_are_withheld_is_moved_by_late_fixes(late: float):
    """The counters stood still for 50 s before the stop, and are sound since then."""
    time, s = stop_and_go([700.0], 1200.0)
    stuck = (s > 100.0) & (s < 695.0)
    counted = np.cumsum(np.where(stuck, 0.0, np.diff(s, prepend=0.0)))
    found = np.array(driven(time, s, counted, 2, late, math.inf))
    assert (found[:, 0] < found[:, 1])[600:].all()


def test_who_drives_off_without_fixes_while_the_counters_are_withheld_is_covered_by_the_level():
    """Both wheels lock twice before a stop, where the sky is lost; then they are sound."""
    time, s = stop_and_go([500.0, 620.0], 1000.0)
    locked = ((s > 484.0) & (s < 496.0)) | ((s > 604.0) & (s < 616.0))
    counted = np.cumsum(np.where(locked, 0.0, np.diff(s, prepend=0.0)))
    stands = int(np.flatnonzero(s > 619.0)[0])
    found = np.array(driven(time, s, counted, 10, 0.0, time[stands] + 6.0))
    assert (found[:, 0] < found[:, 1])[200:].all()
    first, last = found[[stands + 90 - len(time), stands + 180 - len(time)], 1]
    assert last > 1.5 * first  # nothing says that it still stands


@pytest.mark.parametrize("far", [(49.4, 8.9), (8.7, 49.4)])
def test_one_fix_of_elsewhere_does_not_move_a_vehicle_whose_odometer_counts(far):
    """15 km away, and with latitude and longitude swapped; no vehicle is there within a second."""
    online = Localizer(TOWN, vehicle=CAR)
    for second in range(60):
        for tenth in range(10):
            online.take(Distance(1e9 + second + 0.1 * tenth, 10.0 * second + tenth))
        fix = town_fix(20.0 + 10.0 * second + 9.5, -1.75, 1e9 + second + 0.95)
        if second == 40:
            fix = GeoFix.with_sigma(fix.time, *far, 3.0)
        said = online.update(fix)
        assert second < 30 or abs(said.pose.x - 29.5 - 10.0 * second) < 5.0
        assert second < 30 or said.protection_level < 60.0
        assert second < 30 or said.p_way > 0.95
