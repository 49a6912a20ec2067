"""Wheels and gyro of a dead-reckoning receiver, message by message, as in the log of it."""

import numpy as np
import pytest

from readers.test_ubx import CAR, NOON, esf, pvt, ride
from whichroad import Distance, SpeedYaw, WheelTicks, YawRate, read_drive
from whichroad.live.decode import NmeaStream


def sensed(content, size=97):
    """What comes out of a log in pieces, and the fixes."""
    stream, found, fixes = NmeaStream(vehicle=CAR), [], []
    for k in range(0, len(content), size):
        fixes += stream.feed(content[k : k + size])
        found += stream.sensed()
    return found, fixes + stream.flush(), stream


def test_rear_wheels_come_out_on_the_clock_of_the_fixes_as_in_the_log(tmp_path):
    content, time, *_ = ride()
    found, fixes, stream = sensed(content)
    (tmp_path / "f9r.ubx").write_bytes(content)
    log = read_drive(tmp_path / "f9r.ubx", vehicle=CAR)[0].odometry
    assert len(fixes) == 180
    assert len(found) == len(time) - 1  # before the first epoch the clock is not known
    assert all(isinstance(one, WheelTicks) for one in found)
    assert [one.time for one in found] == pytest.approx(time[1:].tolist(), abs=1e-3)
    for side in ("left", "right"):
        steps = np.diff([getattr(one, side) for one in found])
        assert steps.tolist() == np.diff(getattr(log, side)[1:]).tolist()
    assert stream.skipped == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_a_tick_and_a_gyro_however_it_is_mounted(sign):
    content, time, distance, turn = ride(gyro_sign=sign, types=(5, 10))
    found, *_ = sensed(content)
    ways = [one for one in found if isinstance(one, Distance)]
    turns = [one for one in found if isinstance(one, YawRate)]
    assert len(ways) + len(turns) == len(found)
    steps = np.diff([one.distance for one in ways])
    assert steps == pytest.approx(np.diff(distance[1:]), abs=0.021)
    assert turns[0].time < NOON + 30.0  # the first turn has shown it
    turned = sum(0.1 * one.yaw_rate for one in turns)
    assert turned == pytest.approx(turn[-1] - np.interp(turns[0].time, time, turn), abs=0.05)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_speed_waits_until_it_is_known_how_the_gyro_is_mounted(sign):
    content, time, *_ = ride(gyro_sign=sign, types=(5, 11))
    found, *_ = sensed(content)
    assert all(isinstance(one, SpeedYaw) for one in found)
    assert max(one.yaw_rate for one in found) == pytest.approx(np.radians(12.0), abs=1e-3)
    assert min(one.yaw_rate for one in found) == pytest.approx(0.0, abs=1e-3)
    assert len(found) > 0.8 * len(time)


def test_sensors_clock_begins_again_at_32_bits_and_wheels_turn_backwards():
    content = b""
    for k in range(40):
        tick = 50 * k | (1 << 23 if k >= 20 else 0)
        content += esf((2**32 - 10_500 + 1000 * k) % 2**32, (10, tick)) + pvt(k)
    found, *_ = sensed(content)
    assert [one.time - NOON for one in found] == pytest.approx(np.arange(1.0, 40.0))
    steps = np.diff([one.distance for one in found])
    assert steps == pytest.approx(np.where(np.arange(2, 40) >= 20, -1.0, 1.0))


def test_dead_reckoned_fixes_are_passed_over_beside_their_wheels():
    content = b"".join(pvt(k, kind=1 if k > 5 else 3) + esf(1000 * k, (10, k)) for k in range(10))
    _, fixes, stream = sensed(content)
    assert len(fixes) == 6
    assert stream.skipped == 4
    alone = NmeaStream()
    assert len(alone.feed(content) + alone.flush()) == 10
    assert alone.sensed() == []
