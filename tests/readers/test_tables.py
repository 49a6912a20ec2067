"""Drive tables by the names of their columns, whoever wrote them."""

import io
import re
from pathlib import Path

import geopandas
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.feather
import pyarrow.parquet as pq
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from whichroad import match_many, speeds
from whichroad.errors import ReadError, SettingError
from whichroad.observations import (
    ASSUMED,
    FROM_HDOP,
    FROM_QUALITY,
    Odometer,
    SpeedYawRate,
    WheelCounts,
    WheelSpeeds,
)
from whichroad.readers import drive_from_table, read_drive
from whichroad.readers.many_trips import own_names
from whichroad.readers.names import NAMES, normal
from whichroad.readers.reported_fixes import RADIUS_68
from whichroad.settings import Settings, Vehicle

T0 = 1_780_315_200.0  # 2026-06-01 12:00 UTC
N = 5


def table(**columns):
    """Five fixes a second apart; columns are added, replaced, or left out by None."""
    given = {
        "time": T0 + np.arange(N),
        "lat": 49.4 + 1e-4 * np.arange(N),
        "lon": 8.7 + 1e-4 * np.arange(N),
        **columns,
    }
    return {name: values for name, values in given.items() if values is not None}


def one(columns, **kwargs):
    """The only drive of a table in memory."""
    (drive,) = drive_from_table(pd.DataFrame(columns), **kwargs)
    return drive


def test_a_plain_table_of_fixes(sound):
    drive = one(table())
    sound(drive)
    assert drive.fixes.time == pytest.approx(T0 + np.arange(N))
    assert drive.fixes.lat_deg == pytest.approx(49.4 + 1e-4 * np.arange(N))
    assert (drive.fixes.cov_ee == Settings().default_sigma_m ** 2).all()
    assert (drive.fixes.flags == ASSUMED).all()
    assert drive.odometry is None
    assert drive.skipped == {}


@pytest.mark.parametrize("lat", NAMES["lat"])
@pytest.mark.parametrize("shape", [str, str.upper, lambda s: s.replace("_", " ").title()])
def test_latitude_goes_by_all_its_names(lat, shape):
    columns = table(lat=None)
    columns[shape(lat)] = 49.4 + 1e-4 * np.arange(N)
    assert len(one(columns).fixes) == N


def test_no_name_means_two_things():
    seen = [name for names in NAMES.values() for name in names]
    assert len(seen) == len(set(seen))
    assert all(normal(name) == name for name in seen)


def test_every_name_is_documented():
    text = (Path(__file__).parents[2] / "docs" / "formats.md").read_text("utf-8")
    told = set(re.findall(r"`([^`\s]+)`", text))
    by_unit = ("time", "speed", "wheel_rl", "wheel_rr")  # told as stem and unit
    names = [n for quantity, names in NAMES.items() if quantity not in by_unit for n in names]
    left = [name.replace("rr", "rl").replace("right", "left") for name in names]
    assert [name for name in left if name not in told] == []


@pytest.mark.parametrize(
    "written",
    [
        lambda t: [f"{np.datetime64(int(s), 's')}Z" for s in t],
        lambda t: [str(np.datetime64(int(s), "s")) for s in t],
        lambda t: [str(np.datetime64(int(s), "s")).replace("T", " ") + ".000" for s in t],
        lambda t: [str(np.datetime64(int(s) + 7200, "s")) + "+02:00" for s in t],
        lambda t: t,
        lambda t: [f"{s:.3f}" for s in t],
        lambda t: (t * 1e3).astype(np.int64),
        lambda t: (t * 1e6).astype(np.int64),
        lambda t: (t * 1e9).astype(np.int64),
        lambda t: (t * 1e9).astype("datetime64[ns]"),
        lambda t: pd.to_datetime(t, unit="s", utc=True).tz_convert("Europe/Paris"),
    ],
)
def test_times_are_utc_in_any_usual_writing(written):
    columns = table(time=written(T0 + np.arange(N)))
    assert one(columns).fixes.time == pytest.approx(T0 + np.arange(N), abs=1e-4)


@pytest.mark.parametrize(("name", "per_second"), [("time_ms", 1e3), ("t_us", 1e6), ("utc_ns", 1e9)])
def test_a_unit_in_the_name_of_the_time_decides(name, per_second):
    columns = table(time=None) | {name: per_second * np.arange(1.0, N + 1)}
    assert one(columns).fixes.time == pytest.approx(np.arange(1.0, N + 1))


