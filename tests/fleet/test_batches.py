"""What engines call on a partition: pure, picklable, with schemas known before."""

import pickle
import subprocess
import sys
from functools import partial

import numpy as np
import pyarrow as pa
import pytest

import whichroad
from fleet.conftest import trip
from whichroad.batch import match_many, match_stream, trips
from whichroad.errors import ReadError, SettingError
from whichroad.fleet import SCHEMAS, match_batches
from whichroad.readers import many_trips


@pytest.mark.parametrize("give", sorted(SCHEMAS))
def test_a_partition_gives_the_rows_of_the_whole_table(town, table, give):
    usual = match_many(table, town)
    wanted = usual.points.select(SCHEMAS[give].names) if give == "slim" else None
    wanted = wanted if give == "slim" else getattr(usual, give)
    for size in (50, 5000):
        batches = table.to_batches(max_chunksize=size)
        found = pa.Table.from_batches(match_batches(iter(batches), town, give=give))
        sorted_ = match_batches(iter(batches), town, give=give, ordered=True)
        assert pa.Table.from_batches(sorted_).equals(found)
        assert found.schema.equals(SCHEMAS[give])
        assert found.equals(wanted)


def test_only_what_is_asked_for_is_made(town, table, monkeypatch):
    def never(*args, **more):
        raise AssertionError("points were made")

    monkeypatch.setattr(trips, "points_table", never)
    assert sum(batch.num_rows for batch in match_batches(table, town, give="path"))
    assert sum(b.num_rows for b in match_batches(table, town, give="drives")) == 40


def test_it_can_be_pickled_and_runs_in_another_process(town, table, tmp_path):
    call = partial(match_batches, map=str(town), give="drives", vehicle=whichroad.Vehicle())
    with (tmp_path / "call").open("wb") as file:
        pickle.dump((call, table.slice(0, 200)), file)
    code = (
        "import pickle, sys\n"
        "call, table = pickle.load(open(sys.argv[1], 'rb'))\n"
        "print(sum(batch.num_rows for batch in call(table)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "call")], capture_output=True, text=True
    )
    assert done.stdout.strip() == "3", done.stderr


def test_what_is_not_given_is_refused(town, table):
    with pytest.raises(SettingError, match="path, drives"):
        list(match_batches(table, town, give="lines"))


def test_a_trip_that_comes_again_is_refused_by_engines_and_told_in_a_stream(
    town, table, monkeypatch
):
    monkeypatch.setattr(many_trips, "APART", 100)
    late = pa.concat_tables([table.slice(0, 40), table.slice(79, 300), table.slice(40, 39)])
    batches = late.to_batches(max_chunksize=60)
    with pytest.raises(ReadError, match="'car 00' comes again"):
        list(match_batches(iter(batches), town))
    with pytest.raises(ReadError, match="'car 00' comes again after others"):
        list(match_batches(iter(table.to_batches(max_chunksize=7) * 2), town, ordered=True))
    drives = pa.concat_tables([t.drives for t in match_stream(iter(batches), town, threads=1)])
    names = drives["drive_id"].to_pylist()
    assert names.count("car 00") == 2
    notes = [row["notes"] for row in drives.to_pylist() if row["drive_id"] == "car 00"]
    assert notes[0] == []
    assert "the same name" in notes[1][0]
    assert all(not row["notes"] for row in drives.to_pylist() if row["drive_id"] != "car 00")


def test_a_long_trip_stops_none_of_its_neighbours(town, table):
    n = 100_000
    one = trip("long", 1)
    at = np.minimum(np.arange(n) * len(one) // n, len(one) - 1)
    long = pa.table(
        {
            "trip_id": ["long"] * n,
            "time": 1.5e9 + np.arange(n),
            "lat": one["lat"].to_numpy()[at],
            "lon": one["lon"].to_numpy()[at],
        }
    )
    rows = pa.concat_tables([table.slice(0, 79), long, table.slice(79)])
    drives = pa.Table.from_batches(
        match_batches(iter(rows.to_batches(max_chunksize=10_000)), town, give="drives")
    )
    usual = {row["drive_id"]: row for row in match_many(table, town).drives.to_pylist()}
    for row in drives.to_pylist():
        if row["drive_id"] == "long":
            assert row["fixes"] == n
        else:
            assert row == usual[row["drive_id"]]
    assert drives.num_rows == 41
