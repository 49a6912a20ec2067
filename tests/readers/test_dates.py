"""Dates and times as people, spreadsheets and tools write them."""

import re
from datetime import UTC, datetime
from email.utils import format_datetime
from itertools import combinations, permutations

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.errors import ReadError
from whichroad.readers import drive_from_table, read_drive
from whichroad.readers.bare_times import are_clocks
from whichroad.readers.dates import UNSAID, Writing, day_of, of_texts
from whichroad.readers.splitting import in_time_order, split_trips
from whichroad.readers.unread_times import year_of

START = datetime(2026, 3, 28, 22, 30, 0, tzinfo=UTC)
T0 = START.timestamp()
N = 60
METRES = 1.0 / 111_195.0  # degrees of latitude
MOMENTS = pd.date_range(START, periods=N, freq="s")
LAT = 49.4 + 10.0 * METRES * np.arange(N)


def drive_of(folder, **columns):
    """The only drive of a CSV with these columns beside its places."""
    columns = {**columns, "lat": LAT, "lon": np.full(N, 8.7)}
    path = folder / "x.csv"
    pd.DataFrame(columns).to_csv(path, index=False, sep=";")
    (drive,) = read_drive(path, tz=columns.pop("tz", None))
    return drive


WRITTEN = [
    "%Y-%m-%dT%H:%M:%SZ",
    "%Y%m%dT%H%M%SZ",
    "%Y%m%d%H%M%S",
    "%Y%m%d %H%M%S",
    "%Y/%m/%d %H:%M:%S",
    "%d.%m.%Y %H:%M:%S",
    "%d/%m/%Y %H:%M:%S",
    "%m/%d/%Y %H:%M:%S",
    "%m/%d/%Y %I:%M:%S %p",
    "%Y-%m-%d %I:%M:%S %p",
    "%d-%b-%Y %H:%M:%S.000",
    "%b %d, %Y %I:%M:%S %p",
    "%B %d, %Y, %I:%M:%S %p",
    "%a, %d %b %Y %H:%M:%S +0000",
    "%a, %d %b %Y %H:%M:%S GMT",
    "%a %b %d %H:%M:%S GMT+00:00 %Y",
    "%Y-%m-%d %H:%M:%S.000+0000",
    "%Y-%m-%d %H:%M:%S UTC",
]


@pytest.mark.parametrize("form", WRITTEN)
def test_dates_are_read_in_all_usual_writings(tmp_path, form):
    drive = drive_of(tmp_path, time=MOMENTS.strftime(form))
    assert drive.fixes.time == pytest.approx(T0 + np.arange(N))
    assert drive.skipped == {}


def test_dates_of_mails_are_read(tmp_path):
    drive = drive_of(tmp_path, time=[format_datetime(m.to_pydatetime()) for m in MOMENTS])
    assert drive.fixes.time == pytest.approx(T0 + np.arange(N))


@given(st.datetimes(datetime(1980, 1, 1), datetime(2099, 12, 31)), st.sampled_from(WRITTEN))
def test_any_date_is_read_as_python_reads_it(moment, form):
    moment = moment.replace(microsecond=0)
    if form.startswith(("%d/", "%m/")) and moment.day <= 12 and moment.day != moment.month:
        return  # of a single date it cannot be known which number is the month
    read = of_texts([moment.strftime(form)], UNSAID, "x")
    if read is None:  # digits alone are read as a number
        assert form == "%Y%m%d%H%M%S"
        return
    assert read.seconds[0] == moment.replace(tzinfo=UTC).timestamp()


@pytest.mark.parametrize(("name", "unit"), [("time", 1), ("ts", 1e3), ("epoch", 1e6), ("utc", 1e9)])
def test_numbers_since_1970_are_in_the_unit_of_their_size(tmp_path, name, unit):
    values = (unit * (T0 + np.arange(N))).astype(np.int64)
    assert drive_of(tmp_path, **{name: values}).fixes.time == pytest.approx(T0 + np.arange(N))


@pytest.mark.parametrize("digits", ["%Y%m%d%H%M%S", "%Y%m%d%H%M%S000"])
def test_digits_of_a_date_are_no_count_of_milliseconds(tmp_path, digits):
    drive = drive_of(tmp_path, time=MOMENTS.strftime(digits).astype(np.int64))
    assert drive.fixes.time == pytest.approx(T0 + np.arange(N))


