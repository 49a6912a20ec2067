"""Metres and shares along the roads of the source, by pyproj along the lines as they were drawn."""

import geopandas
import numpy as np
import pyproj
import pytest
import shapely
from benchmarks.overture_segments import segment, table

from whichroad import match
from whichroad.replay.recorded_messages import RecordedMessages
from whichroad.roadmap import RoadMap

GEOD = pyproj.Geod(ellps="WGS84")
NODES = {1: (0, 0), 2: (120, 10), 3: (200, 0), 4: (260, 80), 5: (120, -90), 6: (400, 80)}
WAYS = [(10, [1, 2, 3], {}), (20, [6, 4, 3], {"oneway": "yes"}), (30, [5, 2], {})]


def along(places, lon, lat):
    """Metres from the start of a line to the point nearest to a place, and its length."""
    line = shapely.LineString(places)
    share = line.project(shapely.Point(lon, lat), normalized=True)
    lons, lats = zip(*shapely.get_coordinates(shapely.ops.substring(line, 0, share, True)),
                     strict=True)  # fmt: skip
    return GEOD.line_length(lons, lats), GEOD.line_length(*zip(*places, strict=True))


def agree(roads, drawn, names=None, tolerance=0.05):
    """Assert that places along all edges are those along the lines of the source."""
    compared = 0
    for e in range(len(roads)):
        for s in np.linspace(0.5, roads.arrays.edges.length[e] - 0.5, 7):
            x, y, _ = roads.at(e, float(s))
            lat, lon = (float(v[0]) for v in roads.plane.to_geodetic(np.array([x]), np.array([y])))
            name, _ = roads.source(e, float(s))
            if names is not None and name not in names:
                continue
            m, whole = along(drawn[name], lon, lat)
            place = roads.on_source(e, s)
            assert place.m[0] == pytest.approx(m, abs=tolerance), (e, s, name)
            assert place.share[0] == pytest.approx(m / whole, abs=tolerance / whole)
            compared += 1
    return compared


@pytest.fixture
def drawn(degrees):
    return {number: [degrees(*NODES[n]) for n in nodes] for number, nodes, _ in WAYS}


def test_places_on_ways_are_those_along_the_ways_in_both_directions(osm, drawn):
    assert agree(osm(NODES, WAYS), drawn) > 50


def test_a_way_that_a_box_cuts_keeps_its_own_start(osm, xml, drawn, degrees, tmp_path):
    path = tmp_path / "map.osm"
    path.write_text(xml(NODES, WAYS))
    west, south = degrees(130, -50)
    east, north = degrees(500, 50)
    roads = RoadMap.from_osm(path, bbox=(west, south, east, north))
    assert set(roads.pieces.way.tolist()) == {0, 1}
    assert agree(roads, drawn) > 10
    assert roads.pieces.offset.min() == pytest.approx(along(drawn[10], *drawn[10][1])[0], abs=0.05)


def test_rows_of_both_directions_each_count_from_their_own_start(line):
    there, side = line((0, 0), (100, 5), (200, 0)), line((100, 5), (100, 80))
    rows = {"id": ["a", "b", "c"], "geometry": [there, there.reverse(), side]}
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(rows, crs="EPSG:4326"), directed=True)
    drawn = {i: list(g.coords) for i, g in zip(rows["id"], rows["geometry"], strict=True)}
    assert {roads.source(e, 1.0)[0] for e in range(len(roads))} == {"a", "b", "c"}
    assert agree(roads, drawn) > 30


def test_several_lines_of_a_row_follow_each_other(line):
    parts = [line((0, 0), (100, 0)), line((150, 0), (250, 0))]
    rows = {
        "id": ["a", "b"],
        "geometry": [shapely.MultiLineString(parts), line((0, 500), (0, 550))],
    }
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(rows, crs="EPSG:4326"), directed=False)
    found = {}
    for e in range(len(roads)):
        if roads.source(e, 1.0) == ("a", True):
            place = roads.on_source([e, e], [0.0, 100.0])
            found[round(float(place.m[0]))] = place
    assert found.keys() == {0, 100}
    assert found[100].m == pytest.approx([100.0, 200.0], abs=0.05)
    assert found[100].share == pytest.approx([0.5, 1.0], abs=1e-3)


def test_parts_of_a_segment_count_from_the_start_of_the_segment(degrees):
    places = [degrees(0, 0), degrees(300, 40), degrees(1000, 0)]
    limits = [{"max_speed": {"value": 50, "unit": "km/h"}, "between": [0.3, 0.55]}]
    bridge = [{"values": ["is_bridge"], "between": [0.7, 0.8]}]
    row = segment("s", places, [("a", 0.0), ("b", 1.0)], speed_limits=limits, road_flags=bridge)
    roads = RoadMap.from_edges(table([row]))
    assert agree(roads, {"s": places}, tolerance=0.2) == 14
    assert len(np.unique(roads.pieces.way)) == 5


def test_attributes_of_points_are_those_of_their_source(osm, degrees):
    """Two streets without a junction between them are one edge."""
    nodes = {1: (0, 0), 2: (150, 0), 3: (400, 0)}
    streets = {"10": ("Kurze Straße", 30), "20": ("Lange Straße", 70)}
    ways = [
        (int(way), [at, at + 1], {"name": name, "maxspeed": str(limit)})
        for at, (way, (name, limit)) in enumerate(streets.items(), 1)
    ]
    roads = osm(nodes, ways)
    assert len(roads) == 2  # a direction each
    lon, lat = zip(*(degrees(10.0 * k, 1.0) for k in range(40)), strict=True)
    table = {"time": np.arange(40.0), "lat": lat, "lon": lon, "sigma_m": [2.0] * 40}
    result = match(table, roads, attributes=True)
    points = result.to_arrow().to_pylist()
    named = [(p["source_id"], p["name"], p["speed_limit_kmh"]) for p in points if p["source_id"]]
    assert {source for source, _, _ in named} == {"10", "20"}
    assert all(streets[source] == (name, limit) for source, name, limit in named)
    recorded = RecordedMessages(result, roads)
    roads_told = [recorded.message(k, k, None)["road"] for k in range(len(points))]
    assert [(r["source_id"], r["name"], r["speed_limit_kmh"]) for r in roads_told] == [
        (p["source_id"], p["name"], p["speed_limit_kmh"]) for p in points
    ]
