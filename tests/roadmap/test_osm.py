"""Maps from OpenStreetMap: what becomes of ways, one-ways, restrictions and cut extracts."""

import bz2
import gzip
import math

import numpy as np
import osmium
import pyproj
import pytest

from whichroad.graph.network import AGAINST_ONE_WAY, NO_ACCESS, U_TURN
from whichroad.roadmap import RoadMap

CROSS = {1: (0, 0), 2: (100, 0), 3: (0, 100), 4: (-100, 0), 5: (0, -100)}
ARMS = [(10, [1, 2], {}), (20, [1, 3], {}), (30, [1, 4], {}), (40, [1, 5], {})]


def test_a_cross_has_four_streets_in_both_directions(osm, check):
    roads = osm(CROSS, ARMS)
    check(roads)
    assert len(roads) == 8
    assert roads.info()["nodes"] == 5
    assert np.all(roads.arrays.edges.rule == 0)


# arms that lead on, to a ring through their ends
RING = [*ARMS, (50, [2, 3, 4, 5, 2], {})]


def test_turns_have_the_angles_and_priors_of_the_model(osm, turn):
    roads = osm(CROSS, RING)
    straight, left, right, back = (turn(roads, 4, 1, n) for n in (2, 3, 5, 4))
    assert straight[1] == pytest.approx(0, abs=1e-4)
    assert left[1] == pytest.approx(math.pi / 2, abs=1e-4)
    assert right[1] == pytest.approx(-math.pi / 2, abs=1e-4)
    assert back[1] == np.float32(math.pi)
    assert back[2] == U_TURN
    assert [p for p, _, _ in (straight, left, right, back)] == pytest.approx(
        [x / 2.01 for x in (1, 0.5, 0.5, 0.01)], rel=1e-5
    )


def test_a_dead_end_leaves_nothing_but_turning_round(osm, turn):
    roads = osm(CROSS, ARMS)
    assert turn(roads, 1, 2, 1)[0] == 1


def test_into_a_dead_end_one_turns_as_often_as_it_is_long(osm, turn):
    """Of those shorter than 500 m fewer drives are bound for; a stub of 1 m changes nothing."""
    nodes = {**CROSS, 3: (0, 1), 5: (0, -250), 6: (500, 0), 7: (900, 0)}
    roads = osm(nodes, [(10, [1, 6, 7], {}), *ARMS[1:]])
    stub, middle, on = (turn(roads, 4, 1, n)[0] for n in (3, 5, 7))
    assert middle / on == pytest.approx(0.5 * 0.5, rel=1e-3)  # round a corner
    assert stub / on == pytest.approx(0.5 / 500.0, rel=1e-2)


def test_where_there_is_no_junction_one_hardly_turns_round(osm, turn):
    """A street of another class goes on: a node of two ways."""
    nodes = {1: (0, 0), 2: (600, 0), 3: (1200, 0)}
    roads = osm(nodes, [(10, [1, 2], {}), (20, [2, 3], {"highway": "tertiary"})])
    back, _, broken = turn(roads, 1, 2, 1)
    assert broken == U_TURN
    assert back / turn(roads, 1, 2, 3)[0] == pytest.approx(1e-4, rel=1e-4)


def test_turning_into_a_service_road_is_less_likely_from_a_street_only(osm, turn):
    roads = osm(CROSS, [*ARMS[:1], (20, [1, 3], {"highway": "service"}), *ARMS[2:]])
    assert turn(roads, 4, 1, 3)[0] / turn(roads, 4, 1, 5)[0] == pytest.approx(0.3, rel=1e-5)
    assert turn(roads, 3, 1, 4)[0] / turn(roads, 3, 1, 2)[0] == pytest.approx(1, rel=1e-5)
    assert roads.arrays.edges.service.sum() == 2


@pytest.mark.parametrize(
    ("tags", "legal"),
    [
        ({}, (True, True)),
        ({"oneway": "yes"}, (True, False)),
        ({"oneway": "1"}, (True, False)),
        ({"oneway": "-1"}, (False, True)),
        ({"oneway": "reverse"}, (False, True)),
        ({"oneway": "no"}, (True, True)),
        ({"junction": "roundabout"}, (True, False)),
        ({"junction": "circular"}, (True, False)),
        ({"highway": "motorway"}, (True, False)),
        ({"highway": "motorway", "oneway": "no"}, (True, True)),
        ({"oneway": "reversible"}, (True, True)),
    ],
)
def test_one_way_streets_exist_in_the_other_direction_but_break_a_rule(
    osm, check, tags, legal, edge
):
    roads = osm({1: (0, 0), 2: (100, 0)}, [(10, [1, 2], tags)])
    check(roads)
    rules = [int(roads.arrays.edges.rule[edge(roads, *pair)]) for pair in ((1, 2), (2, 1))]
    assert rules == [0 if ok else AGAINST_ONE_WAY for ok in legal]