def test_what_is_skipped_is_counted_by_reason(sound):
    columns = table(
        time=T0 + np.array([0, 2, 1, 1, 3]),
        lat=np.array([49.4, 49.4, 49.4, 49.5, 149.0]),
    )
    drive = one(columns)
    sound(drive)
    assert drive.fixes.time == pytest.approx(T0 + np.arange(3))
    assert drive.fixes.lat_deg == pytest.approx([49.4] * 3)  # the first of two stays
    assert drive.skipped == {
        "impossible position": 1,
        "repeated time": 1,
        "time running backwards (sorted)": 2,
    }


def test_empty_and_strange_cells_are_skipped_and_counted(put, sound):
    text = f"time,lat,lon\n{T0},49.4,8.7\n{T0 + 1},north,8.7\n,49.4,8.7\n{T0 + 3},49.4,8.7\n"
    (drive,) = read_drive(put("x.csv", text + f"{T0 + 4},49.4\n"))
    sound(drive)
    assert len(drive.fixes) == 2
    assert drive.skipped["row with a wrong number of cells"] == 1
    assert drive.skipped["unparsable number in lat"] == 1
    assert drive.skipped["no time"] == 1


@pytest.mark.parametrize("cells", [[49.4, "n/a", 49.5], ["n/a", 49.4, 49.5], [49.4, b"x", pd.NA]])
def test_cells_of_several_kinds_are_read_as_text_is(cells):
    frame = pd.DataFrame(
        {"time": T0 + np.arange(3), "lon": 8.7, "lat": pd.Series(cells, dtype="O")}
    )
    text = frame.assign(lat=[c if isinstance(c, str) else f"{c}" for c in cells])
    (drive,), (expected,) = drive_from_table(frame), drive_from_table(text)
    assert drive.fixes.lat_deg.tolist() == expected.fixes.lat_deg.tolist()
    assert sum(drive.skipped.values()) >= 3 - len(drive.fixes)
    (drive,) = drive_from_table(frame.to_dict("records"))
    assert drive.fixes.lat_deg.tolist() == expected.fixes.lat_deg.tolist()


@pytest.mark.parametrize("worthless", [1000.1, 5000.0, 9999.0, 1e9, 1e200, np.inf])
@pytest.mark.parametrize("name", ["sigma_m", "accuracy", "sigma_n_m"])
def test_a_fix_whose_error_is_beyond_use_is_skipped_and_counted(name, worthless, sound):
    factor = RADIUS_68 if name == "accuracy" else 1.0
    cells = factor * np.array([3.0, worthless, 999.0, 3.0, worthless])
    more = {"sigma_e_m": np.full(N, 3.0)} if name == "sigma_n_m" else {}
    (drive,) = drive_from_table(table(**{name: cells}, **more))
    sound(drive)
    assert drive.fixes.time.tolist() == [T0, T0 + 2.0, T0 + 3.0]
    assert drive.skipped == {"sigma beyond 1,000 m (says nothing of the place)": 2}


def along(n: int, decimals: int) -> pd.DataFrame:
    """A drive to the north-east at 14 m/s, a fix every second."""
    k = np.arange(n)
    lat, lon = 49.41234567 + 8.9e-5 * k, 8.71234567 + 1.37e-4 * k
    return pd.DataFrame(
        {"time": T0 + k, "lat": lat.round(decimals), "lon": lon.round(decimals), "sigma_m": 3.0}
    )


@pytest.mark.parametrize(("decimals", "step"), [(2, 1112.0), (3, 111.2), (4, 11.12)])
def test_the_error_of_rounded_coordinates_is_added_and_said(decimals, step, put, sound):
    frame = along(1200, decimals)
    (drive,) = drive_from_table(frame)
    sound(drive)
    assert drive.fixes.cov_nn == pytest.approx(9.0 + step**2 / 12.0, rel=1e-3)
    east = step * np.cos(np.radians(49.45))
    assert drive.fixes.cov_ee == pytest.approx(9.0 + east**2 / 12.0, rel=5e-3)
    assert drive.fixes.lat_deg == pytest.approx(frame.lat.to_numpy(), abs=3e-8)
    moved = np.abs(np.diff(drive.fixes.lat_deg)) + np.abs(np.diff(drive.fixes.lon_deg))
    assert (moved > 1e-8).all()  # so that none is said to repeat the one before
    (note,) = drive.notes
    assert note.startswith(f"coordinates are rounded to {decimals} decimals")
    (read,) = read_drive(put("a.csv", frame.to_csv(index=False)))
    assert note in read.notes
    assert read.fixes.cov_nn.tolist() == drive.fixes.cov_nn.tolist()


@pytest.mark.parametrize("decimals", [5, 6, 9])
def test_coordinates_of_five_decimals_and_few_places_are_left_as_they_are(decimals):
    for frame in (along(500, decimals), along(5, 4), along(500, 4).assign(lon=8.7)):
        (drive,) = drive_from_table(frame)
        assert drive.fixes.cov_nn.tolist() == [9.0] * len(frame)
        assert drive.fixes.lat_deg.tolist() == frame.lat.tolist()
        assert not drive.notes


