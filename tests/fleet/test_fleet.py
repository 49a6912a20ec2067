"""Files in, a folder out: the same answers however rows come, and after any end."""

import json
import os
import random
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import duckdb
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv
import pyarrow.feather as feather
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

import whichroad
from fleet.conftest import grid_map, trip
from whichroad.batch import match_many
from whichroad.cli import app
from whichroad.errors import DriveError, ReadError, SettingError, WriteError
from whichroad.fleet import run_fleet
from whichroad.fleet.staging import _run
from whichroad.readers import many_trips
from whichroad.tables.schema import DRIVES, PATH, SLIM


def rows_of(folder: Path, name: str) -> pa.Table:
    """A table of a run, by trip."""
    table = pq.read_table(folder / name)
    keys = [(n, "ascending") for n in ("drive_id", "seq", "time") if n in table.column_names]
    return table.sort_by(keys).combine_chunks()


def same(folder: Path, tables: whichroad.batch.Tables, points: str | None = None) -> None:
    """Assert that a run has the rows of `match_many`."""
    for name, usual in (("path", tables.path), ("drives", tables.drives)):
        keys = [(n, "ascending") for n in ("drive_id", "seq") if n in usual.column_names]
        assert rows_of(folder, name).to_pylist() == usual.sort_by(keys).to_pylist()
    if points:
        found = rows_of(folder, "points")
        usual = tables.points.sort_by([("drive_id", "ascending"), ("time", "ascending")])
        assert found.select(SLIM.names).to_pylist() == usual.select(SLIM.names).to_pylist()


@pytest.fixture(scope="module")
def usual(town, table):
    return match_many(table, town)


def test_a_fleet_hears_sensors_and_tells_places(tmp_path, town, table):
    rows = table.slice(0, 400).append_column("satellites", pa.array([8.0] * 400))
    pq.write_table(rows, tmp_path / "trips.parquet")
    places = tmp_path / "marks.csv"
    places.write_text(f"id,lat,lon\nmark,{rows['lat'][40]},{rows['lon'][40]}\n")
    sky, out = [whichroad.sensors.Sky()], tmp_path / "out"
    options = {"trip_id": "trip_id", "workers": 1, "sensors": sky, "places": places}
    run_fleet(tmp_path / "trips.parquet", town, out, **options)
    usual = match_many(rows, town, drive_id="trip_id", sensors=sky, places=places)
    same(out, usual)
    for name in ("ahead", "nearby"):
        assert len(getattr(usual, name))
        assert rows_of(out, name).to_pylist() == getattr(usual, name).to_pylist()
    notes = [note for row in rows_of(out, "drives")["notes"].to_pylist() for note in row]
    assert not any("not heard" in note for note in notes)
    with pytest.raises(WriteError, match="places"):
        run_fleet(tmp_path / "trips.parquet", town, out, resume=True, **options | {"places": None})
    with pytest.raises(ReadError, match="does not exist"):
        run_fleet(tmp_path / "trips.parquet", town, tmp_path / "b", places="nowhere.csv")


def test_rows_in_any_order_give_what_rows_in_order_give(tmp_path, town, table, shuffled, usual):
    pq.write_table(shuffled, tmp_path / "any.parquet")
    pq.write_table(table, tmp_path / "sorted.parquet", row_group_size=700)
    options = {"trip_id": "trip_id", "workers": 1, "unit_rows": 500, "points": "slim"}
    run_fleet(tmp_path / "any.parquet", town, tmp_path / "a", **options)
    done = run_fleet(tmp_path / "sorted.parquet", town, tmp_path / "b", order="sorted", **options)
    assert done.units > 4
    assert done.done.rows == table.num_rows
    same(tmp_path / "a", usual, "slim")
    same(tmp_path / "b", usual, "slim")
    assert not list(tmp_path.glob("*/.work"))


