"""What is no map is refused by name; damage gives a map or a refusal, and nothing else."""

import bz2
import gzip
import json
import random
import zlib

import geopandas
import numpy as np
import osmium
import pandas
import pyarrow as pa
import pytest
import shapely

from whichroad.errors import MapError
from whichroad.roadmap import RoadMap, store

NODES = {1: (0, 0), 2: (100, 0), 3: (0, 100), 4: (-100, 0), 5: (0, -100)}
WAYS = [
    (10, [1, 2], {"name": "Höhenweg", "maxspeed": "30 mph", "lanes": "2", "layer": "1"}),
    (20, [1, 3], {"oneway": "yes", "width": "7 m"}),
    (30, [4, 1, 5], {"highway": "service"}),
]
BAN = (
    {"type": "restriction", "restriction": "no_left_turn"},
    (("way", 10, "from"), ("node", 1, "via"), ("way", 20, "to")),
)
CELLS = [
    None, np.nan, pandas.NA, pandas.NaT, 1, 0, -1, 3.5, 1e300, -np.inf, 2**70, "", "x", "yes", "-1",
    "50 mph", "9" * 400, b"\xff", [1, 2], [], {"a": 1}, {1, 2}, True, np.array([1, 2]), 1j,
    object(),
]  # fmt: skip
NAMES = ["id", "from", "to", "oneway", "cost", "reverse_cost", "name", "highway", "maxspeed",
         "lanes", "width", "layer", "bridge", "tunnel", "junction", "access", "other"]  # fmt: skip


def damaged(content, rng):
    """The bytes, cut short, changed, with more or with less in them."""
    changed = bytearray(content)
    place, other = rng.randrange(len(changed)), rng.randrange(len(changed))
    match rng.randrange(6):
        case 0:
            del changed[place:]
        case 1:
            del changed[place : place + rng.randrange(1, 30)]
        case 2:
            changed[place:place] = rng.randbytes(rng.randrange(1, 20))
        case 3:
            changed[place:place] = changed[other : other + rng.randrange(1, 40)]
        case 4:
            for _ in range(rng.randrange(1, 6)):
                changed[rng.randrange(len(changed))] = rng.randrange(256)
        case 5:  # where there are numbers, others
            digits = [i for i, c in enumerate(changed) if 48 <= c < 58]
            for _ in range(rng.randrange(1, 4) if digits else 0):
                changed[rng.choice(digits)] = rng.choice(b'0123456789-.eEnx"<, ')
    return bytes(changed)


@pytest.fixture(scope="module")
def good(tmp_path_factory, xml, line):
    """Sound files of every kind, by suffix, and the map of the compiled one."""
    folder = tmp_path_factory.mktemp("good")
    text = xml(NODES, WAYS, [BAN], {2: {"barrier": "bollard"}})
    (folder / "a.osm").write_text(text)
    for name, form in {"a.osm.pbf": "pbf", "b.osm.pbf": "pbf,pbf_compression=none"}.items():
        with osmium.SimpleWriter(osmium.io.File(str(folder / name), form)) as writer:
            for item in osmium.FileProcessor(str(folder / "a.osm")):
                writer.add(item)
    town = geopandas.GeoDataFrame(
        {"id": [7, 8], "from": [1, 1], "to": [2, 3], "name": ["East", None], "maxspeed": [50, 30]},
        geometry=[line((0, 0), (50, 5), (100, 0)), line((0, 0), (0, 100))],
        crs=4326,
    )
    town.to_parquet(folder / "a.parquet")
    town.to_file(folder / "a.geojson", driver="GeoJSON")
    town.to_wkt().to_csv(folder / "a.csv", index=False)
    RoadMap.from_osm(folder / "a.osm").save(folder / "a.map")
    content = {path.name[2:]: path.read_bytes() for path in sorted(folder.iterdir(), reverse=True)}
    content["raw.osm.pbf"] = (folder / "b.osm.pbf").read_bytes()
    content["osm.gz"] = gzip.compress(text.encode(), mtime=0)
    content["osm.bz2"] = bz2.compress(text.encode())
    content["csv.gz"] = gzip.compress(content["csv"], mtime=0)
    return content


def attempt(door, *arguments):
    """The map, or None and with what words it was refused."""
    try:
        return door(*arguments), ""
    except MapError as error:
        return None, str(error)


