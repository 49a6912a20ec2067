"""Clocks that differ: late fixes and late odometry are found, mended and named."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import whichroad
from whichroad import Distance, GeoFix, Localizer, WheelTicks, simulate_drive
from whichroad.epochs import build_timeline
from whichroad.geodesy.plane import Plane
from whichroad.lineage.epoch_by_epoch import run_again
from whichroad.observations import Drive, Fixes, Observation, Odometer
from whichroad.recorded import localize_recorded
from whichroad.roadmap import RoadMap
from whichroad.sensors.clock_delay import delay_of
from whichroad.sensors.odometry import Motion, motion_of
from whichroad.settings import Settings
from whichroad.simulate import SimulatedDrive

PLANE = Plane(49.4, 8.7)
SECONDS = 600.0


def speed_at(time: np.ndarray, seed: int = 0) -> np.ndarray:
    """m/s of a car in a town: it stops now and then, and never twice alike."""
    random = np.random.default_rng(seed)
    at = np.cumsum(random.uniform(8.0, 25.0, 80))
    return np.interp(time, at, random.choice([0.0, 8.0, 14.0], len(at)))


def motion(seed: int = 0) -> Motion:
    time = np.arange(0.0, SECONDS, 0.1)
    speed = speed_at(time, seed)
    steps = 0.05 * (speed[1:] + speed[:-1])
    return Motion(time, np.concatenate([[0.0], np.cumsum(steps)]), 0.0 * time)


def fixes_of(metres: np.ndarray, time: np.ndarray, seed: int = 0) -> Fixes:
    """Fixes of a car that has driven so far towards the north."""
    random = np.random.default_rng(seed)
    n = len(time)
    x, y = random.normal(0.0, 0.7, (2, n))
    lat, lon = PLANE.to_geodetic(x, metres + y)
    nan, cov = np.full(n, np.nan), np.full(n, 6.0)
    return Fixes(time, lat, lon, cov, 0.0 * cov, cov, nan, nan, nan, nan, np.zeros(n, np.uint8))


def late_fixes(delay: float, seed: int = 0) -> Fixes:
    """Fixes that are stamped so much too late, or too early."""
    driven = motion(seed)
    time = np.arange(0.5, SECONDS - 1.0)
    return fixes_of(np.interp(time, driven.time, driven.distance), time + delay, seed)


@pytest.mark.parametrize("delay", [0.8, 1.0, 3.0, 18.0, 40.0, -0.7, -2.0, -18.0])
def test_a_delay_is_found(delay: float):
    for seed in range(4):
        assert delay_of(motion(seed), late_fixes(delay, seed), PLANE) == pytest.approx(
            delay, abs=0.15
        )


@pytest.mark.parametrize("delay", [0.0, 0.1, -0.2])
def test_clocks_that_agree_stay_as_they_are(delay: float):
    assert all(delay_of(motion(k), late_fixes(delay, k), PLANE) == 0.0 for k in range(10))


@pytest.mark.parametrize("cov", [0.0, np.inf, np.nan])
def test_sigmas_that_say_nothing_do_no_harm(cov: float):
    fixes = late_fixes(1.0)
    fixes.cov_ee[:] = fixes.cov_nn[:] = cov
    assert delay_of(motion(), fixes, PLANE) in (0.0, pytest.approx(1.0, abs=0.15))


def test_too_little_tells_nothing():
    none = late_fixes(1.0)
    few = Fixes(*(getattr(none, name)[:20] for name in Fixes.__slots__))
    steady = Motion(np.arange(0.0, SECONDS), 10.0 * np.arange(0.0, SECONDS), None)
    for driven, fixes in ((motion(), None), (motion(), few), (steady, none)):
        assert delay_of(driven, fixes, PLANE) == 0.0


def test_a_minute_of_wrong_fixes_is_no_delay():
    """For a minute they run away at 8 m/s while the car stands, or comes back."""
    time = np.arange(0.5, SECONDS - 1.0)
    driven = motion()
    metres = np.interp(time, driven.time, driven.distance)
    for begin in range(60, 500, 40):
        pulled = metres + 8.0 * np.clip(time - begin, 0.0, 60.0)
        assert delay_of(driven, fixes_of(pulled, time), PLANE) == 0.0


@pytest.mark.parametrize("lag", [0.5, 1.0, 1.5])
def test_a_receiver_that_smooths_is_not_late(lag: float):
    """It believes in a constant velocity; it lags while that changes, and catches up."""
    driven = motion()
    time = np.arange(0.5, SECONDS - 1.0)
    metres = np.interp(time, driven.time, driven.distance)
    speed = speed_at(time)
    kept = np.exp(-1.0 / lag)
    place, going, out = metres[0], speed[0], []
    for k in range(len(time)):
        place = metres[k] + kept * (place + (going if k else 0.0) - metres[k])
        going = speed[k] + kept * (going - speed[k])
        out.append(place)
    assert abs(delay_of(driven, fixes_of(np.array(out), time), PLANE)) < 0.5


def slipping(time: np.ndarray, metres: np.ndarray, slip: float) -> np.ndarray:
    """The same by wheels that spin while the car becomes faster, and lock while it brakes."""
    steps = np.diff(metres, prepend=metres[0])
    speed = np.convolve(np.gradient(metres, time), np.ones(5) / 5.0, "same")
    change = np.gradient(speed, time)
    return metres[0] + np.cumsum(steps * (1.0 + slip * ((change > 0.4) - 1.2 * (change < -0.6))))


@pytest.mark.parametrize("slip", [0.1, 0.15])
def test_wheels_that_slip_are_no_delay(slip: float):
    for seed in range(6):
        true = motion(seed)
        time = np.arange(0.5, SECONDS - 1.0)
        fixes = fixes_of(np.interp(time, true.time, true.distance), time, seed)
        driven = true._replace(distance=slipping(true.time, true.distance, slip))
        assert delay_of(driven, fixes, PLANE) == 0.0


@pytest.fixture(scope="module")
def ride(town):
    """Eight kilometres of a car with wheels."""
    return simulate_drive(town, seed=3, length_m=8000.0)


def shifted(drive: Drive, fixes: float = 0.0, wheels: float = 0.0) -> Drive:
    """The same with stamps that are so much too late."""
    assert drive.fixes is not None
    assert drive.odometry is not None
    return replace(
        drive, fixes=replace(drive.fixes, time=drive.fixes.time + fixes),
        odometry=replace(drive.odometry, time=drive.odometry.time + wheels),
    )  # fmt: skip


def off(roads: RoadMap, ride: SimulatedDrive, time: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Errors of latitudes and longitudes, m."""
    x, y = roads.plane.from_geodetic(*places)
    truth = ride.truth
    return np.hypot(
        x - np.interp(time, truth.time, truth.x), y - np.interp(time, truth.time, truth.y)
    )


