"""A table of many trips at the command line, and tables that grow in their file."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from whichroad.cli import app
from whichroad.errors import DriveError, ReadError, WriteError
from whichroad.geodesy.plane import Plane
from whichroad.writers.stream import growing

PLANE = Plane(49.4, 8.7)


def run(*args: object):
    return CliRunner().invoke(app, [str(a) for a in args])


@pytest.fixture
def town(tmp_path: Path) -> Path:
    lat, lon = PLANE.to_geodetic(np.array([0.0, 500.0, 1000.0]), np.zeros(3))
    (a, b, c) = ([float(x), float(y)] for x, y in zip(lon, lat, strict=True))
    roads = [
        {
            "type": "Feature",
            "properties": {"id": i},
            "geometry": {"type": "LineString", "coordinates": line},
        }
        for i, line in enumerate(([a, b], [b, c]))
    ]
    path = tmp_path / "town.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": roads}))
    return path


def trips(tmp_path: Path, names: list[str], north: float = 0.0) -> Path:
    n = 20
    lat, lon = PLANE.to_geodetic(np.linspace(50.0, 900.0, n), np.full(n, north))
    one = {"time": 1.6e9 + np.arange(n) * 4.0, "lat": lat, "lon": lon}
    tables = [pa.table({"trip_id": [name] * n, **one}) for name in names]
    path = tmp_path / "trips.parquet"
    pq.write_table(pa.concat_tables(tables), path)
    return path


def test_a_table_of_many_trips_is_matched_trip_by_trip(tmp_path, town):
    source = trips(tmp_path, ["a", "b", "c"])
    out, path_out = tmp_path / "points.parquet", tmp_path / "path.csv"
    done = run("match", source, "--map", town, "-o", out, "--path-out", path_out, "--every", 8)
    assert done.exit_code == 0, done.output
    points = pq.read_table(out)
    assert points["drive_id"].to_pylist() == [name for name in "abc" for _ in range(10)]
    assert json.loads(points.schema.metadata[b"geo"])["primary_column"] == "geometry"
    assert path_out.read_text().count("\n") == 1 + 3
    assert "answered               3" in done.output


@pytest.mark.parametrize("names", [["a", "b"], ["a"]])
def test_folders_that_bear_the_names_of_trips_are_a_table_of_them(tmp_path, town, names):
    table = pq.read_table(trips(tmp_path, names))
    pq.write_to_dataset(table, tmp_path / "parts", partition_cols=["trip_id"])
    done = run("match", tmp_path / "parts", "--map", town, "-o", tmp_path / "points.parquet")
    assert done.exit_code == 0, done.output
    found = pq.read_table(tmp_path / "points.parquet")["drive_id"].to_pylist()
    assert found == [name for name in names for _ in range(20)]


def test_what_is_left_out_of_a_folder_is_said(tmp_path, town):
    table, folder = pq.read_table(trips(tmp_path, ["a", "b"])), tmp_path / "parts"
    folder.mkdir()
    for name in "ab":
        pq.write_table(table.filter(pc.field("trip_id") == name), folder / f"{name}.parquet")
    (folder / "c.parquet").write_bytes(b"PAR1")
    (folder / "readme.txt").write_text("hi")
    done = run("match", folder, "--map", town)
    assert done.exit_code == 0, done.output
    assert "skipped: readme.txt: no .parquet file\n" in done.stderr
    assert "skipped: c.parquet: cannot be read (" in done.stderr
    assert "answered               2" in done.output


def test_nothing_answered_is_a_failure_that_says_why(tmp_path, town):
    source = trips(tmp_path, ["a", "b"], north=-90_000.0)
    done = run("match", source, "--map", town)
    assert isinstance(done.exception, DriveError)
    assert "none of 2 trips" in str(done.exception)
    assert "km from the map" in done.stderr


def test_a_table_without_times_is_refused_once_with_all_its_columns(tmp_path, town):
    source = trips(tmp_path, ["a", "b"])
    table = pq.read_table(source).rename_columns(["trip_id", "when", "lat", "lon"])
    pq.write_table(table, source)
    done = run("match", source, "--map", town)
    assert isinstance(done.exception, ReadError)
    assert "no time among the columns (trip_id, when, lat, lon)" in str(done.exception)


def test_why_a_trip_has_no_answer_is_told_with_what_was_skipped(tmp_path, town):
    source = trips(tmp_path, ["a", "b"])
    table = pq.read_table(source)
    nowhere = np.where(np.arange(40) < 20, 0.0, table["lat"].to_numpy())
    zero = np.where(np.arange(40) < 20, 0.0, table["lon"].to_numpy())
    table = table.set_column(2, "lat", pa.array(nowhere)).set_column(3, "lon", pa.array(zero))
    pq.write_table(table, source)
    done = run("match", source, "--map", town)
    assert "no answer: a: it holds neither" in done.output
    assert "skipped: impossible position: 20" in done.output


def test_an_output_that_exists_is_not_replaced(tmp_path, town):
    source = trips(tmp_path, ["a", "b"])
    out = tmp_path / "points.parquet"
    out.write_text("mine")
    assert isinstance(run("match", source, "--map", town, "-o", out).exception, WriteError)
    assert out.read_text() == "mine"


@pytest.mark.parametrize("suffix", [".parquet", ".arrow", ".csv"])
def test_a_table_that_grew_reads_as_the_whole(tmp_path, suffix):
    part = pa.table({"lat": [49.0], "lon": [8.0]})
    path = tmp_path / f"grown{suffix}"
    with growing(path) as write:
        write(part)
        assert not path.exists()
        write(part)
    if suffix == ".parquet":
        assert pq.read_table(path, columns=["lat", "lon"]).equals(pa.concat_tables([part, part]))
    else:
        assert path.stat().st_size > 0


def test_a_table_that_fails_while_it_grows_leaves_nothing(tmp_path):
    def grow() -> None:
        with growing(tmp_path / "grown.parquet") as write:
            write(pa.table({"lat": [49.0], "lon": [8.0]}))
            raise DriveError("stop")

    with pytest.raises(DriveError, match="stop"):
        grow()
    assert not list(tmp_path.iterdir())


def test_own_names_and_local_times_of_a_table_are_said_and_read(tmp_path, town):
    source = trips(tmp_path, ["a", "b"])
    table = pq.read_table(source)
    local = pa.array(table["time"].to_numpy().astype("datetime64[s]"))
    theirs = pa.table({"car": table["trip_id"], "ts": local, "la": table["lat"],
                       "lo": table["lon"], "speed": [99.0] * len(table)})  # fmt: skip
    pq.write_table(theirs, source)
    own = ("--columns", "time=ts,lat=la,lon=lo,drive_id=car")
    done = run("match", source, "--map", town, *own, "-o", tmp_path / "utc.parquet")
    assert done.exit_code == 0, done.output
    assert "times in column 'ts' name no zone and were taken as UTC" in done.stderr
    assert "note: 2 trips: column 'speed'" in done.stderr
    zone = ("--tz", "Europe/Berlin", "-o", tmp_path / "local.parquet")
    done = run("match", source, "--map", town, *own, *zone)
    assert "name no zone" not in done.stderr
    utc, berlin = (pq.read_table(tmp_path / f"{n}.parquet")["time"] for n in ("utc", "local"))
    assert (utc[0].as_py() - berlin[0].as_py()).seconds == 7200


def test_fixes_off_the_map_are_told_of_all_trips_together(tmp_path, town):
    source = trips(tmp_path, ["a", "b"])
    table = pq.read_table(source)
    lat = table["lat"].to_numpy().copy()
    lat[3:6] += 0.05
    pq.write_table(table.set_column(2, "lat", pa.array(lat)), source)
    done = run("match", source, "--map", town)
    assert "note: 3 of 40 fixes (7.5 %) are farther than 1 km" in done.stderr


def test_what_a_table_of_roads_was_read_without_is_said(tmp_path, town):
    roads = json.loads(town.read_text())
    for road in roads["features"]:
        road["properties"]["oneway"] = 2
    town.write_text(json.dumps(roads))
    said = "skipped of the map: one-way numbers of a code that is not known: 2 (2) (all taken as"
    source = trips(tmp_path, ["a", "b"])
    assert said in run("match", source, "--map", town).stderr
    one = tmp_path / "one.csv"
    pq.read_table(trips(tmp_path, ["a"])).drop_columns("trip_id").to_pandas().to_csv(one)
    assert said in run("match", one, "--map", town).stderr
    done = run("fleet", source, "--map", town, "-o", tmp_path / "out", "--workers", 1)
    assert done.exit_code == 0, done.output
    assert said in done.stderr
    compiled = tmp_path / "town.map"
    assert "skipped: one-way numbers" in run("map", "build", town, "-o", compiled).stderr
    assert "of the map" not in run("match", source, "--map", compiled).stderr


def test_the_order_of_dates_of_a_table_of_trips_may_be_said(tmp_path, town):
    source = trips(tmp_path, ["a", "b"])
    table = pq.read_table(source)
    october = 1.6e9 + 20 * 86_400.0  # the 3rd
    moments = pa.array(np.array(table["time"]) + october - 1.6e9, pa.float64())
    moments = moments.cast(pa.int64()).cast(pa.timestamp("s"))
    table = table.set_column(1, "time", pc.strftime(moments, "%m/%d/%Y %H:%M:%S"))
    pq.write_table(table, source)
    refused = run("match", source, "--map", town)
    assert "--dates" in str(refused.exception) + refused.output
    out = tmp_path / "points.parquet"
    done = run("match", source, "--map", town, "-o", out, "--dates", "mdy")
    assert done.exit_code == 0, done.output
    assert pq.read_table(out)["time"][0].as_py().timestamp() == october
