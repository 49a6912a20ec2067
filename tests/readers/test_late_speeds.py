"""Speeds and courses that lag behind the places of their rows are moved to them."""

from collections import Counter

import numpy as np
import pytest

from whichroad.geodesy.units import METRES_PER_DEGREE
from whichroad.readers.late_speeds import Columns, delays, in_time
from whichroad.readers.reported_fixes import Reported, make_fixes
from whichroad.settings import Settings

LAT = 49.4


def drive(step: float = 1.0, seconds: float = 400.0, seed: int = 0) -> dict[str, np.ndarray]:
    """Speeds and turns of a town, places with the errors of a phone."""
    random = np.random.default_rng(seed)
    knots = np.arange(0.0, seconds + 20.0, 12.0)
    fine = np.arange(0.0, seconds, 0.01)
    speed = np.interp(fine, knots, random.uniform(0.0, 14.0, len(knots)))
    course = np.interp(fine, knots, np.cumsum(random.choice([0.0, 90.0, -90.0], len(knots))))
    every = slice(None, None, round(step / 0.01))
    east = np.cumsum(speed * np.sin(np.radians(course)))[every] * 0.01
    north = np.cumsum(speed * np.cos(np.radians(course)))[every] * 0.01
    time, speed, course = fine[every], speed[every], course[every]
    lat = LAT + (north + random.normal(0.0, 0.7, len(time))) / METRES_PER_DEGREE
    lon = (east + random.normal(0.0, 0.7, len(time))) / METRES_PER_DEGREE
    return {
        "time": time, "lat": lat, "lon": lon / np.cos(np.radians(LAT)),
        "speed": np.abs(speed + random.normal(0.0, 0.3, len(time))),
        "course": (course + random.normal(0.0, 3.0, len(time))) % 360.0,
    }  # fmt: skip


def late(values: np.ndarray, rows: int) -> np.ndarray:
    return np.concatenate([np.full(rows, values[0]), values[: len(values) - rows]])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("step", "of_speed", "of_course"),
    [
        (step, *late)
        for step, cases in (
            (0.2, [(0, 0), (2, 0), (4, 4), (6, 2), (10, 10)]),
            (1.0, [(0, 0), (2, 0), (4, 4), (6, 2), (10, 10)]),
            (2.0, [(0, 0), (4, 4), (10, 10)]),
        )
        for late in cases
    ],
)
def test_each_delay_is_found(seed: int, step: float, of_speed: int, of_course: int):
    d = drive(step, 1000.0, seed)
    speed = late(d["speed"], round(of_speed / step))
    course = late(d["course"], round(of_course / step))
    found = delays(d["time"], d["lat"], d["lon"], speed, course)
    assert found == pytest.approx((of_speed, of_course), abs=1.0 if step == 2.0 else 0.0)


def test_a_speed_that_tells_nothing_of_its_time_is_left():
    d = drive()
    even, far = np.full(400, 10.0), drive(5.0, 2000.0)
    assert delays(d["time"], d["lat"], d["lon"], even, None) == (0, 0)
    unlike = np.random.default_rng(9).uniform(0.0, 14.0, 400)
    assert delays(d["time"], d["lat"], d["lon"], unlike, None) == (0, 0)
    speed = late(far["speed"], 1)
    assert delays(far["time"], far["lat"], far["lon"], speed, far["course"]) == (0, 0)


def test_of_many_drives_those_that_are_late_are_moved_and_counted():
    drives = [drive(seed=k) for k in range(6)]
    for k in (1, 4):
        drives[k]["speed"] = late(drives[k]["speed"], 3)
    joined = {name: np.concatenate([d[name] for d in drives]) for name in drives[0]}
    joined["time"] += np.repeat(np.arange(6) * 1000.0, 400)
    columns = Columns(joined["speed"], None, joined["course"])
    place, skipped = (joined["lat"], joined["lon"]), Counter()
    moved = in_time(joined["time"], place, columns, np.arange(6) * 400, skipped)
    assert skipped == {"speed 3 s behind its place (moved there)": 800}
    for k in range(6):
        own = slice(400 * k, 400 * k + 397)
        np.testing.assert_array_equal(moved.speed[own], drive(seed=k)["speed"][:397])
    assert np.isnan(moved.speed[797:800]).all()
    np.testing.assert_array_equal(moved.course, joined["course"])


def test_fixes_have_the_speed_of_their_place():
    d = drive()
    told = Reported(
        d["time"], d["lat"], d["lon"], speed=late(d["speed"], 4), bearing_deg=late(d["course"], 4)
    )
    skipped: Counter[str] = Counter()
    fixes = make_fixes(told, Settings(), skipped)
    np.testing.assert_array_equal(fixes.speed[:390], d["speed"][:390])
    assert np.isinf(fixes.sigma_speed[396:]).all()
    assert skipped == {"speed 4 s behind its place (moved there)": 400}
