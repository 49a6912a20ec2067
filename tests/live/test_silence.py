"""Sensors that fall silent: what is left goes on, and what returns is taken up without a jump."""

import math

import numpy as np
import pytest

from whichroad import Distance, GeoFix, Localizer, WheelTicks, simulate_drive

BEGIN, END = 60.0, 110.0  # s of the drive without wheels


@pytest.fixture(scope="module", params=range(3))
def drive(request, town):
    return simulate_drive(town, seed=request.param, length_m=1800.0)


def by_time(drive, odometry):
    f, o = drive.drive.fixes, drive.drive.odometry
    fixes = [GeoFix(*map(float, row)) for row in zip(*(getattr(f, n) for n in GeoFix.__slots__))]  # noqa: B905
    start = o.time[0]
    wheels = [
        WheelTicks(*map(float, row))
        for row in zip(o.time, o.left, o.right, strict=True)
        if odometry(row[0] - start)
    ]
    return sorted(wheels + fixes, key=lambda one: one.time)


def errors(town, drive, observations):
    """Time since the start, and error in sigmas, of each estimate."""
    localizer, truth, rows = Localizer(town, vehicle=drive.vehicle), drive.truth, []
    for one in observations:
        said = localizer.update(one)
        if not said.hypotheses:
            continue
        at = min(int(np.searchsorted(truth.time, one.time)), len(truth.time) - 1)
        away = np.array([said.pose.x - truth.x[at], said.pose.y - truth.y[at]])
        rows.append((one.time - truth.time[0], away @ np.linalg.solve(said.cov[:2, :2], away)))
    return np.array(rows)


def test_dead_wheels_leave_what_the_receiver_says(town, drive):
    rows = errors(town, drive, by_time(drive, lambda t: not BEGIN < t < END))
    dark = rows[(rows[:, 0] > BEGIN) & (rows[:, 0] < END)]
    back = rows[rows[:, 0] >= END][:100]
    # sigmas mean what they say, but for fixes whose errors last: 25 is five sigmas
    assert np.mean(dark[:, 1] / 2) < 5.0
    assert np.max(back[:, 1]) < 40.0


def test_odometry_that_speaks_seldom_is_not_silent(town, drive):
    rare = by_time(drive, lambda t: abs(t / 4.0 - round(t / 4.0)) < 0.01)
    localizer = Localizer(town, vehicle=drive.vehicle)
    for one in rare:
        localizer.take(one)
    assert localizer._interval == pytest.approx(4.0, abs=0.5)
    assert not localizer._is_silent(8.0)
    assert localizer._is_silent(13.0)


def test_a_prediction_does_not_turn_for_ever(town, drive):
    """It goes on nearly straight for ten seconds, but where a road takes it round a corner."""
    localizer = Localizer(town, vehicle=drive.vehicle)
    straight = []
    for one in by_time(drive, lambda t: True):
        said = localizer.update(one)
        if said.status == "on_road" and abs(localizer._rate[1]) > 0.2:
            ahead = localizer.predict(said.time + 10.0)
            way = math.hypot(ahead.pose.x - said.pose.x, ahead.pose.y - said.pose.y)
            straight.append(way / abs(localizer._rate[0]))
    assert np.quantile(straight, 0.005) > 4.0  # but where the road ahead is not sure
    assert np.mean(straight) > 9.0


def test_a_prediction_covers_what_a_vehicle_may_do_meanwhile(town, drive):
    """It accelerates out of corners, brakes, stands and starts, and takes any road."""
    localizer, truth = Localizer(town, vehicle=drive.vehicle), drive.truth
    over, wrong, due = [], [], truth.time[0] + 20.0
    for one in by_time(drive, lambda t: True):
        localizer.take(one)
        if one.time < due or one.time + 14.0 > truth.time[-1]:
            continue
        due = one.time + 1.0
        for ahead in (3.0, 6.0, 10.0, 14.0):
            said = localizer.predict(one.time + ahead)
            at = int(np.searchsorted(truth.time, one.time + ahead))
            error = math.hypot(said.pose.x - truth.x[at], said.pose.y - truth.y[at])
            over.append(error > said.protection_level)
            wrong.append(said.p_road > 0.999 and error > 100.0)
    assert np.mean(over) < 0.005
    assert not any(wrong)


def test_a_vehicle_that_stands_may_start_meanwhile(town, drive):
    localizer, levels = Localizer(town, vehicle=drive.vehicle), []
    for one in by_time(drive, lambda t: True):
        said = localizer.update(one)
        if said.status == "stopped" and not levels:
            ahead = [localizer.predict(said.time + t) for t in (0.0, 2.0, 4.0, 8.0)]
            levels = [one.protection_level for one in ahead]
    assert not levels or np.all(np.diff(levels) > [2.0, 10.0, 20.0])  # 1.2 m/s²: 38 m in 8 s


def test_an_odometer_that_falls_silent_leaves_the_distance_uncertain(town, drive):
    """By a fifth of what is extrapolated; while it speaks, by little."""
    o, f = drive.drive.odometry, drive.drive.fixes
    car = drive.vehicle
    metres = 0.5 * (o.left * car.metres_per_tick_left + o.right * car.metres_per_tick_right)
    localizer = Localizer(town, vehicle=car)
    fixes = [GeoFix(*map(float, row)) for row in zip(*(getattr(f, n) for n in GeoFix.__slots__))]  # noqa: B905
    readings = [Distance(float(t), float(m)) for t, m in zip(o.time, metres, strict=True)]
    seen = sorted(
        [one for one in readings + fixes if one.time < o.time[0] + BEGIN], key=lambda one: one.time
    )
    for one in seen:
        said = localizer.update(one)
    ahead = localizer.predict(said.time + 20.0)
    away = abs(localizer._rate[0]) * 20.0
    sigma = math.sqrt(ahead.cov[0, 0] + ahead.cov[1, 1])
    assert away > 50.0
    assert sigma > 0.15 * away
