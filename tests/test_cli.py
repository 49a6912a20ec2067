import json
import subprocess
import sys
from datetime import UTC, datetime

import geopandas
import pandas
import pytest
import typer

from whichroad import RoadMap, __version__, cli
from whichroad.cli.arguments import read_window
from whichroad.errors import DriveError

HEAVY = {
    "numpy",
    "numba",
    "llvmlite",
    "pandas",
    "geopandas",
    "pyarrow",
    "shapely",
    "pyproj",
    "osmium",
}
HEAVY |= {"matplotlib", "can", "cantools", "rich", "starlette", "uvicorn", "websockets", "serial"}


@pytest.fixture
def run(monkeypatch, capsys):
    """Run the command line here: exit code, standard output, standard error."""

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["whichroad", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        said = capsys.readouterr()
        return stop.value.code, said.out, said.err

    return call


@pytest.mark.parametrize("command", [[], ["match"], ["map"], ["simulate"], ["live"], ["warmup"]])
def test_help_loads_nothing_that_takes_time(command):
    code = "import sys, whichroad.cli as c\ntry: c.main()\nfinally: print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code, *command, "--help"], capture_output=True, text=True
    )
    assert done.returncode == 0
    assert "Usage:" in done.stdout
    assert HEAVY & {name.partition(".")[0] for name in done.stdout.split()} == set()


def test_the_version_is_said(run):
    assert run("--version") == (0, f"whichroad {__version__}\n", "")


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly"],
        ["match"],
        ["match", "drive.nmea"],
        ["match", "drive.nmea", "--map", "m", "--model", "perfect"],
        ["match", "drive.nmea", "--map", "m", "--start", "49.4,8.7"],
        ["match", "drive.nmea", "--map", "m", "--start", "8.7,249.4,90"],
        ["match", "drive.nmea", "--map", "m", "--mask", "120"],
        ["match", "drive.nmea", "--map", "m", "--mask", "240:120"],
        ["match", "drive.nmea", "--map", "m", "--every", "soon"],
        ["simulate", "--map", "m", "-o", "d", "--preset", "hilly"],
        ["evaluate", "points.parquet"],
    ],
)
def test_wrong_usage_is_exit_code_2_without_a_traceback(run, arguments):
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert "Usage:" in err
    assert "Traceback" not in err


