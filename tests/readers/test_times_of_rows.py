"""What the order of rows tells of times that are not fine enough, or come twice."""

from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from whichroad.readers import drive_from_table
from whichroad.readers.dates import Writing
from whichroad.readers.regular_trips import batched_fixes
from whichroad.readers.splitting import split_trips
from whichroad.settings import Settings

from .driving import METRES, town

MINUTE = 60.0


def cut(frame: pd.DataFrame, unit: float) -> pd.DataFrame:
    """The drive with times cut to a whole unit."""
    return frame[["time", "lat", "lon"]].assign(time=np.floor(frame["time"] / unit) * unit)


def fast() -> pd.DataFrame:
    """A drive with five fixes a second; all receivers are in phase with their clock."""
    frame = town(step=0.2, n=900, noise=0.0)
    return frame.assign(time=frame["time"][0] + 0.2 * np.arange(900))


@pytest.mark.parametrize("late", [0.0, 17.0, 43.0])
def test_times_in_whole_minutes_are_spread_by_the_order_of_rows(late, sound):
    frame = town(n=600)
    frame["time"] += late
    (drive,) = drive_from_table(cut(frame, MINUTE))
    sound(drive)
    assert drive.fixes.time == pytest.approx(frame["time"].to_numpy(), abs=1e-3)
    assert not drive.skipped
    (note,) = drive.notes
    assert note.startswith("times were in whole minutes; 590 rows were spread evenly")


def test_times_in_whole_seconds_are_spread_by_the_order_of_rows(sound):
    (drive,) = drive_from_table(cut(fast(), 1.0))
    sound(drive)
    assert drive.fixes.time == pytest.approx(fast()["time"].to_numpy(), abs=1e-3)
    assert "times were in whole seconds; 720 rows" in drive.notes[0]


def test_rows_that_come_latest_first_are_spread_in_the_order_of_time(sound):
    (drive,) = drive_from_table(cut(town(n=600), MINUTE)[::-1])
    sound(drive)
    assert drive.fixes.lat_deg == pytest.approx(town(n=600)["lat"].to_numpy())


def test_rows_beside_a_gap_are_spread_on_its_sides():
    frame = town(n=600).drop(index=range(200, 330))
    (drive,) = drive_from_table(cut(frame, MINUTE))
    assert drive.fixes.time == pytest.approx(frame["time"].to_numpy(), abs=1e-3)


def test_rows_that_repeat_a_place_are_not_spread(sound):
    frame = cut(fast(), 1.0)
    (drive,) = drive_from_table(frame.loc[frame.index.repeat(2)])
    sound(drive)
    assert drive.skipped == {"repeated time": len(frame)}
    assert drive.fixes.time == pytest.approx(fast()["time"].to_numpy(), abs=1e-3)


def test_rows_of_two_receivers_at_one_time_are_dropped_and_it_is_said(sound):
    one = cut(town(), 1.0)
    other = one.assign(lat=one["lat"] + 2.0 * METRES)
    both = pd.concat([one, other]).sort_values("time", kind="stable")
    (drive,) = drive_from_table(both)
    sound(drive)
    assert drive.skipped == {"repeated time": len(one)}
    assert "240 of 480 rows have the time of a row before them at another place" in drive.notes[0]
    assert drive.fixes.lat_deg == pytest.approx(one["lat"].to_numpy())


def test_rows_of_two_receivers_that_lead_on_in_the_middle_are_dropped_too():
    one = cut(town(n=600, noise=0.0), 1.0)
    ahead = np.where(np.arange(600) % 20 == 0, 0.5, np.where(np.arange(600) % 2, -25.0, 25.0))
    other = one.copy()
    for name in ("lat", "lon"):  # now far ahead, now behind, and half a second ahead in between
        other[name] = np.interp(np.arange(600) + ahead, np.arange(600), one[name])
    (drive,) = drive_from_table(pd.concat([one, other]).sort_values("time", kind="stable"))
    assert "have the time of a row before them at another place" in drive.notes[0]
    assert drive.fixes.lat_deg == pytest.approx(one["lat"].to_numpy())


def test_fixes_and_odometry_of_one_time_are_left_as_they_are(sound):
    fixes = cut(town(), 1.0)
    wheels = pd.DataFrame({"time": fixes["time"], "wheel_rl": 8.0, "wheel_rr": 8.0})
    both = pd.concat([wheels, fixes]).sort_values("time", kind="stable")
    (drive,) = drive_from_table(both)
    sound(drive)
    assert drive.fixes.time == pytest.approx(fixes["time"].to_numpy())
    assert drive.odometry.time == pytest.approx(fixes["time"].to_numpy())
    assert not drive.skipped


def test_a_drive_too_short_to_tell_is_not_spread_and_it_is_said():
    (drive,) = drive_from_table(cut(town(n=200), MINUTE))
    assert drive.skipped == {"repeated time": 196}
    assert "where times were rounded, give them with their fractions" in drive.notes[0]


def test_each_drive_of_a_table_is_spread_on_its_own(sound):
    coarse, fine = cut(town(n=600), MINUTE), town(seed=1)[["time", "lat", "lon"]]
    table = pd.concat([coarse.assign(drive_id="coarse"), fine.assign(drive_id="fine")])
    first, second = drive_from_table(table)
    assert len(first.fixes) == 600
    assert "590 rows" in first.notes[0]
    assert len(second.fixes) == 240
    assert not second.notes


