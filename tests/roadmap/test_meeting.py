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


def _overpass(line, **levels):
    """Two roads cut where one passes over the other: west, east, south, north."""
    ends = [((-90, 0), (0, 0)), ((0, 0), (100, 0)), ((0, -90), (0, 0)), ((0, 0), (0, 100))]
    return geopandas.GeoDataFrame(levels, geometry=[line(*e) for e in ends], crs=4326)


@pytest.mark.parametrize("names", [("F_ZLEV", "T_ZLEV"), ("f_elev", "t_elev")])
def test_ends_of_different_levels_do_not_meet(line, check, names):
    levels = dict(zip(names, ([0, 0, 0, 1], [0, 0, 1, 0]), strict=True))
    roads = RoadMap.from_edges(_overpass(line, **levels), directed=False)
    check(roads)
    assert roads.info()["nodes"] == 4
    assert sorted(round(float(m)) for m in roads.arrays.edges.length) == [190] * 4
    levels = dict(zip(names, ([0, 0, 0, "1"], [0, 0, 1, None]), strict=True))
    table = _overpass(line, **levels).assign(u=[1, 9, 3, 9], v=[9, 2, 9, 4])
    assert RoadMap.from_edges(table, directed=False).info()["nodes"] == 5


def test_heights_of_ends_are_no_levels(line):
    table = _overpass(line, f_elev=[101.2, 101.5, 99, 101.4], t_elev=[101.5, 103, 101.4, 99])
    roads = RoadMap.from_edges(table, directed=False)
    assert roads.info()["nodes"] == 5
    why = "levels of ends that are no whole numbers up to 9 (none was read)"
    assert roads.info()["skipped"] == {why: 4}


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


def _named(lines, origin, target, **more):
    return geopandas.GeoDataFrame(
        {"id": range(len(lines)), "from": origin, "to": target, **more}, geometry=lines, crs=4326
    )


def _lengths(roads):
    edges = roads.arrays.edges
    ends = zip(roads.node_ids(edges.from_node), roads.node_ids(edges.to_node), strict=True)
    return {pair: (round(float(m)), int(r))
            for pair, m, r in zip(ends, edges.length, edges.rule, strict=True)}  # fmt: skip


CROSS = [((0, 0), (300, 0)), ((300, 0), (300, 400)), ((300, 0), (700, 0)), ((300, 0), (300, -500))]
CROSS_NODES = [(1, 2), (2, 3), (2, 4), (2, 5)]


@given(st.lists(st.booleans(), min_size=4, max_size=4), st.permutations(range(4)))
def test_lines_may_name_their_nodes_in_any_order(line, swapped, order):
    once = ["no", "yes", "yes", "-1"]
    lines = [line(*CROSS[i]) for i in order]
    once = [once[i] for i in order]
    straight = [CROSS_NODES[i] for i in order]
    named = [pair[::-1] if swapped[i] else pair for i, pair in zip(order, straight, strict=True)]
    table = _named(lines, *zip(*named, strict=True), oneway=once)
    roads = RoadMap.from_edges(table)
    whole = RoadMap.from_edges(_named(lines, *zip(*straight, strict=True), oneway=once))
    assert _lengths(roads) == _lengths(whole)  # directions are those of the drawing
    why = "lines drawn from their second node to their first (nodes exchanged)"
    assert roads.info()["skipped"] == ({why: sum(swapped)} if any(swapped) else {})


def test_a_line_alone_that_names_its_nodes_in_both_orders_is_one_road(line, check):
    lines = [line((0, 0), (300, 0))] * 2
    roads = RoadMap.from_edges(_named(lines, [1, 2], [2, 1], oneway=["no", "no"]))
    check(roads)
    assert _lengths(roads) == {(1, 2): (300, 0), (2, 1): (300, 0)}


def test_a_line_shorter_than_ends_may_lie_apart_joins_its_nodes_in_any_order(line):
    lines = [
        line((0, 0), (300, 0)),
        line((300, 0), (300.4, 0)),
        line((300.4, 0), (600, 0)),
        line((300, 0), (300, -200)),
        line((300.4, 0), (300.4, 200)),
    ]
    roads = RoadMap.from_edges(_named(lines, [1, 3, 4, 2, 3], [2, 2, 3, 5, 6], oneway=["no"] * 5))
    assert {(1, 2), (2, 3), (3, 4), (2, 5), (3, 6)} < set(_lengths(roads))


def test_where_rows_are_directions_the_nodes_tell_which(line, check):
    lines = [line(*points) for points in CROSS]
    there, back = zip(*CROSS_NODES, strict=True)
    for table in (
        _named(lines * 2, [*there, *back], [*back, *there]),
        _named(lines[:3] * 2, [*there[:3], *back[:3]], [*back[:3], *there[:3]]),
    ):
        roads = RoadMap.from_edges(table)
        check(roads)
        assert not roads.arrays.edges.rule.any()
        turned = {
            "lines drawn from their second node to their first (lines turned)": len(table) // 2
        }
        assert roads.info()["skipped"] == turned
        assert set(roads.sources(np.arange(len(roads)), 1.0)[0]) == set(table.id)
    table = _named(lines, there, back, cost=[1.0] * 4, reverse_cost=[-1.0] * 4)
    table.loc[3, ["from", "to"]] = 5, 2
    rule = _lengths(RoadMap.from_edges(table))
    assert rule[5, 2] == (500, 0)
    assert rule[2, 5][1] > 0


def test_of_two_way_roads_the_drawing_stays(line):
    table = _named([line(*points) for points in CROSS], [1, 3, 2, 2], [2, 2, 4, 5])
    roads = RoadMap.from_edges(table)
    pairs = zip(roads.node_ids(roads.arrays.edges.from_node), range(len(roads)), strict=True)
    forward = {n: roads.source(e, 1.0) for n, e in pairs if roads.source(e, 1.0)[0] == 1}
    assert forward == {2: (1, True), 3: (1, False)}


def test_a_node_lies_where_most_lines_have_it_and_far_ends_do_not_meet_it(line, check):
    lines = [line((0, 0), (100, 250)), *(line(*points) for points in CROSS)]
    table = _named(lines, [9, *(a for a, _ in CROSS_NODES)], [2, *(b for _, b in CROSS_NODES)])
    roads = RoadMap.from_edges(table, directed=False)
    check(roads)
    assert roads.info()["skipped"] == {"ends over 100 m from their node (not joined to it)": 1}
    found = sorted(round(float(m)) for m in roads.arrays.edges.length)
    assert found == [269, 269, 300, 300, 400, 400, 400, 400, 500, 500]


def test_ends_that_are_drawn_on_by_more_than_a_junction_are_told(line):
    lines = [line(*points) for points in CROSS]
    lines[1] = line((300, 40), (300, 400))
    roads = RoadMap.from_edges(_named(lines, *zip(*CROSS_NODES, strict=True)), directed=False)
    assert roads.info()["skipped"] == {"ends drawn on to their node by over 20 m": 1}


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