def errors(roads: RoadMap, answer: whichroad.Result, ride: SimulatedDrive) -> np.ndarray:
    """m, of the points."""
    table = answer.to_arrow()
    time = table["time"].to_numpy().astype("datetime64[us]").astype(float) / 1e6
    return off(roads, ride, time, np.array([table[name].to_numpy() for name in ("lat", "lon")]))


@pytest.mark.parametrize(("late", "wheels"), [(1.5, 0.0), (4.0, 0.0), (0.0, 1.5), (0.0, 17.0)])
def test_a_recorded_drive_is_answered_as_if_its_clocks_agreed(town, ride, late, wheels):
    sound = whichroad.match(ride.drive, town, vehicle=ride.vehicle)
    answer = whichroad.match(shifted(ride.drive, late, wheels), town, vehicle=ride.vehicle)
    assert [one.what for one in sound.diagnosis] == []
    [found] = answer.diagnosis
    assert found.what == "clock"
    assert found.statistic == pytest.approx(late - wheels, abs=0.15)
    late_by = found.statistic  # the note of the readers names the odometry
    assert f"add {-late_by:.1f} s to gnss, or {late_by:.1f} s to odometry," in found.advice
    usual, now = (np.nanmedian(errors(town, one, ride)) for one in (sound, answer))
    assert now < usual + 2.0  # a second is 10 m


def test_a_late_odometer_in_rows_of_the_fixes_is_answered_at_the_rows(town, ride):
    """One table: each row has a fix, and what the odometer said 1.5 s before."""
    fixes, wheels = ride.drive.fixes, motion_of(ride.drive.odometry, ride.vehicle)
    distance = np.interp(fixes.time - 1.5, wheels.time, wheels.distance)
    one = replace(ride.drive, odometry=Odometer(fixes.time, distance))
    line = build_timeline(one, town.plane, ride.vehicle)
    assert line.delay == pytest.approx(-1.5, abs=0.2)
    np.testing.assert_array_equal(line.epochs.time, fixes.time)
    true = np.interp(fixes.time, wheels.time, wheels.distance)
    inside = slice(10, -10)
    assert np.abs(np.cumsum(line.epochs.arc) - true)[inside].std() < 2.0  # 5 m, not put right


