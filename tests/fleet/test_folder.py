"""Trips on a folder of maps: each on the one that holds it, cut at borders, and named."""

import json
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import whichroad
from fleet.conftest import PLANE
from whichroad.batch import match_many
from whichroad.errors import MapError
from whichroad.fleet import MAPS_SCHEMAS, RoadMaps, match_batches, run_fleet
from whichroad.roadmap import checked, shared_maps

BLOCK = 200.0  # m
ROWS = 7  # streets along


def region(columns: range, every: int = 1) -> whichroad.RoadMap:
    """Streets along and across, of some columns of blocks; every one along, or every n-th."""
    import geopandas
    import shapely

    k, rows = np.array(columns) * BLOCK, np.arange(0, ROWS, every) * BLOCK
    ends = [((a, b), (a + BLOCK, b)) for a in k[:-1] for b in rows]
    ends += [((a, b), (a, b + every * BLOCK)) for a in k[::every] for b in rows[:-1]]
    lines = []
    for line in ends:
        lat, lon = PLANE.to_geodetic(*np.array(line).T)
        lines.append(shapely.LineString(np.column_stack([lon, lat])))
    return whichroad.RoadMap.from_edges(
        geopandas.GeoDataFrame({"id": np.arange(len(lines))}, geometry=lines, crs="EPSG:4326")
    )


def drive(name: str, begin: float, end: float, row: int, first: float = 1.6e9) -> pa.Table:
    """A drive along a street from one column to another, a fix each second."""
    rng = np.random.default_rng(len(name))
    x = np.arange(begin, end, 12.0)
    noise = rng.normal(0, 2, (2, len(x)))
    lat, lon = PLANE.to_geodetic(x + noise[0], row * BLOCK + noise[1])
    time = first + np.arange(len(x))
    return pa.table({"trip_id": [name] * len(x), "time": time, "lat": lat, "lon": lon})


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """West and east, which share 600 m; a small part of the west; one far away."""
    folder = tmp_path_factory.mktemp("maps")
    region(range(24)).save(folder / "west.map")
    region(range(20, 44)).save(folder / "east.map")
    region(range(2, 22)).save(folder / "centre.map")
    region(range(300, 305)).save(folder / "far.map")
    (folder / "notes.txt").write_text("no map")
    return folder


@pytest.fixture(scope="module")
def trips() -> pa.Table:
    """In the west, over the border, in the east, and nowhere."""
    return pa.concat_tables(
        [
            drive("w", 100.0, 4000.0, 2),
            drive("b", 600.0, 8000.0, 3, 1.6e9 + 1),
            drive("e", 5000.0, 8000.0, 4, 1.6e9 + 2),
            drive("s", 4300.0, 4500.0, 5, 1.6e9 + 3),
            drive("n", 30000.0, 31000.0, 1, 1.6e9 + 4),
        ]
    )


def test_each_trip_takes_the_map_that_holds_it_and_is_cut_at_a_border(maps, trips):
    tables = match_many(trips, maps)
    drives = {row["drive_id"]: row for row in tables.drives.to_pylist()}
    assert list(drives) == ["w", "b/1", "b/2", "e", "s", "n"]
    assert {name: row["map"] for name, row in drives.items() if name != "s"} == {
        "w": "west.map", "b/1": "west.map", "b/2": "east.map", "e": "east.map", "n": "east.map",
    }  # fmt: skip
    assert [row["answered"] for row in drives.values()] == [True] * 5 + [False]
    assert drives["w"]["notes"] == []
    assert "this is part 2 of 2, on east.map" in drives["b/2"]["notes"][0]
    assert sum(drives[k]["fixes"] for k in ("b/1", "b/2")) == 617
    border = tables.points.filter(pa.compute.equal(tables.points["drive_id"], "b/2"))
    x, _ = PLANE.from_geodetic(border["lat"][0].as_py(), border["lon"][0].as_py())
    assert 3800.0 < x < 4800.0  # in the middle of what both maps hold
    alone = match_many(trips.slice(0, 325), maps / "west.map")
    for name in ("points", "path", "drives"):
        found = getattr(tables, name)
        own = found.filter(pa.compute.equal(found["drive_id"], "w"))
        assert own.drop_columns(["map"]).to_pylist() == getattr(alone, name).to_pylist()


