"""Several sensors on one clock: nothing counted twice, nothing lost, gaps known."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from strategies import seeds
from whichroad.epochs import Timeline, build_timeline, epochs_of_fixes
from whichroad.errors import DriveError
from whichroad.filter.state import CLOCK, DISTANCE, WHEELS
from whichroad.geodesy.plane import Plane
from whichroad.observations import (
    INTERPOLATED,
    Drive,
    Fixes,
    Odometer,
    OdometryLog,
    SpeedYawRate,
    WheelCounts,
)
from whichroad.recorded import is_sparse
from whichroad.settings import Vehicle

PLANE = Plane(49.4, 8.7)
CAR = Vehicle(track_width=1.5, metres_per_tick_left=0.04, metres_per_tick_right=0.04)


def fixes_at(time: list[float], x: list[float] | None = None) -> Fixes:
    """Fixes along the plane's x axis with a sigma of 3 m."""
    n = len(time)
    lat, lon = PLANE.to_geodetic(np.array(x if x is not None else [0.0] * n), np.zeros(n))
    zero, inf, nine = np.zeros(n), np.full(n, np.inf), np.full(n, 9.0)
    return Fixes(
        np.array(time, float),
        lat,
        lon,
        nine,
        zero,
        nine,
        zero,
        inf,
        zero,
        inf,
        np.zeros(n, np.uint8),
    )


def timeline(odometry: OdometryLog | None = None, fixes: Fixes | None = None, mask=()) -> Timeline:
    return build_timeline(Drive("d", fixes, odometry), PLANE, CAR, mask)


def odometer(time: list[float], distance: list[float]) -> Odometer:
    return Odometer(np.array(time, float), np.array(distance, float))


def test_a_fix_between_two_wheel_readings_splits_the_arc_and_the_turn():
    log = SpeedYawRate(np.array([0.0, 1.0, 2.0]), np.full(3, 8.0), np.full(3, 0.2))
    e = timeline(log, fixes_at([1.25])).epochs
    np.testing.assert_allclose(e.time, [0.0, 1.0, 1.25, 2.0])
    np.testing.assert_allclose(e.arc, [0.0, 8.0, 2.0, 6.0])
    np.testing.assert_allclose(e.turn, [0.0, 0.2, 0.05, 0.15])
    assert e.has_fix.tolist() == [0, 0, 1, 0]
    assert (e.odometry_valid == 1).all()


@given(seeds, st.integers(2, 60), st.integers(0, 40))
def test_counts_telescope_however_fixes_cut_the_way(seed: int, readings: int, fixes: int):
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(0.0, 20.0, readings))
    left, right = np.cumsum(rng.integers(-3, 40, (2, readings)), axis=1).astype(float)
    at = np.sort(rng.uniform(time[0], time[-1], fixes))
    log = WheelCounts(time, left, right)
    e = timeline(log, fixes_at(at.tolist()) if fixes else None).epochs
    metres = 0.04 * np.array([left[-1] - left[0], right[-1] - right[0]])
    assert e.arc.sum() == pytest.approx(metres.mean(), abs=1e-9)
    assert e.turn.sum() == pytest.approx((metres[1] - metres[0]) / 1.5, abs=1e-9)


@given(seeds)
def test_epochs_are_in_time_order_and_hold_every_fix_once(seed: int):
    rng = np.random.default_rng(seed)
    time = np.sort(rng.uniform(0.0, 20.0, 30))
    at = np.sort(rng.choice(np.concatenate([time, rng.uniform(0.0, 20.0, 30)]), 12, replace=False))
    assume(np.diff(at).min() > 2e-4)  # closer ones share an epoch
    e = timeline(odometer(time.tolist(), time.tolist()), fixes_at(at.tolist(), at.tolist())).epochs
    assert (np.diff(e.time) > 0).all()
    with_fix = e.has_fix == 1
    assert with_fix.sum() == 12
    np.testing.assert_allclose(e.time[with_fix], at, atol=1e-4)
    np.testing.assert_allclose(e.fix[with_fix, 0], at, atol=1e-4)
    assert (e.fix[~with_fix] == 0).all()


def test_forward_and_left_are_the_chord_of_the_arc():
    log = SpeedYawRate(np.array([0.0, 1.0]), np.full(2, 9.0), np.full(2, 0.5))
    e = timeline(log).epochs
    radius = 9.0 / 0.5
    assert e.forward[1] == pytest.approx(radius * math.sin(0.5))
    assert e.left[1] == pytest.approx(radius * (1.0 - math.cos(0.5)))


def test_readings_less_than_a_tenth_of_a_millisecond_apart_are_one_epoch():
    e = timeline(odometer([0.0, 1.0, 2.0], [0.0, 5.0, 9.0]), fixes_at([1.00005])).epochs
    np.testing.assert_allclose(e.time, [0.0, 1.0, 2.0])
    assert e.has_fix.tolist() == [0, 1, 0]


def test_two_fixes_of_one_moment_are_one_epoch_with_one_of_them():
    e = timeline(fixes=fixes_at([5.0, 5.0, 6.0], [10.0, 11.0, 20.0])).epochs
    assert e.time.tolist() == [5.0, 6.0]
    assert round(float(e.fix[0, 0])) in (10, 11)


