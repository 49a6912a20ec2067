"""Drives beside the mapped roads: moved as a whole, on none of them, or by no motor vehicle."""

import re

import numpy as np
import pandas as pd
import pytest

import whichroad
from laws.public import degrees, road_map
from whichroad.diagnosis.off_roads import off_road_findings
from whichroad.filter.records import new_epochs
from whichroad.filter.summary.estimate import ESTIMATE
from whichroad.graph.network import records
from whichroad.simulate import simulate_drive

LAT, METRE = 49.4, 1.0 / 111_195.0
EAST = METRE / np.cos(np.radians(LAT))  # degrees of longitude a metre
NAMES = ("off roads", "no motor vehicle", "too fast for its roads")


def driven(roads: whichroad.RoadMap, seed: int, length: float = 4000.0) -> pd.DataFrame:
    fixes = simulate_drive(roads, seed=seed, length_m=length).drive.fixes
    return pd.DataFrame({"time": fixes.time, "lat": fixes.lat_deg, "lon": fixes.lon_deg})


def shifted(frame: pd.DataFrame, east: float, north: float) -> pd.DataFrame:
    return frame.assign(lat=frame.lat + north * METRE, lon=frame.lon + east * EAST)


def turned(frame: pd.DataFrame, degrees: float) -> pd.DataFrame:
    """The drive turned about its middle, where it fits no road."""
    east, north = (frame.lon - frame.lon.mean()) / EAST, (frame.lat - frame.lat.mean()) / METRE
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return frame.assign(
        lat=frame.lat.mean() + (s * east + c * north) * METRE,
        lon=frame.lon.mean() + (c * east - s * north) * EAST,
    )


def said(frame: pd.DataFrame, roads: whichroad.RoadMap, lag: str | None = None) -> list[str]:
    """What `match` and `match_many` both say."""
    alone = whichroad.match(frame, roads, lag=lag)
    findings = [one for one in alone.diagnosis if one.what in NAMES]
    assert all(one.level == "warning" for one in findings)
    many = whichroad.match_many(frame.assign(trip_id="a"), roads, lag=lag)
    notes = [n for n in many.drives["notes"].to_pylist()[0] if n.startswith(NAMES)]
    assert notes == [one.note for one in findings]
    return notes


def by(note: str, *sides: str) -> float:
    """By how many metres to one side the note says that places are to be moved."""
    found = re.search(rf"(\d+) m ({'|'.join(sides)})", note)
    return 0.0 if found is None else float(found[1]) * (1.0 if found[2] == sides[0] else -1.0)


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("shift", [(50.0, -40.0), (-60.0, 0.0), (350.0, 350.0), (-20.0, 500.0)])
def test_places_that_are_moved_as_a_whole_are_named_with_the_way_back(town, shift, lag):
    (note,) = said(shifted(driven(town, 3), *shift), town, lag)
    assert note.startswith("off roads: the places lie beside the roads, and on them if all are")
    back = by(note, "east", "west"), by(note, "north", "south")
    assert np.hypot(back[0] + shift[0], back[1] + shift[1]) < 25.0


def test_a_drive_that_fits_no_road_is_named_without_a_shift(town):
    (note,) = said(turned(driven(town, 3), 38.0), town)
    assert note.startswith("off roads: most of the way lies on no mapped road; is the map of this")


@pytest.mark.parametrize(
    ("sigma", "named"), [(3.0, True), (20.0, True), (60.0, False), (320.0, False)]
)
def test_places_that_are_coarse_are_not_off_the_roads(town, sigma, named):
    """Beside the roads is where they lie: of those that were rounded to two decimals most do."""
    frame = turned(driven(town, 4), 38.0)
    epochs, rows = new_epochs(len(frame)), records(len(frame), ESTIMATE)
    epochs["time"], epochs["has_fix"], epochs["fix"][:, 2] = frame.time, 1, sigma
    epochs["fix"][:, 0], epochs["fix"][:, 1] = town.plane.from_geodetic(
        frame.lat.to_numpy(), frame.lon.to_numpy()
    )
    rows["p_off_road"] = 0.9
    assert bool(off_road_findings(epochs, rows, [0, len(frame)], town.arrays)) == named


