"""Times of a fleet: of an hour that clocks show twice, and in several forms in one column."""

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