def test_of_two_maps_that_hold_a_trip_it_takes_that_with_more_about_it(maps):
    inside = drive("c", 2000.0, 2600.0, 3)  # west and centre hold it and all about it
    edge = drive("d", 500.0, 900.0, 3)  # it begins at the end of the centre
    taken = match_many(pa.concat_tables([inside, edge]), maps).drives["map"].to_pylist()
    assert taken == ["centre.map", "west.map"]


def test_a_trip_that_ends_just_beyond_a_border_is_cut_at_it(maps):
    """A map whose last road is 300 m away does not hold a place where another has the roads."""
    for name, begin, end in (("over", 3000.0, 4900.0), ("into", 3750.0, 8000.0)):
        rows = match_many(drive(name, begin, end, 3), maps).drives.to_pylist()
        assert [row["map"] for row in rows] == ["west.map", "east.map"]
        assert all(row["answered"] for row in rows)


def test_a_map_without_small_streets_beside_a_full_one_still_holds_a_trip():
    """Roads of its own lie to all sides: it does not end there."""
    maps = RoadMaps({"all": region(range(44), 3), "town": region(range(20, 44))}, "two")
    there, street = np.arange(1000.0, 6000.0, 12.0), np.arange(6000.0, 7000.0, 12.0)
    x = np.concatenate([there, street, np.full(60, 7000.0)])
    y = np.concatenate(
        [np.full(len(there), 600.0), np.full(len(street), 860.0), np.full(60, 600.0)]
    )
    lat, lon = PLANE.to_geodetic(x, y)
    (shares,) = maps.shares(lat, lon, np.array([0, len(x)]))
    assert [maps.names[share.map] for share in shares] == ["all"]


@pytest.mark.parametrize("sigma", [5.0, 100.0])
def test_coarse_fixes_beside_a_border_cut_nothing(sigma):
    """They scatter over it, and back."""
    maps = RoadMaps({"west": region(range(25)), "east": region(range(24, 49))}, "two")
    parts = []
    for seed in range(10):
        x, y = np.random.default_rng(seed).normal(0.0, sigma, (2, 120))
        lat, lon = PLANE.to_geodetic(4700.0 + x, np.linspace(0.0, 1200.0, 120) + y)
        parts.append(len(maps.shares(lat, lon, np.array([0, 120]))[0]))
    assert sorted(parts)[:-1] == [1] * 9
    assert max(parts) <= 2


def test_a_single_fix_beyond_cuts_nothing(maps):
    table = drive("w", 100.0, 3000.0, 2)
    lat = table["lat"].to_numpy().copy()
    lon = table["lon"].to_numpy().copy()
    lat[50], lon[50] = PLANE.to_geodetic(7000.0, 400.0)
    table = table.set_column(2, "lat", pa.array(lat)).set_column(3, "lon", pa.array(lon))
    assert match_many(table, maps).drives["map"].to_pylist() == ["west.map"]


def test_rows_in_any_order_other_columns_and_parts_of_splits(maps, trips):
    usual = match_many(trips, maps)
    mixed = trips.take(np.random.default_rng(3).permutation(len(trips)))
    found = match_many(mixed, maps)
    assert found.path.sort_by([("drive_id", "ascending"), ("seq", "ascending")]).equals(
        usual.path.sort_by([("drive_id", "ascending"), ("seq", "ascending")])
    )
    b = trips.slice(325, 617)
    from pyproj import Transformer

    to = Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    x, y = to.transform(b["lon"].to_numpy(), b["lat"].to_numpy())
    plane = pa.table({"trip_id": b["trip_id"], "time": b["time"], "x": x, "y": y})
    assert match_many(plane, maps, crs="EPSG:32632").drives["drive_id"].to_pylist() == [
        "b/1", "b/2",
    ]  # fmt: skip
    assert match_many(b, maps, split="5min").drives["drive_id"].to_pylist() == ["b/1.1", "b/1.2"]