def test_days_of_a_spreadsheet_are_dates(tmp_path):
    days = (T0 + np.arange(N)) / 86_400 + 25_569  # as Excel counts them
    drive = drive_of(tmp_path, time=days)
    assert drive.fixes.time == pytest.approx(T0 + np.arange(N), abs=1e-4)
    assert any("spreadsheet's days" in note for note in drive.notes)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("µs", 1e6), ("s", 1.0)])
def test_times_from_a_start_are_in_the_unit_that_fits_the_places(tmp_path, unit, factor):
    drive = drive_of(tmp_path, t=factor * np.arange(N))
    assert drive.fixes.time == pytest.approx(np.arange(N))
    assert any(f"taken as {unit} from a start" in n for n in drive.notes) == (unit != "s")


@pytest.mark.parametrize(
    ("day", "clock"),
    [("%Y-%m-%d", "%H:%M:%S"), ("%d.%m.%Y", "%H:%M:%S"), ("%Y%m%d", "%H%M%S"),
     ("%m/%d/%Y", "%I:%M:%S %p"), ("%Y/%m/%d", "%H:%M:%S.000")],
)  # fmt: skip
def test_date_and_time_may_stand_in_columns_of_their_own(tmp_path, day, clock):
    drive = drive_of(tmp_path, date=MOMENTS.strftime(day), time=MOMENTS.strftime(clock))
    assert drive.fixes.time == pytest.approx(T0 + np.arange(N))


def test_times_of_day_in_digits_may_lack_the_zero_of_their_hour(tmp_path):
    clock = [81_500 + k for k in range(N)]
    drive = drive_of(tmp_path, date=["20260328"] * N, time=clock)
    assert drive.fixes.time[0] == datetime(2026, 3, 28, 8, 15, tzinfo=UTC).timestamp()


def test_numbers_beside_a_date_that_are_no_clock_count_from_a_start(tmp_path):
    counted = drive_of(tmp_path, date=["2026-03-28"] * N, time=100_000 + 1000 * np.arange(N))
    assert np.diff(counted.fixes.time) == pytest.approx(1.0)
    assert any("taken as ms from a start" in note for note in counted.notes)


@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S,250", "%d.%m.%Y %H:%M:%S,250"])
def test_fractions_of_seconds_may_stand_behind_a_comma(tmp_path, form):
    drive = drive_of(tmp_path, time=MOMENTS.strftime(form))
    assert drive.fixes.time == pytest.approx(T0 + 0.25 + np.arange(N))


def test_times_of_day_alone_are_counted_from_1970_over_midnight_and_it_is_said(tmp_path):
    late = pd.date_range("2026-03-28 23:59:30", periods=N, freq="s").strftime("%H:%M:%S")
    drive = drive_of(tmp_path, time=late)
    assert drive.fixes.time == pytest.approx(86_370.0 + np.arange(N))
    assert any(note.startswith("no date beside") for note in drive.notes)


@pytest.mark.parametrize(
    "form", ["%Y-%m-%d %H:%M:%S", "%d.%m.%Y %H:%M:%S", "%Y%m%d%H%M%S", "%b %d, %Y %I:%M:%S %p"]
)
def test_times_without_a_zone_are_utc_unless_the_caller_names_one(tmp_path, form):
    path = tmp_path / "x.csv"
    local = MOMENTS.tz_convert("Europe/Berlin").strftime(form)
    pd.DataFrame({"time": local, "lat": LAT, "lon": 8.7}).to_csv(path, index=False, sep=";")
    (drive,) = read_drive(path)
    assert drive.fixes.time == pytest.approx(T0 + 3600 + np.arange(N))
    assert any("name no zone and were taken as UTC" in note for note in drive.notes)
    (drive,) = read_drive(path, tz="Europe/Berlin")
    assert drive.fixes.time == pytest.approx(T0 + np.arange(N))
    assert not any("zone" in note for note in drive.notes)


def test_a_drive_across_the_begin_of_summer_time_is_one_without_a_gap(tmp_path):
    moments = pd.date_range("2026-03-29T00:59:30Z", periods=N, freq="s")
    local = moments.tz_convert("Europe/Berlin").strftime("%Y-%m-%d %H:%M:%S")
    frame = pd.DataFrame({"time": local, "lat": LAT, "lon": 8.7})
    (drive,) = drive_from_table(frame, tz="Europe/Berlin")
    assert np.diff(drive.fixes.time) == pytest.approx(1.0)
    assert drive.fixes.time[0] == moments[0].timestamp()