def test_processes_give_what_one_gives(tmp_path, town, table, usual):
    pq.write_table(table, tmp_path / "t.parquet")
    told = []
    done = run_fleet(
        tmp_path / "t.parquet", town, tmp_path / "out", workers=2, unit_rows=400, points="all",
        progress=told.append,
    )  # fmt: skip
    same(tmp_path / "out", usual, "all")
    assert len(told) == done.units
    assert told[-1].done.rows == told[-1].rows == table.num_rows


@pytest.mark.parametrize("order", ["any", "sorted"])
def test_all_units_of_work_have_the_unit_of_speed_that_the_first_trips_tell(tmp_path, town, order):
    trips = [trip(f"car {i:02}", i, 1.6e9 + 50 * i, i).slice(0, 80 if i < 2 else 9)
             for i in range(20)]  # fmt: skip
    table = pa.concat_tables(trips)
    table = table.append_column("speed", pa.array(np.full(len(table), 43.2)))
    pq.write_table(table, tmp_path / "t.parquet")
    run_fleet(
        tmp_path / "t.parquet", town, tmp_path / "out", workers=2, unit_rows=40, order=order,
        points="all",
    )  # fmt: skip
    usual = match_many(table, town)
    assert usual.drives["notes"].to_pylist() == [
        ["column 'speed' taken in km/h, which fits the places"]
    ] * len(trips)
    same(tmp_path / "out", usual, "all")


def test_trips_in_the_order_of_time_of_more_vehicles_than_a_stream_holds(
    tmp_path, town, monkeypatch
):
    monkeypatch.setattr(many_trips, "APART", 5000)
    many = 6000
    one = trip("x", 2)
    names = np.tile([f"v{i:05}" for i in range(many)], 2)
    at = np.repeat([10, 14], many)  # all vehicles at one moment, and then at the next
    table = pa.table(
        {
            "trip_id": names,
            "time": one["time"].to_numpy()[at],
            "lat": one["lat"].to_numpy()[at],
            "lon": one["lon"].to_numpy()[at],
        }
    )
    pq.write_table(table, tmp_path / "t.parquet", row_group_size=1000)
    done = run_fleet(tmp_path / "t.parquet", town, tmp_path / "out", workers=1)
    assert done.done.trips == done.done.answered == many
    assert done.done.fixes == 2 * many
    with pytest.raises(ReadError, match="comes again after others"):
        run_fleet(tmp_path / "t.parquet", town, tmp_path / "o", order="sorted", workers=1)
    with pytest.raises(ReadError, match="sort them by trip and time"):
        list(whichroad.fleet.match_batches(tmp_path / "t.parquet", town))


@pytest.mark.parametrize("kind", ["csv", "csv of numbers", "arrow", "hive", "geo", "query", "odd"])
def test_other_files_and_queries_are_read(tmp_path, town, table, shuffled, usual, kind):
    source, trip_id = tmp_path / "in", "drive_id"
    source.mkdir()
    stamps = pa.array(shuffled["time"].to_numpy() * 1e6).cast(pa.int64()).cast(pa.timestamp("us"))
    if kind == "csv":
        text = stamps.cast(pa.string())
        pacsv.write_csv(shuffled.set_column(1, "time", text), source / "a.csv")
    elif kind == "csv of numbers":
        pacsv.write_csv(shuffled, source / "a.csv")
    elif kind == "arrow":
        feather.write_feather(shuffled, source / "a.arrow")
    elif kind == "hive":
        for day in range(3):
            (source / f"day={day}").mkdir()
            pq.write_table(shuffled.slice(day * 1100, 1100), source / f"day={day}" / "x.parquet")
        (source / "_SUCCESS").write_text("")
    elif kind == "geo":
        from whichroad.tables.schema import point_wkb

        wkb = point_wkb(shuffled["lon"].combine_chunks(), shuffled["lat"].combine_chunks())
        plain = shuffled.drop_columns(["lat", "lon"]).append_column("geometry", wkb)
        pq.write_table(plain, source / "a.geoparquet")
    elif kind == "odd":
        trip_id = "Fahrt nr. 1"
        pq.write_table(
            shuffled.rename_columns([trip_id, "time", "lat", "lon"]), source / "it's.parquet"
        )
    else:
        pq.write_table(shuffled, source / "a.parquet")
    what = source if kind != "query" else f"SELECT * FROM '{source}/a.parquet' WHERE lat > 0;"
    run_fleet(what, town, tmp_path / "out", workers=1, trip_id=trip_id)
    drives = rows_of(tmp_path / "out", "drives")
    assert drives["drive_id"].to_pylist() == sorted(usual.drives["drive_id"].to_pylist())
    assert rows_of(tmp_path / "out", "path")["edge_id"].to_pylist() == (
        usual.path.sort_by([("drive_id", "ascending"), ("seq", "ascending")])["edge_id"].to_pylist()
    )