def one_error(outcome):
    """The one line of a run that could answer nothing."""
    code, out, err = outcome
    assert (code, out) == (1, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    return err


def test_a_missing_drive_is_one_line(run, tmp_path):
    error = one_error(run("match", tmp_path / "none.nmea", "--map", tmp_path / "none.osm.pbf"))
    assert "none.nmea" in error


def test_a_missing_map_is_one_line(run, tmp_path):
    assert "none.osm.pbf" in one_error(run("map", "info", tmp_path / "none.osm.pbf"))


@pytest.mark.parametrize("option", [["--tz", "Mars"], ["--dates", "ydm"]])
@pytest.mark.parametrize("command", ["match", "inspect", "calibrate", "fleet"])
@pytest.mark.parametrize("drive", ["drive.gpx", "trips.csv"])
def test_no_zone_and_no_order_of_dates_is_refused_before_the_work(
    run, tmp_path, command, drive, option
):
    if drive == "drive.gpx":  # whose times name their zone
        point = '<trkpt lat="49.4" lon="8.7"><time>2026-06-01T08:00:00Z</time></trkpt>'
        text = f"<gpx><trk><trkseg>{point}</trkseg></trk></gpx>"
    else:  # of many trips
        text = "trip_id,time,lat,lon\na,2026-06-01T08:00:00Z,49.4,8.7\n"
        text += "b,2026-06-01T09:00:00Z,49.4,8.7\n"
    (tmp_path / drive).write_text(text)
    places = ["--map", tmp_path / "none.map", "-o", tmp_path / "o.toml"]
    places = [] if command == "inspect" else places[:2] if command == "match" else places
    error = one_error(run(command, tmp_path / drive, *places, *option))
    assert f"'{option[1]}' is no" in error
    assert "was expected" in error


def test_an_output_that_exists_is_refused_before_the_work(run, tmp_path):
    (tmp_path / "points.csv").write_text("mine")
    error = one_error(run("match", "drive.nmea", "--map", "m", "-o", tmp_path / "points.csv"))
    assert "--force" in error
    assert (tmp_path / "points.csv").read_text() == "mine"


def test_an_output_of_unknown_suffix_names_those_known(run, tmp_path):
    error = one_error(run("match", "drive.nmea", "--map", "m", "-o", tmp_path / "points.kml"))
    assert ".parquet" in error


def break_with(monkeypatch, error):
    def broken():
        raise error

    monkeypatch.setattr(cli, "app", broken)


def test_an_error_of_several_lines_is_said_in_one(run, monkeypatch):
    break_with(monkeypatch, DriveError("drive.csv: nothing\n  in it"))
    assert one_error(run()) == "error: drive.csv: nothing in it\n"


def test_a_bug_is_one_line_and_no_traceback(run, monkeypatch):
    break_with(monkeypatch, KeyError("lat"))
    error = one_error(run())
    assert "KeyError" in error
    assert "report" in error


def test_an_interrupt_is_exit_code_130(run, monkeypatch):
    break_with(monkeypatch, KeyboardInterrupt())
    assert run()[0] == 130


@pytest.mark.parametrize(
    ("text", "window"),
    [
        ("120:240", (120.0, 240.0)),
        ("0.5:inf", (0.5, float("inf"))),
        (
            "2026-06-01T08:02:00Z:2026-06-01T08:04:00.5Z",
            (
                datetime(2026, 6, 1, 8, 2, tzinfo=UTC),
                datetime(2026, 6, 1, 8, 4, 0, 500_000, tzinfo=UTC),
            ),
        ),
        (
            "2026-06-01T08:02:2026-06-01T10:04:00+02:00",
            (datetime(2026, 6, 1, 8, 2, tzinfo=UTC), datetime(2026, 6, 1, 8, 4, tzinfo=UTC)),
        ),
    ],
)
def test_a_mask_is_two_moments(text, window):
    assert read_window(text) == window


@pytest.mark.parametrize("text", ["", ":", "1:", "a:b", "1:2026-06-01T08:02:00Z", "1:2:3"])
def test_what_is_no_mask_is_refused(text):
    with pytest.raises(typer.BadParameter, match="START:END"):
        read_window(text)


def test_a_start_south_of_the_equator_is_no_option(run, tmp_path):
    outcome = run("match", "none.nmea", "--map", "none", "--start", "-33.8,151.2,90")
    assert "--start" not in one_error(outcome)


# From end to end


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    """A compiled map of the town that the simulator draws."""
    from whichroad.simulate import draw_town

    folder = tmp_path_factory.mktemp("town")
    (folder / "town.osm").write_text(draw_town(), encoding="utf-8")
    RoadMap.from_osm(folder / "town.osm").save(folder / "town.map")
    return folder


def test_a_map_is_built_and_told(run, town, tmp_path):
    code, out, _ = run("map", "build", town / "town.osm", "-o", tmp_path / "m.map")
    assert (code, "MB" in out) == (0, True)
    code, out, err = run("map", "info", tmp_path / "m.map")
    assert (code, err) == (0, "")
    assert "edges" in out
    assert "--force" in one_error(run("map", "build", town / "town.osm", "-o", tmp_path / "m.map"))


def test_a_map_that_is_built_says_what_was_left_out(run, town, tmp_path):
    source = (town / "town.osm").read_text(encoding="utf-8")
    area = '<tag k="area" v="yes"/></way>'
    (tmp_path / "town.osm.xml").write_text(source.replace("</way>", area, 1), encoding="utf-8")
    code, out, err = run("map", "build", tmp_path / "town.osm.xml", "-o", tmp_path / "m.map")
    assert code == 0
    assert "km of roads" in out
    assert "skipped: ways that are areas: 1" in err
    south, north = RoadMap.open(tmp_path / "m.map").info()["lat"]
    part = f"-180,-90,180,{(south + north) / 2}"
    half = ("map", "build", tmp_path / "town.osm.xml", "--bbox", part, "-o", tmp_path / "half.map")
    code, _, err = run(*half)
    assert (code, "ways outside the box" in err) == (0, True)
    assert 0 < len(RoadMap.open(tmp_path / "half.map")) < len(RoadMap.open(tmp_path / "m.map"))
    assert "bbox is" in one_error(run(*half[:3], "--bbox", "1,2,3", "-o", tmp_path / "x.map"))


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("drive.csv", "time,lat,lon\n0,49.4,8.7\n", "seems to be a drive and not a map"),
        ("drive.nmea", "$GPGGA,1\n", "seems to belong to a drive"),
        ("drive.gpx", "<gpx/>", "seems to belong to a drive"),
        ("notes.txt", "a map of sorts", "an OpenStreetMap extract (.osm.pbf"),
        ("city.map", "not compiled", "an OpenStreetMap extract (.osm.pbf"),
    ],
)
def test_what_is_no_map_is_answered_by_what_is_one(run, tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    for command in (("map", "build", tmp_path / name, "-o", tmp_path / "m.out"),
                    ("map", "info", tmp_path / name)):  # fmt: skip
        error = one_error(run(*command))
        assert said in error
        assert "make it by" not in error


def test_a_broken_source_leaves_no_map(run, tmp_path):
    (tmp_path / "bad.osm").write_text("<osm>")
    one_error(run("map", "build", tmp_path / "bad.osm", "-o", tmp_path / "m.map"))
    assert [file.name for file in tmp_path.iterdir()] == ["bad.osm"]


@pytest.mark.slow
def test_a_drive_is_simulated_answered_and_evaluated(run, town, tmp_path):
    roads = ("--map", town / "town.map")
    code, out, _ = run("simulate", *roads, "-o", tmp_path, "--length", 1, "--seed", 3)
    assert (code, "drive.nmea" in out) == (0, True)
    one_error(run("simulate", *roads, "-o", tmp_path))

    points, path = tmp_path / "points.parquet", tmp_path / "path.geojson"
    drive = (tmp_path / "drive.nmea", "--vehicle", tmp_path / "vehicle.toml")
    wheels = ("--can", tmp_path / "can.log", "--dbc", tmp_path / "vehicle.dbc")
    code, out, _ = run("match", *drive, *wheels, *roads, "-o", points, "--path-out", path)
    assert (code, "epochs" in out) == (0, True)
    assert geopandas.read_file(path).geometry.geom_type.eq("LineString").all()

    lives = tmp_path / "lineage.csv"
    code, out, _ = run("match", *drive, *wheels, *roads, "--lineage", lives)
    assert (code, "no output was asked for" in out) == (0, False)
    rows = pandas.read_csv(lives)
    assert rows.birth[0] == "start"
    assert (rows.reason == "alive at the drive's end").any()
    assert "exists already" in one_error(run("match", *drive, *roads, "--lineage", lives))

    assert out.index("mean P of the way") < out.index("mean P of the edge")

    code, out, _ = run("evaluate", points, "--truth", tmp_path / "truth.parquet")
    assert (code, "right edge" in out) == (0, True)

    thin = ("-o", tmp_path / "thin.csv", "--every", 5, "--attributes", "--mask", "20:40")
    code, out, _ = run("match", *drive, *roads, *thin)
    assert (code, "fixes masked" in out) == (0, True)
    assert "highway" in (tmp_path / "thin.csv").read_text().partition("\n")[0]
    seconds = len(geopandas.read_parquet(points)) / 10
    assert abs(len((tmp_path / "thin.csv").read_text().splitlines()) - seconds / 5) <= 3

    code, out, _ = run("match", *drive, *roads, "--lag", "full")
    assert (code, "no output was asked for" in out, "decided until" in out) == (0, True, True)
    one_error(run("match", *drive, *roads, "--lag", "soon"))


@pytest.mark.slow
def test_the_demo_answers_from_its_files_alone(run, tmp_path, monkeypatch):
    folder = tmp_path / "demo"
    code, out, _ = run("demo", "--out", folder)
    assert (code, str(folder / "drive.png") in out) == (0, True)
    summary = json.loads((folder / "summary.json").read_text())
    for name in [*summary["files"], *summary["pictures"]]:
        assert (folder / name).stat().st_size > 0
    assert summary["figures"]["right_edge"] > 0.95
    assert summary["figures"]["outage_right_edge"] > 0.95
    monkeypatch.setattr("whichroad.demo.plot_drive", lambda *_, **__: [folder / "drive.png"])
    monkeypatch.setattr("whichroad.demo.plot_methods", lambda *_, **__: [])
    assert run("demo", "--out", folder)[0] == 0  # an earlier demo's folder is used again


def test_the_demo_refuses_a_folder_with_something_else(run, tmp_path):
    (tmp_path / "points.parquet").write_text("mine")
    assert "--force" in one_error(run("demo", "--out", tmp_path))
    assert (tmp_path / "points.parquet").read_text() == "mine"


@pytest.mark.parametrize(
    "arguments",
    [
        ["--map", "m"],
        ["--map", "m", "--nmea", "somewhere"],
        ["--map", "m", "--nmea", "udp://:1", "--speed", "fast"],
        ["--map", "m", "--nmea", "udp://:1", "--host", "0.0.0.0"],
        ["--map", "m", "--nmea", "udp://:1", "--nmea-out", "http://here"],
        ["--map", "m", "--nmea", "udp://:1", "--window", "99"],
        ["--map", "m", "--can", "can0"],
    ],
)
def test_a_service_that_cannot_be_is_refused_in_one_line(run, town, arguments):
    arguments = [str(town / "town.map") if one == "m" else one for one in arguments]
    code, out, err = run("live", *arguments, "--port", 0)
    assert (code in (1, 2), out) == (True, "")
    assert "Traceback" not in err