def test_a_zone_that_has_no_effect_is_said_and_an_unknown_one_refused():
    frame = pd.DataFrame({"time": T0 + np.arange(N), "lat": LAT, "lon": 8.7})
    (drive,) = drive_from_table(frame, tz="Europe/Berlin")
    assert any("tz Europe/Berlin not used" in note for note in drive.notes)
    with pytest.raises(ReadError, match=r"'Europe/Nowhere' is not a known time zone"):
        drive_from_table(frame, tz="Europe/Nowhere")


def test_dates_whose_month_cannot_be_known_are_refused_with_what_to_do(tmp_path):
    for time in (["03/04/2026 10:00:00"] * N, ["03-04-2026 10:00"] * N):
        with pytest.raises(ReadError, match=r"is the month; ISO 8601 .* write them .*--dates"):
            drive_of(tmp_path, time=time)


@pytest.mark.parametrize("form", ["%m/%d/%Y %I:%M:%S %p", "%m-%d-%Y %H:%M:%S"])
def test_the_caller_may_say_whether_month_or_day_comes_first(tmp_path, form):
    path = tmp_path / "x.csv"
    moments = pd.date_range("2026-06-01T22:30:00Z", periods=N, freq="s")
    frame = pd.DataFrame({"time": moments.strftime(form), "lat": LAT, "lon": 8.7})
    frame.to_csv(path, index=False)
    for (drive,) in (read_drive(path, dates="mdy"), drive_from_table(frame, dates="mdy")):
        assert drive.fixes.time[0] == moments[0].timestamp()
        assert len(drive.fixes) == N
    (drive,) = read_drive(path, dates="dmy")
    assert drive.fixes.time[0] == pd.Timestamp("2026-01-06T22:30:00Z").timestamp()


def test_an_order_of_dates_that_does_not_fit_or_is_none_is_refused():
    frame = pd.DataFrame({"time": ["06/28/2026 10:00:00"] * N, "lat": LAT, "lon": 8.7})
    with pytest.raises(ReadError, match=r"'06/28/2026 10:00:00'; .* in the order dmy of dates"):
        drive_from_table(frame, dates="dmy")
    with pytest.raises(ReadError, match="'ydm' is no order of day, month and year; mdy"):
        drive_from_table(frame, dates="ydm")


def test_the_order_of_dates_holds_where_vehicles_are_cut_into_trips():
    moments = pd.date_range("2026-06-01T22:30:00Z", periods=N, freq="s")
    table = pa.table({"time": moments.strftime("%m/%d/%Y %H:%M:%S"), "lat": LAT, "lon": [8.7] * N})
    _, seconds = in_time_order(table, written=Writing.of(None, "mdy"))
    assert seconds[0] == moments[0].timestamp()


@pytest.mark.parametrize(
    "cell", ["2612-01-01T00:00:00Z", "31.02.2026 10:00", "2026-02-31T10:00:00Z", "1843-01-01 00:00",
             "2026-03-28 25:00:00", "28.03.2026 13:00 PM"]
)  # fmt: skip
def test_a_date_that_cannot_be_is_skipped_and_counted(tmp_path, cell):
    time = [*MOMENTS.strftime("%Y-%m-%dT%H:%M:%SZ")[:-1], cell]
    if "." in cell:
        time = [*MOMENTS.strftime("%d.%m.%Y %H:%M")[:-1], cell]
    drive = drive_of(tmp_path, time=time)
    counts = [drive.skipped.get(reason, 0) for reason in ("no time", "unparsable time")]
    assert sum(counts) == 1
    assert drive.fixes.time.max() < T0 + N


FORMS = {
    "ISO": lambda moments: moments.strftime("%Y-%m-%dT%H:%M:%SZ"),
    "ISO local": lambda moments: moments.strftime("%Y-%m-%d %H:%M:%S"),
    "dmy": lambda moments: moments.strftime("%d/%m/%Y %H:%M:%S"),
    "mdy": lambda moments: moments.strftime("%m/%d/%Y %I:%M:%S %p"),
    "German": lambda moments: moments.strftime("%d.%m.%Y %H:%M:%S"),
    "digits": lambda moments: moments.strftime("%Y%m%d%H%M%S"),
    "s": lambda moments: (moments.as_unit("s").asi8).astype(str),
    "ms": lambda moments: (moments.as_unit("ms").asi8).astype(str),
}


