"""Own names of columns and a zone: the command and its folder, as `match_many` has them."""

import json
import time

import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.feather as feather
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from fleet.test_fleet import rows_of, same
from whichroad.batch import match_many
from whichroad.cli import app
from whichroad.fleet import run_fleet


@pytest.fixture(scope="module")
def usual(town, table):
    return match_many(table, town)


OWN = {"time": "Zeit", "lat": "Breite", "lon": "Laenge"}
BERLIN = "Europe/Berlin"


def their_own(table: pa.Table) -> pa.Table:
    """The same with other names, and times of Berlin (two hours before UTC) that name no zone."""
    local = pa.array((table["time"].to_numpy() + 7200.0) * 1e6).cast(pa.int64())
    return pa.table(
        {
            "Fahrt": table["trip_id"],
            "Zeit": local.cast(pa.timestamp("us")),
            "Breite": table["lat"],
            "Laenge": table["lon"],
        }
    )


@pytest.mark.parametrize("kind", ["parquet", "sorted", "csv", "several"])
def test_own_names_and_a_zone_give_what_the_usual_ones_give(tmp_path, town, table, usual, kind):
    source, theirs = tmp_path / "in", their_own(table)
    source.mkdir()
    if kind == "several":
        pq.write_table(theirs.slice(0, 1000), source / "a.parquet")
        feather.write_feather(theirs.slice(1000), source / "b.arrow")
    elif kind == "csv":
        text = theirs["Zeit"].cast(pa.string())
        pacsv.write_csv(theirs.set_column(1, "Zeit", text), source / "a.csv")
    else:
        pq.write_table(theirs, source / "a.parquet", row_group_size=700)
    order = "sorted" if kind == "sorted" else "any"
    done = run_fleet(
        source, town, tmp_path / "out", columns=OWN | {"drive_id": "Fahrt"}, tz=BERLIN,
        workers=1, order=order,
    )  # fmt: skip
    assert done.note is None
    same(tmp_path / "out", usual)


def test_csv_without_a_zone_is_of_utc_whatever_the_zone_of_the_machine(
    tmp_path, town, table, monkeypatch
):
    text = pa.array(table["time"].to_numpy() * 1e6).cast(pa.int64()).cast(pa.timestamp("us"))
    rows = table.set_column(1, "time", text.cast(pa.string())).slice(0, 79)
    pacsv.write_csv(rows, tmp_path / "a.csv")
    monkeypatch.setenv("TZ", BERLIN)
    time.tzset()
    try:
        done = run_fleet(
            tmp_path / "a.csv", town, tmp_path / "out", points="slim", workers=1
        )  # fmt: skip
    finally:
        monkeypatch.undo()
        time.tzset()
    assert rows_of(tmp_path / "out", "points")["time"][0].as_py().timestamp() == 1.6e9
    assert "'time' name no zone and were taken as UTC" in done.note


def test_the_command_takes_own_names_and_a_zone_and_goes_on_with_these_alone(tmp_path, town, table):
    pq.write_table(their_own(table.slice(0, 400)), tmp_path / "t.parquet")

    def ran(out: str, *more: str) -> tuple[int, str]:
        line = ["fleet", str(tmp_path / "t.parquet"), "--map", str(town), "-o", str(tmp_path / out),
                "--workers", "1", "--trip-id", "Fahrt", *more]  # fmt: skip
        done = CliRunner().invoke(app, line)
        text = f"{done.output} {done.exception}"
        return done.exit_code, " ".join(text.replace("│", " ").split())

    named = ["--columns", "time=Zeit,lat=Breite", "--columns", "lon=Laenge"]
    code, text = ran("out", *named)
    assert code == 0, text
    assert "note: times in column 'Zeit' name no zone" in text
    held = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (held["columns"], held["tz"]) == (OWN, None)
    for out, more, what in (
        ("out", [*named, "--resume", "--tz", BERLIN], "other tz"),
        ("out", [*named, "--resume", "--columns", "speed=Breite"], "other columns"),
        ("new", ["--columns", "time=Zeiit,lat=Breite,lon=Laenge"], "did you mean Zeit?"),
        ("new", ["--columns", "time=1"], "the name of a column was expected"),
        ("new", ["--columns", "tempo=Zeit"], "not the name of a quantity"),
        ("new", ["--columns", "Zeit"], "NAME=COLUMN was expected"),
        ("new", ["--tz", "Mars"], "not a known time zone"),
    ):
        code, text = ran(out, *more)
        assert code != 0
        assert what in text


def test_the_command_finds_the_column_of_trips_by_its_usual_names(tmp_path, town, table):
    few = table.slice(0, 400)
    for name in ("trip_id", "Journey ID"):
        pq.write_table(few.rename_columns([name, *few.column_names[1:]]), tmp_path / "t.parquet")
        line = ["fleet", str(tmp_path / "t.parquet"), "--map", str(town), "--workers", "1"]
        done = CliRunner().invoke(app, [*line, "-o", str(tmp_path / name)])
        assert done.exit_code == 0, done.output
        rows = rows_of(tmp_path / name, "drives")
        assert set(rows["drive_id"].to_pylist()) == set(few["trip_id"].to_pylist())
