"""UBX: fixes, covariances, wheel ticks and gyro as pyubx2 reads them, streamed or whole."""

import io
import struct
from dataclasses import astuple

import numpy as np
import pytest
from pyubx2 import GET, UBXMessage, UBXReader

from whichroad.errors import ReadError
from whichroad.live.decode import NmeaStream
from whichroad.observations import ASSUMED, Odometer, WheelCounts
from whichroad.readers import read_drive
from whichroad.readers.reckoned_places import LEFT_OUT
from whichroad.readers.reported_fixes import as_records
from whichroad.readers.ubx import UbxParser
from whichroad.sensors.odometry import motion_of
from whichroad.settings import Vehicle

NOON = 1_780_315_200  # 2026-06-01 12:00 UTC, a Monday
ITOW = 36 * 3_600_000  # ms, about then
CAR = Vehicle(metres_per_tick_left=0.02, metres_per_tick_right=0.02, track_width=1.5)


def pvt(
    k, *, lat=49.4, lon=8.7, speed=10.0, course=90.0, h_acc=2.0, kind=3, ok=1, valid=1, dt=1.0,
    invalid=0,
):  # fmt: skip
    """The NAV-PVT of the k-th epoch, by pyubx2."""
    stamp = np.datetime64(round((NOON + k * dt) * 1e3), "ms").item()
    return UBXMessage(
        "NAV", "NAV-PVT", GET,
        iTOW=ITOW + round(1e3 * k * dt), year=stamp.year, month=stamp.month, day=stamp.day,
        hour=stamp.hour, min=stamp.minute, second=stamp.second, validDate=valid, validTime=valid,
        nano=stamp.microsecond * 1000, fixType=kind, gnssFixOk=ok, lat=lat, lon=lon,
        hAcc=round(h_acc * 1e3), gSpeed=round(speed * 1e3), headMot=course % 360.0, sAcc=200,
        invalidLlh=invalid, hMSL=52_000,
    ).serialize()  # fmt: skip


def cov(k, ee, en, nn, valid=1):
    return UBXMessage(
        "NAV", "NAV-COV", GET, iTOW=ITOW + 1000 * k, posCovValid=valid,
        posCovEE=ee, posCovNE=en, posCovNN=nn,
    ).serialize()  # fmt: skip


def esf(tag_ms, *measured, calibrated=False):
    """An ESF-MEAS of (type, 24 bits) pairs; written by hand, read by pyubx2 below."""
    words = b"".join(struct.pack("<I", kind << 24 | value & 0xFFFFFF) for kind, value in measured)
    flags = len(measured) << 11 | (8 if calibrated else 0)
    payload = struct.pack("<IHH", 0 if calibrated else tag_ms, flags, 0) + words
    return framed(b"\x10\x02", payload + (struct.pack("<I", tag_ms) if calibrated else b""))


def framed(kind, payload):
    body = kind + struct.pack("<H", len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) & 255
        b = (b + a) & 255
    return b"\xb5\x62" + body + bytes([a, b])


def oracle(content, name):
    """Messages of one type, by pyubx2."""
    stream = UBXReader(io.BytesIO(content), protfilter=2, quitonerror=0)
    return [m for _, m in stream if m is not None and m.identity == name]


@pytest.fixture
def read(put):
    """A function from a log's bytes to its drive."""
    return lambda content, **more: read_drive(put("log.ubx", content), **more)[0]


def corners(n=60):
    """Epochs about the globe's corners, all but every fifth with a covariance."""
    rng = np.random.default_rng(5)
    content = b""
    for k in range(n):
        content += pvt(
            k, lat=float(rng.uniform(-89, 89)), lon=float(rng.uniform(-179, 179)),
            speed=float(rng.uniform(3, 30)), course=float(rng.uniform(0, 360)),
            h_acc=float(rng.uniform(1, 9)),
        )  # fmt: skip
        if k % 5:
            content += cov(k, *rng.uniform(2, 9, 1), rng.uniform(-1, 1), *rng.uniform(2, 9, 1))
    return content


