"""Killed at any moment: the recording can be read, the restart resumes, a second is lost."""

import asyncio
import contextlib
import random
import time

import pytest

from live.service import Served, drive_files
from whichroad import match, read_drive, read_vehicle
from whichroad.evaluate.input_tables import read_table
from whichroad.live import server

pytestmark = pytest.mark.slow


def test_a_killed_service_resumes_and_its_recordings_are_readable(files, town, tmp_path):
    options = ("--map", files / "town.map", *drive_files(files / "drive"))
    options += ("--record", tmp_path / "rec", "--state", tmp_path / "state")
    car = read_vehicle(files / "drive" / "vehicle.toml")
    rng, position = random.Random(1), 0.0
    for number in range(4):
        served = Served(*options, "--speed", 5)
        resumed = served.until(lambda said: said["answered"])["play"]["position_s"]
        if number:
            assert resumed >= position - 5 * 1.0 - 0.5
        time.sleep(rng.uniform(0.8, 1.6))
        position = served.get("/estimate")["play"]["position_s"]
        served.kill()
        served.__exit__()
        (drive,) = read_drive(tmp_path / "rec", vehicle=car)
        begin = drive.odometry.time[0]
        assert drive.odometry.time[-1] - begin >= position - 5 * 1.0 - 0.5
        points = read_table(tmp_path / "rec")
        assert points.num_rows > 0
    matched = match(tmp_path / "rec", town, vehicle=car)
    assert matched.summary["epochs_without_answer"] < 10


def test_a_stopped_service_leaves_all_that_was(files, tmp_path):
    options = ("--map", files / "town.map", *drive_files(files / "drive"))
    with Served(*options, "--speed", "max", "--once", "--record", tmp_path / "rec") as served:
        served.process.wait(60)
        assert served.process.returncode == 0
    (drive,) = read_drive(tmp_path / "rec")
    (whole,) = read_drive(
        files / "drive" / "drive.nmea", can=files / "drive" / "can.log",
        dbc=files / "drive" / "vehicle.dbc",
        vehicle=read_vehicle(files / "drive" / "vehicle.toml"),
    )  # fmt: skip
    assert len(drive.fixes) == len(whole.fixes)
    assert len(drive.odometry.time) == len(whole.odometry.time)


def test_an_interrupted_service_ends_well(files):
    with Served("--map", files / "town.map", *drive_files(files / "drive")) as served:
        code, said = served.stop()
    assert code in (0, 130)
    assert "Traceback" not in said


def test_a_task_that_misses_its_end_once_is_ended_again():
    """As `asyncio.wait_for` of Python 3.11 may, where its result comes in the same moment."""

    async def deaf():
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.sleep(60.0)
        await asyncio.sleep(60.0)

    async def run():
        task = asyncio.create_task(deaf())
        await asyncio.sleep(0.01)
        await asyncio.wait_for(server._ended([task]), 10.0)
        return task.cancelled()

    assert asyncio.run(run())
