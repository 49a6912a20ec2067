"""What arrives in pieces says the same as the whole log, and says it at once."""

import asyncio
import math
import time
from collections import Counter
from dataclasses import astuple, replace

import can
import numpy as np
import pytest

from whichroad import (
    Distance,
    GeoFix,
    Localizer,
    SpeedYaw,
    Vehicle,
    WheelSpeed,
    WheelTicks,
    YawRate,
    read_drive,
    read_vehicle,
)
from whichroad.live.addresses import nmea_address
from whichroad.live.decode import CanStream, NmeaStream
from whichroad.live.filter_loop import FilterLoop
from whichroad.live.playback import RecordedObservations
from whichroad.live.sources import READERS, NmeaInput
from whichroad.live.vehicle_run import Fitted, VehicleRun
from whichroad.nmea_frame import checksum
from whichroad.readers.can_frames import key, read_frames
from whichroad.readers.nmea import NmeaParser
from whichroad.readers.reckoned_places import LEFT_OUT
from whichroad.simulate.drive_files import nmea_text, write_drive
from whichroad.simulate.simulated_drive import START


@pytest.fixture(scope="module")
def log(ride):
    return nmea_text(ride).encode()


def bursts(log):
    """The log second by second; the simulator ends each with ZDA."""
    found, burst = [], b""
    for line in log.splitlines(keepends=True):
        burst += line
        if line[3:6] == b"ZDA":
            found.append(burst)
            burst = b""
    return found


def of_blocks(data):
    parser = NmeaParser()
    return parser.feed(data) + parser.flush()


def of_pieces(data, rng):
    parser, fixes, at = NmeaParser(today=START), [], 0
    while at < len(data):
        size = int(rng.integers(1, 400))
        fixes += parser.feed(data[at : at + size])
        at += size
    return fixes + parser.flush()


def assert_same(ours, theirs, fields=slice(None)):
    assert len(ours) == len(theirs)
    for a, b in zip(ours, theirs, strict=True):
        a, b = astuple(a)[fields], astuple(b)[fields]
        assert a == pytest.approx(b, rel=1e-12, abs=1e-12)


def test_pieces_say_what_the_whole_log_says(log):
    assert_same(of_pieces(log, np.random.default_rng(1)), of_blocks(log))


@pytest.mark.parametrize("seed", range(20))
def test_lost_and_damaged_sentences_say_what_the_whole_log_says(log, seed):
    rng = np.random.default_rng(seed)
    lines = [line for line in log.splitlines(keepends=True)[:400] if rng.random() > 0.1]
    for i in rng.integers(0, len(lines), 40):
        line = bytearray(lines[i])
        line[rng.integers(0, len(line) - 2)] = rng.integers(33, 127)
        lines[i] = bytes(line)
    data = b"".join(lines)
    # a VTG alone belongs to the burst before, which is out already: speeds may differ
    assert_same(of_pieces(data, rng), of_blocks(data), slice(6))


def test_a_fix_comes_out_with_its_last_sentence_once_that_is_known(log):
    stream, waited = NmeaStream(), []
    for burst in bursts(log)[:30]:
        fixes = stream.feed(burst)
        waited.append(not fixes)
        assert len(fixes or stream.flush()) == 1
    assert waited == [True] * 3 + [False] * 27


def test_a_receiver_that_changes_its_burst_is_learnt_anew(log):
    stream, fixes = NmeaStream(), []
    for number, burst in enumerate(bursts(log)[:60]):
        lines = burst.splitlines(keepends=True)
        if number >= 30:  # now it ends with RMC, after what used to be the end
            lines = [lines[0], lines[1], lines[4], lines[3], lines[2]]
        for line in lines:
            fixes += stream.feed(line)
    fixes += stream.flush()
    assert len(fixes) == 60
    assert all(math.isfinite(fix.sigma_speed) for fix in fixes[40:])


def test_a_stream_out_of_order_gives_the_answer_of_the_sorted_one(town, ride, log):
    rng, some = np.random.default_rng(3), bursts(log)[:60]
    order = np.argsort(np.arange(60) + rng.uniform(0.0, 3.0, 60))
    said = []
    for chosen in (range(60), order):
        loop, stream = FilterLoop(Localizer(town, vehicle=ride.vehicle), window=4.0), NmeaStream()
        for k in (0, *(k for k in chosen if k)):
            loop.observe(stream.feed(some[k]) + stream.flush())
        assert stream.skipped == 0
        assert loop.health()["skipped"] == {}
        said.append(loop.localizer.estimate())
    assert said[0].time == said[1].time
    assert np.array_equal(said[0].cov, said[1].cov)
    assert (said[0].pose, said[0].edge) == (said[1].pose, said[1].edge)