def test_fixes_and_covariances_are_those_of_pyubx2(read, sound):
    content = corners()
    drive = read(content)
    sound(drive)
    fixes, theirs = drive.fixes, oracle(content, "NAV-PVT")
    covs = {m.iTOW: m for m in oracle(content, "NAV-COV")}
    assert len(fixes) == len(theirs) == 60
    assert not drive.skipped
    assert fixes.time == pytest.approx(NOON + np.arange(60.0), abs=1e-6)
    assert fixes.lat_deg == pytest.approx([m.lat for m in theirs], abs=1e-10)
    assert fixes.lon_deg == pytest.approx([m.lon for m in theirs], abs=1e-10)
    assert fixes.speed == pytest.approx([m.gSpeed / 1e3 for m in theirs])
    assert fixes.sigma_speed == pytest.approx([m.sAcc / 1e3 for m in theirs])
    assert fixes.bearing_deg == pytest.approx([m.headMot for m in theirs])
    for k, m in enumerate(theirs):
        found = [fixes.cov_ee[k], fixes.cov_en[k], fixes.cov_nn[k]]
        if m.iTOW in covs:
            c = covs[m.iTOW]
            assert found == pytest.approx([c.posCovEE, c.posCovNE, c.posCovNN])
        else:
            variance = (m.hAcc / 1e3 / 1.515) ** 2
            assert found == pytest.approx([variance, 0.0, variance])


@pytest.mark.data
def test_a_real_receiver_is_read_as_pyubx2_reads_it(data_folder, put, sound):
    content = (data_folder / "nmea_gst" / "ublox-zed-f9r.log").read_bytes()
    drive = read_drive(put("f9r.ubx", content))[0]
    sound(drive)
    theirs = [m for m in oracle(content, "NAV-PVT") if m.gnssFixOk and m.fixType in (1, 2, 3, 4)]
    assert len(drive.fixes) == len(theirs) > 20
    assert drive.fixes.lat_deg == pytest.approx([m.lat for m in theirs], abs=1e-10)
    assert drive.fixes.lon_deg == pytest.approx([m.lon for m in theirs], abs=1e-10)
    by_nmea = read_drive(put("f9r.nmea", content))[0].fixes
    same = np.isin(np.round(by_nmea.time, 2), np.round(drive.fixes.time, 2))
    assert same.any()
    at = np.interp(by_nmea.time[same], drive.fixes.time, drive.fixes.lat_deg)
    assert np.abs(at - by_nmea.lat_deg[same]).max() < 1e-5