def test_driving_against_a_one_way_is_unlikely(osm, turn):
    roads = osm(CROSS, [*ARMS[:3], (40, [5, 1], {"oneway": "yes"})])
    prior, _, broken = turn(roads, 4, 1, 5)
    assert broken == AGAINST_ONE_WAY
    assert prior / turn(roads, 4, 1, 3)[0] == pytest.approx(2e-4, rel=1e-4)


def test_a_roundabout_is_driven_one_way_round(osm, check):
    ring = {i: (20 * math.cos(t), 20 * math.sin(t)) for i, t in enumerate(np.arange(0, 6, 1), 1)}
    nodes = {**ring, 11: (100, 0), 14: (-80, 20)}
    ways = [
        (10, [1, 2, 3, 4, 5, 6, 1], {"junction": "roundabout", "lanes": "2"}),
        (20, [1, 11], {}),
        (30, [4, 14], {}),
    ]
    roads = osm(nodes, ways)
    check(roads)
    edges = roads.arrays.edges
    assert len(roads) == 8
    ring = [e for e in range(8) if roads.attributes(e)["roundabout"]]
    assert len(ring) == 4
    legal = [e for e in ring if edges.rule[e] == 0]
    assert len(legal) == 2
    for e in legal:  # counter-clockwise, and nobody keeps right of a roundabout's middle
        line = roads.edge_line(e)
        middle = (
            roads.edge_line(legal[0]).mean(axis=0) / 2 + roads.edge_line(legal[1]).mean(axis=0) / 2
        )
        (ux, uy), (vx, vy) = line[0] - middle, line[1] - middle
        assert ux * vy - uy * vx > 0
        assert edges.lane[e] == 0


def test_lanes_and_widths_say_where_one_drives(osm, edge):
    nodes = {1: (0, 0), 2: (100, 0), 3: (0, 100), 4: (-100, 0), 5: (0, -100), 6: (70, 70)}
    ways = [
        (10, [1, 2], {"highway": "primary"}),
        (20, [1, 3], {"highway": "primary", "width": "9 m"}),
        (30, [1, 4], {"highway": "residential"}),
        (40, [1, 5], {"highway": "primary", "oneway": "yes"}),
        (50, [1, 6], {"highway": "primary", "oneway": "yes", "lanes": "2"}),
    ]
    roads = osm(nodes, ways)
    lane = [float(roads.arrays.edges.lane[edge(roads, 1, n)]) for n in (2, 3, 4, 5, 6)]
    assert lane == pytest.approx([1.75, 2.25, 1.2, 0, 1.5])


def test_speeds_come_from_limits_or_classes(osm, edge):
    ways = [
        (10, [1, 2], {"maxspeed": "50"}),
        (20, [1, 3], {"maxspeed": "30 mph"}),
        (30, [1, 4], {"highway": "living_street"}),
        (40, [1, 5], {"maxspeed": "walk"}),
    ]
    roads = osm(CROSS, ways)
    speed = [float(roads.arrays.edges.speed[edge(roads, 1, n)]) * 3.6 for n in (2, 3, 4, 5)]
    assert speed == pytest.approx([50, 48.28, 12, 7], abs=0.01)
    assert roads.attributes(edge(roads, 1, 3))["speed_limit_kmh"] == pytest.approx(48.28, abs=0.01)
    assert roads.attributes(edge(roads, 1, 4))["speed_limit_kmh"] is None


def test_streets_that_run_on_are_one_edge_that_knows_its_ways(osm, check, edge):
    nodes = {1: (0, 0), 2: (30, 0), 3: (100, 0), 4: (100, 50), 5: (100, 90)}
    ways = [
        (10, [1, 2, 3], {"name": "High Street"}),
        (20, [5, 4, 3], {"name": "Low Street"}),  # drawn the other way
    ]
    roads = osm(nodes, ways)
    check(roads)
    assert len(roads) == 2
    there, back = edge(roads, 1, 5), edge(roads, 5, 1)
    assert roads.source(there, 10.0) == (10, True)
    assert roads.source(there, 99.9) == (10, True)
    assert roads.source(there, 100.1) == (20, False)
    assert roads.source(back, 80.0) == (20, True)
    assert roads.source(back, 100.0) == (10, False)
    ids, forward = roads.sources([there, back, there], [0.0, 0.0, 150.0])
    assert ids == [10, 20, 20]
    assert forward.tolist() == [True, True, False]
    assert roads.attributes(there)["name"] == "High Street"  # the longer one
    assert roads.attributes(there, 150.0)["name"] == "Low Street"


