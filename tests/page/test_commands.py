"""`whichroad replay`, `whichroad report` and `match --report`."""

import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

from whichroad import cli


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Run the command line here: exit code, standard output, standard error."""

    def call(*arguments: Any) -> tuple[Any, str, str]:
        monkeypatch.setattr(sys, "argv", ["whichroad", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        said = capsys.readouterr()
        return stop.value.code, said.out, said.err

    return call


@pytest.fixture
def logs(folder: Path) -> list[str]:
    options = {"can": "can.log", "dbc": "vehicle.dbc", "vehicle": "vehicle.toml", "map": "map.osm"}
    named = [part for name, file in options.items() for part in (f"--{name}", str(folder / file))]
    return [str(folder / "drive.nmea"), *named]


def test_match_and_its_report_are_one_call(run: Any, logs: list[str], tmp_path: Path):
    page = tmp_path / "report.html"
    code, _, _ = run("match", *logs, "--mask", "90:130", "--report", page)
    assert code == 0
    assert '"masked":' in page.read_text("utf-8")
    code, _, said = run("match", *logs, "--report", page)
    assert code == 1
    assert "exists" in said
    code, _, said = run("match", *logs, "--report", tmp_path / "report.png")
    assert code == 1
    assert ".html was expected" in said


def test_a_report_of_points_needs_no_drive(run: Any, logs: list[str], folder: Path, tmp_path: Path):
    points, page = tmp_path / "points.parquet", tmp_path / "report.html"
    assert run("match", *logs, "-o", points)[0] == 0
    assert run("report", points, "--map", folder / "map.osm", "-o", page)[0] == 0
    assert page.stat().st_size > 100_000
    code, _, said = run("report", folder / "truth.parquet", "-o", tmp_path / "truth.html")
    assert code == 1
    assert "whichroad match -o" in said


BARE = "import sys; sys.modules[sys.argv.pop(1)] = None; from whichroad.cli import main; main()"


@pytest.mark.parametrize(
    ("command", "package"),
    [
        *((command, name) for command in ("replay", "live") for name in ("starlette", "uvicorn")),
        ("replay", "websockets"),
        ("live", "websockets"),
        ("live", "serial"),
    ],
)
def test_without_the_extra_a_command_says_what_to_install(
    logs: list[str], command: str, package: str
):
    source = ["--nmea", "/dev/ttyNONE"] if command == "live" else logs[:1]
    done = subprocess.run(
        [sys.executable, "-c", BARE, package, command, *source, *logs[-2:]],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1] == (
        f"error: {command}: the package {package} is missing; it was expected for this; "
        'install it by pip install "whichroad[live]", or ".[live]" in the source folder'
    )


def test_a_path_is_drawn_where_it_can_be(run: Any, logs: list[str], folder: Path, tmp_path: Path):
    points, path, page = (tmp_path / name for name in ("points.csv", "path.csv", "report.html"))
    assert run("match", *logs, "-o", points, "--path-out", path)[0] == 0
    map_ = ("--map", folder / "map.osm")
    assert run("report", points, *map_, "--path", path, "-o", page)[0] == 0
    code, _, said = run("report", points, "--path", path, "-o", tmp_path / "other.html")
    assert code == 2
    assert "--path was given without --map" in said
    code, _, said = run("replay", *logs, "--path", path)
    assert code == 2
    assert "--path was given with a drive" in said


def test_a_file_that_is_not_there_is_called_that(run: Any, tmp_path: Path):
    code, _, said = run("report", tmp_path / "points.parquet", "-o", tmp_path / "report.html")
    assert code == 1
    assert "points.parquet: the file does not exist" in said
    code, _, said = run("map", "build", tmp_path / "city.osm.pbf", "-o", tmp_path / "city.map")
    assert code == 1
    assert "city.osm.pbf: the file does not exist" in said


def test_a_report_of_several_drives_is_refused_before_the_work(
    run: Any, logs: list[str], tmp_path: Path
):
    drives = tmp_path / "two.csv"
    drives.write_text("trip,time,lat,lon\na,0,49.41,8.7\nb,0,49.41,8.7\n")
    out = tmp_path / "points.csv"
    code, _, said = run("match", drives, *logs[-2:], "-o", out, "--report", tmp_path / "r.html")
    assert code == 1
    assert "2 drives (a, b)" in said
    assert "whichroad report points.parquet --drive-id" in said
    assert not out.exists()


def test_a_port_that_is_taken_is_one_sentence_and_exit_code_1(run: Any, logs: list[str]):
    with socket.create_server(("127.0.0.1", 0)) as door:
        code, _, said = run("replay", *logs, "--port", door.getsockname()[1], "--no-browser")
    assert code == 1
    assert said.count("\n") == 1
    assert "--port" in said


def test_replay_serves_until_it_is_interrupted(logs: list[str]):
    command = [sys.executable, "-m", "whichroad", "replay", *logs, "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        url = re.search(r"http://\S+", process.stdout.readline())
        assert url is not None
        with urlopen(url.group(), timeout=20) as answer:
            assert b"whichroad" in answer.read()
        process.terminate()
        assert process.wait(20) is not None


def test_a_report_needs_neither_a_server_nor_maplibre():
    code = (
        "import sys\n"
        "for name in ('starlette', 'uvicorn', 'maplibre'): sys.modules[name] = None\n"
        "import whichroad.replay.drive_report, whichroad.replay.open_replay\n"
        "import whichroad.replay.points"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
