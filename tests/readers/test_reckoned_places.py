"""Places that a receiver has dead-reckoned, beside odometry and alone."""

import numpy as np
import pandas as pd
import pytest

from whichroad.readers import NmeaParser, drive_from_table, read_drive
from whichroad.readers.reckoned_places import KEPT, LEFT_OUT

BEGIN = 1_780_300_800  # 2026-06-01 08:00 UTC
MODES = "6AAAAA6666AAAAAAAAAA"  # of the fix of each second: dead-reckoned, or with satellites


def log(nmea, modes=MODES):
    """The sentences of these epochs, ten metres apart."""
    return b"".join(
        nmea.burst(clock=f"0800{k:02d}.00", lon=8.7 + 1.4e-4 * k, quality=6 if mode == "6" else 1)
        for k, mode in enumerate(modes)
    )


def motion(names, times=None):
    """Ten rows a second of 10 m/s straight on."""
    times = np.arange(0.0, 20.0, 0.1) if times is None else times
    values = {
        "speed_mps": 10.0, "yaw_rate_radps": 0.0, "wheel_rl_mps": 10.0, "wheel_rr_mps": 10.0,
        "odometer_m": 10.0 * times,
    }  # fmt: skip
    return pd.DataFrame({"time": BEGIN + times} | {n: values[n] for n in names}).to_csv(index=False)


def seconds(drive):
    """The seconds at which the drive has fixes."""
    return (drive.fixes.time - BEGIN).round(3).tolist()


@pytest.mark.parametrize(
    "names",
    [
        ("wheel_rl_mps", "wheel_rr_mps"),
        ("speed_mps", "yaw_rate_radps"),
        ("odometer_m", "yaw_rate_radps"),
    ],
)
def test_beside_odometry_that_measures_turns_they_are_left_out_and_counted(nmea, put, names):
    (drive,) = read_drive([put("a.nmea", log(nmea)), put("motion.csv", motion(names))])
    assert seconds(drive) == [k for k in range(20) if not 6 <= k < 10]  # the first tells the begin
    assert drive.skipped == {LEFT_OUT: 4}


def test_alone_or_beside_an_odometer_without_turns_they_stay(nmea, put):
    file = put("a.nmea", log(nmea))
    for files in ([file], [file, put("motion.csv", motion(["odometer_m"]))]):
        (drive,) = read_drive(files)
        assert len(drive.fixes) == 20
        assert not drive.skipped


def test_where_odometry_is_silent_or_no_other_fix_comes_they_stay(nmea, put):
    names = ("wheel_rl_mps", "wheel_rr_mps")
    early = put("motion.csv", motion(names, np.arange(0.0, 2.6, 0.1)))
    (drive,) = read_drive([put("a.nmea", log(nmea)), early])
    assert seconds(drive) == [k for k in range(20) if not 6 <= k < 8]
    (drive,) = read_drive([put("a.nmea", log(nmea, "6" * 20)), put("m.csv", motion(names))])
    assert len(drive.fixes) == 20


@pytest.mark.parametrize(
    ("speed", "kept"), [(0.0, True), (5.0, True), (16.0, True), (9.0, False), (11.0, False)]
)
def test_where_the_odometry_says_another_way_they_stay_and_it_is_said(put, speed, kept):
    times = np.arange(160.0)
    inside = (times >= 30.0) & (times < 130.0)
    turning = np.linspace(0.0, 3.0, 160)  # a bend: the way is longer than the chord
    table = pd.DataFrame({
        "time": BEGIN + times,
        "lat": 49.4 + np.cumsum(np.sin(turning)) * 10.0 / 111_195,
        "lon": 8.7 + np.cumsum(np.cos(turning)) * 10.0 / 72_370,
        "fix_quality": np.where(inside, 6, 1),
        "speed_mps": np.where(inside & (times > 60.0), speed, 10.0),
        "yaw_rate_radps": 3.0 / 160.0,
    })  # fmt: skip
    (drive,) = drive_from_table(table)
    assert len(drive.fixes) == (160 if kept else 60)
    assert drive.skipped == ({} if kept else {LEFT_OUT: 100})
    assert (KEPT in drive.notes) == kept


def test_a_table_with_the_kind_of_fix_and_a_ubx_log_without_sensors_are_alike(nmea, put):
    times = np.arange(20.0)
    table = pd.DataFrame({
        "time": BEGIN + times, "lat": 49.4, "lon": 8.7 + 1.4e-4 * times,
        "fix_quality": [6 if mode == "6" else 1 for mode in MODES],
        "wheel_rl_mps": 10.0, "wheel_rr_mps": 10.0,
    })  # fmt: skip
    (drive,) = drive_from_table(table)
    assert seconds(drive) == [k for k in range(20) if not 6 <= k < 10]
    assert drive.skipped == {LEFT_OUT: 4}


def test_on_line_the_same_are_left_out_while_odometry_is_heard(nmea):
    parser = NmeaParser(today=BEGIN, beside=lambda at: at >= BEGIN + 8)
    fixes = parser.feed(log(nmea)) + parser.flush()
    assert [fix.time - BEGIN for fix in fixes] == [k for k in range(20) if k not in (8, 9)]
    assert parser.skipped == {LEFT_OUT: 2}


@pytest.mark.parametrize(("begin", "kept"), [(0, range(16, 30)), (12, range(22, 30)), (25, [])])
def test_on_line_they_stay_once_they_move_on_while_the_odometry_stands(nmea, begin, kept):
    parser = NmeaParser(
        today=BEGIN, beside=lambda _: True, stood=lambda at: max(at - BEGIN - begin, 0.0)
    )
    fixes = parser.feed(log(nmea, "A" * 6 + "6" * 24)) + parser.flush()
    assert [fix.time - BEGIN for fix in fixes] == [*range(6), *kept]
    assert parser.skipped == {LEFT_OUT: 24 - len(kept)}


def test_on_line_they_are_left_out_while_they_stand_as_the_odometry_does(nmea):
    parser = NmeaParser(today=BEGIN, beside=lambda _: True, stood=lambda at: at - BEGIN)
    for k in range(30):
        parser.feed(nmea.burst(clock=f"0800{k:02d}.00", lon=8.7 + 1e-6 * k, quality=6))
    parser.flush()
    assert parser.skipped == {LEFT_OUT: 30}