@pytest.mark.parametrize(
    "tags", [{"oneway": "yes"}, {"highway": "primary"}, {"highway": "service"}, {"access": "no"}]
)
def test_a_change_that_matters_ends_an_edge(osm, check, tags):
    roads = osm({1: (0, 0), 2: (50, 0), 3: (100, 0)}, [(10, [1, 2], {}), (20, [2, 3], tags)])
    check(roads)
    assert len(roads) == 4


def test_one_way_pieces_drawn_against_each_other_do_not_join(osm):
    nodes = {1: (0, 0), 2: (50, 0), 3: (100, 0)}
    one_way = {"oneway": "yes"}
    assert len(osm(nodes, [(10, [1, 2], one_way), (20, [2, 3], one_way)])) == 2
    assert len(osm(nodes, [(10, [1, 2], one_way), (20, [3, 2], one_way)])) == 4


def test_a_ring_without_a_junction_is_a_loop(osm, check):
    nodes = {1: (0, 0), 2: (50, 0), 3: (50, 50), 4: (0, 50)}
    roads = osm(nodes, [(10, [2, 3, 4, 1, 2], {})])
    check(roads)
    assert len(roads) == 2
    edges = roads.arrays.edges
    assert roads.node_ids(edges.from_node) == [2, 2]
    np.testing.assert_allclose(edges.length, 200, atol=0.1)
    assert (edges.end_turn - edges.first_turn).tolist() == [2, 2]


def test_a_loop_at_the_end_of_a_street_is_two_edges(osm, check):
    nodes = {1: (0, 0), 2: (50, 0), 3: (90, 30), 4: (90, -30)}
    roads = osm(nodes, [(10, [1, 2], {}), (20, [2, 3, 4, 2], {})])
    check(roads)
    edges = roads.arrays.edges
    assert len(roads) == 4
    assert (edges.from_node == edges.to_node).sum() == 2


@pytest.mark.parametrize(
    ("values", "spread"),
    [
        ({}, 0.0),
        ({"lanes": "2"}, 0.0),
        ({"lanes": "4"}, 1.65),
        ({"lanes": "2", "oneway": "yes"}, 1.65),
        ({"highway": "motorway"}, 1.65),
        ({"highway": "motorway_link"}, 0.0),
    ],
)
def test_a_road_of_several_lanes_spreads_the_vehicle_over_them_in_both_directions(
    osm, values, spread
):
    roads = osm(CROSS, [(10, [4, 1, 2], values)])
    assert roads.arrays.edges.lane_sigma.tolist() == pytest.approx([spread, spread])


def test_closed_roads_are_kept_and_entering_them_is_unlikely(osm, edge, turn):
    nodes = {**CROSS, 5: (0, -200), 6: (0, 200)}
    closed = {"access": "private"}
    roads = osm(
        nodes, [*ARMS[:1], *ARMS[2:], (20, [1, 3], closed), (50, [3, 6], {"motor_vehicle": "no"})]
    )
    prior, _, broken = turn(roads, 4, 1, 6)
    assert broken == NO_ACCESS
    assert prior / turn(roads, 4, 1, 5)[0] == pytest.approx(2e-4, rel=1e-4)
    assert roads.arrays.edges.rule[edge(roads, 1, 6)] == NO_ACCESS
    assert roads.attributes(edge(roads, 1, 6))["access"] == "no"


@pytest.mark.parametrize(
    ("tags", "access"),
    [
        ({"access": "no", "motorcar": "yes"}, "yes"),
        ({"vehicle": "no"}, "no"),
        ({"motor_vehicle": "destination"}, "limited"),
        ({"access": "permissive"}, "yes"),
    ],
)
def test_the_most_particular_access_tag_decides(osm, tags, access):
    roads = osm({1: (0, 0), 2: (100, 0)}, [(10, [1, 2], tags)])
    assert roads.attributes(0)["access"] == access
    assert (roads.arrays.edges.rule[0] == NO_ACCESS) == (access == "no")