@pytest.mark.parametrize("offset", [0.0, 1.7e9])
def test_a_mask_withholds_and_counts_the_fixes_of_its_windows(offset: float):
    """Windows may be absolute, or count from the drive's start."""
    times = (offset + np.arange(10.0)).tolist()
    for window in [(2.0, 4.0), (offset + 2.0, offset + 4.0)]:
        t = timeline(odometer(times, times), fixes_at(times), [window, (8.5, 99.0)])
        assert t.masked == 4
        assert t.epochs.has_fix.tolist() == [1, 1, 0, 0, 0, 1, 1, 1, 1, 0]


def test_motion_in_a_gap_of_the_odometry_is_bridged_but_not_taken_for_measured():
    yaw = SpeedYawRate(np.array([0.0, 1.0, 6.0, 7.0]), np.full(4, 10.0), np.zeros(4))
    e = timeline(yaw, fixes_at([3.0])).epochs
    np.testing.assert_allclose(e.arc, [0.0, 10.0, 20.0, 30.0, 10.0])
    assert e.odometry_valid.tolist() == [1, 1, 0, 0, 1]


def test_an_odometer_measures_distance_in_a_gap_too():
    log = odometer([0.0, 1.0, 6.0, 7.0], [0.0, 10.0, 60.0, 70.0])
    e = timeline(log, fixes_at([3.0])).epochs
    np.testing.assert_allclose(e.arc, [0.0, 10.0, 20.0, 30.0, 10.0])
    assert e.odometry_valid.tolist() == [1, 1, 1, 1, 1]


def test_before_the_first_and_after_the_last_reading_the_vehicle_keeps_its_speed():
    log = odometer([2.5, 3.0, 4.0, 5.0], [0.0, 5.0, 15.0, 25.0])
    e = timeline(log, fixes_at([0.0, 1.0, 2.0, 6.0, 6.5])).epochs
    np.testing.assert_allclose(np.cumsum(e.arc), 10.0 * e.time, atol=1e-9)
    known = (e.time >= 3.0) & (e.time <= 5.0)
    assert (e.odometry_valid[known] == 1).all()
    assert (e.odometry_valid[e.time < 2.5] == 0).all()
    assert (e.odometry_valid[e.time > 5.0] == 0).all()


def test_what_moves_the_vehicle_is_the_best_that_was_logged():
    time = [0.0, 1.0, 2.0]
    yaw = SpeedYawRate(np.array(time), np.full(3, 8.0), np.zeros(3))
    assert timeline(yaw, fixes_at(time)).mode == WHEELS
    assert timeline(odometer(time, time), fixes_at(time)).mode == DISTANCE
    assert timeline(fixes=fixes_at(time)).mode == CLOCK
    assert timeline(odometer([0.0], [0.0]), fixes_at(time)).mode == CLOCK


def test_a_drive_without_fixes_and_odometry_is_refused():
    with pytest.raises(DriveError, match="d: it holds neither fixes nor odometry"):
        timeline()
    with pytest.raises(DriveError, match="neither"):
        timeline(odometer([1.0], [0.0]))


@given(seeds, st.lists(st.integers(1, 9), min_size=1, max_size=5))
def test_drives_of_fixes_alone_are_put_on_their_clocks_at_once(seed: int, counts: list[int]):
    rng = np.random.default_rng(seed)
    parts = [fixes_at(np.cumsum(rng.uniform(1e-5, 3e-4, n)).tolist()) for n in counts]
    columns = [np.concatenate(c) for c in zip(*(_columns(p) for p in parts), strict=True)]
    first = np.cumsum([0, *counts[:-1]]).tolist()
    epochs, own = epochs_of_fixes(Fixes(*columns), first, PLANE)
    for low, good, part in zip(first, own, parts, strict=True):
        assert good == (np.diff(part.time) > 1e-4).all()
        if good:
            masked = timeline(fixes=part, mask=[(-9.0, -8.0)])  # which hides nothing
            own_rows = epochs[low : low + len(masked.epochs)]
            np.testing.assert_array_equal(own_rows, masked.epochs)


def lined(every: int, n: int = 100) -> Fixes:
    """Fixes each second of which one of `every` was measured."""
    fixes = fixes_at([float(k) for k in range(n)], [5.0 * k for k in range(n)])
    flags = np.where(np.arange(n) % every > 0, INTERPOLATED, 0).astype(np.uint16)
    return dataclasses.replace(fixes, flags=flags)


def test_belief_waits_at_places_that_were_interpolated():
    alone = timeline(fixes=lined(20))
    assert alone.epochs.filled.tolist() == [int(k % 20 > 0) for k in range(100)]
    assert alone.interval == 20.0
    assert is_sparse(alone)


def test_beside_odometry_places_that_were_interpolated_are_no_fixes():
    time = [0.5 * k for k in range(200)]
    both = timeline(odometer(time, [2.5 * k for k in range(200)]), lined(20))
    assert np.flatnonzero(both.epochs.has_fix).tolist() == [0, 40, 80, 120, 160]
    assert not both.epochs.filled.any()


def test_a_mask_counts_fixes_and_leaves_places_that_were_interpolated():
    masked = timeline(fixes=lined(20), mask=[(35.0, 45.0)])
    assert masked.masked == 11
    assert not masked.epochs.has_fix[40]
    assert masked.epochs.filled[46:60].all()


def _columns(fixes: Fixes) -> list[np.ndarray]:
    return [getattr(fixes, f.name) for f in dataclasses.fields(Fixes)]


@given(st.lists(st.floats(0.01, 100.0), max_size=12))
def test_the_usual_interval_is_the_median(steps: list[float]):
    line = timeline(fixes=fixes_at(np.cumsum([0.0, *steps]).tolist()))
    wanted = np.median(np.diff(line.epochs.time)) if steps else 0.0
    assert line.interval == wanted
