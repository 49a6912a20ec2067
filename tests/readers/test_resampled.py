"""Rows that were made up from others are no measurements: lines, held values, zeros for none."""

import numpy as np
import pandas as pd
import pytest

from whichroad.geodesy.plane import Plane
from whichroad.observations import HELD_COURSE, HELD_SPEED, INTERPOLATED, ZERO_SPEED, Fixes
from whichroad.readers import read_drive
from whichroad.readers.drive_tables import drive_from_table

T0 = 1.7e9
PLANE = Plane(49.4, 8.7)


def driven(n: int = 400, every: float = 1.0, sigma: float = 1.0, seed: int = 0) -> pd.DataFrame:
    """A vehicle that speeds up, slows down, stands for half a minute and turns."""
    rng = np.random.default_rng(seed)
    time = every * np.arange(n)
    speed = np.maximum(9.0 + 8.0 * np.sin(time / 17.0), 0.0)
    speed[(time > 200.0) & (time < 232.0)] = 0.0
    course = np.radians(90.0 * np.round(2.0 * np.sin(time / 40.0)))
    x, y = np.cumsum(every * speed * np.array([np.sin(course), np.cos(course)]), axis=1)
    x, y = np.array([x, y]) + rng.normal(0.0, sigma, (2, n))
    lat, lon = PLANE.to_geodetic(x, y)
    told = np.maximum(speed + rng.normal(0.0, 0.2, n), 0.0) * (speed > 0.0)
    return pd.DataFrame(
        {
            "time": T0 + time,
            "lat": lat,
            "lon": lon,
            "sigma_m": 3.0,
            "speed_mps": told.round(2),
            "bearing_deg": (np.degrees(course) + rng.normal(0.0, 2.0, n)) % 360.0,
        }
    )


def held(frame: pd.DataFrame, column: str, every: int) -> pd.DataFrame:
    rows = np.arange(len(frame)) // every * every
    return frame.assign(**{column: frame[column].to_numpy()[rows]})


def interpolated(
    frame: pd.DataFrame, every: int, decimals: int = 15, shift: float = 0.0
) -> pd.DataFrame:
    """Places of which only some were measured, on lines between these."""
    time = frame.time.to_numpy()
    made = frame.drop(columns=["speed_mps", "bearing_deg"])
    for name in ("lat", "lon"):
        column = np.interp(time, time[::every] + shift, frame[name][::every])
        made[name] = column.round(decimals)
    return made


def read(frame: pd.DataFrame) -> tuple[Fixes, list[str]]:
    (drive,) = drive_from_table(frame)
    assert drive.fixes is not None
    assert len(drive.fixes) == len(frame)
    return drive.fixes, list(drive.notes)


@pytest.mark.parametrize(("every", "decimals"), [(5, 15), (10, 15), (30, 15), (10, 7), (30, 6)])
def test_places_on_lines_between_fixes_are_no_fixes_and_counted(put, every, decimals):
    frame = interpolated(driven(1200), every, decimals)
    fixes, (note,) = read(frame)
    made = (fixes.flags & INTERPOLATED) > 0
    real = np.arange(len(frame)) % every == 0
    assert not made[real].any() or made[real].mean() < 0.03  # such as one on the line by chance
    moved = np.diff(fixes.lat_deg, prepend=0.0) != 0.0
    assert made[~real & moved].all()
    assert note.startswith(f"places of {made.sum():,} of 1,200 rows lie on the lines")
    (drive,) = read_drive(put("a.csv", frame.to_csv(index=False)))
    assert drive.fixes.flags.tolist() == fixes.flags.tolist()
    assert note in drive.notes


@pytest.mark.parametrize("every", [10, 30, 60])
@pytest.mark.parametrize("seed", [0, 1])
def test_lines_are_found_in_places_of_five_decimals(put, every, seed):
    frame = interpolated(driven(1200, seed=seed), every, 5)
    fixes, (note,) = read(frame)
    made = (fixes.flags & INTERPOLATED) > 0
    between = np.arange(len(frame)) % every > 0
    moves = np.abs(np.diff(fixes.lat_deg, prepend=0.0)) > 1.5e-5
    assert made[between & moves].mean() > 0.8
    assert (~made).sum() >= len(frame) / every  # each bend has its fix, or one beside it
    assert note.startswith(f"places of {made.sum():,} of 1,200 rows lie on the lines")
    (drive,) = read_drive(put("a.csv", frame.to_csv(index=False)))
    assert drive.fixes.flags.tolist() == fixes.flags.tolist()


def test_fixes_between_the_rows_leave_two_rows_at_each_bend():
    fixes, _ = read(interpolated(driven(1200), 10, shift=0.4))
    made = (fixes.flags & INTERPOLATED) > 0
    assert 0.75 < made.mean() < 0.85


def test_rows_at_the_end_that_repeat_the_last_fix_are_no_fixes():
    fixes, _ = read(interpolated(driven(1208), 10))
    assert ((fixes.flags & INTERPOLATED) > 0)[-7:].all()
    assert not fixes.flags[-8]


def smooth(decimals: int) -> pd.DataFrame:
    """A receiver of ten fixes a second without noise."""
    return driven(3000, 0.1, 0.0).round({"lat": decimals, "lon": decimals})


