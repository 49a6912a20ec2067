"""A folder with the files that the pages speak of."""

import contextlib
import io
import itertools
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import osmium
import pandas as pd
import pytest

import whichroad
import whichroad.demo
from whichroad.cli import main

# The README's readers have no asammdf, which python-can imports where it is: that takes long.
MAIN = "import sys; sys.modules['asammdf'] = None; from whichroad.cli import main; main()"
OWN_PROCESS = {"live"}  # it takes signals
OUTPUTS = {"-o", "--out", "--path-out", "--report", "--lineage", "--ahead", "--nearby"}


@pytest.fixture(scope="session")
def stock(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `whichroad demo` leaves, but for pictures; and more under names that the pages use."""
    folder = tmp_path_factory.mktemp("stock")
    with pytest.MonkeyPatch.context() as patch:  # drawing takes most of its time
        patch.setattr(whichroad.demo, "plot_drive", lambda *_, **__: [folder / "drive.png"])
        patch.setattr(whichroad.demo, "plot_methods", lambda *_, **__: [])
        whichroad.demo.run_demo(folder, force=True)
    shutil.copy(folder / "can.log", folder / "car.log")
    shutil.copy(folder / "vehicle.dbc", folder / "car.dbc")
    with osmium.SimpleWriter(str(folder / "city.osm.pbf")) as writer:
        for thing in osmium.FileProcessor(str(folder / "map.osm")):
            writer.add(thing)
    roads = whichroad.RoadMap.from_osm(folder / "city.osm.pbf")
    roads.save(folder / "city.map")
    roads.edges_table().to_file(folder / "roads.geojson")
    _write_drives(folder)
    return folder


def _write_drives(folder: Path) -> None:
    """The demo's fixes as tables: a drive, one with columns of its own, trips of a fleet."""
    fixes = whichroad.read_drive(folder / "drive.nmea")[0].fixes
    assert fixes is not None
    table = pd.DataFrame(
        {"time": pd.to_datetime(fixes.time, unit="s", utc=True), "lat": fixes.lat_deg,
         "lon": fixes.lon_deg}
    )  # fmt: skip
    table.to_csv(folder / "drive.csv", index=False)
    table.to_csv(folder / "mine.csv", index=False)
    own = {"time": "ts", "lat": "Latitude", "lon": "Longitude"}
    local = table.assign(time=table.time.dt.tz_convert("Europe/Berlin").dt.tz_localize(None))
    local.rename(columns=own).to_csv(folder / "own.csv", index=False)
    _write_gpx(folder / "drive.gpx", table)
    (folder / "tracks").mkdir()
    _write_gpx(folder / "tracks" / "morning.gpx", table[:100])
    _write_gpx(folder / "tracks" / "noon.gpx", table[150:250])
    trips = table.assign(trip_id=[f"trip {row // 60}" for row in range(len(table))])
    trips.to_parquet(folder / "trips.parquet")
    trips.to_csv(folder / "trips.csv", index=False)
    (folder / "lake" / "june").mkdir(parents=True)
    trips.assign(day="2026-06-01").to_parquet(folder / "lake" / "june" / "1.parquet")
    (folder / "days").mkdir()
    table.assign(vehicle="van").to_csv(folder / "days" / "1.csv", index=False)


def _write_gpx(path: Path, table: pd.DataFrame) -> None:
    points = "".join(
        f'<trkpt lat="{row.lat:.7f}" lon="{row.lon:.7f}">'
        f"<time>{row.time.isoformat()}</time></trkpt>"
        for row in table.itertuples()
    )
    path.write_text(
        '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">'
        f"<trk><trkseg>{points}</trkseg></trk></gpx>"
    )


@pytest.fixture
def place(stock: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A fresh copy of these files, as the working folder; `whichroad` and its Python are found."""
    folder = tmp_path / "place"
    shutil.copytree(stock, folder)
    programs = tmp_path / "bin"
    programs.mkdir()
    program = programs / "whichroad"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{MAIN}" "$@"\n')
    program.chmod(0o755)
    (programs / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    (programs / "python").chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def process(place: Path) -> Callable[[str], str]:
    """Runs a command as a shell does and gives what it printed."""

    def run(command: str) -> str:
        _clear(place, command)
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", command], capture_output=True, text=True,
            timeout=600, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        return done.stdout + done.stderr

    return run


@pytest.fixture
def shell(
    place: Path, process: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> Callable[[str], str]:
    """The same, without a process for each `whichroad` that needs none: they start slowly."""

    def run(command: str) -> str:
        words = shlex.split(command, comments=True)
        if words[0] != "whichroad" or words[1] in OWN_PROCESS or set(command) & set("*?|<>&;$"):
            return process(command)
        _clear(place, command)
        monkeypatch.setattr(sys, "argv", words)
        said = io.StringIO()
        with (
            contextlib.redirect_stdout(said), contextlib.redirect_stderr(said),
            pytest.raises(SystemExit) as stop,
        ):  # fmt: skip
            main()
        assert not stop.value.code, f"{command}\n{said.getvalue()}"
        return said.getvalue()

    return run


def _clear(place: Path, command: str) -> None:
    """Remove the files that a command writes: they may be there from before."""
    for option, value in itertools.pairwise(shlex.split(command, comments=True)):
        if option in OUTPUTS and (place / value).is_file():
            (place / value).unlink()