def test_a_time_may_be_the_index_of_a_frame():
    frame = pd.DataFrame(table(time=None), index=pd.to_datetime(T0 + np.arange(N), unit="s"))
    assert one(frame).fixes.time == pytest.approx(T0 + np.arange(N))
    assert one(frame.rename_axis("Timestamp")).fixes.time == pytest.approx(T0 + np.arange(N))


@pytest.mark.parametrize("index", ["time", "trip_id", ["trip_id", "time"], ["time", "mood"]])
def test_an_index_that_is_a_column_too_is_read_once(index):
    frame = pd.DataFrame(table(trip_id=["a"] * N, mood=["good"] * N))
    drive = one(frame.set_index(index, drop=False))
    assert drive.drive_id == "a"
    assert drive.fixes.time == pytest.approx(T0 + np.arange(N))


def test_a_level_of_an_index_is_a_column_beside_one_that_is_one_too():
    frame = pd.DataFrame(table(trip_id=["a"] * N)).set_index(["trip_id", "time"])
    drive = one(frame.assign(time=T0 + np.arange(N)))
    assert drive.drive_id == "a"
    assert drive.fixes.time == pytest.approx(T0 + np.arange(N))


def test_a_nameless_index_of_times_beside_a_column_of_them_is_no_column():
    frame = pd.DataFrame(table(), index=pd.to_datetime(np.arange(N), unit="s"))
    assert one(frame).fixes.time == pytest.approx(T0 + np.arange(N))


@pytest.mark.parametrize("ids", [["veh", "trip_id"], ("veh", "trip_id")])
def test_several_columns_for_the_name_of_a_trip_are_refused(ids):
    frame = pd.DataFrame(table(trip_id=["a"] * N, veh=["b"] * N))
    for call in (lambda: drive_from_table(frame, id=ids), lambda: own_names(None, ids)):
        with pytest.raises(SettingError, match=r"'veh', 'trip_id'.; one name was expected"):
            call()


def test_columns_that_are_not_used_may_hold_anything():
    drive = one(table(remark=[object() for _ in range(N)]))
    assert len(drive.fixes) == N