def straight(n: int) -> pd.DataFrame:
    """A computed drive around corners, at one speed."""
    at = 12.0 * np.arange(n)
    line = np.arange(n // 20 + 2) * 230.0
    x, y = (
        np.interp(at, line, 115.0 * np.arange(len(line))),
        np.interp(at, line, 200.0 * (np.arange(len(line)) % 2)),
    )
    lat, lon = PLANE.to_geodetic(x, y)
    return pd.DataFrame({"time": T0 + np.arange(n), "lat": lat, "lon": lon, "sigma_m": 3.0})


@pytest.mark.parametrize(
    "frame",
    [driven(), driven().round(6), driven().round(5), smooth(15), smooth(7), smooth(6), smooth(5),
     driven(1200, 1.0, 0.0).round(5), driven(1200, 1.0, 0.1).round(5), straight(800).round(5),
     straight(800), straight(800).round(7), interpolated(driven(19), 5),
     driven().assign(lat=49.4), interpolated(driven(200), 90)],
)  # fmt: skip
def test_what_was_measured_or_computed_is_left_as_it_is(frame):
    fixes, notes = read(frame)
    assert not fixes.flags.any()
    assert notes == []


@pytest.mark.parametrize("every", [3, 5, 10])
def test_of_speeds_that_are_held_the_first_is_used(every):
    frame = driven()
    fixes, (note,) = read(held(frame, "speed_mps", every))
    known = np.isfinite(fixes.sigma_speed)
    first = np.arange(len(frame)) % every == 0
    moves = frame.speed_mps.to_numpy() > 3.0
    assert known[first & moves].all()
    assert not known[~first & moves].any()
    assert fixes.speed[first & moves].tolist() == frame.speed_mps[first & moves].tolist()
    assert ((fixes.flags & HELD_SPEED) > 0).tolist() == (~known).tolist()
    assert note.startswith(f"speeds of {(~known).sum()} of 400 rows repeat the row before")
    courses = np.isfinite(fixes.sigma_bearing_deg)  # these are measured every second
    assert courses[moves].mean() > 0.95


@pytest.mark.parametrize("every", [5, 10])
def test_of_courses_that_are_held_the_first_is_used(every):
    frame = driven()
    fixes, (note,) = read(held(frame, "bearing_deg", every))
    known = np.isfinite(fixes.sigma_bearing_deg)
    first = np.arange(len(frame)) % every == 0
    fast = frame.speed_mps.to_numpy() > 3.0
    assert known[first & fast].all()
    assert not known[~first].any()
    assert np.isfinite(fixes.sigma_speed).all()
    assert ((fixes.flags & HELD_COURSE) > 0).tolist() == (~first).tolist()
    assert note.startswith("courses of ")


def test_a_vehicle_that_stands_keeps_its_speed_of_0_but_for_the_last():
    frame = held(driven(), "speed_mps", 5)
    fixes, _ = read(frame)
    standing = (frame.time > T0 + 205.0) & (frame.time < T0 + 234.5)  # driving is told then
    known = np.isfinite(fixes.sigma_speed[standing])
    assert known.tolist() == [True] * 25 + [False] * 4


@pytest.mark.parametrize("every", [0.1, 1.0])
def test_speeds_and_courses_in_whole_units_are_not_held(every):
    frame = driven(2000, every)
    frame["speed_kmh"] = (3.6 * frame.pop("speed_mps")).rolling(5, 1).mean().round()
    frame["bearing_deg"] = frame.bearing_deg.rolling(9, 1).median().round()
    fixes, notes = read(frame)
    assert not fixes.flags.any()
    assert not notes


def test_speeds_of_0_while_driving_are_none_and_counted():
    frame = driven()
    zero = np.random.default_rng(3).random(len(frame)) < 0.5
    fixes, (note,) = read(frame.assign(speed_mps=np.where(zero, 0.0, frame.speed_mps)))
    unknown = np.isinf(fixes.sigma_speed)
    assert unknown[zero].all()
    assert unknown.tolist() == ((fixes.flags & ZERO_SPEED) > 0).tolist()
    assert np.isinf(fixes.sigma_bearing_deg[unknown]).all()
    assert note.startswith(f"speeds of 0 in {unknown.sum()} of 400 rows are not used")


def pulled(pace: float, sigma: float) -> pd.DataFrame:
    """A vehicle that stands for half a minute while its fixes go away and come back."""
    frame = driven(sigma=sigma)
    away = np.interp(frame.time - T0, [200.0, 216.0, 232.0], [0.0, 16.0 * pace, 0.0])
    return frame.assign(lat=frame.lat + away / 111_195.0)


@pytest.mark.parametrize("frame", [pulled(10.0, 1.0), pulled(0.0, 30.0), pulled(2.0, 10.0)])
def test_speeds_of_0_are_believed_where_only_fixes_move(frame):
    fixes, notes = read(frame)
    assert not fixes.flags.any()
    assert not notes
    zero = frame.speed_mps.to_numpy() == 0.0
    assert np.isfinite(fixes.sigma_speed[zero]).all()


def test_a_few_zeros_are_left_to_the_filter():
    frame = driven()
    frame.loc[[5, 100], "speed_mps"] = 0.0
    fixes, notes = read(frame)
    assert not fixes.flags.any()
    assert not notes
