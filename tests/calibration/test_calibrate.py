"""A car's own drives tell its wheels, antenna and clock, and where they cannot, that is said."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtrit

from whichroad import DriveError, Vehicle, calibrate, cli, read_vehicle, simulate_drive
from whichroad.calibration.by_statistics import student_t
from whichroad.epochs import build_timeline
from whichroad.observations import SpeedYawRate, WheelSpeeds
from whichroad.settings import to_toml
from whichroad.simulate import PRESETS
from whichroad.simulate.drive_files import write_drive

LATE = 0.15  # s
CAR = replace(
    PRESETS["good"], metres_per_tick=0.0404 * 1.02, scale_sigma=0.0, differential_sigma=0.0,
    track_width=1.55, track_sigma=0.0, antenna_forward=1.5,
)  # fmt: skip


@pytest.fixture(scope="module")
def rides(town):
    """Drives of one car, whose receiver's clock is late."""
    made = [simulate_drive(town, seed=k, length_m=4000.0, scenario=CAR) for k in range(10)]
    return [
        replace(one, drive=replace(one.drive, fixes=replace(
            one.drive.fixes, time=one.drive.fixes.time + LATE)))
        for one in made
    ]  # fmt: skip


def test_wheels_antenna_and_clock_are_found(town, rides, tmp_path):
    found = calibrate([ride.drive for ride in rides], town)
    assert found.drives + found.held_out == 10
    assert found["odometer scale"].estimate == pytest.approx(1.02, abs=0.002)
    assert found["track width"].estimate == pytest.approx(1.55, abs=0.02)
    assert found["gnss clock offset"].estimate == pytest.approx(-LATE, abs=0.05)
    assert found.gain > 0.0
    assert found["odometer scale"].low < 1.02 < found["odometer scale"].high
    (tmp_path / "car.toml").write_text(found.to_toml(), encoding="utf-8")
    assert to_toml(read_vehicle(tmp_path / "car.toml")) == to_toml(found.vehicle)


def test_sensors_that_never_move_tell_nothing(town, rides):
    """A gyro that is always zero, and wheels that stand: no interval, and nothing is taken over."""
    for log in (
        lambda t: SpeedYawRate(t.time, t.speed, np.zeros(len(t.time))),
        lambda t: WheelSpeeds(t.time, np.zeros(len(t.time)), np.zeros(len(t.time))),
    ):
        drives = [replace(ride.drive, odometry=log(ride.truth)) for ride in rides[:4]]
        found = calibrate(drives, town)
        turning = [
            one for one in found.quantities if one.name.startswith(("gyro", "right", "track"))
        ]
        assert len(turning) == 2
        assert not any(one.told for one in turning)
        assert all(one.high == np.inf for one in turning)
    assert not found["odometer scale"].told


def test_a_gyro_s_bias_and_scale_are_found(town, rides):
    drives = []
    for ride in rides[:6]:
        truth = ride.truth
        rate = np.gradient(np.unwrap(truth.heading), truth.time) / 0.98 + 0.004
        log = SpeedYawRate(truth.time, truth.speed / 1.01, rate)
        drives.append(replace(ride.drive, odometry=log))
    found = calibrate(drives, town)
    assert found["odometer scale"].estimate == pytest.approx(1.01, abs=0.002)
    assert found["gyro scale"].estimate == pytest.approx(0.98, abs=0.01)
    assert found["gyro bias"].estimate == pytest.approx(0.004, abs=0.001)
    turn = build_timeline(drives[0], town.plane, found.vehicle).epochs.turn.sum()
    heading = np.unwrap(rides[0].truth.heading)
    assert turn == pytest.approx(heading[-1] - heading[0], abs=0.3)


@pytest.fixture(scope="module")
def long(town):
    """One long drive."""
    return simulate_drive(town, seed=77, length_m=20_000.0)


def test_what_the_data_cannot_tell_stays_as_it_was(town, long):
    found = calibrate(long.drive, town)
    assert not any(one.told for one in found.quantities)
    assert to_toml(found.vehicle) == to_toml(Vehicle())
    assert "the data cannot tell" in found.to_toml()


def test_drives_without_odometry_or_off_the_map_are_refused_with_their_reasons(town, rides):
    bare = replace(rides[0].drive, odometry=None)
    away = replace(rides[0].drive, fixes=replace(
        rides[0].drive.fixes, lat_deg=rides[0].drive.fixes.lat_deg + 5.0))  # fmt: skip
    with pytest.raises(DriveError, match="no odometry: 1, fixes off the map: 1"):
        calibrate([bare, away], town)


def test_the_command_writes_a_car(town, long, tmp_path, monkeypatch, capsys):
    write_drive(long, town, tmp_path / "drive")
    town.save(tmp_path / "town.map")
    folder = tmp_path / "drive"
    arguments = [
        "calibrate", folder / "drive.nmea", "--can", folder / "can.log", "--dbc",
        folder / "vehicle.dbc", "--vehicle", folder / "vehicle.toml", "--map",
        tmp_path / "town.map", "-o", tmp_path / "car.toml",
    ]  # fmt: skip
    for code, text in ((0, "from 1 drive"), (1, "exists already")):
        monkeypatch.setattr(sys, "argv", ["whichroad", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        said = capsys.readouterr()
        assert stop.value.code == code
        assert text in said.out + said.err
    assert read_vehicle(tmp_path / "car.toml") == read_vehicle(folder / "vehicle.toml")


def test_the_quantile_of_student_s_t_is_scipy_s():
    for freedom in (1, 2, 3, 4, 9, 30, 99):
        assert student_t(freedom) == pytest.approx(stdtrit(freedom, 0.975), rel=1e-12)
