"""Places that somebody has put on the roads of the map before: that is said, and of no others."""

import numpy as np
import pandas as pd
import pytest
import shapely

import whichroad
from whichroad.simulate import simulate_drive

METRE = 1.0 / 111_195.0  # degrees of latitude
EAST = METRE / np.cos(np.radians(49.4))


def driven(roads: whichroad.RoadMap, seed: int) -> pd.DataFrame:
    fixes = simulate_drive(roads, seed=seed, length_m=3000.0).drive.fixes
    return pd.DataFrame({"time": fixes.time, "lat": fixes.lat_deg, "lon": fixes.lon_deg})


def snapped(frame: pd.DataFrame, roads: whichroad.RoadMap) -> pd.DataFrame:
    """Each place at the nearest centre line."""
    scale = [METRE / EAST, 1.0]  # degrees that are as long
    lines = [
        shapely.LineString(shapely.get_coordinates(one)[:, :2] * scale)
        for one in roads.edges_table().geometry
    ]
    tree = shapely.STRtree(lines)
    places = shapely.points(frame[["lon", "lat"]].to_numpy() * scale)
    put = [
        lines[k].interpolate(lines[k].project(place))
        for k, place in zip(tree.nearest(places), places, strict=True)
    ]
    return frame.assign(lon=shapely.get_x(put) / scale[0], lat=shapely.get_y(put))


def said(frame: pd.DataFrame, roads: whichroad.RoadMap, lag: str | None = None) -> list[str]:
    """What `match` and `match_many` both say."""
    alone = whichroad.match(frame, roads, lag=lag)
    findings = [one for one in alone.diagnosis if one.what == "snapped places"]
    assert all(one.level == "information" for one in findings)
    many = whichroad.match_many(frame.assign(trip_id="a"), roads, lag=lag)
    notes = [n for n in many.drives["notes"].to_pylist()[0] if n.startswith("snapped places")]
    assert notes == [one.note for one in findings]
    return notes


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("decimals", [6, 15])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("every", [1, 5])
def test_places_on_the_centre_lines_are_named(town, every, seed, decimals, lag):
    frame = snapped(driven(town, seed)[::every], town).round({"lat": decimals, "lon": decimals})
    (note,) = said(frame, town, lag)
    assert note.startswith("snapped places: most places lie on the centre lines of this map")
    assert note.endswith("give the places as they were measured, or else errors of 10 m (sigma_m)")


def test_so_are_those_of_five_decimals_where_they_lie_on_the_answered_road(town):
    assert said(snapped(driven(town, 0)[::5], town).round({"lat": 5, "lon": 5}), town)


@pytest.mark.parametrize("seed", range(6))
def test_measured_places_are_not(town, seed):
    frame = driven(town, seed)
    assert said(frame, town) == []
    assert said(frame[::5], town) == []
    fine = snapped(frame, town).assign(sigma_m=0.05)  # in the middle of a lane, and known so well
    assert said(fine, town) == []


def test_of_few_places_nothing_is_said(town):
    assert said(snapped(driven(town, 0)[:100:8], town), town) == []