def test_a_message_names_all_columns_and_stays_on_one_line(tmp_path):
    path = tmp_path / "x.parquet"
    pq.write_table(pa.table({"time": [T0], "wea\nther": ["fine"], "mood": ["good"]}), path)
    with pytest.raises(ReadError, match=r"time, .*, mood") as caught:
        read_drive(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("late", [1e308, -1e308, np.inf, 1e300])
def test_a_time_that_no_calendar_knows_is_none(late, sound):
    columns = {"time": T0 + np.arange(9.0), "wheel_rl_ticks": 9 * [0], "wheel_rr_ticks": 9 * [0]}
    columns["time"][4] = late
    drive = one(columns)
    sound(drive)
    assert len(drive.odometry.time) == 8
    assert drive.skipped == {"no time": 1}


def test_trips_become_drives_in_order_of_appearance(sound):
    ids = ["b", "a", "b", "a", "b"]
    drives = drive_from_table(pd.DataFrame(table(trip_id=ids)))
    assert [drive.drive_id for drive in drives] == ["b", "a"]
    assert [len(drive.fixes) for drive in drives] == [3, 2]
    for drive in drives:
        sound(drive)


def test_a_matrix_is_taken_as_it_is():
    columns = table(cov_ee_m2=[4.0] * N, cov_en_m2=[1.0] * N, cov_nn_m2=[9.0] * N)
    fixes = one(columns).fixes
    assert np.column_stack([fixes.cov_ee, fixes.cov_en, fixes.cov_nn]).tolist() == [[4, 1, 9]] * N
    assert not fixes.flags.any()


def test_a_covariance_that_is_not_one_is_replaced_flagged_and_counted(sound):
    columns = table(
        cov_ee_m2=[4.0, -4.0, 4.0, np.inf, 0.0], cov_en_m2=[1.0, 1, 99, 1, 0], cov_nn_m2=[9.0] * N
    )
    drive = one(columns)
    sound(drive)
    usual = Settings().default_sigma_m ** 2
    assert drive.fixes.cov_ee.tolist() == [4, usual, usual, usual, usual]
    assert drive.fixes.cov_en.tolist() == [1, 0, 0, 0, 0]
    assert drive.fixes.flags.tolist() == [0] + [ASSUMED] * 4
    assert drive.skipped == {
        "variance of 0 or less (settings' default used)": 2,
        "covariance not positive definite (settings' default used)": 2,
    }


def test_ellipses_sigmas_and_accuracies_are_covariances():
    ellipse = table(sigma_major_m=[3.0] * N, sigma_minor_m=[1.0] * N, sigma_bearing_deg=[90.0] * N)
    assert one(ellipse).fixes.cov_ee == pytest.approx([9.0] * N)
    assert one(ellipse).fixes.cov_nn == pytest.approx([1.0] * N)
    tilted = one(ellipse | {"sigma_bearing_deg": [45.0] * N}).fixes
    assert tilted.cov_en == pytest.approx([4.0] * N)  # towards the north-east
    assert one(table(sigma_m=[2.0] * N)).fixes.cov_nn == pytest.approx([4.0] * N)
    accuracy = one(table(accuracy=[2.0] * N)).fixes
    assert accuracy.cov_ee == pytest.approx([(2.0 / RADIUS_68) ** 2] * N)


@pytest.mark.parametrize("unknown", [0.0, -1.0])
@pytest.mark.parametrize("name", ["accuracy", "sigma_m"])
def test_an_accuracy_that_is_none_is_replaced_flagged_and_counted(name: str, unknown: float, sound):
    drive = one(table(**{name: [3.0, unknown, 3.0, np.nan, 3.0]}))
    sound(drive)
    assert drive.fixes.flags.tolist() == [0, ASSUMED, 0, ASSUMED, 0]
    assert drive.skipped == {"accuracy or sigma of 0 or less (settings' default used)": 1}


def test_an_accuracy_that_is_none_leaves_the_word_to_the_hdop():
    drive = one(table(accuracy=[3.0, 0.0, 3.0, 0.0, 3.0], hdop=[1.0] * N))
    assert drive.fixes.flags.tolist() == [0, FROM_HDOP, 0, FROM_HDOP, 0]


def test_a_quality_of_gga_decides_where_no_error_is_reported(sound):
    drive = one(table(fix_quality=[4, 5, 1, 0, 9], sigma_m=[np.nan, np.nan, np.nan, 1.0, 1.0]))
    sound(drive)
    assert drive.skipped == {"no fix by its quality, 0": 1}
    usual = Settings().default_sigma_m
    expected = [0.0075 * usual, 0.1 * usual, usual, 1.0]
    assert np.sqrt(drive.fixes.cov_ee) == pytest.approx(expected)
    rough = ASSUMED | FROM_QUALITY
    assert drive.fixes.flags.tolist() == [rough, rough, ASSUMED, 0]


def test_numbers_that_differ_by_maker_are_no_quality_unless_the_caller_says_so():
    columns = table(quality=[4] * N, fix_type=[4] * N)
    assert (one(columns).fixes.flags == ASSUMED).all()
    own = {"fix_quality": "quality"}
    (named,) = drive_from_table(pd.DataFrame(columns), columns=own)
    assert (named.fixes.flags == ASSUMED | FROM_QUALITY).all()


@pytest.mark.parametrize("unknown", [99.0, 99.9, 99.99, np.float32(99.99)])
def test_a_hdop_that_stands_for_unknown_is_counted_and_not_used(unknown, sound):
    table = {"time": T0 + np.arange(2), "lat": 49.4, "lon": 8.7, "hdop": [1.5, unknown]}
    (drive,) = drive_from_table(pd.DataFrame(table).astype({"hdop": np.asarray(unknown).dtype}))
    sound(drive)
    assert drive.skipped == {"HDOP of 99, 99.9 or 99.99 (taken as unknown)": 1}
    assert drive.fixes.flags.tolist() == [FROM_HDOP, ASSUMED]
    assert drive.fixes.cov_ee == pytest.approx([6.0**2, 5.0**2])


def test_a_large_hdop_is_believed_and_one_beside_a_covariance_is_not_looked_at():
    table = {"time": T0 + np.arange(2), "lat": 49.4, "lon": 8.7, "hdop": [50.0, 99.99],
             "sigma_m": [np.nan, 2.0]}  # fmt: skip
    (drive,) = drive_from_table(pd.DataFrame(table))
    assert not drive.skipped
    assert drive.fixes.cov_ee == pytest.approx([200.0**2, 2.0**2])


def test_minus_one_is_what_phones_write_for_no_speed_and_no_course(sound):
    drive = one(table(speed=[-1.0, 10.0, 10.0, 10.0, 10.0], course=[-1.0, 90, -1.0, -1.5, 359.0]))
    sound(drive)
    assert np.isfinite(drive.fixes.sigma_speed).tolist() == [False, True, True, True, True]
    known = np.isfinite(drive.fixes.sigma_bearing_deg)
    assert known.tolist() == [False, True, False, True, True]
    assert drive.fixes.bearing_deg[known] == pytest.approx([90.0, 358.5, 359.0])
    assert drive.skipped == {
        "negative receiver speed (ignored)": 1,
        "course of -1 (ignored)": 2,
    }


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("2026-06-01 12:00:00 UTC", 0.0),
        ("2026-06-01 12:00:00.250 GMT", 0.25),
        ("2026-06-01T14:00:00+02:00[Europe/Berlin]", 0.0),
        ("2026-06-01T12:00:00Z[UTC]", 0.0),
    ],
)
def test_a_zone_may_be_told_by_name_where_that_says_what_time_it_is(text: str, seconds: float):
    later = [f"2026-06-01T13:00:0{i}Z" for i in range(N - 1)]
    assert one(table(time=[text, *later])).fixes.time[0] == T0 + seconds


