"""A folder as `whichroad simulate` writes it is a drive, with its car and its CAN signals."""

import shutil
import sys

import numpy as np
import pytest

import whichroad
from whichroad import cli
from whichroad.errors import ReadError
from whichroad.inspection import inspect_files
from whichroad.observations import WheelCounts
from whichroad.readers import read_drive, read_vehicle, vehicle_beside
from whichroad.simulate import draw_town, simulate_drive, write_drive

FILES = {"drive.nmea", "can.log"}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Two drives of one car that begin at the same time, each in its folder, and their map."""
    place = tmp_path_factory.mktemp("drives")
    (place / "town.osm").write_text(draw_town(), encoding="utf-8")
    roads = whichroad.RoadMap.from_osm(place / "town.osm")
    roads.save(place / "town.map")
    for seed in (1, 2):
        write_drive(simulate_drive(roads, seed=seed, length_m=8000.0), roads, place / f"d{seed}")
    return place


def odometry_of(place, name):
    """The same by naming each file."""
    folder = place / name
    (drive,) = read_drive(
        folder / "drive.nmea", can=folder / "can.log", dbc=folder / "vehicle.dbc",
        vehicle=read_vehicle(folder / "vehicle.toml"),
    )  # fmt: skip
    return drive


@pytest.mark.parametrize("by", ["folder", "files", "pattern"])
def test_a_simulated_folder_is_read_with_its_car_and_without_its_truth(place, by):
    folder = place / "d1"
    given = {"folder": folder, "files": list(folder.iterdir()), "pattern": f"{folder}/*"}[by]
    (drive,), wanted = read_drive(given), odometry_of(place, "d1")
    assert isinstance(drive.odometry, WheelCounts)
    assert np.array_equal(drive.odometry.left, wanted.odometry.left)
    assert np.array_equal(drive.fixes.lat_deg, wanted.fixes.lat_deg)
    assert {source.rpartition("/")[2] for source in drive.sources} == FILES
    assert "d1: vehicle.toml and vehicle.dbc of this folder used" in drive.notes
    assert "d1: truth.parquet left out: the truth of a simulated drive" in drive.notes
    assert vehicle_beside(given) == read_vehicle(folder / "vehicle.toml")


@pytest.mark.parametrize("by", ["folders", "files"])
def test_folders_of_one_time_are_drives_under_their_own_names(place, by):
    folders = [place / "d1", place / "d2"]
    files = [folder / name for folder in folders for name in sorted(FILES)]
    car = {"dbc": folders[0] / "vehicle.dbc", "vehicle": read_vehicle(folders[0] / "vehicle.toml")}
    drives = read_drive(folders) if by == "folders" else read_drive(files, **car)
    assert [drive.drive_id for drive in drives] == ["d1", "d2"]
    for drive in drives:
        wanted = odometry_of(place, drive.drive_id)
        assert np.array_equal(drive.odometry.right, wanted.odometry.right)
        assert np.array_equal(drive.fixes.lat_deg, wanted.fixes.lat_deg)


def test_files_of_one_name_belong_together_in_one_folder(place, tmp_path):
    for name in ("d1", "d2"):
        for file, suffix in (("drive.nmea", ".nmea"), ("can.log", ".log")):
            shutil.copy(place / name / file, tmp_path / f"{name}{suffix}")
        shutil.copy(place / name / "vehicle.dbc", tmp_path)
        shutil.copy(place / name / "vehicle.toml", tmp_path)
    drives = read_drive(tmp_path)
    assert [drive.drive_id for drive in drives] == ["d1", "d2"]
    for drive in drives:
        wanted = odometry_of(place, drive.drive_id)
        assert np.array_equal(drive.odometry.left, wanted.odometry.left)


def test_folders_of_different_cars_ask_for_one(place, tmp_path):
    shutil.copytree(place / "d2", tmp_path / "d2")
    text = (tmp_path / "d2" / "vehicle.toml").read_text()
    (tmp_path / "d2" / "vehicle.toml").write_text(text.replace('"right"', '"left"'))
    with pytest.raises(ReadError, match=r"another car than .*--vehicle FILE"):
        read_drive([place / "d1", tmp_path / "d2"])
    car = read_vehicle(place / "d1" / "vehicle.toml")
    notes = read_drive(tmp_path / "d2", vehicle=car)[0].notes
    assert "d2: vehicle.toml is not used; another vehicle was given" in notes


def test_what_is_missing_in_a_folder_is_said(place, tmp_path):
    shutil.copy(place / "d1" / "can.log", tmp_path)
    with pytest.raises(ReadError, match=r"can.log: a CAN log, and no .dbc is there; .*--dbc FILE"):
        read_drive(tmp_path)
    with pytest.raises(ReadError, match=r"vehicle.dbc\); a log or table was expected"):
        read_drive(place / "d1" / "vehicle.dbc")


def test_inspect_takes_no_truth_for_a_drive(place):
    folder = place / "d1"
    found = inspect_files([folder])
    assert f"match {folder} --map MAP" in found.command
    found = inspect_files(sorted(folder.iterdir()))
    assert "truth.parquet" not in found.command
    assert any("truth.parquet: the truth" in section.title for section in found.sections)
    options = {"can": folder / "can.log", "dbc": folder / "vehicle.dbc"}
    found = inspect_files([folder / "drive.nmea"], **options, vehicle=folder / "vehicle.toml")
    assert f"--can {folder / 'can.log'} --dbc {folder / 'vehicle.dbc'}" in found.command


def run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["whichroad", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code


def test_two_simulated_folders_calibrate_a_car(place, tmp_path, monkeypatch, capsys):
    out = tmp_path / "car.toml"
    folders = [place / "d1", place / "d2"]
    assert run(monkeypatch, "calibrate", *folders, "--map", place / "town.map", "-o", out) == 0
    assert "from 2 drives" in capsys.readouterr().out
    known, found = (read_vehicle(path) for path in (place / "d1" / "vehicle.toml", out))
    assert found.signals == known.signals  # so that CAN logs can be matched with the new file
    assert found.counter_bits == known.counter_bits