def test_a_zone_and_own_names_cut_where_the_usual_ones_cut(maps, trips, tmp_path):
    from pyproj import Transformer

    usual = match_many(trips, maps)
    micros = pa.array((trips["time"].to_numpy() + 7200.0) * 1e6).cast(pa.int64())
    to = Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    x, y = to.transform(trips["lon"].to_numpy(), trips["lat"].to_numpy())
    trip, local = trips["trip_id"], micros.cast(pa.timestamp("us"))
    degrees = pa.table({"T": trip, "Z": local, "B": trips["lat"], "L": trips["lon"]})
    plane = pa.table({"T": trip, "Z": local, "R": x, "H": y})
    for table, own in (
        (degrees, {"lat": "B", "lon": "L"}),
        (plane, {"x": "R", "y": "H"}),
    ):
        named = {"columns": own | {"time": "Z", "drive_id": "T"}, "tz": "Europe/Berlin"}
        more = named | {"crs": "EPSG:32632"}
        found = match_many(table, maps, **more)
        assert found.drives["fixes"].to_pylist() == usual.drives["fixes"].to_pylist()
        keys = ["drive_id", "edge_id", "map"]
        assert found.path.select(keys).equals(usual.path.select(keys))
        assert found.points["time"].equals(usual.points["time"])
        pq.write_table(table, tmp_path / "t.parquet")
        out = tmp_path / "-".join(own)
        run_fleet(tmp_path / "t.parquet", maps, out, workers=1, order="sorted", **more)
        assert pq.read_table(out / "path").select(keys).equals(found.path.select(keys))


def test_fleet_engines_and_speeds_tell_the_maps_apart(maps, trips, tmp_path):
    usual = match_many(trips, maps)
    for give in ("path", "drives", "slim"):
        parts = list(match_batches(iter(trips.to_batches()), maps, give=give, ordered=True))
        assert parts[0].schema.equals(MAPS_SCHEMAS[give])
    pq.write_table(trips, tmp_path / "t.parquet")
    run_fleet(tmp_path / "t.parquet", maps, tmp_path / "out", workers=1, points="slim")
    path = pq.read_table(tmp_path / "out" / "path")
    assert path.drop_columns(["geometry"] if "geometry" in path.column_names else []).num_rows
    assert sorted(zip(path["map"].to_pylist(), path["edge_id"].to_pylist(), strict=True)) == sorted(
        zip(usual.path["map"].to_pylist(), usual.path["edge_id"].to_pylist(), strict=True)
    )
    told = whichroad.map_of(tmp_path / "out")
    assert told == whichroad.map_of(usual.path) == json.loads(json.dumps(told))
    assert list(told["maps"]) == ["centre.map", "east.map", "far.map", "west.map"]
    assert told["maps"]["west.map"] == whichroad.RoadMap.open(maps / "west.map").identity
    speeds = whichroad.speeds(tmp_path / "out", hours=False)
    pairs = set(zip(path["map"].to_pylist(), path["edge_id"].to_pylist(), strict=True))
    assert speeds.column_names[:2] == ["map", "edge_id"]
    assert set(zip(speeds["map"].to_pylist(), speeds["edge_id"].to_pylist(), strict=True)) <= pairs
    assert len(speeds) > 0.9 * len(pairs)


def test_a_folder_without_maps_and_a_folder_where_one_map_is_expected_are_refused(tmp_path, maps):
    with pytest.raises(MapError, match="no compiled map is in this folder"):
        match_many(drive("w", 100.0, 900.0, 2), tmp_path)
    with pytest.raises(MapError, match="it is a folder; one map was expected"):
        whichroad.roadmap.open_map(maps)


def test_a_folder_is_opened_once_and_anew_when_a_map_of_it_changed(tmp_path, maps, monkeypatch):
    monkeypatch.setattr(checked, "SETTLED", 0.0)  # else files written just now are opened anew
    for name in ("east.map", "west.map"):
        (tmp_path / name).write_bytes((maps / name).read_bytes())
        os.utime(tmp_path / name, (1e9, 1e9))
    assert shared_maps(maps) is shared_maps(maps)
    assert list(shared_maps(tmp_path)) == ["east.map", "west.map"]
    (tmp_path / "east.map").unlink()
    assert list(shared_maps(tmp_path)) == ["west.map"]


def test_an_outline_on_both_sides_of_the_antimeridian():
    import geopandas
    import shapely

    lines = [shapely.LineString([(179.99, 60.0), (180.0, 60.0)]),
             shapely.LineString([(-180.0, 60.0), (-179.99, 60.0)])]  # fmt: skip
    table = geopandas.GeoDataFrame({"id": [1, 2]}, geometry=lines, crs="EPSG:4326")
    maps = RoadMaps({"a": whichroad.RoadMap.from_edges(table), "b": region(range(3))}, "two")
    lon = np.array([179.995, -179.995, 179.9, -179.9, 0.0])
    assert maps.outlines[0].holds(np.full(5, 60.0), lon).tolist() == [True, True] + 3 * [False]
    (shares,) = maps.shares(np.full(2, 60.0), lon[:2], np.array([0, 2]))
    assert [share.map for share in shares] == [0]