def mixed(first, second, moments):
    """The drive of a column whose last 20 times are in another format than those before."""
    cells = [*FORMS[first](moments[: N - 20]), *FORMS[second](moments[N - 20 :])]
    (drive,) = drive_from_table({"time": cells, "lat": LAT, "lon": [8.7] * N})
    return drive


@pytest.mark.parametrize(
    "pair", [pair for pair in combinations(FORMS, 2) if pair != ("dmy", "mdy")]
)
def test_a_column_may_mix_formats(pair):
    for first, second in permutations(pair):
        drive = mixed(first, second, MOMENTS)
        assert drive.fixes.time == pytest.approx(T0 + np.arange(N))
        assert not drive.skipped
        told = [note for note in drive.notes if "mixes formats of times: " in note]
        alike = {*pair} <= {"dmy", "mdy", "German", "digits"} or {*pair} == {"ISO", "ISO local"}
        assert len(told) == (not alike)
        assert all(re.search("[24]0 of 60 rows", note) for note in told)


@pytest.mark.parametrize("form", ["dmy", "mdy"])
def test_dates_that_do_not_show_their_month_are_near_the_others(form):
    moments = pd.date_range("2026-06-05 22:30:00", periods=N, freq="s")
    for pair in permutations(("ISO", form)):
        drive = mixed(*pair, moments)
        assert drive.fixes.time == pytest.approx(moments.as_unit("s").asi8)


@pytest.mark.parametrize("unit", ["ms", "us", "digits"])
def test_numbers_of_times_may_mix_units(unit):
    late = {"ms": 1e3 * T0, "us": 1e6 * T0, "digits": 20_260_328_223_000}[unit]
    step = {"ms": 1e3, "us": 1e6, "digits": 1.0}[unit]
    time = np.where(np.arange(N) < 30, T0 + np.arange(N), late + step * np.arange(N))
    (drive,) = drive_from_table({"time": time, "lat": LAT, "lon": [8.7] * N})
    assert drive.fixes.time == pytest.approx(T0 + np.arange(N))
    assert "30 of 60 rows" in drive.notes[0]


def test_numbers_that_would_be_years_away_are_not_taken_in_another_unit():
    time = T0 + np.arange(N)
    time[50] = 1e3 * (T0 - 3e8)
    (drive,) = drive_from_table({"time": time, "lat": LAT, "lon": [8.7] * N})
    assert len(drive.fixes) == N - 1
    cells = [*FORMS["ISO"](MOMENTS)[:-1], "1234567890"]
    (drive,) = drive_from_table({"time": cells, "lat": LAT, "lon": [8.7] * N})
    assert drive.skipped == {"unparsable time": 1}
    assert not drive.notes


@pytest.mark.parametrize("bad", [1, 12])
@pytest.mark.parametrize("form", ["ISO", "ms"])
def test_rows_without_a_readable_time_are_counted_once_and_told_where_they_are_many(form, bad):
    cells = [*FORMS[form](MOMENTS)[: N - bad - 2], None, None, *["just now"] * bad]
    (drive,) = drive_from_table({"time": cells, "lat": LAT, "lon": [8.7] * N})
    kind = "unparsable time" if form == "ISO" else "unparsable number in time"
    assert drive.skipped == {kind: bad, "no time": 2}
    told = [note for note in drive.notes if "12 of 60 rows left out" in note]
    assert len(told) == (bad == 12)
    assert all("such as 'just now'" in note for note in told)


@pytest.mark.parametrize("values", [5e9, 9e12, 5e18])
def test_numbers_of_implausible_years_are_refused_or_count_from_a_start(tmp_path, values):
    """No drive is silently put into the year 2128 or 2255."""
    try:
        drive = drive_of(tmp_path, time=values + np.arange(N))
    except ReadError:
        return
    said = " ".join(drive.notes)
    assert "from a start" in said or "count" in said


