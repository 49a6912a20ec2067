"""Units that nobody named: taken as what fits the places and what a car can do, and said."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.observations import Odometer, SpeedYawRate, WheelSpeeds
from whichroad.readers import drive_from_table, read_drive
from whichroad.readers.odometry_fit import with_fit_notes
from whichroad.settings import Vehicle

from .driving import T0, N, town

UNITS = {"m/s": 1.0, "km/h": 3.6, "knots": 3600 / 1852, "mph": 1 / 0.44704}


def one(frame, **options):
    (drive,) = drive_from_table(frame.drop(columns=["true_speed", "true_yaw"]), **options)
    return drive


@pytest.mark.parametrize("unit", UNITS)
@given(st.integers(0, 2**31), st.sampled_from([0.2, 1.0, 5.0, 10.0]), st.floats(0.0, 4.0))
def test_a_speed_without_a_unit_is_in_that_which_fits_the_places(unit, seed, step, noise):
    frame = town(seed, n=max(N, round(N / step)), step=step, noise=noise)
    drive = one(frame.assign(speed=UNITS[unit] * frame.true_speed))
    known = np.isfinite(drive.fixes.sigma_speed)
    if known.any():  # else it was not sure, and said so
        assert drive.fixes.speed[known] == pytest.approx(frame.true_speed[known], abs=1e-6)
    said = " ".join(drive.notes)
    assert ("taken in" in said or "not used" in said) == (unit != "m/s" or not known.any())


@pytest.mark.parametrize("unit", UNITS)
def test_a_speed_every_second_is_told_for_sure(unit):
    for seed in range(20):
        frame = town(seed)
        drive = one(frame.assign(speed=UNITS[unit] * frame.true_speed))
        assert drive.fixes.speed == pytest.approx(frame.true_speed.to_numpy())


@pytest.mark.parametrize("unit", UNITS)
def test_a_speed_every_minute_is_right_or_not_used(unit):
    for seed in range(20):
        frame = town(seed, step=60.0, n=60)
        drive = one(frame.assign(speed=UNITS[unit] * frame.true_speed))
        known = np.isfinite(drive.fixes.sigma_speed)
        assert drive.fixes.speed[known] == pytest.approx(frame.true_speed[known])


def test_a_speed_that_fits_no_unit_is_not_used_and_it_is_said():
    frame = town()
    drive = one(frame.assign(speed=0.2 * frame.true_speed))
    assert not np.isfinite(drive.fixes.sigma_speed).any()
    assert any("fits no unit for sure; name it in its unit" in note for note in drive.notes)


@pytest.mark.parametrize("name", ["speed_kmh", "Speed (km/h)", "speed [km/h]", "velocity_kmh"])
def test_a_unit_that_is_named_is_believed_without_a_word(name):
    frame = town()
    drive = one(frame.assign(**{name: 3.6 * frame.true_speed}))
    assert drive.fixes.speed == pytest.approx(frame.true_speed.to_numpy())
    assert drive.notes == ()


def test_all_vehicles_of_a_table_have_one_unit():
    frames = [town(k).assign(vehicle_id=f"{k}") for k in range(3)]
    short = town(3, n=4).assign(vehicle_id="short")
    frame = pd.concat([*frames, short])
    frame = frame.assign(speed=3.6 * frame.true_speed)
    drives = drive_from_table(frame.drop(columns=["true_speed", "true_yaw"]))
    assert drives[3].fixes.speed == pytest.approx(short.true_speed.to_numpy())


def test_wheel_speeds_without_a_unit_are_in_that_which_fits_the_places():
    frame = town()
    drive = one(frame.assign(rl=3.6 * frame.true_speed, rr=3.6 * frame.true_speed))
    assert isinstance(drive.odometry, WheelSpeeds)
    assert drive.odometry.left == pytest.approx(frame.true_speed.to_numpy())
    assert any("'rl' taken in km/h" in note for note in drive.notes)


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("km", 1e3), ("miles", 1609.344)])
def test_an_odometer_without_a_unit_is_in_that_which_fits_the_places(unit, metres):
    frame = town(noise=0.0)
    way = np.cumsum(frame.true_speed)
    drive = one(frame.assign(odometer=1e5 + way / metres))
    assert isinstance(drive.odometry, Odometer)
    driven = drive.odometry.distance - drive.odometry.distance[0]
    assert driven == pytest.approx((way - way[0]).to_numpy(), abs=1e-3)
    assert any(f"taken in {unit}" in note for note in drive.notes) == (unit != "m")


@pytest.mark.parametrize(("name", "factor"), [
    ("yaw_rate", 180 / np.pi), ("yaw_rate", 1.0), ("Yaw rate (Grad/s)", 180 / np.pi),
    ("yaw_rate_degps", 180 / np.pi), ("yaw_rate_radps", 1.0),
])  # fmt: skip
def test_a_yaw_rate_that_no_car_could_reach_in_radians_is_in_degrees(name, factor):
    frame = town()
    drive = one(frame.assign(speed_mps=frame.true_speed, **{name: factor * frame.true_yaw}))
    assert isinstance(drive.odometry, SpeedYawRate)
    assert drive.odometry.yaw_rate == pytest.approx(frame.true_yaw.to_numpy())


def test_a_yaw_rate_that_says_radians_and_means_degrees_is_named():
    frame = town()
    degrees = np.degrees(frame.true_yaw)
    drive = one(frame.assign(speed_mps=frame.true_speed, yaw_rate_radps=degrees))
    assert any("is it in degrees/s?" in note for note in drive.notes)


@pytest.mark.parametrize("late", [2.0, -2.0, 1.0])
def test_odometry_two_seconds_off_is_named_within_a_minute(tmp_path, late):
    for seed in range(10):
        frame = town(seed, n=60)
        frame[["time", "lat", "lon"]].to_csv(tmp_path / "gnss.csv", index=False)
        wheels = town(seed, n=600, step=0.1)
        wheels = pd.DataFrame({"time": wheels.time + late, "wheel_rl_mps": wheels.true_speed,
                               "wheel_rr_mps": wheels.true_speed})  # fmt: skip
        wheels.to_csv(tmp_path / "wheels.csv", index=False)
        (drive,) = read_drive([tmp_path / "gnss.csv", tmp_path / "wheels.csv"])
        said = [note for note in drive.notes if note.startswith("odometry seems to be")]
        assert len(said) == 1, seed
        offset = float(said[0].partition("odometry = ")[2].split()[0])
        assert offset == pytest.approx(-late, abs=0.5)
        car = Vehicle(clock_offset={"odometry": offset})
        (drive,) = read_drive([tmp_path / "gnss.csv", tmp_path / "wheels.csv"], vehicle=car)
        assert not any("seems to be" in note for note in drive.notes)


def test_odometry_on_the_fixes_clock_is_not_accused(tmp_path):
    for seed in range(40):
        frame = town(seed, n=90, noise=3.0)
        drive = one(frame.assign(odometer_m=np.cumsum(frame.true_speed)))
        assert drive.notes == (), seed


def test_odometry_that_covers_a_part_of_the_drive_is_said(tmp_path):
    frame = town()
    way = np.cumsum(frame.true_speed).where(np.arange(N) < 0.18 * N)
    drive = one(frame.assign(odometer_m=way))
    assert any("odometry covers 18 % of the time" in note for note in drive.notes)


def test_odometry_whose_scale_is_wrong_is_named():
    frame = town()
    drive = one(frame.assign(odometer_m=3.6 * np.cumsum(frame.true_speed)))
    assert any("odometry says 3.7 times the distance" in note for note in drive.notes)
    assert any("is its unit, or metres_per_tick" in note for note in drive.notes)


@pytest.mark.parametrize(("factor", "unit"), [(3.6, "km/h"), (2.237, "mph")])
def test_wheel_speeds_that_fit_in_another_unit_are_asked_for_it(factor, unit):
    frame = town()
    drive = one(frame)
    speed = factor * frame.true_speed.to_numpy()
    odometry = WheelSpeeds(drive.fixes.time, speed, speed)
    noted = with_fit_notes(replace(drive, odometry=odometry), Vehicle())
    assert any(f"; is its speed in {unit}?" in note for note in noted.notes)


@pytest.mark.parametrize("factor", [3.6, 1.0])
def test_a_speed_whose_name_says_another_unit_is_named(tmp_path, factor):
    for seed in range(10):
        frame = town(seed)
        frame.assign(speed_mps=factor * frame.true_speed).to_csv(tmp_path / "a.csv", index=False)
        (drive,) = read_drive(tmp_path / "a.csv")
        said = [note for note in drive.notes if note.startswith("speeds of the fixes are 3.")]
        assert len(said) == (factor != 1.0)


@pytest.mark.parametrize("factor", [3.6, 1.0])
@pytest.mark.parametrize("step", [10.0, 20.0, 30.0])
def test_a_table_whose_speed_is_not_in_the_unit_of_its_name_is_told_at_sparse_fixes(factor, step):
    for seed in range(10):
        frames = [town(10 * seed + k, n=60, step=step).assign(vehicle_id=f"{k}") for k in range(5)]
        frame = pd.concat(frames)
        frame = frame.assign(speed_mps=factor * frame.true_speed)
        drives = drive_from_table(frame.drop(columns=["true_speed", "true_yaw"]))
        for drive in drives:
            said = [note for note in drive.notes if "as one in km/h is" in note]
            assert len(said) == (factor != 1.0)
            assert np.isfinite(drive.fixes.sigma_speed).any() == (factor == 1.0)


def test_a_speed_of_traccar_is_in_knots_and_one_of_owntracks_in_kmh():
    frame = town(n=4)  # too short to tell by its places
    traccar = frame.rename(columns={"time": "fixTime"}).assign(deviceId="a", deviceTime=0)
    drive = one(traccar.assign(speed=UNITS["knots"] * frame.true_speed))
    assert drive.fixes.speed == pytest.approx(frame.true_speed.to_numpy())
    drive = one(frame.rename(columns={"time": "tst"}).assign(vel=3.6 * frame.true_speed, acc=5.0))
    assert drive.fixes.speed == pytest.approx(frame.true_speed.to_numpy())


@pytest.mark.parametrize("unit", UNITS)
def test_the_places_decide_against_a_tools_usual_unit(unit):
    frame = town()
    table = frame.rename(columns={"time": "datetime", "lat": "latitude", "lon": "longitude"})
    drive = one(table.assign(device="phone", speed=UNITS[unit] * frame.true_speed))  # as Geotab's
    assert drive.fixes.speed == pytest.approx(frame.true_speed.to_numpy())
    assert bool(drive.notes) == (unit != "km/h")


DBC = """VERSION ""
BU_: Car
BO_ 931 Motion: 8 Car
 SG_ Speed : 0|16@1+ (0.01,0) [0|0] "{speed}" Car
 SG_ YawRate : 16|16@1- (0.01,0) [0|0] "{yaw}" Car
"""


@pytest.mark.parametrize(("speed", "kmh"), [("km/h", 36), ("Km/h", 36), ("KPH", 36), ("kn", 19.44)])
@pytest.mark.parametrize("yaw", ["Grad/s", "°/s", "deg/sec", "DPS", "", "furlong"])
def test_units_of_a_dbc_are_understood_as_people_write_them(put, speed, kmh, yaw):
    payload = round(100 * kmh).to_bytes(2, "little") + (1800).to_bytes(2, "little") + bytes(4)
    log = "".join(f"({T0 + 0.1 * k:.6f}) can0 3A3#{payload.hex()}\n" for k in range(50))
    dbc = put("car.dbc", DBC.format(speed=speed, yaw=yaw))
    car = Vehicle(signals={"speed": "Speed", "yaw_rate": "YawRate"})
    (drive,) = read_drive([], can=put("can.log", log), dbc=dbc, vehicle=car)
    assert drive.odometry.speed == pytest.approx(10.0, abs=2e-3)
    assert drive.odometry.yaw_rate == pytest.approx(np.radians(18.0))
    assert bool(drive.notes) == (yaw in ("", "furlong"))
