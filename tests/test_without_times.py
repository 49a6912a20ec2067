"""Tracks without times are matched by distance, to the same route, and it is said."""

import gpxpy
import pytest
from typer.testing import CliRunner

import whichroad
from whichroad.cli import app
from whichroad.readers.without_times import NOTE
from whichroad.simulate import draw_town, simulate_drive


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    """A town and drives in it."""
    path = tmp_path_factory.mktemp("town") / "town.osm"
    path.write_text(draw_town())
    roads = whichroad.RoadMap.from_osm(path)
    return path, roads, [simulate_drive(roads, seed=k, length_m=2500.0) for k in range(4)]


@pytest.mark.parametrize("step", [1, 5, 15])
def test_the_route_is_that_of_the_track_with_times(town, step):
    _, roads, drives = town
    for drive in drives:
        fixes = drive.drive.fixes
        rows = list(zip(fixes.time, fixes.lat_deg, fixes.lon_deg, strict=True))[::step]
        timed = whichroad.match(rows, roads, lag="full")
        untimed = whichroad.match([row[1:] for row in rows], roads, lag="full")
        assert untimed.path.edge_id.tolist() == timed.path.edge_id.tolist()
        assert untimed.summary["notes"] == [NOTE]
        assert timed.summary["notes"] == []


def test_the_command_says_that_times_were_invented(town, tmp_path):
    path, _, drives = town
    fixes = drives[0].drive.fixes
    gpx = gpxpy.gpx.GPX()
    gpx.tracks.append(gpxpy.gpx.GPXTrack())
    gpx.tracks[0].segments.append(gpxpy.gpx.GPXTrackSegment())
    for lat, lon in zip(fixes.lat_deg, fixes.lon_deg, strict=True):
        gpx.tracks[0].segments[0].points.append(gpxpy.gpx.GPXTrackPoint(lat, lon))
    (tmp_path / "a.gpx").write_text(gpx.to_xml())
    done = CliRunner().invoke(app, ["match", str(tmp_path / "a.gpx"), "--map", str(path)])
    assert done.exit_code == 0
    assert "note: no times in the file: they were invented" in done.output


def test_the_command_takes_own_names_ids_and_zones(town, tmp_path):
    path, _, drives = town
    fixes = drives[0].drive.fixes
    rows = [
        f"{who},{t:.1f},{lat:.8f},{lon:.8f}"
        for t, lat, lon in zip(fixes.time, fixes.lat_deg, fixes.lon_deg, strict=True)
        for who in ("x", "y")
    ]
    (tmp_path / "a.csv").write_text("wer,wann,B,L\n" + "\n".join(rows))
    done = CliRunner().invoke(
        app,
        ["match", str(tmp_path / "a.csv"), "--map", str(path), "--id", "wer",
         "--tz", "Europe/Paris", "--columns", "time=wann,lat=B", "--columns", "lon=L",
         "-o", str(tmp_path / "out.csv")],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "tz Europe/Paris not used" in done.output
    out = (tmp_path / "out.csv").read_text().splitlines()
    assert {line.partition(",")[0].strip('"') for line in out[1:]} == {"x", "y"}
    wrong = CliRunner().invoke(
        app, ["match", str(tmp_path / "a.csv"), "--map", str(path), "--columns", "wann"]
    )
    assert wrong.exit_code == 2
    assert "NAME=COLUMN" in wrong.output