def test_what_a_decoder_drops_is_told_by_health_with_its_reason(town, log):
    loop, stream = FilterLoop(Localizer(town), window=1.0), NmeaStream()
    sensor, some = loop.sensor("port", "gnss"), bursts(log)[:20]

    async def run():
        into = NmeaInput(sensor, stream, loop.take)
        for k in (*range(15), 9, 14, 0):
            into.feed(some[k])
            into.end()

    asyncio.run(run())
    assert sensor.skipped_why == {"repeated time": 3}
    assert loop.health()["skipped"] == {"repeated time": 3}


def test_with_times_of_arrival_a_fix_that_comes_late_is_not_taken_for_a_new_one(town, log):
    run = VehicleRun(Fitted(Localizer(town)), window=1.0, rate=10.0)
    stream, health = NmeaStream(), run.filter_loop.sensor("port", "gnss")
    for burst in (*(bursts(log)[k] for k in (0, 1, 3, 2, 4)), *bursts(log)[100:101]):
        fixes = stream.feed(burst) + stream.flush()
        run._on_arrival(health, fixes, time.perf_counter())
    assert health.count == 5
    assert run.filter_loop.health()["skipped"] == {"time running backwards": 1}


def dead_reckoned(burst):
    """The burst, its GGA with the quality that a receiver gives to such a place."""
    lines = []
    for line in burst.splitlines():
        fields = line.split(b"*")[0].split(b",")
        if fields[0].endswith(b"GGA"):
            fields[6] = b"6"
        body = b",".join(fields)
        lines.append(b"%s*%02X\r\n" % (body, checksum(body[1:])))
    return b"".join(lines)


@pytest.mark.parametrize("by_arrival", [False, True])
@pytest.mark.parametrize(
    ("kinds", "used"),
    [((WheelTicks,), False), ((Distance, YawRate), False), ((Distance,), True), ((), True)],
)
def test_dead_reckoned_places_are_left_out_while_odometry_with_turns_is_heard(
    town, ride, log, monkeypatch, kinds, used, by_arrival
):
    made = []
    monkeypatch.setitem(READERS, "udp", lambda address, health, make: made.append(make()))
    car = Localizer(town, vehicle=ride.vehicle)
    run = VehicleRun(Fitted(car, nmea=[nmea_address("udp://:1")]), window=1.0, rate=10.0)
    [begin] = run.inputs(by_arrival)
    begin()
    loop, some = run.filter_loop, bursts(log)[:12]

    async def feed():
        for k, burst in enumerate(some):
            now = time.time() if by_arrival else START + k
            if k < 10:  # at the 11th it was heard a second ago
                for kind in kinds:
                    values = (0.0, 0.0) if kind is WheelTicks else (0.0,)
                    loop.observe([kind(now - 0.001, *values)])
            made[0].feed(dead_reckoned(burst) if k in (0, 6, 11) else burst)
            made[0].end()

    asyncio.run(feed())
    (health,) = loop.sensors.values()
    # the first says where the drive begins
    assert health.count == (12 if used else 10)
    assert health.skipped_why == ({} if used else {LEFT_OUT: 2})


@pytest.mark.parametrize(
    ("rest", "motion", "used"),
    [
        (WheelSpeed(0.0, 0.0, 0.0), WheelSpeed(0.0, 9.0, 9.0), True),
        (SpeedYaw(0.0, 0.0, 0.01), SpeedYaw(0.0, 9.0, 0.0), True),
        (WheelTicks(0.0, 7.0, 7.0), WheelTicks(0.0, 9.0, 9.0), True),
        (SpeedYaw(0.0, 9.0, 0.0), SpeedYaw(0.0, 9.0, 0.0), False),
    ],
)
def test_dead_reckoned_places_are_used_once_they_move_on_while_odometry_stands(
    town, ride, log, monkeypatch, rest, motion, used
):
    made = []
    monkeypatch.setitem(READERS, "udp", lambda address, health, make: made.append(make()))
    car = Localizer(town, vehicle=ride.vehicle)
    run = VehicleRun(Fitted(car, nmea=[nmea_address("udp://:1")]), window=1.0, rate=10.0)
    [begin] = run.inputs(False)
    begin()

    async def feed():
        for k, burst in enumerate(bursts(log)[:40]):
            reading = motion if k < 8 else rest
            run.filter_loop.observe([replace(reading, time=START + k - 0.001)])
            made[0].feed(dead_reckoned(burst) if k >= 10 else burst)
            made[0].end()

    asyncio.run(feed())
    (health,) = run.filter_loop.sensors.values()
    assert health.count == (30 if used else 10)  # from 20 s on
    assert health.skipped_why == {LEFT_OUT: 10 if used else 30}