def beside(moments, date, clock="%H%M%S", kind=str, **columns):
    """A table of dates in a column of their own, and times of day."""
    texts = {"date": moments.strftime(date), "time": moments.strftime(clock)}
    cells = {name: values.astype(kind) for name, values in texts.items()}
    n = len(moments)
    return pd.DataFrame({**cells, "lat": LAT[:n], "lon": np.full(n, 8.7), **columns})


@pytest.mark.parametrize("kind", [str, int])
@pytest.mark.parametrize(
    ("date", "order"),
    [("%d%m%y", "dmy"), ("%y%m%d", "ymd"), ("%m%d%y", "mdy"), ("%d/%m/%y", "dmy"),
     ("%y-%m-%d", "ymd"), ("%d%m%Y", "dmy")],
)  # fmt: skip
def test_dates_of_six_digits_are_read_in_the_order_that_is_told(tmp_path, date, order, kind):
    if kind is int and not date.replace("%", "").isalpha():
        return
    moments = pd.date_range("2026-06-01 07:46:40", periods=N, freq="s")
    table = beside(moments, date, kind=kind)
    path = tmp_path / "x.csv"
    table.to_csv(path, index=False)
    for (drive,) in (drive_from_table(table, dates=order), read_drive(path, dates=order)):
        assert drive.fixes.time == pytest.approx(moments.as_unit("s").asi8)
    for read in (lambda: drive_from_table(table), lambda: read_drive(path)):
        with pytest.raises(ReadError, match=r"column 'date': dates such as '0?1?\d.*ymd"):
            read()


@pytest.mark.parametrize("date", ["%d%m%y", "%y%m%d", "%m%d%y"])
@pytest.mark.parametrize("start", ["2026-05-28", "2026-06-11"])
def test_dates_of_several_days_show_their_order(date, start):
    moments = pd.date_range(f"{start} 07:46:40", periods=N, freq="2h")
    table = beside(moments, date, kind=int)
    (drive,) = drive_from_table(table)
    assert drive.fixes.time == pytest.approx(moments.as_unit("s").asi8)


def days_of(*dates, start="08:00:00"):
    """A table of a minute for each of some dates, at the same time of day."""
    clocks = pd.date_range(f"2026-06-01 {start}", periods=30, freq="s").strftime("%H:%M:%S")
    n = 30 * len(dates)
    cells = {"date": np.repeat(dates, 30), "time": np.tile(clocks, len(dates))}
    return pd.DataFrame({**cells, "lat": 49.4 + METRES * np.arange(n), "lon": 8.7})


@pytest.mark.parametrize("dates", [("01/05/26", "01/06/26"), ("030426", "030526"), (90624, 100624)])
def test_two_days_that_may_be_a_month_apart_are_refused(dates):
    message = rf"column 'date': dates such as '{dates[0]}' do not show"
    with pytest.raises(ReadError, match=message):
        drive_from_table(days_of(*dates))
    (drive,) = drive_from_table(days_of(*dates), dates="dmy")
    assert not drive.notes


def test_an_order_that_is_taken_for_nearness_is_said():
    (drive,) = drive_from_table(days_of("010626", "020626", "030626"))
    assert drive.fixes.time[0] == datetime(2026, 6, 1, 8, tzinfo=UTC).timestamp()
    (note,) = drive.notes
    assert "'date': dates such as '010626'" in note
    assert "order dmy" in note
    assert "2026-06-01; where that is wrong" in note
    (drive,) = drive_from_table(days_of("123024", "123124"))  # no other order can be
    assert not drive.notes


def test_numbers_of_five_digits_that_are_no_other_dates_are_days_since_1970():
    (drive,) = drive_from_table(days_of(20637, 20638))
    assert drive.fixes.time[[0, 30]] == pytest.approx([86_400 * d + 28_800 for d in (20637, 20638)])
    (note,) = drive.notes
    assert "such as '20637'" in note
    assert "taken as days since 1970: 2026-07-03" in note
    for days in ((20526,), (20525, 20526)):  # as well of 2025 or 2026, or of 2002
        with pytest.raises(ReadError, match=f"column 'date': dates such as '{days[0]}' do not"):
            drive_from_table(days_of(*days))


