"""Rows that were made up from others are no measurements: lines, held values, zeros for none."""

import numpy as np
import pandas as pd
import pytest

from whichroad.geodesy.plane import Plane
from whichroad.observations import INTERPOLATED, Fixes
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
    [driven(), driven().round(6), driven().round(5), smooth(15), smooth(7), smooth(6),
     straight(800), straight(800).round(7), interpolated(driven(19), 5),
     driven().assign(lat=49.4), interpolated(driven(200), 90)],
)  # fmt: skip
def test_what_was_measured_or_computed_is_left_as_it_is(frame):
    fixes, notes = read(frame)
    assert not fixes.flags.any()
    assert notes == []