@pytest.mark.parametrize("suffix", ["parquet", "arrow"])
def test_uuids_name_trips_by_their_text(tmp_path, town, table, usual, suffix):
    texts = [str(uuid.uuid5(uuid.NAMESPACE_DNS, name)) for name in table["trip_id"].to_pylist()]
    stored = pa.array([uuid.UUID(text).bytes for text in texts], pa.binary(16))
    named = table.set_column(0, "trip_id", pa.ExtensionArray.from_storage(pa.uuid(), stored))
    write = pq.write_table if suffix == "parquet" else feather.write_feather
    write(named, tmp_path / f"trips.{suffix}")
    run_fleet(tmp_path / f"trips.{suffix}", town, tmp_path / "out", workers=1)
    drives = rows_of(tmp_path / "out", "drives")
    assert drives["drive_id"].to_pylist() == sorted(set(texts))
    assert sorted(drives["epochs"].to_pylist()) == sorted(usual.drives["epochs"].to_pylist())


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_the_column_that_is_named_names_trips_in_any_case(tmp_path, town, table, suffix):
    named = table.append_column("VEHICLE", pa.array(["bus"] * len(table)))
    write = pacsv.write_csv if suffix == "csv" else pq.write_table
    write(named, tmp_path / f"trips.{suffix}")
    for i, own in enumerate(({"trip_id": "vehicle"}, {"columns": {"trip_id": "VEHICLE"}})):
        run_fleet(tmp_path / f"trips.{suffix}", town, tmp_path / f"out {i}", workers=1, **own)
        assert rows_of(tmp_path / f"out {i}", "drives")["drive_id"].to_pylist() == ["bus"]


def test_poisoned_trips_are_listed_and_the_others_are_as_they_were(tmp_path, town, table, usual):
    far = trip("far", 0)
    far = far.set_column(2, "lat", pa.array(np.full(len(far), -33.0)))
    blank = trip("blank", 1)
    blank = blank.set_column(2, "lat", pa.array(np.full(len(blank), np.nan)))
    nameless = trip(None, 2)
    swapped = trip("swapped", 3).rename_columns(["trip_id", "time", "lon", "lat"])
    still = trip("still", 4)
    still = still.set_column(1, "time", pa.array(np.full(len(still), 1.6e9)))
    half = trip("half", 4)  # most of its rows are used
    half = half.set_column(2, "lat", pa.array([np.nan] * 30 + half["lat"].to_pylist()[30:]))
    poison = [far, blank, nameless, swapped.select(["trip_id", "time", "lat", "lon"]), still, half]
    pq.write_table(pa.concat_tables([table, *poison]), tmp_path / "t.parquet")
    ran = CliRunner().invoke(
        app, ["fleet", str(tmp_path / "t.parquet"), "--map", str(town), "-o", str(tmp_path / "out"),
              "--workers", "1"]
    )  # fmt: skip
    assert ran.exit_code == 0, ran.output
    bad = pq.read_table(tmp_path / "out" / "bad_trips.parquet").to_pylist()
    assert {row["drive_id"] for row in bad} == {"far", "blank", "", "swapped", "still"}
    assert all(row["reason"] for row in bad)
    (one,) = (row for row in bad if row["answered"])
    assert one["drive_id"] == "still"
    assert one["reason"] == "78 rows skipped: repeated time; the answer is of 1 fix"
    assert "5 bad trips listed in" in ran.output
    assert "no answer: " in ran.output
    assert "km of a road; were latitude and longitude swapped?" in ran.output
    good = rows_of(tmp_path / "out", "path")
    good = good.filter(pc.invert(pc.is_in(good["drive_id"], pa.array(["still", "half"]))))
    keys = [("drive_id", "ascending"), ("seq", "ascending")]
    assert good.to_pylist() == usual.path.sort_by(keys).to_pylist()