def test_late_fixes_of_many_trips_are_mended_in_each(town, ride):
    late = build_timeline(shifted(ride.drive, 1.5), town.plane, ride.vehicle)
    assert late.late == late.delay == pytest.approx(1.5, abs=0.1)
    wheels = build_timeline(shifted(ride.drive, 0.0, 1.5), town.plane, ride.vehicle)
    assert wheels.late == 0.0
    assert wheels.delay == pytest.approx(-1.5, abs=0.1)
    left = build_timeline(shifted(ride.drive, 1.5), town.plane, ride.vehicle, clocks=False)
    assert left.late == left.delay == 0.0


def test_the_lineage_of_a_late_drive_is_that_of_its_points(town, ride):
    late = build_timeline(shifted(ride.drive, 1.5), town.plane, ride.vehicle)
    car = {"vehicle": ride.vehicle, "settings": Settings()}
    again = run_again(town, late, start=None, model="default", **car)
    for _ in again.epochs:
        pass
    rows = localize_recorded(town, late, **car).output.rows
    assert np.array_equal(again.estimates.x, rows.x, equal_nan=True)
    assert np.array_equal(again.estimates.p_edge, rows.p_edge, equal_nan=True)


def one_by_one(drive: Drive) -> Sequence[Observation]:
    f, o = drive.fixes, drive.odometry
    if isinstance(o, Odometer):
        wheels = [Distance(*map(float, row)) for row in zip(o.time, o.distance, strict=True)]
    else:
        wheels = [WheelTicks(*map(float, row)) for row in zip(o.time, o.left, o.right, strict=True)]
    fixes = [
        GeoFix(float(t), float(a), float(b), float(c), 0.0, float(c))
        for t, a, b, c in zip(f.time, f.lat_deg, f.lon_deg, f.cov_ee, strict=True)
    ]
    return sorted([*wheels, *fixes], key=lambda one: one.time)


@pytest.mark.parametrize(("late", "wheels"), [(1.0, 0.0), (0.0, 1.0)])
def test_on_line_a_delay_is_learnt_while_driving(town, ride, late, wheels):
    """Within a minute; before, the car is a second's way off."""
    error = {}
    for name, drive in (("sound", ride.drive), ("late", shifted(ride.drive, late, wheels))):
        online = Localizer(town, vehicle=ride.vehicle)
        told = [online.update(one) for one in one_by_one(drive)]
        rows = np.array([(one.time, one.pose.lat, one.pose.lon) for one in told if one.answered]).T
        later = rows[:, rows[0] > rows[0, 0] + 120.0]
        error[name] = np.median(off(town, ride, later[0], later[1:]))
    assert error["late"] < error["sound"] + 1.5
    names = {one.what: one.statistic for one in online.diagnosis}
    assert names == {"clock": pytest.approx(late - wheels, abs=0.35)}


@pytest.mark.parametrize("late", [0.0, 1.0])
def test_on_line_levels_cover_a_delay_that_is_likely(town, late):
    """An odometer alone, whose delay no turn tells: seed 2, until it is sure."""
    ride = simulate_drive(town, seed=2, length_m=3000.0)
    wheels = motion_of(ride.drive.odometry, ride.vehicle)
    drive = replace(shifted(ride.drive, late), odometry=Odometer(wheels.time, wheels.distance))
    online = Localizer(town, vehicle=ride.vehicle)
    told = [one for one in map(online.update, one_by_one(drive)) if one.answered]
    place = np.array([(one.pose.lat, one.pose.lon) for one in told]).T
    error = off(town, ride, np.array([one.time for one in told]), place)
    level = np.array([one.protection_level for one in told])
    assert np.mean(error > level) < 0.02  # 0.70 were above
    assert late or np.median(level) < 13.0  # sound ones are as they were


def test_on_line_wheels_that_slip_are_no_delay(town, ride):
    """By a quarter of their way, both alike: turns are as measured, and no clock is named."""
    o = ride.drive.odometry
    middle = 0.5 * (o.left + o.right)
    more = slipping(o.time, middle, 0.25) - middle
    drive = replace(ride.drive, odometry=replace(o, left=o.left + more, right=o.right + more))
    online = Localizer(town, vehicle=ride.vehicle)
    for one in one_by_one(drive):
        online.update(one)
    assert "clock" not in [one.what for one in online.diagnosis]
