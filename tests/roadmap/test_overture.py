"""Overture's segments: every rule on its range, transitions, and the same city from two sources."""

import json

import numpy as np
import pandas as pd
import pytest
import shapely
from benchmarks.overture import compare
from benchmarks.overture_segments import segment, table, write

from whichroad.errors import MapError
from whichroad.geodesy.plane import Plane
from whichroad.graph.network import AGAINST_ONE_WAY, NO_ACCESS, TURN_BANNED
from whichroad.roadmap import RoadMap
from whichroad.roadmap.open_map import open_map

PLACE = Plane(49.4, 8.7)


def at(x, y):
    lat, lon = PLACE.to_geodetic(float(x), float(y))
    return lon, lat


def line(identity, a, b, ends, **rules):
    """A straight segment from a to b, metres, connectors at its ends and between."""
    return segment(identity, [at(*a), at(*b)], ends, **rules)


def edges_of(roads, identity):
    """(edge, whether it is driven as drawn) of the edges on a segment."""
    ids, forward = roads.sources(np.arange(len(roads)), roads.arrays.edges.length / 2)
    return [
        (e, bool(f)) for e, (one, f) in enumerate(zip(ids, forward, strict=True)) if one == identity
    ]


RANGES = {
    "road_flags": [{"values": ["is_bridge"], "between": [0.2, 0.5]},
                   {"values": ["is_tunnel"], "between": [0.7, 0.9]}],
    "speed_limits": [{"max_speed": {"value": 50, "unit": "km/h"}, "between": [0.0, 0.4]},
                     {"max_speed": {"value": 20, "unit": "mph"}, "between": [0.4, 1.0]}],
    "level_rules": [{"value": 1, "between": [0.2, 0.5]}, {"value": -1, "between": [0.7, 0.9]}],
    "width_rules": [{"value": 7.5, "between": [0.3, 0.8]}],
    "access_restrictions": [
        {"access_type": "denied", "when": {"heading": "backward"}, "between": [0.1, 0.6]},
        {"access_type": "denied", "when": {"mode": ["motor_vehicle"]}, "between": [0.8, 1.0]},
        {"access_type": "denied", "when": {"mode": ["bicycle"]}},
    ],
    "names": {"primary": "Long Street"},
}  # fmt: skip


def holds(rules, share):
    """The rules that hold at a share, as the schema defines `between`."""
    return [
        r for r in rules if r.get("between") is None or r["between"][0] <= share <= r["between"][1]
    ]


def test_every_rule_holds_on_its_range_and_nowhere_else():
    row = line("s", (0, 0), (1000, 0), [("a", 0.0), ("b", 1.0)], **RANGES)
    roads = RoadMap.from_edges(table([row]))
    assert not roads.info()["skipped"]
    for share in np.arange(0.005, 1.0, 0.01):
        x, y = roads.plane.from_geodetic(*(np.array([v]) for v in at(1000 * share, 0)[::-1]))
        near = roads.near(float(x[0]), float(y[0]), 2.0)
        seen = {}
        for edge, s in zip(near.edge.tolist(), near.s.tolist(), strict=True):
            seen[roads.source(edge, s)[1]] = (
                roads.attributes(edge, s),
                roads.arrays.edges.rule[edge],
            )
        flags = {f for r in holds(RANGES["road_flags"], share) for f in r["values"]}
        limits = [r["max_speed"] for r in holds(RANGES["speed_limits"], share)]
        levels = [r["value"] for r in holds(RANGES["level_rules"], share)] or [0]
        widths = [r["value"] for r in holds(RANGES["width_rules"], share)] or [None]
        for attributes, _ in seen.values():
            assert attributes["source_id"] == "s"
            assert attributes["name"] == "Long Street"
            assert attributes["bridge"] == ("is_bridge" in flags)
            assert attributes["tunnel"] == ("is_tunnel" in flags)
            assert attributes["layer"] == levels[0]
            assert attributes["width"] == widths[0]
            wanted = limits[0]["value"] * (1.609344 if limits[0]["unit"] == "mph" else 1.0)
            assert attributes["speed_limit_kmh"] == pytest.approx(wanted)
        assert (seen[False][1] & AGAINST_ONE_WAY > 0) == (0.1 <= share <= 0.6)
        assert not seen[True][1] & AGAINST_ONE_WAY
        assert all((rule & NO_ACCESS > 0) == (share >= 0.8) for _, rule in seen.values())


def test_connectors_join_segments_also_in_their_middle():
    rows = [
        line("main", (0, 0), (200, 0), [("a", 0.0), ("m", 0.5), ("b", 1.0)]),
        line("side", (100, 0), (100, 80), [("m", 0.0), ("c", 1.0)]),
        line("above", (50, -50), (50, 50), [("d", 0.0), ("e", 1.0)]),
    ]
    roads = RoadMap.from_edges(table(rows))
    assert len(edges_of(roads, "main")) == 4
    assert len(edges_of(roads, "side")) == len(edges_of(roads, "above")) == 2
    names = roads.node_ids(np.arange(len(roads.node_id)))
    assert sorted(names) == ["a", "b", "c", "d", "e", "m"]