def test_what_comes_out_has_one_schema_and_names_its_map(tmp_path, town, table):
    pq.write_table(table, tmp_path / "t.parquet")
    run_fleet(tmp_path / "t.parquet", town, tmp_path / "out", workers=1, unit_rows=900)
    files = sorted((tmp_path / "out").rglob("part-*.parquet"))
    assert len(files) > 4
    for file in files:
        schema = pq.read_schema(file)
        assert schema.equals(PATH if file.parent.name == "path" else DRIVES)
        assert schema.metadata[b"whichroad_schema"] == b"1"
        assert whichroad.map_of(file)["fingerprint"] == whichroad.RoadMap.open(town).fingerprint
    assert json.loads(pq.read_schema(files[-1]).metadata[b"geo"])["primary_column"] == "geometry"
    assert whichroad.map_of(tmp_path / "out") == whichroad.map_of(files[0])


RUNS = """
import os
import sys
import duckdb, pandas, pyarrow.dataset, pyproj
import whichroad.fleet.work
from whichroad.fleet import run_fleet
from whichroad.fleet.staging import _run

for workers in sys.stdin:
    run = os.fork()
    if not run:
        how = {"points": "all", "unit_rows": 79, "workers": int(workers), "resume": True}
        run_fleet(*sys.argv[1:], **how)
        os._exit(0)
    print(run, flush=True)
    os.waitpid(run, 0)
    print("ended", flush=True)
"""  # each in a process of its own, which need not import again