@pytest.mark.parametrize("n", [60, 120])
@pytest.mark.parametrize("step", [0.5, 1, 1.0])
def test_dates_beside_seconds_of_a_drive_need_no_order(n, step):
    columns = {"date": ["010626"] * n, "time": step * np.arange(n)}
    table = pd.DataFrame({**columns, "lat": 49.4 + 1e-4 * np.arange(n), "lon": 8.7})
    (drive,) = drive_from_table(table)
    assert drive.fixes.time == pytest.approx(step * np.arange(n))
    assert any("'date' not used: column 'time' holds numbers" in n for n in drive.notes)


def test_a_day_that_can_be_in_one_order_alone_needs_no_word():
    moments = pd.date_range("1999-12-31 07:46:40", periods=N, freq="s")
    for date in ("%d%m%y", "%y%m%d", "%m%d%y"):
        (drive,) = drive_from_table(beside(moments, date))
        assert drive.fixes.time == pytest.approx(moments.as_unit("s").asi8)
    table = beside(moments, "%d%m%y").assign(date=["000000", *["311299"] * (N - 1)])
    (drive,) = drive_from_table(table)  # no date before the first fix
    assert drive.skipped == {"unparsable time": 1}


def test_numbers_of_the_first_hour_have_fewer_digits():
    moments = pd.date_range("2026-06-01 00:00:31", periods=N, freq="10s")
    table = beside(moments, "%Y%m%d", kind=int)
    table["time"] = table.time.astype(float)
    table.loc[:4, "time"] = np.nan
    (drive,) = drive_from_table(table)
    assert drive.fixes.time == pytest.approx(moments.as_unit("s").asi8[5:])
    assert drive.skipped == {"no time": 5}


def test_a_date_that_is_not_used_is_said():
    table = beside(MOMENTS, "day %d", "%H:%M:%S")
    (drive,) = drive_from_table(table)
    assert any("'date' not used: it holds no dates" in n and "'day 28'" in n for n in drive.notes)
    table = beside(MOMENTS, "%Y%m%d").assign(time=81_000.0 + 3.0 * np.arange(N))
    (drive,) = drive_from_table(table)
    assert any("'date' not used: column 'time' holds numbers" in n for n in drive.notes)
    table = beside(MOMENTS, "%d%m%y").assign(time=T0 + np.arange(N))
    (drive,) = drive_from_table(table)  # a whole time needs no date
    assert drive.fixes.time[0] == T0
    assert not drive.notes


def test_days_in_a_column_of_their_own_keep_rows_apart_where_trips_are_cut():
    days = [pd.date_range(f"2026-06-0{k} 07:00:00", periods=30, freq="s") for k in (1, 2)]
    moments = days[0].append(days[1])
    for clock, kind in (("%H%M%S", int), ("%H:%M:%S", str)):
        table = pa.Table.from_pandas(beside(moments, "%Y%m%d", clock, kind))
        ordered, parts = split_trips(table, 300.0)
        assert [(part.low, part.high) for part in parts] == [(0, 30), (30, 60)]
        assert ordered.equals(table)


@pytest.mark.parametrize(
    ("start", "step"),
    [("07:46:40", 1), ("07:46:40", 0.5), ("00:58:10", 10), ("23:59:30", 1), ("07:46:40", 60),
     ("11:02:13", 45)],
)  # fmt: skip
def test_numbers_whose_seconds_go_up_to_59_are_times_of_day(start, step):
    moments = pd.date_range(f"2026-06-01 {start}", periods=N, freq=f"{step}s")
    time = moments.strftime("%H%M%S").astype(float) + moments.microsecond / 1e6
    table = pd.DataFrame({"time": time, "lat": LAT, "lon": 8.7})
    (drive,) = drive_from_table(table)
    assert np.diff(drive.fixes.time) == pytest.approx(np.full(N - 1, step))
    assert any("no date beside the times of day" in note for note in drive.notes)


@pytest.mark.parametrize("step", [1.0, 5.0, 10.0, 25.0, 30.0, 50.0, 60.0, 100.0, 0.01])
@pytest.mark.parametrize("start", [0.0, 5.0, 130.0, 3459.0])
def test_numbers_that_count_on_beyond_59_are_no_times_of_day(start, step):
    assert not are_clocks(start + step * np.arange(40))


def test_even_numbers_without_a_full_minute_or_hour_are_no_times_of_day():
    for n in (10, 59):
        assert not are_clocks(20_000.0 + 100.0 * np.arange(n))
    clocks = pd.date_range("2026-06-01 02:30:00", periods=59, freq="min").strftime("%H%M%S")
    assert are_clocks(clocks.astype(float).to_numpy())


