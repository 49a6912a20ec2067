"""Speeds in steps of whole units, cut or rounded, and courses in few directions."""

from collections import Counter

import numpy as np
import pandas as pd
import pytest

from whichroad.geodesy.units import KNOT, METRES_PER_DEGREE, MPH
from whichroad.observations import COARSE_COURSE, CUT_SPEED, SIGMA_SPEED, Fixes
from whichroad.readers.drive_tables import drive_from_table
from whichroad.readers.regular_trips import batched_fixes
from whichroad.readers.reported_fixes import Reported, make_fixes
from whichroad.settings import Settings

LAT = 49.4


def drive(seconds: int = 600, every: int = 1, seed: int = 0) -> dict[str, np.ndarray]:
    """Speeds and bends of a town with stops, places with the errors of a phone."""
    random = np.random.default_rng(seed)
    fine = np.arange(0.0, seconds, 0.1)
    knots = np.arange(0.0, seconds + 20.0, 15.0)
    speed = np.clip(np.interp(fine, knots, random.uniform(-3.0, 16.0, len(knots))), 0.0, None)
    course = np.interp(fine, knots, np.cumsum(random.uniform(-80.0, 80.0, len(knots))))
    east = np.cumsum(speed * np.sin(np.radians(course)))[:: 10 * every] * 0.1
    north = np.cumsum(speed * np.cos(np.radians(course)))[:: 10 * every] * 0.1
    time, speed, course = fine[:: 10 * every], speed[:: 10 * every], course[:: 10 * every]
    lat = LAT + (north + random.normal(0.0, 0.7, len(time))) / METRES_PER_DEGREE
    east = (east + random.normal(0.0, 0.7, len(time))) / np.cos(np.radians(LAT))
    told = speed + random.normal(0.0, 0.3, len(time)) * (speed > 0.0)
    return {
        "time": 1.7e9 + time, "lat": lat, "lon": 8.7 + east / METRES_PER_DEGREE,
        "speed": np.maximum(told, 0.0).round(2),
        "course": ((course + random.normal(0.0, 3.0, len(time))) % 360.0).round(1),
    }  # fmt: skip


def fixes_of(d: dict[str, np.ndarray], sigma_speed: float | None = None) -> Fixes:
    sigma = None if sigma_speed is None else np.full(len(d["time"]), sigma_speed)
    told = Reported(
        d["time"], d["lat"], d["lon"], speed=d["speed"], sigma_speed=sigma, bearing_deg=d["course"]
    )
    return make_fixes(told, Settings(), Counter())


@pytest.mark.parametrize("step", [1.0, KNOT, MPH, 5 / 3.6])
def test_the_step_of_rounded_speeds_is_in_their_sigma(step: float):
    d = drive()
    d["speed"] = np.round(d["speed"] / step) * step
    fixes = fixes_of(d)
    assert fixes.sigma_speed == pytest.approx(np.hypot(SIGMA_SPEED, step / 12**0.5), rel=1e-6)
    np.testing.assert_array_equal(fixes.speed, d["speed"])
    assert not fixes.flags[fixes.flags >= CUT_SPEED].size
    assert fixes_of(d, 0.9).sigma_speed == pytest.approx(0.9)  # which has it already


@pytest.mark.parametrize("step", [1.0, KNOT, MPH])
@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("decimals", [15, 2])
def test_cut_speeds_get_half_a_step_back(step: float, every: int, decimals: int):
    d = drive(1200, every)
    d["speed"] = (np.floor(d["speed"] / step) * step).round(decimals)
    fixes = fixes_of(d)
    moves = d["speed"] > 0.0
    assert fixes.speed[moves] == pytest.approx(d["speed"][moves] + step / 2, abs=1e-3)
    assert not fixes.speed[~moves].any()
    np.testing.assert_array_equal((fixes.flags & CUT_SPEED) > 0, moves)


@pytest.mark.parametrize("seed", range(20))
def test_rounded_and_fine_speeds_are_not_taken_for_cut_ones(seed: int):
    d = drive(400, seed=seed)
    fine = fixes_of(d)
    assert fine.sigma_speed == pytest.approx(SIGMA_SPEED)
    for step in (1.0, MPH):
        rounded = d | {"speed": np.round(d["speed"] / step) * step}
        np.testing.assert_array_equal(fixes_of(rounded).speed, rounded["speed"])


@pytest.mark.parametrize(("directions", "decimals"), [(8, 1), (16, 1), (16, 0)])
def test_courses_in_few_directions_are_not_used(directions: int, decimals: int):
    d, step = drive(), 360.0 / directions
    d["course"] = (np.round(d["course"] / step) * step % 360.0).round(decimals)
    fixes = fixes_of(d)
    assert np.isinf(fixes.sigma_bearing_deg).all()
    used = d["speed"] > 1.0
    np.testing.assert_array_equal((fixes.flags & COARSE_COURSE) > 0, used)


def test_the_step_of_a_course_is_in_its_sigma():
    d = drive()
    fine = fixes_of(d).sigma_bearing_deg
    d["course"] = np.round(d["course"] / 10.0) * 10.0 % 360.0
    assert fixes_of(d).sigma_bearing_deg == pytest.approx(np.hypot(fine, 10.0 / 12**0.5))
    d["course"] = drive()["course"].round() % 360.0
    np.testing.assert_array_equal(fixes_of(d).sigma_bearing_deg, fine)


def test_a_table_of_trips_is_read_as_each_alone_and_says_so():
    import pyarrow as pa

    drives = [drive(500 + 50 * k, seed=k) for k in range(4)]
    drives[1]["speed"] = np.floor(drives[1]["speed"])
    drives[2]["course"] = np.round(drives[2]["course"] / 45.0) * 45.0 % 360.0
    frames = [
        pd.DataFrame(d).rename(columns={"speed": "speed_mps", "course": "bearing_deg"})
        for d in drives
    ]
    first = np.cumsum([0, *(len(f) for f in frames)])
    together = batched_fixes(pa.Table.from_pandas(pd.concat(frames)), first[:-1], Settings())
    assert together is not None
    assert together.regular.all()
    for k, frame in enumerate(frames):
        (alone,) = drive_from_table(frame)
        own = slice(first[k], first[k + 1])
        for name in ("speed", "sigma_speed", "sigma_bearing_deg", "flags"):
            np.testing.assert_array_equal(
                getattr(together.fixes, name)[own], getattr(alone.fixes, name)
            )
        notes = together.notes.get(k, ())
        assert notes == alone.notes
        assert len(notes) == (k in (1, 2))
    assert together.notes[1][0].startswith("speeds are in steps of 1 m/s and lie half a step below")
    assert together.notes[2][0].startswith("courses are in steps of 45 degrees, and those of")
