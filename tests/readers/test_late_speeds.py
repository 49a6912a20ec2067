"""Speeds and courses that lag behind the places of their rows are moved to them, or these."""

from collections import Counter

import numpy as np
import pytest

from whichroad.geodesy.units import METRES_PER_DEGREE
from whichroad.observations import LATE_PLACE
from whichroad.readers.late_places import Places
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
    skipped: Counter[str] = Counter()
    places = Places(joined["lat"], joined["lon"], *np.ones((3, 2400)), np.zeros(2400, np.bool_))
    same, moved = in_time(joined["time"], places, columns, np.arange(6) * 400, skipped)
    assert same is places
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


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("step", "seconds"),
    [*((step, seconds) for step in (0.2, 1.0) for seconds in (2, 4, 6, 10)), (2.0, 4), (2.0, 10)],
)
@pytest.mark.parametrize("courses_too", [False, True])
def test_places_that_are_late_beside_the_speeds_are_found(seed, step, seconds, courses_too):
    d, rows = drive(step, 1000.0, seed), round(seconds / step)
    course = late(d["course"], rows) if courses_too else d["course"]
    found = delays(d["time"], late(d["lat"], rows), late(d["lon"], rows), d["speed"], course)
    assert found.speed == pytest.approx(-seconds, abs=1.0 if step == 2.0 else 0.0)
    assert found.course == (-found.speed if courses_too else 0)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("step", [0.2, 1.0, 2.0])
def test_of_sound_drives_nothing_is_moved(seed, step):
    d = drive(step, 1000.0, seed)
    assert delays(d["time"], d["lat"], d["lon"], d["speed"], d["course"]) == (0, 0)
    even = np.full(len(d["time"]), 10.0)
    assert delays(d["time"], late(d["lat"], 4), late(d["lon"], 4), even, None) == (0, 0)


def lagging(d: dict[str, np.ndarray], rows: int = 4) -> Reported:
    error = late(np.arange(400.0) / 100.0 + 1.0, rows)
    return Reported(
        d["time"], late(d["lat"], rows), late(d["lon"], rows), cov_ee=error, cov_en=0.0 * error,
        cov_nn=error, speed=d["speed"], bearing_deg=late(d["course"], rows),
    )  # fmt: skip


def test_late_places_and_their_errors_and_courses_are_moved_to_the_speeds():
    d, skipped = drive(), Counter()
    fixes = make_fixes(lagging(d), Settings(), skipped)
    assert len(fixes) == 400
    np.testing.assert_array_equal(fixes.speed, d["speed"])
    for name in ("lat", "lon"):
        moved = getattr(fixes, f"{name}_deg")
        np.testing.assert_allclose(moved[:396], d[name][:396], atol=1e-12)
        np.testing.assert_allclose(moved[396:], d[name][395], atol=1e-12)
    np.testing.assert_allclose(fixes.cov_nn[:396], np.arange(396) / 100.0 + 1.0)
    known = np.isfinite(fixes.sigma_bearing_deg)
    np.testing.assert_array_equal(fixes.bearing_deg[known], d["course"][known])
    assert known[:396].mean() > 0.8
    assert np.flatnonzero(fixes.flags & LATE_PLACE).tolist() == [396, 397, 398, 399]
    assert skipped == {"place 4 s behind its speed (moved there)": 400}


def test_across_a_gap_no_place_is_known():
    d = drive()
    told = lagging(d).rows(np.delete(np.arange(400), np.arange(200, 220)))
    fixes = make_fixes(told, Settings(), Counter())
    row = np.round(fixes.time).astype(int)
    assert row[(fixes.flags & LATE_PLACE) > 0].tolist() == [196, 197, 198, 199, *range(396, 400)]
    known = (fixes.flags & LATE_PLACE) == 0
    np.testing.assert_allclose(fixes.lat_deg[known], d["lat"][row[known]], atol=1e-12)


def test_late_places_are_moved_across_180_degrees():
    d = drive()
    d["lon"] = (d["lon"] - d["lon"].mean() + 360.0) % 360.0 - 180.0
    fixes = make_fixes(lagging(d), Settings(), Counter())
    np.testing.assert_allclose(fixes.lon_deg[:396], d["lon"][:396], atol=1e-9)