def test_a_zero_among_ticks_is_no_time():
    for start in (621_355_968_000_000_000, 116_444_736_000_000_000):  # of .NET and of Windows
        ticks = MOMENTS.as_unit("ns").asi8 // 100 + start
        ticks[0] = 0
        (drive,) = drive_from_table({"time": ticks, "lat": LAT, "lon": [8.7] * N})
        assert drive.fixes.time == pytest.approx(T0 + np.arange(1, N), abs=1e-4)
        assert drive.skipped == {"no time": 1}


def test_ticks_of_100_ns_are_read_and_said(tmp_path):
    ticks = MOMENTS.as_unit("ns").asi8 // 100
    for start in (621_355_968_000_000_000, 116_444_736_000_000_000):  # of .NET and of Windows
        drive = drive_of(tmp_path, time=ticks + start)
        assert drive.fixes.time == pytest.approx(T0 + np.arange(N), abs=1e-4)
        assert any("ticks of 100 ns" in note for note in drive.notes)
        for unit in ("s", "ms"):
            mixed = np.where(np.arange(N) < 30, ticks + start, MOMENTS.as_unit(unit).asi8)
            (drive,) = drive_from_table({"time": mixed, "lat": LAT, "lon": [8.7] * N})
            assert drive.fixes.time == pytest.approx(T0 + np.arange(N), abs=1e-4)
    (drive,) = drive_from_table({"time": 1e9 * (T0 + np.arange(N)), "lat": LAT, "lon": [8.7] * N})
    assert not drive.notes


@pytest.mark.parametrize(("since", "year"), [(-978_307_200.0, "1995"), (2_208_988_800.0, "2096")])
@pytest.mark.parametrize("form", [float, "datetime64[s]"])
def test_times_of_unlikely_years_are_said(since, year, form):
    time = (T0 + since + np.arange(N)).astype(form)
    (drive,) = drive_from_table({"time": time, "lat": LAT, "lon": [8.7] * N})
    assert any(f"times in column 'time' are of {year}; is that right?" in n for n in drive.notes)


def test_seconds_of_a_week_are_said_to_count_from_no_known_start():
    for first, said in ((114_418.0, True), (80_000.0, False), (0.0, False)):
        (drive,) = drive_from_table({"time": first + np.arange(N), "lat": LAT, "lon": [8.7] * N})
        assert drive.fixes.time[0] == first
        told = [note for note in drive.notes if "1.3 days before the first; 1970-01-01" in note]
        assert len(told) == said


def test_dates_without_a_time_of_day_are_refused(tmp_path):
    with pytest.raises(ReadError, match="no time that can be understood, such as '2026-03-28'"):
        drive_of(tmp_path, time=MOMENTS.strftime("%Y-%m-%d"))


@given(st.integers(1980, 2099), st.integers(-1, 14), st.integers(-1, 33))
def test_days_are_those_of_the_calendar(year, month, day):
    found = day_of(np.array([float(year)]), np.array([float(month)]), np.array([float(day)]))[0]
    try:
        expected = (datetime(year, month, day) - datetime(1970, 1, 1)).days
    except ValueError:
        assert np.isnan(found)
    else:
        assert found == expected


def test_31_february_in_nmea_is_no_date(put, nmea):
    good = b"".join(nmea.burst(clock=f"08000{k}.00", lat=49.4 + 1e-4 * k) for k in range(5))
    (drive,) = read_drive(put("a.nmea", good.replace(b"", b"")))
    dated = drive.fixes.time
    bad = nmea.burst(clock="080005.00", date="310226", lat=49.4005)
    (drive,) = read_drive(put("b.nmea", good + bad))
    assert drive.fixes.time[:5] == pytest.approx(dated)
    assert drive.fixes.time[5] == pytest.approx(dated[-1] + 1.0)
    (drive,) = read_drive(put("c.nmea", bad))
    assert any("no date in the log" in note for note in drive.notes)


def test_years_that_no_calendar_has_are_no_error():
    assert [year_of(s) for s in (1.7e9, 4e11, -1e11)] == [2023, 14645, -1199]
    assert year_of(1e300) > 9999