def is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_and_gives_the_same_bytes(tmp_path, town, table):
    """By itself and with workers in turn."""
    source, cut = tmp_path / "t.parquet", tmp_path / "cut"
    pq.write_table(table, source)
    chance = random.Random(5)
    run_fleet(source, town, tmp_path / "whole", workers=2, points="all", unit_rows=79)
    killed, before = 0, []
    with subprocess.Popen(
        [sys.executable, "-c", RUNS, source, town, cut], text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    ) as runs:  # fmt: skip
        for turn in range(6):
            print(1 + turn % 2, file=runs.stdin, flush=True)
            process = int(runs.stdout.readline())
            drives = cut / "drives"
            enough = len(list(drives.glob("part-*"))) + chance.randint(0, 2)
            while is_alive(process) and len(list(drives.glob("part-*"))) < enough:
                time.sleep(0.002)
            time.sleep(chance.uniform(0.0, 0.2 if enough else 1.0))
            if is_alive(process):
                killed += 1
                os.kill(process, signal.SIGKILL)
            assert runs.stdout.readline() == "ended\n"
            before.append(len(list(drives.glob("part-*"))))
        runs.stdin.close()
    line = ["fleet", str(source), "--map", str(town), "-o", str(cut), "--points", "all"]
    ran = CliRunner().invoke(app, [*line, "--workers", "2", "--resume"])
    assert ran.exit_code == 0, ran.output
    assert killed
    assert len(set(before)) > 2  # several ends came between units
    files = sorted(p.relative_to(tmp_path / "whole") for p in (tmp_path / "whole").rglob("*.p*"))
    assert len(files) > 30
    for file in files:
        assert (cut / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()
    left = [p for p in cut.rglob("*") if p.is_file()]
    assert len([p for p in left if not p.name.startswith(".")]) == len(files) + 1  # the manifest


def test_files_that_came_went_or_are_others_are_named(tmp_path, town, table):
    lake = tmp_path / "a lake whose path is longer than sixty characters of a message"
    lake.mkdir()
    for k in range(9):
        pq.write_table(table.slice(79 * k, 79), lake / f"{k}.parquet")
    run_fleet(lake, town, tmp_path / "out", workers=1)
    pq.write_table(table.slice(0, 10), lake / "3.parquet")
    (lake / "4.parquet").unlink()
    pq.write_table(table.slice(79 * 9, 79), lake / "9.parquet")
    said = r"added: \S.*/9\.parquet; removed: \S.*/4\.parquet; changed: \S.*/3\.parquet\); the"
    with pytest.raises(WriteError, match=said):
        run_fleet(lake, town, tmp_path / "out", resume=True)
    for k in range(10):
        pq.write_table(table.slice(0, 5), lake / f"{k}.parquet")
    with pytest.raises(WriteError, match=r"/4\.parquet, and 4 more\)"):
        run_fleet(lake, town, tmp_path / "out", resume=True)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_disk_that_is_full_is_said_to_be(tmp_path):
    with pytest.raises(
        WriteError, match=r"the disk is full .*No space left.*choose another folder"
    ):
        _run(duckdb.connect(), "COPY (SELECT 1) TO '/dev/full' (FORMAT parquet)", tmp_path)
    config = {"memory_limit": "32MB", "max_temp_directory_size": "1MB", "threads": 1}
    con = duckdb.connect(config={**config, "temp_directory": str(tmp_path / "spill")})
    rows = "SELECT random() AS a, repeat('x', 99) || random() AS b FROM range(1000000)"
    with pytest.raises(WriteError, match=f"{tmp_path}: the disk is full"):
        _run(con, f"COPY (SELECT * FROM ({rows}) ORDER BY a) TO '{tmp_path}/t.parquet'", tmp_path)


def test_a_name_that_is_used_again_after_days_is_noted(tmp_path, town):
    def notes(later: float, **options) -> list[list[str]]:
        names = ["a", "b", "c"]
        rows = [trip(name, k, 1.6e9 + 7 * k, k) for k, name in enumerate(names)]
        rows.append(trip("b", 3, 1.6e9 + later, 3))
        return match_many(pa.concat_tables(rows), town, **options).drives["notes"].to_pylist()

    said = "rows of several trips may bear this name; --split (split=) cuts them"
    assert notes(20 * 3600.0) == [[], [f"pause of 20 h: {said}"], []]
    assert notes(40 * 86_400.0) == [[], [f"pause of 40 days: {said}"], []]
    assert notes(3600.0) == [[], [], []]
    assert notes(40 * 86_400.0, split="5min") == [[], [], [], []]


def test_a_run_goes_on_only_as_it_began(tmp_path, town, table):
    pq.write_table(table, tmp_path / "t.parquet")
    run_fleet(tmp_path / "t.parquet", town, tmp_path / "out", workers=1, unit_rows=900)
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "out").rglob("part-*")}
    with pytest.raises(WriteError, match="holds a run already"):
        run_fleet(tmp_path / "t.parquet", town, tmp_path / "out")
    with pytest.raises(WriteError, match="other points"):
        run_fleet(tmp_path / "t.parquet", town, tmp_path / "out", points="slim", resume=True)
    car = whichroad.Vehicle(driving_side="left")
    with pytest.raises(WriteError, match="other vehicle"):
        run_fleet(tmp_path / "t.parquet", town, tmp_path / "out", vehicle=car, resume=True)
    assert not (tmp_path / "out" / "points").exists()  # what is refused leaves nothing
    (tmp_path / "out" / "drives" / "part-00001.parquet").unlink()
    done = run_fleet(tmp_path / "t.parquet", town, tmp_path / "out", workers=1, resume=True)
    assert done.units_before == done.units - 1
    changed = {p.name for p, when in before.items() if p.stat().st_mtime_ns != when}
    assert changed == {"part-00001.parquet"}
    roads = grid_map()
    roads.arrays.edges.speed[0] += 1.0
    roads.save(tmp_path / "other.map")
    with pytest.raises(WriteError, match="other map"):
        run_fleet(tmp_path / "t.parquet", tmp_path / "other.map", tmp_path / "out", resume=True)
    pq.write_table(table.slice(0, 100), tmp_path / "t.parquet")
    with pytest.raises(WriteError, match="other inputs"):
        run_fleet(tmp_path / "t.parquet", town, tmp_path / "out", resume=True)