@pytest.mark.parametrize(
    ("kind", "times"),
    [("osm", 150), ("osm.gz", 60), ("osm.bz2", 60), ("osm.pbf", 60), ("raw.osm.pbf", 200),
     ("parquet", 100), ("geojson", 100), ("csv", 150), ("csv.gz", 60)],
)  # fmt: skip
def test_a_damaged_file_gives_a_sound_map_or_is_refused_by_name(tmp_path, good, check, kind, times):
    path = tmp_path / f"x.{kind}"
    path.write_bytes(good[kind])
    door = RoadMap.from_osm if "osm" in kind else RoadMap.from_edges
    check(door(path))
    rng = random.Random(kind)
    refusals = []
    for _ in range(times):
        path.write_bytes(damaged(good[kind], rng))
        roads, refusal = attempt(door, path)
        if roads is not None:
            check(roads)
        else:
            refusals.append(refusal)
    assert refusals
    assert all(str(path) in refusal and "\n" not in refusal for refusal in refusals)


def test_a_damaged_compiled_map_is_refused_or_the_same(tmp_path, good):
    path, again = tmp_path / "x.map", tmp_path / "y.map"
    rng = random.Random(1)
    for _ in range(300):
        path.write_bytes(damaged(good["map"], rng))
        roads, refusal = attempt(RoadMap.open, path)
        if roads is None:
            assert str(path) in refusal
        else:
            roads.save(again)
            assert again.read_bytes() == good["map"]


def changed(value, rng):
    """Something of JSON with a part of it gone or another."""
    if isinstance(value, (dict, list)) and value and rng.random() < 0.9:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        copy, key = value.copy(), rng.choice(keys)
        if rng.random() < 0.15:
            del copy[key]
        else:
            copy[key] = changed(copy[key], rng)
        return copy
    other = [None, -1, 0, 2**31, 2**70, 1.5, 1e300, float("nan"), "x", "<i8", [], {}, [-1], [2**40]]
    return rng.choice(other)


def test_a_compiled_map_whose_header_tells_otherwise_is_refused_or_opened(tmp_path, good):
    content, path, rng = good["map"], tmp_path / "x.map", random.Random(2)
    fixed = store._FIXED
    magic, version, length, _, _ = fixed.unpack_from(content)
    header = json.loads(content[fixed.size : fixed.size + length])
    body = content[store._aligned(fixed.size + length) :]
    for _ in range(300):
        text = json.dumps(changed(header, rng)).encode()
        start = store._aligned(fixed.size + len(text))
        begin = fixed.pack(magic, version, len(text), zlib.crc32(text), start + len(body)) + text
        path.write_bytes(begin.ljust(start, b"\0") + body)
        roads, refusal = attempt(RoadMap.open, path)
        assert roads is not None or str(path) in refusal


@pytest.mark.parametrize("seed", range(4))
def test_a_table_of_anything_gives_a_sound_map_or_is_refused(tmp_path, line, check, seed):
    rng = random.Random(seed)
    lines = [line((0, 0), (50, 5), (100, 0)), line((0, 0), (0, 100)), line((-100, 0), (0, 0))]
    odd = [None, shapely.Point(1, 2), shapely.LineString(), shapely.MultiLineString(lines[:2]), 5,
           "LINESTRING(", b"\1", lines[0].wkt, lines[1].wkb, object()]  # fmt: skip
    for _ in range(60):
        rows = rng.randrange(6)
        table = pandas.DataFrame(index=range(rows))
        for name in rng.sample(NAMES, rng.randrange(5)):
            few = rng.sample(CELLS, rng.choice([1, 2, len(CELLS)]))
            table[name] = pandas.Series([rng.choice(few) for _ in range(rows)], dtype=object)
        geometry = [rng.choice(lines if rng.random() < 0.8 else odd) for _ in range(rows)]
        table["geometry"] = pandas.Series(geometry, dtype=object)
        crs = rng.choice([None, None, None, 4326, "x", {}, 5.5])
        roads, refusal = attempt(RoadMap.from_edges, table, crs)
        if roads is None:
            assert "table of edges" in refusal
            continue
        check(roads)
        roads.edges_table()
        roads.save(tmp_path / "a.map")
        assert RoadMap.open(tmp_path / "a.map").info() == roads.info()