@pytest.mark.parametrize("text", ["2026-06-01 12:00:00 Europe/Berlin", "2026-06-01 12:00:00 CEST"])
def test_a_zone_whose_offset_is_not_told_is_no_time(text: str):
    later = [f"2026-06-01T13:00:0{i}Z" for i in range(N - 1)]
    assert one(table(time=[text, *later])).skipped == {"unparsable time": 1}


def test_speeds_come_in_the_unit_of_their_name():
    for name, factor in (("speed", 1), ("speed_kmh", 1 / 3.6), ("gps_speed_mph", 0.44704)):
        fixes = one(table(**{name: [36.0] * N})).fixes
        assert fixes.speed == pytest.approx([36.0 * factor] * N)
        assert np.isfinite(fixes.sigma_speed).all()


def test_fixes_and_counters_may_share_a_table(sound):
    lat = np.where(np.arange(9) % 3 == 0, 49.4, np.nan)
    columns = {
        "time": T0 + 0.1 * np.arange(9),
        "lat": lat,
        "lon": lat - 40.7,
        "wheel_rl_ticks": (65_500 + 20 * np.arange(9)) % 65_536,
        "wheel_rr_ticks": 20 * np.arange(9),
    }
    drive = one(columns, vehicle=Vehicle(counter_bits=16))
    sound(drive)
    assert len(drive.fixes) == 3
    assert isinstance(drive.odometry, WheelCounts)
    assert np.diff(drive.odometry.left) == pytest.approx([20.0] * 8)
    assert drive.skipped == {}


@pytest.mark.parametrize("told", [0, 16])
@pytest.mark.parametrize("bits", [8, 12])
def test_counters_that_wrap_at_another_width_are_taken_at_it(told: int, bits: int, sound):
    driven = np.cumsum(np.full(2000, 12.0))
    columns = {
        "time": T0 + 0.1 * np.arange(2000),
        "wheel_rl_ticks": (driven + 100) % 2**bits,
        "wheel_rr_ticks": driven % 2**bits,
    }
    drive = one(columns, vehicle=Vehicle(counter_bits=told))
    sound(drive)
    assert np.diff(drive.odometry.left) == pytest.approx(np.diff(driven))
    assert any(f"taken as {bits} bits" in note for note in drive.notes)
    assert drive.skipped == {}


def test_counters_that_go_back_and_forth_do_not_wrap():
    swing = 120.0 + 119.0 * np.sin(0.05 * np.arange(2000))
    columns = {"time": T0 + 0.1 * np.arange(2000), "wheel_rl_ticks": swing, "wheel_rr_ticks": swing}
    drive = one(columns, vehicle=Vehicle(counter_bits=16))
    assert not any("wrap" in note for note in drive.notes)
    assert drive.odometry.left == pytest.approx(swing)


@pytest.mark.parametrize(
    ("columns", "kind"),
    [
        ({"wheel_rl_mps": 10.0, "wheel_rr_mps": 10.0}, WheelSpeeds),
        ({"rear_left": 10.0, "rear_right": 10.0, "speed": 10.0}, WheelSpeeds),
        ({"speed_mps": 10.0, "yaw_rate_radps": 0.1}, SpeedYawRate),
        ({"odometer_m": np.arange(N) * 10.0}, Odometer),
        ({"speed_kmh": 36.0}, Odometer),
    ],
)
def test_odometry_alone_is_a_drive(columns, kind, sound):
    columns = {"time": T0 + np.arange(N), **columns}
    drive = one(pd.DataFrame(columns))
    sound(drive)
    assert drive.fixes is None
    assert isinstance(drive.odometry, kind)
    if kind is Odometer:
        assert np.diff(drive.odometry.distance) == pytest.approx([10.0] * (N - 1))


