"""The antimeridian and the far north: the same answers as anywhere."""

import numpy as np
import pyarrow as pa
import pytest

import whichroad
from whichroad.batch import match_many
from whichroad.geodesy.plane import Plane

BLOCK = 200.0
PLACES = {"antimeridian": (66.0, 180.0), "north": (80.0, 20.0), "both": (80.0, -180.0)}
USUAL = (49.4, 8.7)


def town_at(lat: float, lon: float, folder) -> whichroad.RoadMap:
    """Three streets along, three across, the middle ones through the place, as OpenStreetMap."""
    plane = Plane(lat, lon)
    k = np.arange(-2, 3) * BLOCK
    nodes, ways = [], []
    for i, x in enumerate(k):
        for j, y in enumerate(k):
            a, b = plane.to_geodetic(np.array([x]), np.array([y]))
            nodes.append(f'<node id="{10 * i + j + 1}" lat="{a[0]:.9f}" lon="{b[0]:.9f}"/>')
    for i in range(5):
        for name, line in (("a", [10 * i + j + 1 for j in range(5)]),
                           ("b", [10 * j + i + 1 for j in range(5)])):  # fmt: skip
            refs = "".join(f'<nd ref="{n}"/>' for n in line)
            number = 100 + 10 * i + (name == "b")
            ways.append(f'<way id="{number}">{refs}<tag k="highway" v="residential"/></way>')
    path = folder / f"{lat}_{lon}.osm"
    path.write_text(f'<osm version="0.6">{"".join(nodes + ways)}</osm>')
    return whichroad.RoadMap.from_osm(path)


def drives_at(lat: float, lon: float) -> pa.Table:
    """East along a street, then north along another; fast and sparse ones."""
    plane = Plane(lat, lon)
    tables = []
    for k, step in enumerate((12.0, 60.0)):
        rng = np.random.default_rng(k)
        s = np.arange(10.0, 790.0, step)
        x, y = np.minimum(s - 400.0, 0.0), np.maximum(s - 400.0, 0.0)
        noise = rng.normal(0, 2, (2, len(s)))
        a, b = plane.to_geodetic(x + noise[0], y + noise[1])
        b = (b + 180.0) % 360.0 - 180.0
        columns = {"drive_id": [f"{k}"] * len(s), "time": 1.6e9 + s / 12.0, "lat": a, "lon": b}
        tables.append(pa.table(columns))
    return pa.concat_tables(tables)


@pytest.mark.parametrize("place", list(PLACES))
def test_a_drive_is_matched_as_anywhere(place, tmp_path):
    usual = match_many(drives_at(*USUAL), town_at(*USUAL, tmp_path))
    table, roads = drives_at(*PLACES[place]), town_at(*PLACES[place], tmp_path)
    found = match_many(table, roads)
    assert found.drives["answered"].to_pylist() == [True, True]
    assert found.drives["skipped"].to_pylist() == [[], []]
    assert found.path["source_id"].to_pylist() == usual.path["source_id"].to_pylist()
    np.testing.assert_allclose(found.path["exit_m"], usual.path["exit_m"], atol=3.0)
    np.testing.assert_allclose(found.points["p_road"], usual.points["p_road"], atol=0.1)
    lon = found.points["lon"].to_numpy()
    assert ((lon >= -180.0) & (lon < 180.0)).all()
    one = whichroad.match(table.slice(0, 65), roads)
    assert (
        one.path_arrow()["source_id"].to_pylist()
        == usual.path.filter(pa.compute.equal(usual.path["drive_id"], "0"))["source_id"].to_pylist()
    )


@pytest.mark.parametrize("place", list(PLACES))
def test_a_vehicle_that_drives_across_is_one_trip(place):
    from whichroad.readers.splitting import split_trips

    table = drives_at(*PLACES[place]).slice(0, 65)
    assert [part[:2] for part in split_trips(table, 300.0)[1]] == [(0, 65)]