@pytest.mark.parametrize(
    "nodes",
    [
        pa.array(["a", "b", "c"]).dictionary_encode(),
        pa.array([[1], [2], None]),
        pa.array([{"x": 1}, {"x": 2}, {"x": 3}]),
        pa.array([1, None, 3], pa.uint64()),
        pa.array([2**63 + 1, 2**63 + 2, 2**63 + 3], pa.uint64()),
        pa.array([1, 2, 3], pa.timestamp("us")),
        pa.array([b"\xff", b"a", None]),
        pa.array([1e300, 2.5, None]),
        pandas.array([1, None, 3], dtype="Int64"),
        pandas.Categorical(["a", "b", None]),
    ],
)
def test_nodes_may_have_any_type_of_name(line, check, nodes):
    lines = [line((0, 0), (100, 0)), line((0, 0), (0, 100)), line((0, 0), (-100, 0))]
    data = {"from": ["hub", "hub", "hub"], "to": nodes, "name": nodes, "speed_limit": nodes}
    if isinstance(nodes, pa.Array):
        table = pa.table({**data, "wkb": [shape.wkb for shape in lines]})
    else:
        table = geopandas.GeoDataFrame(data, geometry=lines, crs=4326)
    roads = RoadMap.from_edges(table)
    check(roads)
    nameless = roads.info()["skipped"].get("rows without from or to", 0)
    assert len(roads) == (2 if nameless else 6)  # two lines that meet are one street


def test_costs_that_are_no_numbers_close_nothing_and_are_counted(line):
    table = geopandas.GeoDataFrame(
        {"cost": [1, "x", None], "reverse_cost": [-1, 1, [2]]},
        geometry=[line((0, i), (90, i)) for i in range(0, 30, 10)],
        crs=4326,
    )
    roads = RoadMap.from_edges(table)
    assert roads.info()["against_one_way"] == 1
    assert roads.info()["skipped"] == {"costs that were not understood (taken as open)": 2}


def test_a_word_that_is_no_utf_8_costs_nothing_but_its_letters(tmp_path, line):
    wkt = line((0, 0), (100, 0)).wkt
    path = tmp_path / "x.csv"
    path.write_bytes(f'id,name,geometry\n1,Straße,"{wkt}"\n'.encode("latin-1"))
    assert RoadMap.from_edges(path).attributes(0)["name"] == "Stra\ufffde"


@pytest.mark.parametrize("name", ["x.osm.pbf", "x.osm", "x.osm.gz", "x.osm.bz2", "x.txt", "x"])
@pytest.mark.parametrize("content", [b"", b"\0\1\2", b"id,from,to\n1,2,3\n", b"<osm><way"])
def test_a_file_that_is_no_map_is_refused_by_name(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MapError, match="x"):
        RoadMap.from_osm(path)


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(MapError, match=r"nowhere\.osm"):
        RoadMap.from_osm(tmp_path / "nowhere.osm")


def test_a_map_without_streets_is_refused(osm):
    with pytest.raises(MapError, match="no drivable way"):
        osm({1: (0, 0), 2: (1, 1)}, [(10, [1, 2], {"highway": "footway"})])
    with pytest.raises(MapError, match="no street has a length"):
        osm({1: (0, 0), 2: (0, 0)}, [(10, [1, 2], {})])


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("x.csv", b"id,from,to\n1,2,3\n"),
        ("x.csv", b""),
        ("x.csv", b"geometry\n\n"),
        ("x.csv", b"geometry\nPOINT (1 2)\n"),
        ("x.parquet", b"PAR1"),
        ("x.geojson", b'{"type": "FeatureCollection", "features": []}'),
        ("x.geojson", b"{"),
        ("x.gpkg", b"\0\1"),
    ],
)
def test_a_table_without_roads_is_refused_by_name(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MapError, match=r"x\."):
        RoadMap.from_edges(path)


def test_what_is_no_table_is_refused(tmp_path):
    with pytest.raises(MapError, match="int"):
        RoadMap.from_edges(5)
    with pytest.raises(MapError, match="the file does not exist"):
        RoadMap.from_edges(tmp_path / "nowhere.csv")


@pytest.mark.parametrize("door", [RoadMap.open, RoadMap.from_osm, RoadMap.from_edges])
def test_a_folder_is_refused_by_name(tmp_path, door):
    with pytest.raises(MapError, match=tmp_path.name):
        door(tmp_path)
