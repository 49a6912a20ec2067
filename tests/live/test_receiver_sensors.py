"""Wheels and gyro of a dead-reckoning receiver, message by message, as in the log of it."""

import asyncio
from functools import partial

import numpy as np
import pytest

from live.service import free_port
from readers.test_ubx import CAR, NOON, esf, pvt, ride
from whichroad import Distance, SpeedYaw, WheelTicks, YawRate, read_drive
from whichroad.live.addresses import Address
from whichroad.live.decode import NmeaStream
from whichroad.live.health import Health
from whichroad.live.senders import OneSender
from whichroad.live.sources import NmeaInput, listen_tcp
from whichroad.writers.nmea_text import sealed


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


def test_a_receiver_that_starts_anew_is_heard_from_its_next_epoch_on():
    content = b""
    for k in range(60):
        tag = 900_000 + 1000 * k if k < 30 else 5_000 + 1000 * k
        content += esf(tag, (10, 50 * k)) + pvt(k)
    found, *_ = sensed(content)
    missing = {round(one.time - NOON) for one in found} ^ set(range(1, 60))
    assert missing == {30}  # as at the start, its clock is not known before


def test_wheels_of_a_second_sender_on_a_port_are_refused():
    content, *_ = ride(types=(8, 9))
    taken = []

    def sender(port, name):
        made = NmeaInput(
            health, NmeaStream(vehicle=CAR), lambda _, some, __: taken.append((name, *some))
        )
        made.port = port
        return made

    async def both():
        port = OneSender()
        first, second = sender(port, "first"), sender(port, "second")
        for part in (content[k : k + 5000] for k in range(0, len(content), 5000)):
            first.feed(part)
            second.feed(part)

    health = Health("port", "gnss")
    asyncio.run(both())
    assert {name for name, *_ in taken} == {"first"}
    assert health.refused > 1000


def test_who_has_left_a_port_does_not_hold_it():
    """A sender that connects for each fix is heard each time."""
    health, port = Health("port", "gnss"), free_port()

    async def send():
        address = Address("listen", "127.0.0.1", port)
        make = partial(NmeaInput, health, deliver=lambda _, some, __: taken.extend(some))
        server = asyncio.create_task(listen_tcp(address, health, lambda: make(stream=NmeaStream())))
        for k in range(5):
            await asyncio.sleep(0.1)
            _, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(sealed(f"GPRMC,0800{k:02d}.00,A,4924.5,N,00242.1,E,5,90,010626,,,A"))
            await writer.drain()
            writer.close()
        await asyncio.sleep(0.2)
        server.cancel()

    taken = []
    asyncio.run(send())
    assert (len(taken), health.refused) == (5, 0)


def test_dead_reckoned_fixes_are_passed_over_beside_their_wheels():
    content = b"".join(pvt(k, kind=1 if k > 5 else 3) + esf(1000 * k, (10, k)) for k in range(10))
    _, fixes, stream = sensed(content)
    assert len(fixes) == 6
    assert stream.skipped == 4
    alone = NmeaStream()
    assert len(alone.feed(content) + alone.flush()) == 10
    assert alone.sensed() == []