def test_nobody_drives_through_a_bollard(osm, check, turn):
    nodes = {1: (0, 0), 2: (50, 0), 3: (100, 0)}
    roads = osm(nodes, [(10, [1, 2, 3], {})], node_tags={2: {"barrier": "bollard"}})
    check(roads)
    assert turn(roads, 1, 2, 3)[2] == NO_ACCESS
    assert turn(roads, 1, 2, 3)[0] < turn(roads, 1, 2, 1)[0]
    opened = {"barrier": "bollard", "motor_vehicle": "yes"}
    assert len(osm(nodes, [(10, [1, 2, 3], {})], node_tags={2: opened})) == 2


def test_where_the_extract_was_cut_the_street_is_cut(osm, check):
    nodes = {1: (0, 0), 2: (50, 0), 4: (150, 0), 5: (200, 0), 7: (0, 50)}
    ways = [(10, [99, 1, 2, 3, 4, 5, 98], {}), (20, [7, 97], {}), (30, [96, 95], {})]
    roads = osm(nodes, ways)
    check(roads)
    assert len(roads) == 4
    assert {roads.source(e, 1.0)[0] for e in range(4)} == {10}
    assert roads.info()["skipped"] == {
        "nodes of ways missing in the extract": 6,
        "ways of fewer than two nodes": 2,
    }


def test_points_in_the_same_place_have_no_street_between_them(osm, check):
    nodes = {1: (0, 0), 2: (50, 0), 3: (50, 0), 4: (100, 0), 5: (50, 60), 6: (50, 60)}
    ways = [(10, [1, 2, 3, 4], {}), (20, [3, 5], {}), (30, [5, 6], {}), (40, [4, 4], {})]
    roads = osm(nodes, ways)
    check(roads)
    assert len(roads) == 6
    assert roads.info()["skipped"] == {"segments without length": 3}


def test_what_is_no_street_for_cars_is_left_out(osm):
    nodes = {1: (0, 0), 2: (100, 0), 3: (0, 100), 4: (100, 100)}
    ways = [
        (10, [1, 2], {}),
        (20, [2, 3], {"highway": "footway"}),
        (30, [1, 3], {"highway": "construction"}),
        (40, [1, 2, 4, 1], {"highway": "service", "area": "yes"}),
    ]
    roads = osm(nodes, ways)
    assert len(roads) == 2
    assert roads.info()["skipped"] == {"ways that are areas": 1}


def test_attributes_are_those_of_the_way(osm):
    tags = {
        "name": "Straße",
        "layer": "-1",
        "tunnel": "yes",
        "lanes": "3",
        "width": "10.5",
        "maxspeed": "70",
    }
    roads = osm({1: (0, 0), 2: (100, 0)}, [(10, [1, 2], tags)])
    assert roads.attributes(0) == {
        "source_id": 10,
        "name": "Straße",
        "highway": "residential",
        "speed_limit_kmh": 70,
        "lanes": 3,
        "width": 10.5,
        "layer": -1,
        "bridge": False,
        "tunnel": True,
        "oneway": 0,
        "roundabout": False,
        "access": "yes",
    }


def test_lengths_are_those_on_the_ground(osm):
    nodes = {1: (0, 0), 2: (3000, 500), 3: (4000, -2500)}
    roads = osm(nodes, [(10, [1, 2, 3], {})])
    lat, lon = roads.plane.to_geodetic(*roads.edge_line(0).T)
    true = pyproj.Geod(ellps="WGS84").line_length(lon, lat)
    assert roads.arrays.edges.length[0] == pytest.approx(true, rel=1e-6)


def test_every_form_of_the_file_gives_the_same_map(tmp_path, xml):
    members = ("way", 30, "from"), ("node", 1, "via"), ("way", 20, "to")
    rule = {"type": "restriction", "restriction": "no_left_turn"}, members
    text = xml(CROSS, ARMS, [rule])
    (tmp_path / "a.osm").write_text(text)
    (tmp_path / "b.osm.gz").write_bytes(gzip.compress(text.encode()))
    (tmp_path / "c.osm.bz2").write_bytes(bz2.compress(text.encode()))
    with osmium.SimpleWriter(str(tmp_path / "d.osm.pbf")) as writer:
        for item in osmium.FileProcessor(str(tmp_path / "a.osm")):
            writer.add(item)
    maps = [RoadMap.from_osm(path) for path in sorted(tmp_path.iterdir())]
    for other in maps[1:]:
        for one, two in zip(maps[0].arrays, other.arrays, strict=True):
            np.testing.assert_array_equal(one, two)