def in_berlin(begin: str, seconds: int = 780) -> tuple[np.ndarray, pd.DataFrame]:
    """Moments of a drive around the end of summer time, and its table with local times."""
    moments = pd.date_range(begin, periods=seconds, freq="s", tz="UTC")
    frame = town(n=seconds)[["lat", "lon"]]
    local = moments.tz_convert("Europe/Berlin").tz_localize(None)
    return moments.as_unit("ns").asi8 / 1e9, frame.assign(time=local)


@pytest.mark.parametrize("form", [None, "%Y-%m-%d %H:%M:%S", "%d.%m.%Y %H:%M:%S"])
@pytest.mark.parametrize("turned", [1, -1])
def test_a_jump_back_in_local_times_is_where_the_clocks_went_back(form, turned, sound):
    moments, frame = in_berlin("2026-10-25T00:55:00")
    if form is not None:
        frame["time"] = frame["time"].dt.strftime(form)
    (drive,) = drive_from_table(frame[::turned], tz="Europe/Berlin")
    sound(drive)
    assert drive.fixes.time == pytest.approx(moments)
    assert "480 rows behind the jump in the local times" in drive.notes[0]


@pytest.mark.parametrize("begin", ["2026-10-24T23:55:00", "2026-10-25T01:55:00"])
def test_rows_that_go_on_from_a_sure_time_are_of_that_side_of_the_change(begin):
    moments, frame = in_berlin(begin)
    (drive,) = drive_from_table(frame, tz="Europe/Berlin")
    assert drive.fixes.time == pytest.approx(moments)
    assert not drive.notes


@pytest.mark.parametrize("begin", ["2026-10-25T00:10:00", "2026-10-25T01:10:00"])
def test_a_drive_within_the_hour_that_comes_twice_is_taken_as_of_the_first_and_it_is_said(begin):
    _, frame = in_berlin(begin)
    (drive,) = drive_from_table(frame, tz="Europe/Berlin")
    assert drive.fixes.time[0] == pd.Timestamp("2026-10-25T00:10:00Z").timestamp()
    assert "780 rows have local times that come twice" in drive.notes[0]
    assert "the first was taken" in drive.notes[0]


@pytest.mark.parametrize("form", [None, "%Y-%m-%dT%H:%M:%S", "%d.%m.%Y %H:%M:%S"])
def test_times_that_no_clock_shows_in_spring_are_counted_and_said(form):
    """A logger goes on by winter time; its rows of 1 to 2 h UTC are read as it shows them."""
    moments = pd.date_range("2026-03-29T00:55:00", periods=780, freq="s")
    frame = town(n=780)[["lat", "lon"]].assign(time=moments + pd.Timedelta("1h"))
    if form is not None:
        frame["time"] = frame["time"].dt.strftime(form)
    (drive,) = drive_from_table(frame, tz="Europe/Berlin")
    assert drive.fixes.time == pytest.approx(moments.as_unit("ns").asi8 / 1e9)
    assert "480 rows with local times that no clock shows" in drive.notes[0]
    assert len(drive.notes) == 1


def test_times_behind_the_hour_that_is_skipped_are_sound():
    moments, frame = in_berlin("2026-03-29T00:55:00")
    (drive,) = drive_from_table(frame, tz="Europe/Berlin")
    assert drive.fixes.time == pytest.approx(moments)
    assert not drive.notes
    frame["time"] = [f"2026-03-29T01:{k // 60:02}:{k % 60:02}Z" for k in range(780)]
    frame.loc[0, "time"] = "2026-03-29T02:00:00"
    (drive,) = drive_from_table(frame, tz="Europe/Berlin")
    assert drive.notes[0].startswith("1 row with local times that no clock shows")


def test_drives_of_one_table_go_through_the_change_on_their_own():
    moments, frame = in_berlin("2026-10-25T00:55:00")
    table = pd.concat([frame.assign(drive_id=name) for name in "ab"]).sort_index(kind="stable")
    for drive in drive_from_table(table, tz="Europe/Berlin"):
        assert drive.fixes.time == pytest.approx(moments)


def test_a_vehicle_is_cut_into_trips_in_the_order_of_true_times():
    table = pa.Table.from_pandas(in_berlin("2026-10-25T00:55:00")[1])
    ordered, parts = split_trips(table, 300.0, written=Writing(ZoneInfo("Europe/Berlin")))
    assert len(parts) == 1
    assert ordered["time"].to_pylist() == table["time"].to_pylist()


def test_trips_within_an_hour_that_comes_twice_or_hides_another_are_not_read_together():
    table = pa.Table.from_pandas(in_berlin("2026-10-25T01:10:00")[1])
    zone = ZoneInfo("Europe/Berlin")
    assert not batched_fixes(table, np.array([0]), Settings(), zone=zone).regular[0]
    spring = pa.Table.from_pandas(in_berlin("2026-03-29T01:10:00")[1])
    assert not batched_fixes(spring, np.array([0]), Settings(), zone=zone).regular[0]
    later = pa.Table.from_pandas(in_berlin("2026-10-25T02:10:00")[1])
    assert batched_fixes(later, np.array([0]), Settings(), zone=zone).regular[0]
