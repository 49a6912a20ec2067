"""Places that no vehicle reaches from the others are no fixes, and keep their rows."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from demands.town import corners, fixes, roads
from whichroad import match, match_many
from whichroad.observations import STRAY
from whichroad.readers import drive_from_table
from whichroad.readers.stray_places import strays

LAT = 49.4


def found(lat: list[float], every: float = 1.0, time: list[float] | None = None) -> list[int]:
    """Rows of a drive along a meridian that are strays."""
    when = every * np.arange(len(lat)) if time is None else np.array(time)
    return np.flatnonzero(strays(when, LAT + np.array(lat), np.full(len(lat), 8.7))).tolist()


def going(n: int = 30) -> list[float]:
    """Degrees of a vehicle at 11 m/s."""
    return [1e-4 * k for k in range(n)]


@pytest.mark.parametrize("every", [1.0, 5.0, 30.0])
@pytest.mark.parametrize("rows", [[0], [0, 1], [12], [12, 13, 20], [28, 29], [0, 29]])
def test_single_places_out_of_reach_are_strays(rows, every):
    lat = [x + 0.2 * (k in rows) for k, x in enumerate(going())]
    assert found(lat, every) == rows


def test_a_stale_place_that_is_repeated_is_one_place():
    assert found([0.2] * 40 + going()) == list(range(40))


def test_what_can_be_reached_or_is_another_stretch_is_none():
    assert found(going()) == []
    assert found([0.012, *going()[1:]], every=30.0) == []  # 1.3 km
    assert found(going(10) + [0.2 + x for x in going(10)]) == []
    assert found(going(3)) == []
    assert found([0.2, *going(2)]) == []


def test_who_is_carried_during_a_pause_is_none():
    lat = going(3) + [9.0 + x for x in going()]  # flown
    assert found(lat, time=[0.0, 1.0, 2.0, *(7200.0 + k for k in range(30))]) == []


def test_rows_of_two_vehicles_are_none():
    lat = going()
    lat[::2] = [x + 0.2 for x in lat[::2]]
    assert found(lat) == []


@pytest.mark.parametrize(("every", "away"), [(1.0, 450.0), (5.0, 500.0), (10.0, 700.0)])
@pytest.mark.parametrize("course", [0.0, 60.0, 90.0])
def test_single_places_at_which_a_vehicle_would_turn_round_at_speed_are_strays(every, away, course):
    rows = [12, 25, 29, 59]
    k = np.arange(60)
    lat, lon = LAT + 1e-4 * every * k, np.full(60, 8.7)  # 11 m/s
    aside = away / 111_195.0 * np.isin(k, rows)
    lat += aside * np.cos(np.radians(course))
    lon += aside * np.sin(np.radians(course)) / np.cos(np.radians(LAT))
    time = every * k
    assert np.flatnonzero(strays(time, lat, lon)).tolist() == rows[:-1]  # the last has no way back
    told = np.where(aside > 0.0, 330.0, 3.0)  # as a network's fix that says so
    assert not strays(time, lat, lon, told).any()
    assert not strays(3.0 * 25.0 / every * time, lat, lon).any()  # there is time to turn


def test_places_beside_strays_are_none():
    lat = np.array(going(60))
    lat[[20, 22]] += 0.006  # 20 and 22 are off, 21 is none
    assert not strays(10.0 * np.arange(60), LAT + lat, np.full(60, 8.7))[21]
    lat[30::4] += 0.006  # of more than a tenth nothing is known
    assert not strays(10.0 * np.arange(60), LAT + lat, np.full(60, 8.7)).any()


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("every", [5, 10])
def test_a_place_that_is_off_by_half_a_kilometre_is_not_driven_to(every, lag):
    way = corners("00", "04", "24", "20", "40", "44")
    table = {k: np.asarray(v) for k, v in fixes(way, speed=11.0).items()}
    table = {k: v[::every] for k, v in table.items() if k in ("time", "lat", "lon")}
    sound = match(table, roads(), lag=lag)
    row = len(table["time"]) // 2
    wrong = {k: v.copy() for k, v in table.items()}
    wrong["lat"][row] -= 600.0 / 111_195.0
    result = match(wrong, roads(), lag=lag)
    (note,) = result.summary["notes"]
    assert note.startswith(f"places of 1 of {len(sound.points)} rows cannot be reached")
    metres = 111_195.0 * (result.points.lat - sound.points.lat).to_numpy()
    assert np.all(np.abs(metres) < result.points.protection_level_m)
    assert result.path.edge_id.tolist() == sound.path.edge_id.tolist()
    trips = {k: np.concatenate([wrong[k], table[k]]) for k in wrong}
    trips["drive_id"] = np.repeat(["a", "b"], len(sound.points))
    many = match_many(pa.table(trips), roads(), lag=lag)
    np.testing.assert_array_equal(many.points["lat"].to_numpy()[: len(sound.points)],
                                  result.points.lat)  # fmt: skip
    assert many.drives["notes"].to_pylist() == [[note], []]


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("rows", [[0], [0, 1], [30, 31], [-1]])
def test_strays_take_no_other_row_with_them(rows, lag):
    table = {k: np.asarray(v) for k, v in fixes(corners("00", "04", "24"), speed=11.0).items()}
    sound = match(table, roads(), lag=lag).points
    wrong = {k: v.copy() for k, v in table.items()}
    wrong["lat"][rows], wrong["lon"][rows] = table["lon"][rows], table["lat"][rows]
    result = match(wrong, roads(), lag=lag)
    points = result.points
    assert len(points) == len(sound)
    (note,) = result.summary["notes"]
    assert note.startswith(f"places of {len(rows)} of {len(sound)} rows cannot be reached")
    other = np.setdiff1d(np.arange(len(sound)), np.arange(len(sound))[rows])
    off = 111_195.0 * (points.lat - sound.lat).to_numpy()[other]
    assert np.all(np.abs(off) < sound.protection_level_m.to_numpy()[other])
    assert np.all(points.p_off_road.to_numpy()[other] < 0.5)
    if 0 in rows:
        assert points.lat[rows].isna().all()
    else:
        assert (points.status.iloc[rows] == "outage").all()
    trips = {**wrong, "drive_id": np.full(len(sound), "a")}
    many = match_many(pa.table(trips), roads(), lag=lag)
    np.testing.assert_array_equal(many.points["lat"].to_numpy(), points.lat)
    assert many.drives["notes"].to_pylist() == [[note]]


def test_strays_are_flagged():
    frame = pd.DataFrame({"time": 1.7e9 + np.arange(30.0), "lat": LAT + np.array(going())})
    frame["lon"] = 8.7
    frame.loc[0, ["lat", "lon"]] = [8.7, LAT]
    (drive,) = drive_from_table(frame)
    assert drive.fixes is not None
    assert np.flatnonzero(drive.fixes.flags & STRAY).tolist() == [0]