def test_odometry_that_fell_silent_stands_beside_no_place(town, ride, observations):
    loop = FilterLoop(Localizer(town, vehicle=ride.vehicle), window=1.0)
    assert not loop.odometry_beside(START)
    loop.observe([one for one in observations if one.time < START + 20.0])
    assert loop.odometry_beside(START + 20.0)
    assert not loop.odometry_beside(START + 26.0)


def test_a_clock_offset_moves_the_fixes(log):
    burst = bursts(log)[0]
    late, plain = NmeaStream(offset=1.5), NmeaStream()
    (a,), (b,) = (s.feed(burst) or s.flush() for s in (late, plain))
    assert a.time - b.time == 1.5


@pytest.mark.parametrize("size", [1, 7, 64, 10_000])
def test_rubbish_between_sentences_counts_once_for_each_stretch(log, size):
    first, second, third = bursts(log)[:3]
    content = b"\n".join(
        (first, b"\x00noise\n" * 15, second, b"more noise", third, b"at the end\n")
    )
    stream = NmeaStream()
    fixes = [f for k in range(0, len(content), size) for f in stream.feed(content[k : k + size])]
    assert len(fixes + stream.flush()) == 3
    assert stream.skipped_why == {"stretch of bytes outside NMEA sentences": 3}
    assert stream.skipped == 3


def test_random_bytes_give_no_fix_and_take_no_memory(log):
    rng = np.random.default_rng(2)
    stream = NmeaStream()
    for _ in range(200):
        assert stream.feed(rng.bytes(5000)) == []
        stream.flush()
    assert len(stream._parser._line) <= 10_000
    assert stream.skipped > 0
    stream.feed(b"\r\n")
    assert [f for b in bursts(log)[:5] for f in (stream.feed(b) or stream.flush())] == of_blocks(
        b"".join(bursts(log)[:5])
    )


# CAN


