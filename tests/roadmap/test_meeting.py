"""Where the lines of a table meet, told by nothing but their geometry, or by names of nodes."""

import geopandas
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from whichroad.errors import MapError
from whichroad.roadmap import RoadMap


@pytest.mark.parametrize(("gap", "edges"), [(0.0, 2), (0.4, 2), (0.6, 4)])
def test_ends_within_half_a_metre_meet(line, gap, edges):
    lines = [line((0, 0), (100, 0)), line((100 + gap, 0), (200, 80))]
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(geometry=lines, crs=4326))
    assert len(roads) == edges


def test_an_end_on_a_vertex_of_another_line_is_a_junction(line, check):
    lines = [line((0, 0), (100, 0), (200, 0)), line((100, 0.2), (100, 100))]
    roads = RoadMap.from_edges(geopandas.GeoDataFrame({"id": [1, 2]}, geometry=lines, crs=4326))
    check(roads)
    assert len(roads) == 6


@pytest.mark.parametrize(("gap", "edges"), [(0.0, 6), (0.4, 6), (-0.4, 6), (0.6, 4), (-0.6, 4)])
@pytest.mark.parametrize("turned", [False, True])
def test_an_end_on_another_line_is_a_junction(line, check, gap, edges, turned):
    side = [(70, gap), (70, 100)]
    lines = [line((0, 0), (200, 0)), line(*(side[::-1] if turned else side))]
    roads = RoadMap.from_edges(
        geopandas.GeoDataFrame({"id": [1, 2]}, geometry=lines, crs=4326), directed=False
    )
    check(roads)
    assert len(roads) == edges
    assert "skipped" not in roads.info() or not roads.info()["skipped"]
    if edges == 6:  # and the line that is met stays straight
        along = [e for e in range(6) if roads.source(e, 1.0)[0] == 1]
        assert sorted(roads.arrays.edges.length[along]) == pytest.approx(
            [70, 70, 130, 130], abs=0.01
        )
        headings = {round(float(np.degrees(roads.at(e, 1.0)[2])), 2) % 180 for e in along}
        assert all(min(h, 180 - h) < 0.02 for h in headings)


def test_several_ends_in_one_place_on_another_line_are_one_junction(line, check):
    lines = [
        line((0, 0), (40, 0), (200, 0)),
        line((100, 0.1), (100, 80)),
        line((60, -90), (100, -0.2)),
        line((150, 0), (150, 60)),
        line((50, 50), (30, 0)),
    ]
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(geometry=lines, crs=4326), directed=False)
    check(roads)
    assert roads.info()["nodes"] == 9
    assert len(roads) == 2 * (4 + 4)
    assert not roads.info()["skipped"]


def test_a_line_does_not_meet_itself_beside_its_vertices(line, check):
    hook = line((0, 0), (100, 0), (100, 50), (50, 50), (50, 0.1))
    roads = RoadMap.from_edges(geopandas.GeoDataFrame(geometry=[hook], crs=4326))
    check(roads)
    assert len(roads) == 2


def test_an_end_on_both_directions_of_a_road_meets_the_road(line, check):
    there, back = line((0, 0), (200, 0)), line((200, 0), (0, 0))
    side = [line((70, 0), (70, 90)), line((70, 90), (70, 0))]
    table = geopandas.GeoDataFrame({"id": [1, 2, 3, 4]}, geometry=[there, back, *side], crs=4326)
    roads = RoadMap.from_edges(table)
    check(roads)
    assert len(roads) == 6
    assert np.all(roads.arrays.edges.rule == 0)
    ids = set(roads.sources(np.arange(6), 1.0)[0])
    assert ids == {1, 2, 3, 4}


@given(st.lists(st.integers(1, 199), min_size=1, max_size=8), st.floats(-180, 180))
def test_ends_along_a_line_cut_it_where_they_are(check, degrees, places, angle):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))

    def line(*points):
        return shapely.LineString([degrees(c * x - s * y, s * x + c * y) for x, y in points])

    sides = [line((5 * p, 0), (5 * p + 1, 30 + i)) for i, p in enumerate(places)]
    table = geopandas.GeoDataFrame(geometry=[line((0, 0), (1000, 0)), *sides], crs=4326)
    roads = RoadMap.from_edges(table)
    check(roads)
    cuts = [0, *(5 * p for p in sorted(set(places))), 1000]
    along = [e for e in range(len(roads)) if roads.source(e, 1.0) == (0, True)]
    np.testing.assert_allclose(
        np.sort(roads.arrays.edges.length[along]), np.sort(np.diff(cuts)), atol=0.01
    )


def test_a_vertex_in_two_lines_is_a_junction_unless_they_are_on_different_levels(line):
    lines = [line((-90, 0), (0, 0), (100, 0)), line((0, -90), (0, 0), (0, 100))]
    assert len(RoadMap.from_edges(geopandas.GeoDataFrame(geometry=lines, crs=4326))) == 8
    bridge = geopandas.GeoDataFrame({"bridge": ["no", "yes"]}, geometry=lines, crs=4326)
    assert len(RoadMap.from_edges(bridge)) == 4
    layer = geopandas.GeoDataFrame({"layer": [0, 1]}, geometry=lines, crs=4326)
    assert len(RoadMap.from_edges(layer)) == 4


def test_a_line_that_ends_beside_its_named_node_is_drawn_on_to_it(line, check):
    lines = [line((0, 0), (100, 0)), line((104, 0), (200, 0)), line((100, 0), (100, 50))]
    table = geopandas.GeoDataFrame(
        {"id": [1, 2, 3], "from": [1, 2, 2], "to": [2, 3, 4]}, geometry=lines, crs=4326
    )
    roads = RoadMap.from_edges(table, directed=False)
    check(roads)
    assert len(roads) == 6
    assert roads.info()["skipped"] == {"ends drawn on to their node": 1}
    assert max(roads.arrays.edges.length) == pytest.approx(100, abs=0.01)


def test_from_and_to_that_are_no_nodes_are_refused(line):
    lines = [line((1000 * i, 0), (1000 * i + 300, 0)) for i in range(9)]
    table = geopandas.GeoDataFrame(
        {"from": ["Alley"] * 9, "to": ["Lane"] * 9}, geometry=lines, crs=4326
    )
    with pytest.raises(MapError, match="rename"):
        RoadMap.from_edges(table)


def test_vertices_too_close_to_tell_apart_are_one(line, check):
    points = [(0, 0), (0.0002, 0), (0.0009, 0), (0.0016, 0.0001), (50, 0), (50, 0.0004), (90, 9)]
    table = geopandas.GeoDataFrame(geometry=[line(*points)], crs=4326)
    roads = RoadMap.from_edges(table)
    check(roads)
    assert len(roads) == 2
    assert np.diff(roads.edge_line(0), axis=0).shape[0] < 6
    assert roads.arrays.edges.length[0] == pytest.approx(50 + np.hypot(40, 9), abs=0.01)
