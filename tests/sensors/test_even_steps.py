"""Odometers that count in coarse steps: learnt, and read within them."""

import json

import numpy as np
import pytest

from whichroad.observations import Distance, Odometer
from whichroad.sensors.even_steps import EvenSteps, even_log
from whichroad.sensors.odometry import motion_of
from whichroad.settings import Vehicle

TODAY = 1780300000.0


def driven(seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Times every 10 ms and ways of a drive with stops, s and m."""
    rng = np.random.default_rng(seed)
    parts = [np.zeros(500)]
    for _ in range(8):
        top = rng.uniform(4.0, 14.0)
        parts += [np.arange(0.0, top, 0.015), np.full(rng.integers(500, 2000), top)]
        parts += [np.arange(top, 0.0, -0.015), np.zeros(rng.integers(200, 1200))]
    speed = np.concatenate(parts)
    return 0.01 * np.arange(len(speed)), np.cumsum(speed) * 0.01


def read(step: float, hz: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, what is read, and where it was."""
    time, way = driven(seed)
    at = slice(None, None, round(100 / hz))
    return TODAY + time[at], np.floor(way[at] / step) * step, way[at]


def told(steps: EvenSteps, time: np.ndarray, distance: np.ndarray) -> np.ndarray:
    rows = zip(time.tolist(), distance.tolist(), strict=True)
    return np.array([steps.even(Distance(*row)).distance for row in rows])


@pytest.mark.parametrize(("step", "hz"), [(5.0, 1), (5.0, 10), (0.5, 10), (0.2, 10), (1.0, 1)])
def test_a_step_is_learnt_and_the_way_is_even(step: float, hz: int):
    time, distance, way = read(step, hz)
    steps = EvenSteps()
    even = told(steps, time, distance)
    assert steps.step == pytest.approx(step)
    late = slice(30 * hz, None)
    assert np.abs(even - distance)[late].max() < 2.0 * step
    assert np.std((even - way)[late]) < 0.5 * step
    speed = np.diff(even[late]) * hz
    assert (speed >= 0.0).all()
    assert np.abs(np.diff(speed)).max() * hz < 8.0  # m/s²; 500 as they are read, of 5 m at 10 Hz


@pytest.mark.parametrize(("step", "hz"), [(0.004, 1), (0.004, 10), (0.1, 10)])
def test_fine_distances_are_as_they_are_read(step: float, hz: int):
    time, distance, _ = read(step, hz)
    steps = EvenSteps()
    assert np.array_equal(told(steps, time, distance), distance)
    assert steps.step == 0.0
    log = Odometer(time, distance)
    assert even_log(log) == (log, None)


def test_one_speed_tells_no_step():
    time = TODAY + np.arange(600) / 10.0
    log = Odometer(time, np.maximum(np.arange(600.0), 50.0) - 50.0)
    assert even_log(log) == (log, None)


def test_speeds_that_are_constant_by_stretches_tell_no_step():
    time = TODAY + np.arange(600.0)
    speed = np.repeat([50.0, 30.0, 0.0, 70.0, 50.0, 30.0], 100) / 3.6
    for noise in (0.0, 0.02, 0.05):
        way = np.cumsum(speed) + np.random.default_rng(1).normal(0.0, noise, len(time))
        log = Odometer(time, way)
        assert even_log(log) == (log, None)


@pytest.mark.parametrize("step", [0.5113, 1.0037, 5.0])
def test_an_odd_reading_and_a_pause_do_not_change_the_step(step: float):
    time, distance, way = read(step, 10)
    distance = np.round(distance, 3)
    distance[len(time) // 2] += 0.3 * step
    heard = (time < time[0] + 60.0) | (time > time[0] + 75.0)
    even, unsure = even_log(Odometer(time[heard], distance[heard]))
    assert unsure is not None
    assert np.std((even.distance - way[heard])[300:]) < 0.6 * step


def test_a_reading_that_comes_twice_is_none():
    time, distance, _ = read(5.0, 10)
    once, twice = EvenSteps(), EvenSteps()
    for row in zip(time.tolist(), distance.tolist(), strict=True):
        told_once = once.even(Distance(*row)).distance
        assert twice.even(Distance(*row)).distance == told_once
        assert twice.even(Distance(*row)).distance == told_once


@pytest.mark.parametrize("step", [0.2, 0.5, 5.0])
def test_a_recording_that_begins_at_speed_is_not_behind(step: float):
    time = TODAY + np.arange(600) / 10.0
    way = 20.0 * (time - TODAY)
    even, _ = even_log(Odometer(time, np.floor(way / step) * step))
    assert np.abs(even.distance - way).max() < 3.0 * step


def test_a_gap_does_not_change_the_step():
    time, distance, way = read(0.2, 10)
    heard = (time < time[0] + 60.0) | (time > time[0] + 95.0)
    even, _ = even_log(Odometer(time[heard], distance[heard]))
    assert np.abs(even.distance - way[heard]).max() < 0.5


def test_what_is_unsure_is_as_much_as_it_errs():
    time, distance, way = read(5.0, 10)
    steps, error, unsure = EvenSteps(), [], 0.0
    for t, d, w in zip(time.tolist(), distance.tolist(), way.tolist(), strict=True):
        error.append(steps.even(Distance(t, d)).distance - w)
        unsure += steps.unsure
    assert unsure / (time[-1] - time[0]) > 0.05  # m²/s
    assert np.std(error[300:]) < 1.6


def test_who_drives_backwards_is_told_so():
    time, distance, way = read(5.0, 10)
    there = np.concatenate([distance, np.floor((2.0 * way[-1] - way - way[-1]) / 5.0) * 5.0])
    clock = np.concatenate([time, time[-1] + 0.1 + time - time[0]])
    even = told(EvenSteps(), clock, there)
    back = np.diff(even[len(time) + 300 :])
    assert (back <= 0.0).all()
    assert np.abs(even - there)[300:].max() < 12.0  # where it turns back at speed


def test_a_recording_is_told_as_on_line():
    time, distance, _ = read(5.0, 10)
    motion = motion_of(Odometer(time, distance), Vehicle())
    assert np.array_equal(motion.distance, told(EvenSteps(), time, distance) - distance[0])
    assert motion.unsure is not None
    assert np.asarray(motion.unsure_at(time)).sum() == pytest.approx(motion.unsure.sum(), rel=0.01)


def test_it_is_kept():
    time, distance, _ = read(5.0, 10)
    whole, half = EvenSteps(), len(time) // 2
    expected = told(whole, time, distance)
    first, second = EvenSteps(), EvenSteps()
    told(first, time[:half], distance[:half])
    second.restore(json.loads(json.dumps(first.kept())))
    assert np.array_equal(told(second, time[half:], distance[half:]), expected[half:])