@pytest.mark.parametrize("seed", range(8))
def test_nothing_is_said_of_a_drive_on_its_roads_nor_of_a_yard_beside_them(town, seed):
    frame = driven(town, seed)
    assert said(frame, town) == []
    at, way = len(frame) // 2, 5.0 * np.arange(60)
    north = 40.0 * np.sin(way / 25.0)
    out = shifted(frame.iloc[[at] * 120], np.r_[way, way[::-1]], np.r_[north, north])
    yard = pd.concat([frame[:at], out, frame[at:]])
    assert said(yard.assign(time=frame.time[0] + np.arange(len(yard))), town) == []


def at_pace(frame: pd.DataFrame, pace: float) -> pd.DataFrame:
    """The way of a drive at an even pace, one row a second, without the stops."""
    way = np.hypot(np.diff(frame.lat) / METRE, np.diff(frame.lon) / EAST)
    way = np.append(0.0, np.cumsum(np.where(way > 2.0, way, 0.0)))
    at = np.arange(0.0, way[-1], pace)
    random = np.random.default_rng(1)
    return pd.DataFrame({
        "time": frame.time[0] + np.arange(len(at)),
        "lat": np.interp(at, way, frame.lat) + METRE * random.normal(0.0, 0.5, len(at)),
        "lon": np.interp(at, way, frame.lon) + EAST * random.normal(0.0, 0.5, len(at)),
    })  # fmt: skip


@pytest.mark.parametrize(("pace", "who"), [(1.4, "somebody on foot"), (4.5, "a bicycle")])
def test_who_walks_or_cycles_off_the_roads_is_named(town, pace: float, who: str):
    frame = at_pace(driven(town, 3, 3000.0), pace)
    (note,) = said(turned(frame, 38.0), town)
    assert note.startswith(f"no motor vehicle: it moves as {who}, and partly off the roads")


@pytest.mark.parametrize("pace", [1.4, 4.5])
def test_a_slow_vehicle_on_the_roads_is_not(town, pace: float):
    assert said(at_pace(driven(town, 3, 3000.0), pace), town) == []


@pytest.mark.parametrize("seed", range(4))
def test_strips_of_a_field_tell_of_no_shift(town, seed):
    turn = np.radians(90.0 * seed)
    strip = np.arange(24)
    east = np.ravel(
        np.column_stack([np.where(strip % 2, 180.0, 0.0), np.where(strip % 2, 0.0, 180.0)])
    )
    north = np.repeat(4.0 * strip, 2)
    way = np.append(0.0, np.cumsum(np.hypot(np.diff(east), np.diff(north))))
    at = np.arange(0.0, way[-1], 2.5)
    x, y = np.interp(at, way, east), np.interp(at, way, north)
    middle = driven(town, 3)[["lat", "lon"]].median()
    c, s = np.cos(turn), np.sin(turn)
    frame = pd.DataFrame({
        "time": 1.7e9 + np.arange(len(at)),
        "lat": middle.lat + (180.0 + s * x + c * y) * METRE,
        "lon": middle.lon + (60.0 + c * x - s * y) * EAST,
    })  # fmt: skip
    assert not [note for note in said(frame, town) if "are moved by" in note]


def test_a_plane_is_named(town):
    middle, s = driven(town, 3)[["lat", "lon"]].mean(), np.arange(-4500.0, 4500.0, 75.0)
    frame = pd.DataFrame({
        "time": 1.7e9 + np.arange(len(s)),
        "lat": middle.lat + 0.6 * s * METRE,
        "lon": middle.lon + 0.8 * s * EAST,
    })  # fmt: skip
    (note,) = said(frame, town)
    assert note.startswith(
        "no motor vehicle: it moves as a plane or a fast train, and off the road"
    )


def test_one_jump_makes_no_plane(town):
    frame = driven(town, 3)
    frame.loc[100:119, "lat"] += 2000.0 * METRE
    assert said(frame, town) == []


@pytest.mark.parametrize(("kmh", "named"), [(90.0, True), (45.0, False)])
def test_a_trip_that_is_too_fast_for_its_streets_is_named(kmh: float, named: bool):
    """Beside streets of 30 km/h, and off the roads where these end, as on a railway line."""
    pieces = [(0.0, 1500.0), (2000.0, 3500.0)]
    roads = road_map(
        [[[a, 0.0], [b, 0.0]] for a, b in pieces], highway=["residential"] * 2, maxspeed=[30] * 2
    )
    x = np.arange(0.0, 3500.0, kmh / 3.6)
    lon, lat = degrees(x, np.full(len(x), -9.0))
    notes = said(pd.DataFrame({"time": 1.78e9 + np.arange(len(x)), "lat": lat, "lon": lon}), roads)
    assert [note.split(":")[0] for note in notes] == ["too fast for its roads"] * named
