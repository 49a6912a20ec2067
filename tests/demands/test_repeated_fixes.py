"""A logger fills a gap with its last fix: the vehicle drives on, the row is named."""

import datetime as dt

import numpy as np
import pyarrow as pa
import pytest

from demands.test_trackers import M, road_map
from demands.town import corners, fixes, roads
from whichroad import Localizer, match, match_many
from whichroad.observations import GeoFix

FROM, TO = 22, 34  # rows of the same place


def frozen() -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Along a row at 14 m/s, then up a column; a gap of 12 s is filled.  And the true latitudes."""
    table = {k: np.asarray(v) for k, v in fixes(corners("20", "24", "44"), speed=14.0).items()}
    truth = table["lat"].copy()
    for name in ("lat", "lon"):
        table[name] = table[name].copy()
        table[name][FROM:TO] = table[name][FROM]
    return table, truth


def test_the_vehicle_drives_on_while_fixes_repeat_a_place_and_they_are_named():
    table, _ = frozen()
    result = match(table, roads())
    points = result.points
    last = points.iloc[TO - 1]
    moved = 111_000.0 * np.hypot(
        last.lat - points.lat.iloc[FROM], (last.lon - points.lon.iloc[FROM]) * 0.65
    )
    assert moved > 60.0
    assert (points.p_road.iloc[TO + 3 : TO + 15] > 0.9).all()
    [found] = [f for f in result.diagnosis if f.what == "gnss: repeated"]
    assert found.statistic == pytest.approx(TO - FROM - 1, abs=1.0)


def test_on_line_they_are_withheld_too():
    table, _ = frozen()
    localizer = Localizer(roads())
    begin = dt.datetime(2026, 6, 1, tzinfo=dt.UTC).timestamp()
    rows = zip(table["time"] - table["time"][0], table["lat"], table["lon"], strict=True)
    answers = [
        localizer.update(GeoFix(begin + float(t), float(lat), float(lon), 3.0))
        for t, lat, lon in rows
    ]
    there, later = answers[FROM].pose, answers[TO - 1].pose
    assert np.hypot(later.lat - there.lat, later.lon - there.lon) > 4e-4


def test_a_vehicle_that_stands_is_not_moved_by_a_receiver_that_holds_its_place():
    table, _ = frozen()
    table["lat"][TO:], table["lon"][TO:] = table["lat"][FROM], table["lon"][FROM]
    stopping = {k: v.copy() for k, v in table.items()}
    n = FROM
    for k in range(1, 6):  # it brakes by 2.8 m/s² and stays
        for name in ("lat", "lon"):
            step = table[name][FROM - 1] - table[name][FROM - 2]
            stopping[name][n + k - 1 :] = stopping[name][n + k - 2] + step * (1.0 - k / 5.0)
    result = match(stopping, roads())
    assert not [f for f in result.diagnosis if f.what == "gnss: repeated"]
    stay = result.points.iloc[n + 8 :]
    assert np.ptp(stay.lon) < 1e-4
    assert (stay.status == "stopped").iloc[-1]


def tunnel() -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The same with a gap of 60 s, around a corner; and without these rows."""
    table = {k: np.asarray(v) for k, v in fixes(corners("20", "24", "44"), speed=14.0).items()}
    true, last = {k: v.copy() for k, v in table.items()}, FROM + 40
    for name in ("lat", "lon"):
        table[name] = table[name].copy()
        table[name][FROM:last] = table[name][FROM]
    return table, true


@pytest.mark.parametrize("lag", [None, "full"])
def test_places_in_a_gap_that_was_filled_are_on_the_path_between(lag):
    table, true = tunnel()
    result = match(table, roads(), lag=lag)
    points, gap = result.points, slice(FROM + 1, FROM + 40)
    north = 111_195.0 * (points.lat.to_numpy() - true["lat"])
    east = 111_195.0 * np.cos(np.radians(49.4)) * (points.lon.to_numpy() - true["lon"])
    off = np.hypot(north, east)
    assert np.all(off[gap] < 60.0)
    assert not np.any(off > points.protection_level_m)
    assert np.all(points.p_road[gap] < 0.999)
    assert set(points.status[gap]) == {"outage"}
    assert np.all(result.path.mean_speed_mps < 25.0)
    [found] = [f for f in result.diagnosis if f.what == "gnss: repeated"]
    assert found.statistic == pytest.approx(39.0, abs=1.0)
    trips = {**table, "drive_id": np.full(len(table["lat"]), "a")}
    many = match_many(pa.table(trips), roads(), lag=lag)
    assert many.points["lat"].to_pylist() == points.lat.tolist()
    assert "gnss: repeated" in " ".join(many.drives["notes"].to_pylist()[0])


@pytest.mark.parametrize("lag", [None, "full"])
def test_a_place_that_is_held_with_a_jitter_is_a_gap_too(lag):
    table, true = tunnel()
    wave = 1e-6 * np.sin(2.0 * np.arange(FROM, FROM + 40))
    table["lat"][FROM : FROM + 40] += wave
    table["lon"][FROM : FROM + 40] += wave[::-1]
    result = match(table, roads(), lag=lag)
    points, gap = result.points, slice(FROM + 1, FROM + 40)
    north = 111_195.0 * (points.lat.to_numpy() - true["lat"])
    east = 111_195.0 * np.cos(np.radians(49.4)) * (points.lon.to_numpy() - true["lon"])
    assert not np.any(np.hypot(north, east) > points.protection_level_m)
    assert np.all(points.p_road[gap] < 0.999)
    assert set(points.status[gap]) == {"outage"}
    [found] = [f for f in result.diagnosis if f.what == "gnss: repeated"]
    assert found.statistic == pytest.approx(39.0, abs=1.0)
    trips = {**table, "drive_id": np.full(len(table["lat"]), "a")}
    many = match_many(pa.table(trips), roads(), lag=lag)
    assert many.points["lat"].to_pylist() == points.lat.tolist()
    assert "within a metre" in " ".join(many.drives["notes"].to_pylist()[0])


def test_who_stood_on_a_long_edge_before_a_gap_is_not_taken_back_by_it():
    """An edge is not driven evenly from its begin to its end."""
    x = np.concatenate([np.full(60, -250.0), -250.0 + 10.0 * np.arange(1, 61)])
    seen = x.copy()
    seen[75:95] = x[74]
    table = {
        "time": np.arange(len(x)), "lat": np.zeros(len(x)), "lon": seen * M,
        "sigma_m": np.full(len(x), 2.0),
    }  # fmt: skip
    points = match(table, road_map({"street": [(-300.0, 0.0), (900.0, 0.0)]}), lag="full").points
    assert (points.status[76:94] == "outage").all()
    error = np.abs(points.lon / M - x)[75:95]
    assert error.max() < 30.0
    assert (error < points.protection_level_m[75:95]).all()
