"""Files of several tools in one folder: each is read by its own names, clocks and places."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fleet.conftest import trip
from whichroad.batch import match_many
from whichroad.errors import ReadError
from whichroad.fleet import run_fleet
from whichroad.fleet.sources import _by_header

START = 1.7e9
BERLIN = 3600  # s before UTC, in winter


def frame(first: int, end: int, zone: str | None = "UTC") -> pd.DataFrame:
    """Trips by name, with times of a zone; None: on clocks of Berlin that name none."""
    rows = pa.concat_tables([trip(f"car {i:02}", i, START + 50 * i, i) for i in range(first, end)])
    table = rows.to_pandas()
    table["time"] = pd.to_datetime(table["time"], unit="s", utc=True)
    clocks = table["time"].dt.tz_convert(zone or "Europe/Berlin")
    table["time"] = clocks if zone else clocks.dt.tz_localize(None)
    return table


def points(table: pd.DataFrame, crs: int):
    """The same rows as GeoParquet has them."""
    import geopandas

    places = geopandas.points_from_xy(table["lon"], table["lat"], crs=4326)
    plain = table.drop(columns=["lon", "lat"])
    return geopandas.GeoDataFrame(plain, geometry=places, crs=4326).to_crs(crs)


def folder(path: Path, *tables) -> Path:
    """A folder of Parquet files, in this order."""
    path.mkdir(parents=True)
    for table, name in zip(tables, "abc", strict=False):
        table.to_parquet(path / f"{name}.parquet")
    return path


def by_fleet(source, town: Path, out: Path, **options) -> pd.DataFrame:
    run_fleet(source, town, out, workers=1, **options)
    return pq.read_table(out / "path").to_pandas()


def by_match(source, town: Path, out: Path, **options) -> pd.DataFrame:
    options.pop("order", None)
    return match_many(source, town, **options).path.to_pandas()


def check_same(path: pd.DataFrame, usual: pd.DataFrame) -> None:
    """The same roads at the same times, to what rounding of places makes."""
    names = ["drive_id", "seq"]
    both = [one.sort_values(names).reset_index(drop=True) for one in (path, usual)]
    assert len(both[0]) == len(both[1]) > 0
    assert (both[0][[*names, "edge_id"]] == both[1][[*names, "edge_id"]]).all(axis=None)
    off = (both[0]["enter_time"] - both[1]["enter_time"]).dt.total_seconds().abs()
    assert off.max() < 0.01


@pytest.fixture(scope="module")
def usual(town):
    return match_many(frame(0, 8), town).path.to_pandas()


@pytest.fixture
def new_york(monkeypatch):
    """A machine whose clocks are those of another zone."""
    monkeypatch.setenv("TZ", "America/New_York")


@pytest.mark.parametrize("matched", [by_fleet, by_match])
@pytest.mark.parametrize("naive_first", [True, False])
def test_times_with_and_without_a_zone_in_one_folder(
    tmp_path, town, usual, new_york, matched, naive_first
):
    halves = [frame(0, 4, None), frame(4, 8)] if naive_first else [frame(0, 4), frame(4, 8, None)]
    for order in ("any", "sorted"):
        source = folder(tmp_path / order, *halves)
        path = matched(source, town, tmp_path / f"o {order}", tz="Europe/Berlin", order=order)
        check_same(path, usual)


@pytest.mark.parametrize("matched", [by_fleet, by_match])
def test_rows_of_a_trip_with_and_without_a_zone(tmp_path, town, usual, new_york, matched):
    table = frame(0, 8)
    naive = table.assign(time=table["time"].dt.tz_localize(None))
    source = folder(tmp_path / "in", table[::2], naive[1::2])
    check_same(matched(source, town, tmp_path / "out"), usual)


def test_times_without_a_zone_in_some_files_are_noted(tmp_path, town, capsys):
    source = folder(tmp_path / "in", frame(0, 4), frame(4, 8, None))
    done = run_fleet(source, town, tmp_path / "out", workers=1)
    assert "name no zone and were taken as UTC" in (done.note or "")
    from whichroad.cli.match_table import match_trips

    match_trips(
        source, town, out=None, path_out=None, by_source=False, every=None, force=False,
        drive_id="drive_id", columns=None, tz=None, crs=None,
    )  # fmt: skip
    assert "name no zone and were taken as UTC" in capsys.readouterr().err


def test_zones_of_csv_and_parquet_together(tmp_path, town, usual, new_york):
    source = folder(tmp_path / "in", frame(0, 4))
    frame(4, 8, None).to_csv(source / "b.csv", index=False)
    check_same(by_fleet(source, town, tmp_path / "out", tz="Europe/Berlin"), usual)


@pytest.mark.parametrize("matched", [by_fleet, by_match])
@pytest.mark.parametrize(
    "halves",
    [(4326, 25832), (25832, 4326), (25832, None), (None, 25832)],
    ids=["degrees first", "metres first", "geometry first", "lat lon first"],
)
def test_places_of_several_kinds_in_one_folder(tmp_path, town, usual, matched, halves):
    tables = [frame(0, 4), frame(4, 8)]
    tables = [t if crs is None else points(t, crs) for t, crs in zip(tables, halves, strict=True)]
    source = folder(tmp_path / "in", *tables)
    check_same(matched(source, town, tmp_path / "out"), usual)


def test_geometries_in_folders_that_bear_the_trip(tmp_path, town, usual):
    for name, rows in frame(0, 8).groupby("trip_id"):
        part = points(rows.drop(columns="trip_id"), 4326)
        folder(tmp_path / "in" / f"trip_id={name}", part)
    check_same(by_fleet(tmp_path / "in", town, tmp_path / "out"), usual)


def test_a_column_that_only_later_files_of_geometries_have_is_read(tmp_path, town):
    first, second = frame(0, 4), frame(4, 8).assign(accuracy_m=40.0)
    usual = match_many(pd.concat([first, second]), town)
    source = folder(tmp_path / "in", points(first, 4326), points(second, 4326))
    run_fleet(source, town, tmp_path / "out", workers=1, points="all")
    found = pq.read_table(tmp_path / "out" / "points").column("lon")
    assert np.allclose(found, usual.points["lon"], rtol=0.0, atol=1e-9)


OTHER = {"trip_id": "journey_id", "time": "timestamp", "lat": "latitude", "lon": "longitude"}


@pytest.mark.parametrize("matched", [by_fleet, by_match])
@pytest.mark.parametrize("order", ["any", "sorted"])
def test_names_of_two_vendors_in_one_folder(tmp_path, town, usual, matched, order):
    source = folder(tmp_path / "in", frame(0, 4), frame(4, 8).rename(columns=OTHER))
    check_same(matched(source, town, tmp_path / "out", order=order), usual)


def test_names_of_two_vendors_in_csv_and_arrow(tmp_path, town, usual):
    source = tmp_path / "in"
    source.mkdir()
    frame(0, 3).to_csv(source / "a.csv", index=False)
    frame(3, 6).rename(columns=OTHER).to_csv(source / "b.csv", index=False)
    frame(6, 8).rename(columns={"lat": "gps_lat"}).to_feather(source / "c.feather")
    check_same(by_fleet(source, town, tmp_path / "out"), usual)


def test_speeds_in_other_units_are_brought_to_one(tmp_path, town):
    first, second = frame(0, 4).assign(speed_mps=12.0), frame(4, 8).assign(speed_kmh=43.2)
    usual = match_many(frame(0, 8).assign(speed_mps=12.0), town)
    source = folder(tmp_path / "in", first, second)
    found = match_many(source, town)
    assert np.allclose(found.points["speed_mps"], usual.points["speed_mps"])


@pytest.mark.parametrize("matched", [by_fleet, by_match])
def test_a_unit_that_one_name_tells_and_the_other_does_not(tmp_path, town, matched):
    first, second = frame(0, 4).assign(speed=43.2), frame(4, 8).assign(speed_kmh=43.2)
    source = folder(tmp_path / "in", first, second)
    with pytest.raises(ReadError, match=r"a\.parquet: its column 'speed' is 'speed_kmh' in .*b\.p"):
        matched(source, town, tmp_path / "out")


def test_csv_files_of_other_headers_stay_in_their_order(town, tmp_path):
    """Trips span files, and --order sorted says that their rows lie together."""
    table = frame(0, 2).sort_values("time")
    cut = [table.iloc[k : k + 30] for k in range(0, 90, 30)] + [table.iloc[90:]]
    cut[1] = cut[1].rename(columns={"lat": "latitude"})
    (tmp_path / "in").mkdir()
    paths = [tmp_path / "in" / f"d{k}.csv" for k in range(4)]
    for part, path in zip(cut, paths, strict=True):
        part.to_csv(path, index=False)
    assert [[p.name for p in group] for group in _by_header(paths)] == [
        ["d0.csv"], ["d1.csv"], ["d2.csv", "d3.csv"]
    ]  # fmt: skip


def test_csv_files_that_tell_excel_their_separator(town, usual, tmp_path):
    (tmp_path / "in").mkdir()
    named = frame(4, 8).rename(columns={"lat": "latitude"})
    for name, part in (("a", frame(0, 4)), ("b", named), ("c", named.iloc[:0])):
        text = part.to_csv(index=False, sep=";")
        (tmp_path / "in" / f"{name}.csv").write_text(f"sep=;\n{text}")
    check_same(by_fleet(tmp_path / "in", town, tmp_path / "out"), usual)
    paths = sorted((tmp_path / "in").iterdir())
    assert [[p.name for p in group] for group in _by_header(paths)] == [["a.csv"], ["b.csv"]]


@pytest.mark.parametrize("empty", ["", "a,b\n"])
def test_a_csv_file_without_rows_leaves_the_others_as_they_are(town, tmp_path, empty: str):
    (tmp_path / "in").mkdir()
    frame(0, 2).to_csv(tmp_path / "in" / "a.csv", index=False)
    usual = by_fleet(tmp_path / "in", town, tmp_path / "before")
    (tmp_path / "in" / "b.csv").write_text(empty)
    check_same(by_fleet(tmp_path / "in", town, tmp_path / "after"), usual)


@pytest.mark.parametrize("matched", [by_fleet, by_match])
def test_an_own_name_of_a_column_holds_for_the_files_that_have_it(town, usual, tmp_path, matched):
    named = frame(0, 4).rename(columns={"time": "ts"})
    source = folder(tmp_path / "in", named, frame(4, 8))
    check_same(matched(source, town, tmp_path / "out", columns={"time": "ts"}), usual)