def test_a_reverse_flag_turns_speeds_round():
    columns = {
        "time": T0 + np.arange(N),
        "wheel_rl_mps": [2.0] * N,
        "wheel_rr_mps": [2.0] * N,
        "reverse": [0, 0, 1, 1, 0],
    }
    assert one(columns).odometry.left.tolist() == [2, 2, -2, -2, 2]
    assert one(columns).geared
    assert not one({k: v for k, v in columns.items() if k != "reverse"}).geared


@pytest.mark.parametrize("name", ["reverse", "gear"])
def test_so_it_does_with_a_speed_beside_a_yaw_rate(name):
    columns = {"time": T0 + np.arange(N), "speed_mps": [2.0] * N, "yaw_rate": [0.0] * N}
    drive = one(
        columns | {name: [0, 0, 1, 1, 0] if name == "reverse" else ["D", "D", "R", "R", "D"]}
    )
    assert drive.odometry.speed.tolist() == [2, 2, -2, -2, 2]
    assert drive.geared


@pytest.mark.parametrize(
    ("gear", "told"),
    [
        (["P", "D", "R", "R", "D"], "R"),
        ([0, 1, -1, -1, 2], "-1"),
        (["neutral", "drive", "Reverse", None, "park"], "Reverse"),  # holds until the next
        (["GearShifter.park", "D3", "GearShifter.reverse", "R1", "S"], "GearShifter.reverse, R1"),
    ],
)
def test_a_gear_turns_speeds_round(gear, told):
    columns = {"time": T0 + np.arange(N), "wheel_rl_mps": [2.0] * N, "wheel_rr_mps": [2.0] * N}
    drive = one(pd.DataFrame({**columns, "Gear": gear}))
    assert drive.odometry.left.tolist() == [2, 2, -2, -2, 2]
    assert f"column 'Gear': {told} taken as going backwards" in drive.notes


def test_gears_by_the_codes_of_a_maker_are_not_guessed_at():
    columns = {"time": T0 + np.arange(N), "wheel_rl_mps": [2.0] * N, "wheel_rr_mps": [2.0] * N}
    drive = one({**columns, "gear": [1, 4, 2, 2, 4]})
    assert drive.odometry.left.tolist() == [2.0] * N
    assert any("no value is known to mean backwards" in note for note in drive.notes)


def test_impossible_speeds_are_counted(sound):
    columns = {
        "time": T0 + np.arange(N),
        "wheel_rl_mps": [2.0, 500.0, 2, 2, 2],
        "wheel_rr_mps": [2.0] * N,
    }
    drive = one(columns)
    sound(drive)
    assert drive.skipped == {"wheel speed beyond 90 m/s": 1}
    assert drive.odometry.left.max() == 2.0


def test_projected_coordinates_need_a_reference_system(sound):
    import pyproj

    lat, lon = 60.17 + 1e-4 * np.arange(N), 24.94 + 1e-4 * np.arange(N)
    x, y = pyproj.Transformer.from_crs(4326, 3067, always_xy=True).transform(lon, lat)
    columns = {"tst": T0 + np.arange(N), "x": x, "y": y, "odo": 10.0 * np.arange(N)}
    drive = one(columns, crs="EPSG:3067")
    sound(drive)
    assert drive.fixes.lat_deg == pytest.approx(lat, abs=1e-8)
    assert drive.fixes.lon_deg == pytest.approx(lon, abs=1e-8)
    assert isinstance(drive.odometry, Odometer)
    del columns["odo"]
    with pytest.raises(ReadError, match="crs="):
        one(columns)
    with pytest.raises(ReadError, match="no_such_crs"):
        one(columns, crs="no_such_crs")


@pytest.mark.parametrize("suffix", [None, "parquet", "gpkg", "geojson"])
def test_rows_without_a_point_are_skipped_and_counted(tmp_path, suffix, sound):
    gpd, shapely = pytest.importorskip("geopandas"), pytest.importorskip("shapely")
    places = [None, shapely.Point(), *gpd.points_from_xy(np.full(3, 8.7), np.full(3, 49.4))]
    frame = gpd.GeoDataFrame({"time": T0 + np.arange(N)}, geometry=places, crs=4326)
    if suffix is None:
        [drive] = drive_from_table(frame)
    else:
        path = tmp_path / f"drive.{suffix}"
        frame.to_parquet(path) if suffix == "parquet" else frame.to_file(path)
        [drive] = read_drive(path)
    sound(drive)
    assert len(drive.fixes) == N - 2
    assert drive.skipped == {"no position": 2}


def test_points_of_a_geodataframe_are_brought_to_degrees(sound):
    import geopandas as gpd

    frame = gpd.GeoDataFrame(
        {"time": T0 + np.arange(N)},
        geometry=gpd.points_from_xy([8.7] * N, [49.4] * N, crs=4326).to_crs(32632),
    )
    (drive,) = drive_from_table(frame)
    sound(drive)
    assert drive.fixes.lat_deg == pytest.approx([49.4] * N)


