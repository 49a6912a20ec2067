"""The sensors of `benchmarks manoeuvres`: each has the errors it is said to have, and no more."""

import math

import numpy as np
import pytest
from benchmarks.manoeuvres.cases import SCENES, lying, sense, set_back, whole_seconds
from benchmarks.manoeuvres.motion import STEP, Motion
from benchmarks.manoeuvres.sensors import (
    PER_TICK,
    TRACK,
    Receiver,
    distances,
    fixes,
    of_sigma,
    wheel_ticks,
    yaw_rates,
)
from benchmarks.worlds.drives import START
from benchmarks.worlds.maps import Plane

from whichroad import GeoFix, WheelTicks

PLANE = Plane(49.4, 8.7)


@pytest.fixture
def motion() -> Motion:
    """200 s: a quarter of a circle of 1 km to the left at 10 m/s, then backwards at 5 m/s."""
    time = STEP * np.arange(round(200.0 / STEP))
    rolled = np.where(time < 157.0, 10.0 * time, 1570.0 - 5.0 * (time - 157.0))
    angle = rolled / 1000.0
    x, y = 1000.0 * np.sin(angle), 1000.0 * (1.0 - np.cos(angle))
    return Motion(time, x, y, angle, rolled, np.zeros(len(time), int))


def errors(motion, heard) -> np.ndarray:
    time = np.array([h.when - START for h in heard])
    lon, lat = np.array([(h.reading.lon_deg, h.reading.lat_deg) for h in heard]).T
    true = np.column_stack([np.interp(time, motion.time, v) for v in (motion.x, motion.y)])
    return PLANE.metres(lon, lat) - true


def column(heard, name) -> np.ndarray:
    return np.array([getattr(h.reading, name) for h in heard])


@pytest.mark.parametrize("receiver", [Receiver(), of_sigma(0.02), of_sigma(60.0, 5.0)])
def test_a_receivers_errors_have_the_sigma_it_reports(motion, receiver):
    drives = [fixes(motion, receiver, False, PLANE, np.random.default_rng(k)) for k in range(120)]
    square = np.mean([np.mean(errors(motion, heard) ** 2) for heard in drives])
    # slow errors: 120 drives of 200 s are some 300 independent values of each axis
    assert math.sqrt(square) == pytest.approx(receiver.sigma, rel=0.12)
    assert set(column(drives[0], "cov_ee")) == {receiver.sigma**2}
    assert np.diff(column(drives[0], "time")) == pytest.approx(receiver.period)


def test_most_of_an_error_is_slow(motion):
    heard = fixes(motion, Receiver(10.0, 0.1), False, PLANE, np.random.default_rng(2))
    assert np.abs(np.diff(errors(motion, heard), axis=0)).max() < 7.5  # 10 m sqrt(2 / 60 s)


def test_doppler_tells_the_way_that_the_vehicle_goes_and_its_speed(motion):
    heard = fixes(motion, Receiver(), True, PLANE, np.random.default_rng(2))
    time = column(heard, "time") - START
    back = time > 158.0
    assert column(heard, "speed")[time < 156.0] == pytest.approx(10.0, abs=0.5)
    assert column(heard, "speed")[back] == pytest.approx(5.0, abs=0.5)
    assert column(heard, "bearing_deg")[0] == pytest.approx(90.0, abs=6.0)
    assert column(heard, "bearing_deg")[back][0] == pytest.approx(180.0, abs=12.0)
    plain = fixes(motion, Receiver(), False, PLANE, np.random.default_rng(2))
    assert np.isinf(column(plain, "sigma_speed")).all()
    assert np.array_equal(column(plain, "lat_deg"), column(heard, "lat_deg"))


def test_wheels_count_the_way_and_the_turn_and_backwards_down(motion):
    heard = wheel_ticks(motion, np.random.default_rng(2))
    left, right = (PER_TICK * column(heard, side) for side in ("left", "right"))
    there = np.searchsorted(column(heard, "time") - START, 157.0)
    assert (left + right)[there] / 2 == pytest.approx(1570.0, rel=0.025)
    assert (right - left)[there] / TRACK == pytest.approx(math.pi / 2, abs=1.3)  # 0.04 % uneven
    assert left[-1] < left[there] - 200.0


def test_wheels_that_count_too_much_do_so_from_the_moment_on(motion):
    sound = wheel_ticks(motion, np.random.default_rng(2))
    factor = np.where(motion.time < 100.0, 1.0, 1.03)
    more = wheel_ticks(motion, np.random.default_rng(2), factor)
    extra = PER_TICK * (column(more, "left") - column(sound, "left"))
    time = column(sound, "time") - START
    assert np.abs(extra[time < 100.0]).max() == 0.0
    assert extra[np.searchsorted(time, 157.0)] == pytest.approx(0.03 * 570.0, rel=0.03)


def test_an_odometer_counts_up_both_ways_in_steps(motion):
    metres = column(distances(motion, np.random.default_rng(2)), "distance")
    assert (np.diff(metres) >= 0.0).all()
    assert metres[-1] == pytest.approx(1785.0, rel=0.025)
    assert 10.0 * metres == pytest.approx(np.round(10.0 * metres))


def test_a_speed_has_a_sign_and_a_yaw_rate_a_bias(motion):
    biases = []
    for seed in range(60):
        heard = yaw_rates(motion, np.random.default_rng(seed))
        biases.append(np.mean(column(heard, "yaw_rate")[:1500]) - 0.01)
    assert np.std(biases) == pytest.approx(0.002, rel=0.3)
    assert column(heard, "speed")[:1500] == pytest.approx(10.0, abs=0.4)
    assert column(heard, "speed")[-100:] == pytest.approx(-5.0, abs=0.3)


@pytest.fixture
def heard(motion):
    case = SCENES["town"][0]
    return sense(case, "wheels", motion, 100.0, PLANE, np.random.default_rng(3))


def test_readings_come_in_the_order_of_time(heard):
    when = [h.when for h in heard]
    assert when == sorted(when) == [h.reading.time for h in heard]
    assert {type(h.reading) for h in heard} == {GeoFix, WheelTicks}


def test_one_fix_lies_and_no_more(heard):
    wrong = [h for h in lying(5.0)(heard, START + 100.0) if h.reading.time != h.when]
    [one] = wrong
    assert one.reading.time == one.when + 5.0
    assert START + 100.0 < one.when <= START + 101.0
    assert isinstance(one.reading, GeoFix)


def test_a_clock_is_set_back_for_all_that_follows(heard):
    off = np.array([h.reading.time - h.when for h in set_back(heard, START + 100.0)])
    late = np.array([h.when > START + 100.0 for h in heard])
    assert np.array_equal(off, np.where(late, -3600.0, 0.0))


def test_whole_seconds_are_those_of_fixes_alone(heard):
    for h in whole_seconds(heard, 0.0):
        is_fix = isinstance(h.reading, GeoFix)
        assert h.reading.time == (math.floor(h.when) if is_fix else h.when)


def test_a_control_hears_the_same_but_for_what_is_wrong(motion):
    more, _, right = SCENES["tyres"]
    both = [
        sense(c, "wheels", motion, 100.0, PLANE, np.random.default_rng(3)) for c in (more, right)
    ]
    pairs = list(zip(*both, strict=True))
    assert all(a == b for a, b in pairs if a.when < START + 100.0 or isinstance(a.reading, GeoFix))
    assert any(a != b for a, b in pairs)
