"""Roads as vector tiles, read back by a plain reader."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from whichroad.page.layer import MAX_ZOOM, RoadLayer, drawn_near, edge_of
from whichroad.page.vectortile import EXTENT, Line, encode_layer
from whichroad.roadmap import RoadMap

from .tiles import decode

POINT = st.tuples(st.integers(-(2**20), 2**20), st.integers(-(2**20), 2**20))


def address(lat: float, lon: float, z: int) -> tuple[float, float]:
    """Where a place is, in tiles of a zoom."""
    y = 0.5 - math.log(math.tan(math.pi / 4 + math.radians(lat) / 2)) / (2 * math.pi)
    return (lon / 360 + 0.5) * 2**z, y * 2**z


@pytest.fixture(scope="module")
def layer(roads: RoadMap) -> RoadLayer:
    return RoadLayer(roads)


@given(st.lists(st.lists(POINT, min_size=2, max_size=6, unique=True), min_size=1, max_size=4))
def test_lines_come_back_as_they_went_in(parts: list[list[tuple[int, int]]]):
    tile = encode_layer("road", [Line(parts, {"name": "Hauptstraße", "rank": 3})])
    assert decode(tile) == {"road": [({"name": "Hauptstraße", "rank": 3}, parts)]}


def test_a_line_that_is_a_point_is_left_out():
    assert encode_layer("road", [Line([[(5, 5), (5, 5)]], {})]) == b""


def test_every_point_of_every_street_lies_on_a_line_of_its_tile(layer: RoadLayer, roads: RoadMap):
    for edge in range(0, len(roads), 7):
        for lon, lat in edge_of(roads, edge)["line"]:
            x, y = address(lat, lon, MAX_ZOOM)
            tile = decode(layer.tile(MAX_ZOOM, int(x), int(y)))
            lines = [line for _, parts in tile["road"] for line in parts]
            place = shapely.Point((x - int(x)) * EXTENT, (y - int(y)) * EXTENT)
            away = min(place.distance(shapely.LineString(line)) for line in lines)
            assert away <= 0.5 * EXTENT / 512 + 1.0  # half a pixel simplified, one unit rounded


def test_from_afar_the_roads_are_there_too(layer: RoadLayer):
    for z in (0, 5, 9):
        x, y = address(49.41, 2.82, z)
        assert "road" in decode(layer.tile(z, int(x), int(y)))


def test_where_no_road_is_the_tile_is_empty(layer: RoadLayer):
    assert layer.tile(10, 0, 0) == b""


@pytest.mark.parametrize("at", [(-1, 0, 0), (MAX_ZOOM + 1, 0, 0), (3, 8, 0), (3, 0, -1)])
def test_a_tile_that_does_not_exist_is_refused(layer: RoadLayer, at: tuple[int, int, int]):
    with pytest.raises(ValueError, match="there is no tile"):
        layer.tile(*at)


def test_names_are_sent_when_the_map_is_close(layer: RoadLayer, roads: RoadMap):
    edge = next(e for e in range(len(roads)) if edge_of(roads, e)["name"] == "Grande Rue")
    lon, lat = np.mean(edge_of(roads, edge)["line"], axis=0)
    x, y = (int(v) for v in address(lat, lon, 15))
    named = {properties["name"] for properties, _ in decode(layer.tile(15, x, y))["name"]}
    assert "Grande Rue" in named
    x, y = (int(v) for v in address(lat, lon, 11))
    assert "name" not in decode(layer.tile(11, x, y))


def test_a_one_way_street_is_drawn_in_its_direction(layer: RoadLayer, roads: RoadMap):
    edges = roads.arrays.edges
    edge = next(
        e for e in range(len(roads)) if edges.rule[e] == 0 and edges.rule[edges.opposite[e]] & 1
    )
    first, *_, last = edge_of(roads, edge)["line"]
    middle = np.mean([first, last], axis=0)
    x, y = address(middle[1], middle[0], 14)
    tile = decode(layer.tile(14, int(x), int(y)))
    begin, end = (
        np.array(address(lat, lon, 14)) * EXTENT - np.floor((x, y)) * EXTENT
        for lon, lat in (first, last)
    )
    ways = [line for p, parts in tile["road"] if "oneway" in p for line in parts]
    mine = min(ways, key=lambda line: np.hypot(*(np.array(line[0]) - begin)))
    assert np.hypot(*(np.array(mine[0]) - begin)) < 3
    assert np.hypot(*(np.array(mine[-1]) - end)) < np.hypot(*(np.array(mine[0]) - end))


def test_the_same_map_has_the_same_version_and_another_has_not(roads: RoadMap, layer: RoadLayer):
    assert RoadLayer(roads).version == layer.version
    other = shapely.LineString([(8.0, 49.0), (8.01, 49.01)])
    import geopandas

    frame = geopandas.GeoDataFrame(geometry=[other], crs="EPSG:4326")
    assert RoadLayer(RoadMap.from_edges(frame)).version != layer.version


def test_only_streets_near_the_track_and_main_roads_are_drawn_in_a_report(roads: RoadMap):
    lon, lat = (np.array(column) for column in zip(*edge_of(roads, 0)["line"], strict=True))
    everything, near = (drawn_near(roads, lat, lon, margin) for margin in (1e5, 20.0))
    assert 0 < len(near) < len(everything) <= len(roads)
    assert edge_of(roads, 0)["name"] in {name for _, name, _ in near}