@pytest.mark.parametrize(
    ("rules", "access"),
    [
        ([{"access_type": "denied"}], "no"),
        ([{"access_type": "denied"}, {"access_type": "allowed", "when": {"mode": ["car"]}}], "yes"),
        ([{"access_type": "denied"},
          {"access_type": "allowed", "when": {"using": ["at_destination"]}}], "limited"),
        ([{"access_type": "denied"},
          {"access_type": "allowed", "when": {"recognized": ["as_private"]}}], "no"),
        ([{"access_type": "denied"},
          {"access_type": "designated", "when": {"mode": ["bus"]}}], "no"),
        ([{"access_type": "denied", "when": {"during": "Mo-Fr 07:00-09:00"}}], "yes"),
        ([{"access_type": "denied", "when": {"mode": ["hgv"]}}], "yes"),
    ],
)  # fmt: skip
def test_the_later_rule_for_cars_decides(rules, access):
    row = line("s", (0, 0), (100, 0), [("a", 0.0), ("b", 1.0)], access_restrictions=rules)
    roads = RoadMap.from_edges(table([row]))
    assert roads.attributes(0)["access"] == access
    assert (roads.arrays.edges.rule[0] & NO_ACCESS > 0) == (access == "no")


CROSS = [
    line("w", (-100, 0), (0, 0), [("west", 0.0), ("m", 1.0)]),
    line("ns", (0, -100), (0, 100), [("south", 0.0), ("m", 0.5), ("north", 1.0)]),
    line("e", (0, 0), (100, 0), [("m", 0.0), ("east", 1.0)]),
]


def banned(roads):
    """Names of the ends of all turns that are banned."""
    turns, edges, found = roads.arrays.turns, roads.arrays.edges, set()
    for e in range(len(roads)):
        for k in range(edges.first_turn[e], edges.end_turn[e]):
            if turns.rule[k] & TURN_BANNED:
                ends = edges.from_node[e], edges.to_node[turns.edge[k]]
                found.add(tuple(roads.node_ids(np.array(ends))))
    return found


@pytest.mark.parametrize(
    ("of", "to", "final", "when", "seen"),
    [
        (0, "ns", "forward", {"heading": "forward"}, {("west", "north")}),
        (0, "ns", "backward", None, {("west", "south")}),
        (0, "e", "forward", None, {("west", "east")}),
        (0, "e", "forward", {"mode": ["hgv"]}, set()),
        (0, "e", "forward", {"mode": ["car", "bus"]}, {("west", "east")}),
        (1, "ns", "backward", {"heading": "forward"}, {("south", "south")}),
        (1, "ns", "forward", {"heading": "forward"}, {("south", "north")}),
        (1, "e", "forward", {"heading": "backward"}, {("north", "east")}),
        (0, "nowhere", "forward", None, set()),
    ],
)
def test_prohibited_transitions_ban_one_turn_in_their_headings(of, to, final, when, seen):
    rows = [dict(row) for row in CROSS]
    step = [{"connector_id": "m", "segment_id": to}]
    one = {"sequence": step, "final_heading": final, "when": when}
    rows[of]["prohibited_transitions"] = [one]
    roads = RoadMap.from_edges(table(rows))
    assert banned(roads) == seen
    assert len(roads.info()["skipped"]) == (0 if seen else 1)


def test_what_is_not_for_cars_is_left_out_and_counted(tmp_path):
    ends = [("a", 0.0), ("b", 1.0)]
    rows = [
        line("s", (0, 0), (100, 0), ends),
        line("f", (0, 0), (100, 0), ends, **{"class": "footway"}),
        line("r", (0, 0), (100, 0), ends, subtype="rail"),
        line("u", (0, 9), (100, 9), [("c", 0.0), ("d", 1.0)],
             road_flags=[{"values": ["is_under_construction"], "between": [0.5, 1.0]}]),
    ]  # fmt: skip
    roads = open_map(write(rows, tmp_path / "segments.parquet"))
    assert roads.info()["skipped"] == {
        "segments of classes not for cars": 1,
        "segments of rail and water": 1,
        "parts under construction or abandoned": 1,
    }
    assert roads.arrays.edges.length[edges_of(roads, "u")[0][0]] == pytest.approx(50.0, rel=1e-3)
    with pytest.raises(MapError, match=r"no road for cars .*segments of rail and water: 1"):
        RoadMap.from_edges(write(rows[2:3], tmp_path / "rail.parquet"))


def test_links_widths_and_unknown_classes_have_the_words_of_openstreetmap():
    ends = [("a", 0.0), ("b", 1.0)]
    kinds = [("motorway", {"subclass": "link"}, "motorway_link"), ("unknown", {}, "road"),
             ("primary", {"road_flags": [{"values": ["is_link"]}]}, "primary_link"),
             ("service", {"subclass": "driveway"}, "service")]  # fmt: skip
    for word, more, wanted in kinds:
        roads = RoadMap.from_edges(
            table([line("s", (0, 0), (100, 0), ends, **{"class": word}, **more)])
        )
        assert roads.column("highway") == [wanted] * 2