@pytest.mark.parametrize("form", ["wkt", "wkb_hex"])
def test_points_may_be_words_of_wkt_or_digits_of_wkb(form, tmp_path):
    import shapely

    cells = [getattr(shapely.Point(8.7, 49.4 + k * 1e-3), form) for k in range(N - 2)]
    frame = pd.DataFrame({"time": T0 + np.arange(N), "geom": [*cells, "", None]})
    (drive,) = drive_from_table(frame)
    assert drive.fixes.lat_deg == pytest.approx(49.4 + 1e-3 * np.arange(N - 2))
    assert drive.skipped == {"no position": 2}


def test_points_of_a_geodataframe_without_a_system_are_in_that_of_the_caller(sound):
    import geopandas as gpd

    degrees = gpd.points_from_xy([8.7] * N, [49.4] * N, crs=4326)
    for system in (3857, 4326):
        frame = gpd.GeoDataFrame(
            {"time": T0 + np.arange(N)},
            geometry=gpd.GeoSeries(degrees).to_crs(system).set_crs(None, allow_override=True),
        )
        drive = drive_from_table(frame, crs=system)[0]
        sound(drive)
        assert drive.fixes.lat_deg == pytest.approx([49.4] * N)
        assert drive.fixes.lon_deg == pytest.approx([8.7] * N)
        if system == 3857:
            with pytest.raises(ReadError, match="x and y without a reference system"):
                drive_from_table(frame)


@pytest.mark.parametrize("suffix", [".csv", ".tsv", ".parquet", ".arrow", ".feather", ".dat"])
def test_all_kinds_of_files_say_the_same(tmp_path, suffix):
    path = tmp_path / f"drive{suffix}"
    content = pa.table(table(speed_mps=np.full(N, 12.5)))
    if suffix == ".parquet":
        pq.write_table(content, path)
    elif suffix in (".arrow", ".feather"):
        pyarrow.feather.write_feather(content, path)
    else:
        options = pa.csv.WriteOptions(delimiter="\t" if suffix == ".tsv" else ",")
        pa.csv.write_csv(content, path, options)
    (drive,) = read_drive(path)
    assert drive.drive_id == "drive"
    assert drive.sources == (str(path),)
    expected = drive_from_table(content)[0].fixes
    for name in expected.__dataclass_fields__:
        assert np.array_equal(getattr(drive.fixes, name), getattr(expected, name)), name


def test_semicolons_a_mark_of_utf8_and_old_encodings_do_not_disturb(put):
    text = f"time;lat;lon;straße\n{T0};49.4;8.7;x\n"
    for content in (text.encode(), b"\xef\xbb\xbf" + text.encode(), text.encode("latin-1")):
        assert len(read_drive(put("x.csv", content))[0].fixes) == 1
    for said in (b"sep=;\n", b"\xef\xbb\xbfSEP=;\r\n", b'"sep=;"\n'):  # for Excel
        (drive,) = read_drive(put("x.csv", said + text.encode()))
        assert len(drive.fixes) == 1
        assert not drive.skipped


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"lat": [1.0], "lon": [2.0]}, "no time .*accepted names are time: time, timestamp"),
        ({"time": [T0]}, "neither position nor odometry .*lat: lat, latitude"),
        ({"time": [], "lat": [], "lon": []}, "no rows"),
        ({"lat": [1.0], "lon": [2.0]}, "rename the columns"),
        ({"time": ["soon"], "lat": [1.0], "lon": [1.0]}, "no time that can be understood"),
        ({"time": ["1.6.26 8:00"], "lat": [1.0], "lon": [1.0]}, "such as '1.6.26 8:00'; ISO 8601"),
    ],
)
def test_a_table_that_lacks_something_says_what_would_do(columns, said):
    with pytest.raises(ReadError, match=said):
        drive_from_table(pa.table(columns))


@pytest.mark.parametrize("name", ["x.csv", "x.parquet", "x.arrow", "x.tsv", "x.unknown"])
@pytest.mark.parametrize(
    "content", [b"", b" \n", b"\x00\x01\x02", b"PAR1", b"a,b\n1,2\n", b"\n,\n"]
)
def test_what_is_no_table_is_refused_by_name(put, name, content):
    with pytest.raises(ReadError, match=r"x\."):
        read_drive(put(name, content))


