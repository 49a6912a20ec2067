"""Times of a fleet: of an hour that clocks show twice, and in several forms in one column."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from fleet.conftest import trip
from fleet.test_mixed_files import by_fleet, check_same
from whichroad.batch import match_many
from whichroad.readers.clock_change import shown_twice
from whichroad.readers.dates import zone_of

BACK = pd.Timestamp("2026-10-25T01:00:00Z").timestamp()  # the clocks of Berlin go back


def trips(start: float, names=range(8)) -> pd.DataFrame:
    """Trips of 79 s one behind the other, each 7 s later, with times in UTC."""
    rows = [trip(f"car {i:02}", i, start + 7 * i, i) for i in names]
    table = pa.concat_tables(rows).to_pandas()
    return table.assign(time=pd.to_datetime(table["time"], unit="s", utc=True))


def local(table: pd.DataFrame) -> pd.DataFrame:
    """The same on clocks of Berlin."""
    return table.assign(time=table["time"].dt.tz_convert("Europe/Berlin").dt.tz_localize(None))


@pytest.mark.parametrize("kind", ["parquet", "csv"])
def test_trips_while_clocks_go_back_in_the_order_in_which_they_were_driven(tmp_path, town, kind):
    table = trips(BACK - 70.0)
    usual = match_many(table, town).path.to_pandas()
    shown = local(table)
    source = tmp_path / f"t.{kind}"
    shown.to_csv(source, index=False) if kind == "csv" else shown.to_parquet(source)
    check_same(by_fleet(source, town, tmp_path / "out", tz="Europe/Berlin"), usual)


def test_rows_in_no_order_while_clocks_go_back_are_sorted(tmp_path, town):
    """Their order does not tell the hour; all times before the change do not depend on it."""
    table = trips(BACK - 7200.0 - 70.0)  # behind the hour before
    usual = match_many(table, town).path.to_pandas()
    shown = local(table).sample(frac=1.0, random_state=1)
    shown.to_parquet(tmp_path / "t.parquet")
    path = by_fleet(tmp_path / "t.parquet", town, tmp_path / "out", tz="Europe/Berlin")
    check_same(path, usual)


def test_hours_that_clocks_show_twice():
    day = pd.Timestamp("2026-10-25").timestamp()
    berlin = zone_of("Europe/Berlin")
    assert shown_twice(day - 9e4, day + 9e4, berlin) == [(day + 7200.0, day + 10800.0)]
    assert shown_twice(day + 7200.0, day + 7201.0, berlin) == [(day + 7200.0, day + 10800.0)]
    assert not shown_twice(day, day + 7199.0, berlin)
    assert len(shown_twice(day, day + 3.2e8, berlin)) == 11
    half = shown_twice(day - 3e7, day, zone_of("Australia/Lord_Howe"))
    assert [end - begin for begin, end in half] == [1800.0]


FORMS = {
    "zone": "%Y-%m-%dT%H:%M:%SZ",
    "iso": "%Y-%m-%d %H:%M:%S",
    "german": "%d.%m.%Y %H:%M:%S",
}


@pytest.mark.parametrize(
    ("first", "then"),
    [("zone", "iso"), ("iso", "zone"), ("zone", "number"), ("iso", "german"), ("german", "zone")],
)
@pytest.mark.parametrize("files", [1, 2])
def test_another_form_of_time_behind_many_rows_of_csv(tmp_path, town, first, then, files):
    table = trips(1.7e9, range(140))
    assert len(table) == 140 * 79
    usual = match_many(table, town).path.to_pandas()
    last = np.arange(len(table)) >= 131 * 79 + 40  # from the middle of a trip on
    written = table["time"].dt.strftime(FORMS[first])
    later = table["time"].astype("datetime64[s, UTC]")
    other = (
        later.astype("int64").astype(str) if then == "number" else later.dt.strftime(FORMS[then])
    )
    table["time"] = np.where(last, other, written)
    for k, part in enumerate((table[~last], table[last])):
        part.to_csv(tmp_path / f"{k}.csv", index=False)
    if files == 1:
        for old in ("0.csv", "1.csv"):
            (tmp_path / old).unlink()
        table.to_csv(tmp_path / "t.csv", index=False)
    check_same(by_fleet(f"{tmp_path}/*.csv", town, tmp_path / "out"), usual)


def test_a_cell_that_is_no_time_does_not_lose_the_others(tmp_path, town):
    table = trips(1.7e9, range(140))
    usual = match_many(table, town).path.to_pandas()
    table["time"] = table["time"].dt.strftime(FORMS["zone"])
    rows = [table.iloc[[-1]].assign(time=bad) for bad in ("n/a", "2026-13-45 10:00:00")]
    pd.concat([table, *rows]).sample(frac=1.0, random_state=1).to_csv(
        tmp_path / "t.csv", index=False
    )
    check_same(by_fleet(tmp_path / "t.csv", town, tmp_path / "out"), usual)
