"""`whichroad inspect`: what files hold, as `match` understands them, and the command for it."""

import shlex
import sys
from pathlib import Path

import geopandas
import numpy as np
import pandas as pd
import pytest

import whichroad
from whichroad import cli
from whichroad.geodesy.plane import Plane
from whichroad.geodesy.units import KMH, KNOT
from whichroad.inspection import inspect_files
from whichroad.settings import Settings
from whichroad.simulate import draw_town, simulate_drive, write_drive

N = 120
START = 1.6e9


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A simulated drive in all its files, and its map."""
    place = tmp_path_factory.mktemp("drive")
    (place / "town.osm").write_text(draw_town(), encoding="utf-8")
    roads = whichroad.RoadMap.from_osm(place / "town.osm")
    roads.save(place / "town.map")
    write_drive(simulate_drive(roads, seed=3, length_m=900.0), roads, place)
    return place


@pytest.fixture(scope="module")
def track(folder) -> pd.DataFrame:
    """A drive along a street of the map at 12 m/s, a fix a second, a gap of 40 s."""
    roads = whichroad.RoadMap.open(folder / "town.map")
    plane = roads.plane
    line = max((roads.edge_line(e) for e in range(len(roads))), key=len)
    lat, lon = plane.to_geodetic(line[0, 0] + 12.0 * np.arange(N), np.full(N, line[0, 1]))
    time = START + np.arange(N) + np.where(np.arange(N) >= 60, 40.0, 0.0)
    return pd.DataFrame({"time": time, "lat": lat, "lon": lon})


def rows_of(found, title: str) -> dict[str, str]:
    [section] = [s for s in found.sections if s.title.startswith(title)]
    return dict(section.rows)


def said_of(found) -> str:
    return "\n".join(line for section in found.sections for line in section.said)


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [("speed_kmh", KMH, "km/h"), ("speed_knots", KNOT, "knots"), ("speed_mps", 1.0, "m/s")],
)
def test_columns_are_named_with_what_they_were_read_as(track, tmp_path, name, factor, unit):
    table = track.assign(altitude=112.0, **{name: 12.0 / factor}, hdop=0.9)
    table.to_csv(tmp_path / "in.csv", index=False)
    found = inspect_files([tmp_path / "in.csv"])
    columns = rows_of(found, "columns of in.csv")
    assert columns["time"] == "column 'time', unit by its size"
    assert columns["lat"] == "column 'lat', degrees"
    assert columns["speed"] == f"column {name!r}, {unit}"
    assert columns["not used"] == "altitude"
    drive = rows_of(found, "drive in")
    assert drive["time"] == "2020-09-13T12:26:40Z to 2020-09-13T12:29:19Z, 3 min"
    assert drive["fixes"] == "120, one every 1 s; 1 gap over 5 s, the longest 41 s"
    assert drive["speed"].startswith("12 m/s, with 120 of 120 fixes")
    assert drive["places"].endswith("1.4 km")
    assert drive["odometry"] == "none"


def test_dates_and_a_speed_without_a_unit_are_named_as_what_they_are(track, tmp_path):
    dates = pd.to_datetime(track.time, unit="s", utc=True).dt.strftime("%Y-%m-%dT%H:%M:%SZ")
    track.assign(time=dates, speed=43.2).to_csv(tmp_path / "in.csv", index=False)
    columns = rows_of(inspect_files([tmp_path / "in.csv"]), "columns of in.csv")
    assert columns["time"] == "column 'time', dates"
    said = "m/s unless a note says otherwise, as the name has no unit"
    assert columns["speed"] == f"column 'speed', {said}"


def test_sigmas_are_given_with_their_source(track, tmp_path):
    usual = Settings()
    known = np.arange(N)
    table = track.assign(
        hdop=np.where(known < 20, np.nan, 2.0),
        sigma_m=np.where(known < 60, np.nan, 3.0),
    )
    table.to_csv(tmp_path / "in.csv", index=False)
    drive = rows_of(inspect_files([tmp_path / "in.csv"]), "drive in")
    assert drive["sigma of 60 fixes"] == "3 m, as reported"
    by_hdop = f"{2.0 * usual.user_range_error_m:.3g} m, HDOP times {usual.user_range_error_m:g} m"
    assert drive["sigma of 40 fixes"] == by_hdop
    assert "none reported" in drive["sigma of 20 fixes"]
    track.to_csv(tmp_path / "bare.csv", index=False)
    drive = rows_of(inspect_files([tmp_path / "bare.csv"]), "drive bare")
    assert drive["sigma"] == (
        f"{usual.default_sigma_m:g} m, none reported: the setting default_sigma_m, "
        f"{usual.default_sigma_m:g} m"
    )


def test_sigmas_by_the_kind_of_fix_are_told_from_the_others(track, tmp_path):
    quality = np.where(np.arange(N) < 20, 4, 1)
    track.assign(hdop=1.0, fix_quality=quality).to_csv(tmp_path / "in.csv", index=False)
    drive = rows_of(inspect_files([tmp_path / "in.csv"]), "drive in")
    kind = "by the kind of fix (RTK, dead reckoning)"
    assert drive["sigma of 20 fixes"] == f"0.03 m, HDOP times 4 m, {kind}"
    assert drive[f"sigma of {N - 20} fixes"] == "4 m, HDOP times 4 m"


def test_what_is_skipped_and_noted_is_said(track, tmp_path):
    table = track.assign(yaw_rate=0.0)
    table.loc[3, "lat"] = 200.0
    table.to_csv(tmp_path / "in.csv", index=False)
    said = said_of(inspect_files([tmp_path / "in.csv"]))
    assert "skipped: impossible position: 1" in said
    assert "note: yaw rate not used" in said


def test_odometry_that_covers_a_part_is_named(track, tmp_path):
    track.to_csv(tmp_path / "gnss.csv", index=False)
    early = START + np.arange(0.0, 32.0, 0.1)
    wheels = pd.DataFrame({"time": early, "wheel_rl_mps": 12.0, "wheel_rr_mps": 12.0})
    wheels.to_csv(tmp_path / "wheels.csv", index=False)
    found = inspect_files([tmp_path / "gnss.csv", tmp_path / "wheels.csv"])
    both = dict(found.sections[-1].rows)
    assert both["odometry"] == "speeds of both rear wheels: 320, 10 Hz"
    assert both["odometry covers"] == "20 % of the time of the fixes"


def test_a_drive_off_the_map_is_said_and_the_map_left_out_of_the_command(track, folder, tmp_path):
    lat, lon = Plane(49.4, 2.8).to_geodetic(0.0, 90_000.0)
    track.assign(lat=lat, lon=lon).to_csv(tmp_path / "far.csv", index=False)
    found = inspect_files([tmp_path / "far.csv", folder / "town.map"])
    assert "km from the map" in said_of(found)
    assert "--map MAP" in found.command


def test_a_clock_without_a_date_has_none(track, tmp_path):
    track.assign(time=np.arange(N)).to_csv(tmp_path / "in.csv", index=False)
    drive = rows_of(inspect_files([tmp_path / "in.csv"]), "drive in")
    assert drive["time"] == "0 s to 119 s, 119 s"


# At the command line


@pytest.fixture
def run(monkeypatch, capsys, folder, tmp_path):
    """Run the command line in an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["whichroad", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        said = capsys.readouterr()
        return stop.value.code, said.out, said.err

    return call


def command_of(out: str) -> list[str]:
    """The words of the command that `inspect` proposes."""
    line = out.splitlines()[-1].removeprefix("to match: whichroad ")
    assert line != out.splitlines()[-1]
    return shlex.split(line)


def test_the_command_that_is_proposed_matches_the_files(run, folder):
    names = ("drive.nmea", "can.log", "vehicle.toml", "town.map", "vehicle.dbc")
    code, out, _ = run("inspect", *(folder / name for name in names))
    assert code == 0
    assert "counters of both rear wheels" in out
    assert "all fixes lie on the map" in out
    assert "as reported" in out
    assert run(*command_of(out))[0] == 0
    assert len(geopandas.read_parquet("points.parquet")) > 100
    code, out, _ = run("inspect", "points.parquet", folder / "town.map")
    assert code == 0
    assert "points that `whichroad match` wrote" in out
    assert run(*command_of(out))[0] == 0
    assert Path("report.html").stat().st_size > 10_000


def test_the_reference_system_is_in_the_command(run, folder, track):
    points = geopandas.points_from_xy(track.lon, track.lat, crs=4326).to_crs("EPSG:32631")
    table = pd.DataFrame({"time": track.time, "x": points.x, "y": points.y})
    table.to_csv("plane.csv", index=False)
    code, out, _ = run("inspect", "plane.csv", folder / "town.osm")
    assert code == 0  # the map is understood
    assert "--crs" in out
    code, out, _ = run("inspect", "plane.csv", folder / "town.osm", "--crs", "EPSG:32631")
    assert code == 0
    assert "column 'x', m" in out
    assert "--crs EPSG:32631" in out
    assert run(*command_of(out))[0] == 0


def test_one_reference_system_serves_drive_and_map(run, folder, track):
    points = geopandas.points_from_xy(track.lon, track.lat, crs=4326).to_crs("EPSG:32631")
    table = pd.DataFrame({"time": track.time, "x": points.x, "y": points.y})
    table.to_csv("plane.csv", index=False)
    table.assign(odo=12.0 * np.arange(N)).to_csv("odo.csv", index=False)
    edges = whichroad.RoadMap.open(folder / "town.map").edges_table().to_crs("EPSG:32631")
    edges.to_wkt().to_csv("roads.csv", index=False)
    for drive in ("plane.csv", "odo.csv"):
        code, out, _ = run("inspect", drive, "roads.csv")
        words = command_of(out)
        assert words[:6] == ["match", drive, "--map", "roads.csv", "--crs", "CRS"]
        code, _, said = run(*words[:4])
        assert (code, "--crs" in said) == (1, True)
        code, out, _ = run("inspect", drive, "roads.csv", "--crs", "EPSG:32631")
        assert "roads.csv: a road map" in out
        assert run(*command_of(out), "--force")[0] == 0
    code, out, _ = run("inspect", "points.parquet", "roads.csv", "--crs", "EPSG:32631")
    assert "report points.parquet --map roads.csv --crs EPSG:32631" in out
    assert run(*command_of(out))[0] == 0
    degrees = whichroad.RoadMap.open(folder / "town.map").edges_table()
    degrees.to_wkt().to_csv("degrees.csv", index=False)  # which the drive's system is not for
    command = ("match", "plane.csv", "--map", "degrees.csv", "--crs", "EPSG:32631")
    assert run(*command, "-o", "points.csv")[0] == 0


def test_maps_of_every_kind_are_maps(run, folder):
    roads = whichroad.RoadMap.open(folder / "town.map").edges_table()
    roads.to_parquet("town.parquet")
    roads.to_file("town.geojson")
    roads.to_file("town.gpkg")
    roads.to_wkt().to_csv("town.csv", index=False)
    for name in ("town.parquet", "town.geojson", "town.gpkg", "town.csv", folder / "town.osm"):
        code, out, _ = run("inspect", name)
        assert (code, f"{name}: a road map" in out) == (0, True)
        assert f"whichroad match DRIVE --map {name}" in out


def test_what_cannot_be_understood_is_said_for_each_file(run, folder):
    Path("notes.txt").write_text("nothing of the kind")
    Path("empty.csv").write_text("")
    code, out, _ = run("inspect", "notes.txt", "empty.csv", "none.nmea", folder / "town.map")
    assert code == 0
    assert out.count("error: ") == 3
    assert "a file of unknown format" in out
    assert "none.nmea" in out
    code, out, error = run("inspect", "notes.txt")
    assert (code, error.count("\n")) == (1, 1)
    assert "none of the files could be read" in error


def test_a_table_of_wkt_with_a_date_is_one_of_roads(folder, tmp_path):
    edges = whichroad.RoadMap.open(folder / "town.map").edges_table().to_crs(32632)
    wkt = pd.DataFrame({"source_date": "2021-04-07", "geom_wkt": edges.geometry.to_wkt()})
    wkt.to_csv(tmp_path / "links.csv", index=False)
    [section] = inspect_files([tmp_path / "links.csv"]).sections
    assert "without a coordinate system" in section.said[0]
    assert "whichroad map build --crs" in section.said[0]


def test_drives_of_several_files_are_described_once(track, tmp_path):
    track.rename(columns={"time": ""}).assign(time=track.time).to_csv(tmp_path / "a.csv")
    track.assign(lat=track.lat + 0.3).to_csv(tmp_path / "b.csv", index=False)
    found = inspect_files([tmp_path / "a.csv", tmp_path / "b.csv"])
    titles = [section.title for section in found.sections]
    assert [t for t in titles if t.startswith("drive ")] == ["drive a", "drive b"]
    assert titles[-1] == "all files together: 2 drives"
    assert any("2 files are 2 drives" in said for said in found.sections[-1].said)
    assert "(no name)" in rows_of(found, "columns of a.csv")["not used"]