def test_a_cut_parquet_is_refused(put):
    buffer = io.BytesIO()
    pq.write_table(pa.table(table()), buffer)
    whole = buffer.getvalue()
    for end in (10, len(whole) // 2, len(whole) - 1):
        with pytest.raises(ReadError, match=r"x\.parquet"):
            read_drive(put("x.parquet", whole[:end]))


@pytest.mark.parametrize("thing", [5, "text", None, [1, 2]])
def test_what_is_no_table_in_memory_is_refused(thing):
    with pytest.raises(ReadError, match="table"):
        drive_from_table(thing)


class LazyFrame:
    """One of polars, as its class is called; it has names of columns and no rows."""

    columns = ("time", "lat", "lon")


def test_a_frame_without_rows_yet_is_refused_with_what_makes_it_a_table():
    for read in (drive_from_table, speeds):
        with pytest.raises(ReadError, match=r"^table: a LazyFrame .*; give its \.collect\(\)$"):
            read(LazyFrame())


def _trips_in_rows():
    """Two trips with a row each, in several ways, and what is said of them."""
    cells = {"time": [[T0, T0 + 1]] * 2, "lat": [[49.4, 49.5]] * 2, "lon": [[8.7, 8.8]] * 2}
    fixes = [[{"time": T0, "lat": 49.4, "lon": 8.7}]] * 2
    lines = shapely.linestrings([[[8.7, 49.4], [8.8, 49.5]]] * 2)
    times, exploded = {"time": [T0, T0]}, r"\.explode\(\['time', 'lat', 'lon'\]\)"
    yield cells, exploded
    yield (
        pa.table(cells).cast(pa.schema([(k, pa.large_list(pa.float64())) for k in cells])),
        exploded,
    )
    yield {"points": fixes}, r"\.explode\('points'\).*\.unnest\('points'\)"
    yield times | {"POLYLINE": ["[[8.7, 49.4], [8.8, 49.5]]"] * 2}, r"\.explode\('POLYLINE'\)"
    yield times | {"geometry": [line.wkt for line in lines]}, r"lines, .* get_coordinates\("
    yield times | {"geometry": [line.wkb for line in lines]}, r"lines, .* get_coordinates\("
    yield geopandas.GeoDataFrame(times, geometry=lines, crs=4326), r"lines, .* get_coordinates\("


@pytest.mark.parametrize(("trips", "said"), list(_trips_in_rows()))
def test_trips_of_one_row_each_are_told_how_to_get_a_row_for_each_fix(trips, said, tmp_path):
    with pytest.raises(ReadError, match=said):
        drive_from_table(trips)
    if isinstance(trips, geopandas.GeoDataFrame):
        trips.to_parquet(tmp_path / "trips.parquet")
    else:
        pq.write_table(pa.table(trips), tmp_path / "trips.parquet")
    with pytest.raises(ReadError, match=rf"^trips\.parquet: .*{said}"):
        read_drive(tmp_path / "trips.parquet")


CELLS = st.one_of(
    st.floats(), st.integers(-(2**70), 2**70), st.text(max_size=8), st.sampled_from(["", "1e999"])
)


def test_a_table_is_no_path_and_own_columns_are_a_mapping():
    for thing in (pd.DataFrame(table()), pa.table(table()), table()):
        with pytest.raises(ReadError, match=r"in memory was given; paths .*whichroad\.match"):
            read_drive(thing)
    with pytest.raises(SettingError, match=r"columns is 'time=a'; .*as a dict"):
        drive_from_table(pd.DataFrame(table()), columns="time=a")
    with pytest.raises(SettingError, match=r"columns is 'time=a'"):
        match_many(table(trip_id=["a"] * N), None, columns="time=a")


@given(st.lists(st.tuples(CELLS, CELLS, CELLS, CELLS), min_size=1, max_size=6))
def test_any_cells_give_records_or_a_read_error(rows):
    from .conftest import check_records

    names = ("time", "lat", "lon", "wheel_rl_mps")
    frame = pd.DataFrame({name: [str(row[k]) for row in rows] for k, name in enumerate(names)})
    try:
        (drive,) = drive_from_table(frame)
    except ReadError:
        return
    check_records(drive)


def test_a_table_of_places_alone_without_one_that_can_be_understood_is_refused(put):
    table = put("places.txt", "lat lon\nnorth east\n49.4 <8\n")
    with pytest.raises(ReadError, match=r"places\.txt: no row has both a latitude and a longitude"):
        read_drive(table)


def test_a_single_reading_of_a_full_counter_is_no_wrap():
    """Found by the fuzz: there is no step to judge."""
    table = {"time": [T0, T0 + 1.0], "lat": [49.4, 49.4], "lon": [8.7, 8.7001],
             "wheel_rl_ticks": [65535.0, np.nan], "wheel_rr_ticks": [65535.0, np.nan]}  # fmt: skip
    [drive] = drive_from_table(pd.DataFrame(table))
    assert len(drive.fixes) == 2
    assert not any("wrap" in note for note in drive.notes)