@pytest.fixture(scope="module")
def files(town, ride, tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    write_drive(ride, town, folder)
    return folder


def test_frames_one_by_one_say_what_the_whole_log_says(files):
    car = read_vehicle(files / "vehicle.toml")
    stream = CanStream(files / "vehicle.dbc", car)
    skipped = Counter()
    frames = read_frames(files / "can.log", stream.frames, skipped)
    rows = sorted(
        (float(t), k, bytes(d[:n]))
        for k, f in frames.items()
        for t, d, n in zip(f.time, f.data, f.length, strict=True)
    )
    ours = [one for t, k, d in rows for one in stream.feed(k, t, d)]
    (drive,) = read_drive(files / "can.log", vehicle=car, dbc=files / "vehicle.dbc")
    theirs = drive.odometry
    assert all(isinstance(one, WheelTicks) for one in ours)
    assert [one.time for one in ours] == theirs.time.tolist()
    assert [one.left for one in ours] == pytest.approx(theirs.left.tolist())
    assert [one.right for one in ours] == pytest.approx(theirs.right.tolist())


DBC = """VERSION ""
BU_: A
BO_ 256 L: 8 A
 SG_ Left : 7|16@0- (0.01,1) [0|0] "km/h" A
BO_ 257 R: 8 A
 SG_ Right : 4|12@1- (0.1,0) [0|0] "km/h" A
"""


def test_wheels_in_two_frames_are_brought_to_one_time(tmp_path):
    import cantools

    (tmp_path / "two.dbc").write_text(DBC)
    base = cantools.database.load_string(DBC)
    signals = {"wheel_rl": "Left", "wheel_rr": "Right"}
    stream = CanStream(tmp_path / "two.dbc", Vehicle(signals=signals))
    time, said = 1.7e9, []
    for i in range(10):
        left = base.encode_message("L", {"Left": 36.0 - 3.6 * i})
        right = base.encode_message("R", {"Right": 36.0 - 3.6 * i})
        said += stream.feed(key(256, False), time + 0.02 * i, left)
        said += stream.feed(key(257, False), time + 0.02 * i + 0.01, right)
    assert [round(one.time - time, 6) for one in said] == [round(0.02 * i, 6) for i in range(1, 10)]
    assert [one.left for one in said] == pytest.approx([10.0 - i for i in range(1, 10)])
    assert [one.right for one in said] == pytest.approx([10.5 - i for i in range(1, 10)], abs=1e-4)


MOTION = """VERSION ""
BU_: A
BO_ 258 Turns: 8 A
 SG_ YawRate : 0|16@1- (0.01,0) [0|0] "deg/s" A
BO_ 259 Way: 8 A
 SG_ Odometer : 0|32@1+ (0.1,0) [0|0] "m" A
 SG_ Speed : 32|16@1+ (0.01,0) [0|0] "km/h" A
"""


@pytest.mark.parametrize("roles", [("odometer", "yaw_rate"), ("odometer", "speed"), ("odometer",)])
def test_an_odometer_comes_before_a_speed_and_with_its_yaw_rate(tmp_path, roles):
    import cantools

    base = cantools.database.load_string(MOTION)
    dbc, log = tmp_path / "motion.dbc", tmp_path / "can.log"
    dbc.write_text(MOTION)
    names = {"odometer": "Odometer", "yaw_rate": "YawRate", "speed": "Speed"}
    car = Vehicle(signals={role: names[role] for role in roles})
    frames = [(1.7e9 + 0.02 * i, 258, base.encode_message("Turns", {"YawRate": 0.3 * i}))
              for i in range(50)]  # fmt: skip
    frames += [
        (1.7e9 + 0.1 * i + 0.005, 259, base.encode_message("Way", {"Odometer": i, "Speed": 36.0}))
        for i in range(10)
    ]
    log.write_text("".join(f"({t:.6f}) can0 {k:03X}#{d.hex()}\n" for t, k, d in sorted(frames)))
    stream = CanStream(dbc, car)
    ours = [one for t, k, d in sorted(frames) for one in stream.feed(key(k, False), t, d)]
    [drive] = read_drive(log, vehicle=car, dbc=dbc)
    recorded = RecordedObservations(drive)
    theirs = [recorded[k] for k in range(len(recorded))]
    assert [type(one) for one in ours] == [type(one) for one in theirs]
    assert [one.time for one in ours] == pytest.approx([one.time for one in theirs], abs=1e-6)
    values = [one.yaw_rate if isinstance(one, YawRate) else one.distance for one in theirs]
    assert values == pytest.approx(
        [one.yaw_rate if isinstance(one, YawRate) else one.distance for one in ours]
    )
    assert ("yaw_rate" in roles) == any(isinstance(one, YawRate) for one in ours)


J1939 = """VERSION ""
BU_: A
BO_ 256 Wheels: 8 A
 SG_ Left : 0|16@1+ (0.00390625,0) [0|250.996] "km/h" A
 SG_ Right : 16|16@1+ (0.00390625,0) [0|250.996] "km/h" A
VAL_ 256 Right 65535 "SNA" ;
"""


def test_a_signal_that_is_not_available_is_counted_and_no_speed(tmp_path):
    (tmp_path / "car.dbc").write_text(J1939)
    signals = {"wheel_rl": "Left", "wheel_rr": "Right"}
    stream, said = CanStream(tmp_path / "car.dbc", Vehicle(signals=signals)), []
    for i in range(40):
        raw = 0xFFFF if i % 10 == 0 else 0x2000
        data = raw.to_bytes(2, "little") * 2 + bytes(4)
        said += stream.feed(key(256, False), 1.7e9 + 0.1 * i, data)
    assert [one.left for one in said] == pytest.approx([32.0 / 3.6] * 36)
    assert [one.right for one in said] == pytest.approx([32.0 / 3.6] * 36)
    assert stream.skipped_why == {"signal not available": 8}


def test_the_value_of_reverse_is_one_whatever_its_name_says(tmp_path):
    gear = ' SG_ Gear : 32|4@1+ (1,0) [0|8] "" A\n'
    (tmp_path / "car.dbc").write_text(
        J1939.replace("VAL_", gear + 'VAL_ 256 Gear 1 "Gear_err" ;\nVAL_')
    )
    signals = {"wheel_rl": "Left", "wheel_rr": "Right", "reverse": "Gear", "reverse_value": "1"}
    stream, said = CanStream(tmp_path / "car.dbc", Vehicle(signals=signals)), []
    for i in range(4):
        data = (0x2000).to_bytes(2, "little") * 2 + bytes([i >= 2, 0, 0, 0])
        said += stream.feed(key(256, False), 1.7e9 + 0.1 * i, data)
    assert said[0].left > 0.0 > said[-1].left
    assert said[-1].geared
    assert not stream.skipped_why


def test_frames_that_mean_nothing_are_counted_or_passed_over(files):
    stream = CanStream(files / "vehicle.dbc", read_vehicle(files / "vehicle.toml"))
    message = can.Message(arbitration_id=928, data=[1])
    assert stream.feed(key(928, False), 1.7e9, bytes(message.data)) == []
    assert stream.skipped_why == {"frame cut short": 2}
    assert stream.feed(key(1, False), 1.7e9, b"12345678") == []
    rng = np.random.default_rng(3)
    for i in range(500):
        for one in stream.feed(key(928, False), 1.7e9 + i, rng.bytes(8)):
            assert not isinstance(one, GeoFix)
            assert math.isfinite(one.left)