def test_a_saved_map_and_a_frame_say_the_same(tmp_path):
    rows = [line("s", (0, 0), (1000, 0), [("a", 0.0), ("b", 1.0)], **RANGES), *CROSS]
    roads = RoadMap.from_edges(table(rows))
    roads.save(tmp_path / "a.map")
    frame = RoadMap.from_edges(table(rows).to_pandas())
    for other in (RoadMap.open(tmp_path / "a.map"), frame):
        assert other.info() == roads.info()
        assert other.column("source_id") == roads.column("source_id")


@pytest.mark.parametrize("kind", ["geojson", "geojsonl", "gpkg", "gpkg in metres", "text.parquet"])
def test_other_files_than_parquet_say_the_same(kind, tmp_path):
    """As the downloader writes them, and as GDAL and geopandas save them again: lists are text."""
    geopandas = pytest.importorskip("geopandas")
    rows = [line("s", (0, 0), (1000, 0), [("a", 0.0), ("b", 1.0)], **RANGES), *CROSS]
    rows[1] = rows[1] | {
        "prohibited_transitions": [
            {"sequence": [{"connector_id": "m", "segment_id": "ns"}], "final_heading": "forward"}
        ]
    }
    roads = RoadMap.from_edges(table(rows))
    features = []
    for row in table(rows).to_pylist():
        shape = json.loads(shapely.to_geojson(shapely.from_wkb(row.pop("geometry"))))
        told = {name: cell for name, cell in row.items() if cell is not None}
        features.append({"type": "Feature", "geometry": shape, "properties": told})
    path = tmp_path / f"segments.{'geojsonl' if kind == 'geojsonl' else 'geojson'}"
    whole = json.dumps({"type": "FeatureCollection", "features": features})
    path.write_text("\n".join(map(json.dumps, features)) if kind == "geojsonl" else whole)
    if kind.startswith(("gpkg", "text")):
        frame = geopandas.read_file(path)
        lists = [name for name in frame.columns if frame[name].dtype == object]
        for name in {*lists} - {"geometry"}:
            frame[name] = [
                c if c is None or isinstance(c, str) else json.dumps(c) for c in frame[name]
            ]
        frame = frame.to_crs(32632) if "metres" in kind else frame
        path = tmp_path / f"segments.{kind.split()[0]}"
        frame.to_parquet(path) if "text" in kind else frame.to_file(path, driver="GPKG")
    other = open_map(path)
    assert other.info()["skipped"] == {}
    same = ("nodes", "edges", "legal_edges", "highway")
    assert {k: other.info()[k] for k in same} == {k: roads.info()[k] for k in same}
    assert banned(other) == banned(roads) == {("west", "north")}
    columns = ["source_id", "name", "speed_limit_kmh", "layer", "bridge", "oneway", "width"]
    ours, theirs = (one.edges_table()[columns] for one in (roads, other))
    pd.testing.assert_frame_equal(ours, theirs)


@pytest.mark.parametrize("kind", ["csv", "shp"])
def test_text_of_numpy_records_and_names_of_ten_letters_are_read(kind, tmp_path):
    """As pandas writes CSV, and as a shapefile cuts names."""
    geopandas = pytest.importorskip("geopandas")
    more = RANGES if kind == "csv" else {}
    rows = [line("s", (0, 0), (1000, 0), [("a", 0.0), ("b", 1.0)], **more), *CROSS]
    roads = RoadMap.from_edges(table(rows))
    plain = table(rows).to_pandas()
    shapes = shapely.from_wkb(plain.pop("geometry"))
    cells = plain.map(lambda cell: str(cell) if isinstance(cell, np.ndarray | list) else cell)
    path = tmp_path / f"segments.{kind}"
    if kind == "csv":
        assert "} {" in "".join(cells["connectors"])
        cells.assign(geometry=shapely.to_wkt(shapes, rounding_precision=9)).to_csv(path)
    else:
        cells = cells[["id", "class", "subtype", "connectors"]]
        assert (cells["connectors"].str.len() < 254).all()  # of which a shapefile keeps no more
        geopandas.GeoDataFrame(cells, geometry=shapes, crs=4326).to_file(path)
    assert open_map(path).info()["nodes"] == roads.info()["nodes"]


@pytest.mark.data
@pytest.mark.slow
def test_a_city_has_the_same_legal_directions_levels_and_limits_from_both_sources(data_folder):
    told = compare(data_folder / "maps" / "heidelberg.osm.pbf")
    assert told["found"] >= 0.995 * told["chosen"]
    assert told["rule"] >= 0.995 * told["found"]
    assert told["levels"] == told["found"]
    assert told["limits"] == told["found"]