def ride(*, gyro_sign=1, types=(8, 9), turns=True, offset_ms=123_456, calibrated=False):
    """Three minutes of fixes at 1 Hz and sensors at 10 Hz, on their own clock.

    Returns:
        The log, and true times, distances and turns of the readings.
    """
    t = np.arange(0.0, 180.0, 0.1)
    speed = 10.0 + 2.0 * np.sin(t / 9.0)
    rate = np.where(turns & (np.mod(t, 30.0) > 20.0), np.radians(12.0), 0.0)
    distance = np.concatenate([[0.0], np.cumsum(0.05 * (speed[1:] + speed[:-1]))])
    turn = np.concatenate([[0.0], np.cumsum(0.05 * (rate[1:] + rate[:-1]))])
    content, ticks = b"", {}
    for side, kind in ((-1, 8), (1, 9), (0, 10)):
        ticks[kind] = np.round((distance + side * 0.75 * turn) / 0.02) + 2**23 - 1000
    for k, at in enumerate(t.tolist()):
        measured = {
            5: round(gyro_sign * np.degrees(rate[k]) * 4096),
            11: round(speed[k] * 1e3),
            **{kind: int(ticks[kind][k]) % 2**23 for kind in (8, 9, 10)},
        }
        content += esf(
            offset_ms + round(1e3 * at), *((n, measured[n]) for n in types), calibrated=calibrated
        )
        if k % 10 == 0:
            content += pvt(k // 10, course=float(90.0 - np.degrees(turn[k])), lat=49.4 + 1e-5 * k)
    return content, NOON + t, distance, turn


@pytest.mark.parametrize("calibrated", [False, True])
def test_rear_wheels_wrap_and_are_on_the_clock_of_the_fixes(read, sound, calibrated):
    content, time, distance, turn = ride(calibrated=calibrated)
    drive = read(content, vehicle=CAR)
    sound(drive)
    log = drive.odometry
    assert isinstance(log, WheelCounts)
    assert log.time == pytest.approx(time, abs=1e-3)
    motion = motion_of(log, CAR)
    assert motion.distance == pytest.approx(distance, abs=0.03)
    assert motion.turn == pytest.approx(turn, abs=0.04)
    raw = [m.dataField_01 for m in oracle(content, "ESF-MEAS")]
    assert (log.left % 2**23).tolist() == raw


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("wheel", [10, 11])
def test_a_tick_or_a_speed_takes_its_turns_from_the_gyro_however_it_is_mounted(read, sign, wheel):
    content, _, distance, turn = ride(gyro_sign=sign, types=(5, wheel))
    drive = read(content, vehicle=CAR)
    motion = motion_of(drive.odometry, CAR)
    assert motion.distance == pytest.approx(distance, abs=0.1)
    assert motion.turn == pytest.approx(turn, abs=1e-3)
    assert (sign < 0) == any("points down" in note for note in drive.notes)


def test_a_gyro_without_turns_is_taken_as_mounted_upright_and_that_is_said(read):
    drive = read(ride(types=(5, 10), turns=False)[0], vehicle=CAR)
    assert any("is taken so" in note for note in drive.notes)


def test_one_tick_alone_is_an_odometer_and_backwards_it_falls(read):
    content = b""
    for k in range(40):
        content += esf(1000 * k, (10, 50 * k | (1 << 23 if k >= 20 else 0))) + pvt(k)
    log = read(content, vehicle=CAR).odometry
    assert isinstance(log, Odometer)
    steps = np.diff(log.distance)
    assert steps == pytest.approx(np.where(np.arange(1, 40) >= 20, -1.0, 1.0))


def test_dead_reckoned_fixes_are_no_second_witness_beside_the_wheels_they_came_from(read):
    epochs = b"".join(pvt(k, kind=1 if k > 5 else 3) + esf(1000 * k, (10, k)) for k in range(10))
    drive = read(epochs, vehicle=CAR)
    assert len(drive.fixes) == 6
    assert drive.skipped == {"dead-reckoned fix (without GNSS)": 4}
    alone = read(b"".join(pvt(k, kind=1 if k > 5 else 3) for k in range(10)))
    assert len(alone.fixes) == 10


def test_beside_wheels_of_another_log_dead_reckoned_fixes_are_left_out(put):
    content = b"".join(pvt(k, kind=1 if 4 <= k < 8 else 4, lon=8.7 + 1e-4 * k) for k in range(10))
    rows = "".join(f"{NOON + k / 10},10,10\n" for k in range(100))
    files = [put("a.ubx", content), put("w.csv", "time,wheel_rl_mps,wheel_rr_mps\n" + rows)]
    (drive,) = read_drive(files)
    assert drive.fixes.time - NOON == pytest.approx([0, 1, 2, 3, 8, 9])
    assert drive.skipped == {LEFT_OUT: 4}
    stream = NmeaStream(beside=lambda at: at >= NOON + 6)
    assert len(stream.feed(content)) == 8
    assert stream.skipped_why == {LEFT_OUT: 2}


def test_a_place_that_the_receiver_calls_invalid_is_none(read):
    content = b"".join(pvt(k, invalid=int(3 <= k < 7)) for k in range(10))
    drive = read(content, columns={"+height_m": "height_m"})
    assert drive.fixes.time - NOON == pytest.approx([0, 1, 2, 7, 8, 9])
    assert drive.skipped == {"epoch without a fix": 4}
    assert len(drive.sensed) == 6
    stream = NmeaStream()
    assert [fix.time for fix in stream.feed(content)] == drive.fixes.time.tolist()
    assert stream.skipped_why == {"epoch without a fix": 4}


def test_epochs_without_a_fix_or_a_date_and_covariances_that_are_none_are_counted(read):
    content = pvt(0) + pvt(1, ok=0) + pvt(2, kind=0) + pvt(3, valid=0) + pvt(4, kind=5)
    content += pvt(5) + cov(5, -1.0, 0.0, 2.0) + pvt(6) + cov(6, 9.0, 0.0, 9.0, valid=0)
    drive = read(content)
    assert drive.fixes.time - NOON == pytest.approx([0, 5, 6])
    assert drive.fixes.flags.tolist() == [0, ASSUMED, 0]
    assert drive.skipped == {
        "epoch without a fix": 3,
        "epoch without a date": 1,
        "variance of 0 or less (settings' default used)": 1,
    }


def test_damaged_messages_are_counted_and_others_pass(read, nmea):
    frames = [pvt(k) for k in range(6)]
    frames[2] = frames[2][:40] + b"\x55" + frames[2][41:]
    content = frames[0] + nmea.burst() + b"".join(frames[1:5]) + frames[5][:50]
    drive = read(content)
    assert drive.fixes.time - NOON == pytest.approx([0, 1, 3, 4])
    assert drive.skipped == {"UBX checksum that is wrong": 1, "UBX message cut short": 1}


def test_a_message_inside_of_a_message_is_not_read(read):
    content = pvt(0) + framed(b"\x02\x13", b"xx" + pvt(7) + b"yy") + pvt(1)
    drive = read(content)
    assert drive.fixes.time - NOON == pytest.approx([0, 1])
    assert any("0x02 0x13: 1" in note for note in drive.notes)


def test_a_log_without_positions_is_refused_with_what_it_holds(read):
    with pytest.raises(ReadError, match=r"no NAV-PVT message \(NAV-COV: 1\)"):
        read(cov(0, 1.0, 0.0, 1.0))


def test_the_content_shows_the_format_where_the_name_does_not(put):
    assert len(read_drive(put("log.bin", corners()))[0].fixes) == 60


@pytest.mark.parametrize("seed", range(5))
def test_pieces_say_what_the_whole_log_says(read, seed):
    content, rng = corners(), np.random.default_rng(seed)
    parser, fixes, at = UbxParser(), [], 0
    while at < len(content):
        size = int(rng.integers(1, 200))
        fixes += parser.feed(content[at : at + size])[0]
        at += size
    fixes += parser.pause()
    whole = as_records(read(content).fixes)
    assert len(fixes) == len(whole) == 60
    for a, b in zip(fixes[3:], whole[3:], strict=True):  # until NAV-COV is known to come
        assert astuple(a) == pytest.approx(astuple(b), rel=1e-12)


def test_epochs_that_come_late_or_twice_on_line_are_passed_on_or_counted():
    rng, messages = np.random.default_rng(3), [pvt(k) + cov(k, 2.0, 0.5, 3.0) for k in range(100)]
    order = np.argsort(np.arange(100) + rng.uniform(0.0, 3.0, 100))
    parser = UbxParser()
    fixes = [f for k in order for f in parser.feed(messages[k])[0]] + parser.pause()
    assert [fix.time - NOON for fix in fixes] == order.tolist()
    assert all(fix.cov_ee == pytest.approx(2.0) for fix in fixes[1:])
    assert not parser.skipped
    assert parser.feed(messages[50])[0] + parser.pause() == []
    assert parser.skipped == {"repeated time": 1}


def test_a_covariance_of_another_epoch_is_not_waited_with():
    parser = UbxParser()
    parser.feed(pvt(0) + cov(0, 2.0, 0.5, 3.0))
    assert parser.feed(pvt(2) + cov(1, 9.0, 0.0, 9.0))[0] == []
    (fix,) = parser.feed(cov(2, 2.0, 0.5, 3.0))[0]
    assert fix.cov_ee == pytest.approx(2.0)


def test_on_line_the_sentences_beside_ubx_are_passed_over_and_alone_are_read(nmea):
    stream = NmeaStream()
    assert len(stream.feed(nmea.burst("120000.00")) + stream.flush()) == 1
    fixes = stream.feed(pvt(1) + cov(1, 2.0, 0.5, 3.0) + nmea.burst("120001.00")) + stream.flush()
    assert len(fixes) == 1
    fixes = stream.feed(pvt(2)) + stream.feed(cov(2, 2.0, 0.5, 3.0))
    assert [fixes[0].cov_ee, fixes[0].cov_en, fixes[0].cov_nn] == pytest.approx([2.0, 0.5, 3.0])
    assert stream.skipped == 0