def test_what_cannot_be_run_is_refused_with_what_to_do(tmp_path, town, table, monkeypatch):
    pq.write_table(table, tmp_path / "t.parquet")
    for options, words in (
        ({"order": "yes"}, "any, sorted"),
        ({"points": "few"}, "none, slim, all"),
        ({"workers": 0}, "at least 1"),
        ({"split": "soon"}, "5min"),
        ({"memory": "much"}, "256MB"),
    ):
        with pytest.raises(SettingError, match=words):
            run_fleet(tmp_path / "t.parquet", town, tmp_path / "o", **options)
    with pytest.raises(ReadError, match="not there"):
        run_fleet(tmp_path / "none.parquet", town, tmp_path / "o")
    with pytest.raises(ReadError, match="DuckDB cannot read"):
        run_fleet("SELECT nonsense", town, tmp_path / "o")
    with pytest.raises(ReadError, match=r"for example drive_id, trip_id, .*--trip-id"):
        run_fleet(tmp_path / "t.parquet", town, tmp_path / "o", trip_id="car")
    monkeypatch.setitem(sys.modules, "duckdb", None)
    with pytest.raises(SettingError, match=r"whichroad\[fleet\]"):
        run_fleet(tmp_path / "t.parquet", town, tmp_path / "o")
    away = table.set_column(2, "lat", pa.array(np.full(len(table), -33.0)))
    pq.write_table(away, tmp_path / "t.parquet")
    with pytest.raises(DriveError, match="none of 40 trips"):
        run_fleet(tmp_path / "t.parquet", town, tmp_path / "p", order="sorted", workers=1)


def test_all_files_that_cannot_be_read_are_named_at_once(tmp_path, town, table):
    lake = tmp_path / "lake"
    lake.mkdir()
    pq.write_table(table.slice(0, 400), lake / "good.parquet")
    for name in ("bad", "worse"):
        (lake / f"{name}.parquet").write_bytes((lake / "good.parquet").read_bytes()[:500])
    (lake / "empty.arrow").write_bytes(b"")
    named = r"3 files: .*bad\.parquet: cannot .*worse\.parquet: cannot .*empty\.arrow: cannot"
    for order in ("any", "sorted"):
        with pytest.raises(ReadError, match=named):
            run_fleet(lake, town, tmp_path / order, order=order)
    for path in lake.iterdir():
        path.unlink()
    pacsv.write_csv(table.slice(0, 400), lake / "good.csv")
    for name in ("bad", "worse"):
        (lake / f"{name}.csv").write_bytes(bytes(range(128, 256)) * 40)
    with pytest.raises(ReadError, match=r"2 files: .*bad\.csv: cannot .*worse\.csv: cannot"):
        run_fleet(lake, town, tmp_path / "csv")


def test_the_process_that_hands_out_work_does_without_pandas(tmp_path, town, table):
    pq.write_table(table.slice(0, 79), tmp_path / "t.parquet")
    code = (
        "import sys, whichroad.fleet.run as r\n"
        "r._all = lambda *a: sys.exit(print('pandas' in sys.modules))\n"
        "r.run_fleet(*sys.argv[1:], workers=2, order='sorted')"
    )
    line = [sys.executable, "-c", code, str(tmp_path / "t.parquet"), str(town), str(tmp_path / "o")]
    assert subprocess.run(line, capture_output=True, text=True).stdout.strip() == "False"
