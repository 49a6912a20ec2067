"""Streets that lie on each other: each direction of a segment is there once."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.errors import MapError
from whichroad.graph.network import AGAINST_ONE_WAY, NO_ACCESS
from whichroad.roadmap import RoadMap

NODES = {1: (0, 0), 2: (60, 10), 3: (100, 0), 4: (200, 0), 5: (60, 90)}
ONE_WAY = {"oneway": "yes"}
SERVICE = {"highway": "service"}


def streets(roads):
    """Source, whether driven as drawn, and rule of each directed edge, by node ids."""
    edges = roads.arrays.edges
    pairs = list(zip(roads.node_ids(edges.from_node), roads.node_ids(edges.to_node), strict=True))
    assert len(set(pairs)) == len(pairs)
    return {p: (*roads.source(e, 1.0), int(edges.rule[e])) for e, p in enumerate(pairs)}


def repeats(roads):
    return roads.info()["skipped"].get("segments drawn twice", 0)


def test_a_street_drawn_twice_is_one(osm, check):
    roads = osm(NODES, [(10, [1, 2, 3], {}), (20, [1, 2, 3], {}), (30, [3, 2, 1], {})])
    check(roads)
    assert streets(roads) == {(1, 3): (10, True, 0), (3, 1): (10, False, 0)}
    assert repeats(roads) == 4


def test_a_part_drawn_twice_leaves_the_street_in_one_piece(osm, check):
    roads = osm({**NODES, 6: (300, 0)}, [(10, [1, 2, 3, 4, 6], {}), (20, [4, 3, 2], {})])
    check(roads)
    assert streets(roads) == {(1, 6): (10, True, 0), (6, 1): (10, False, 0)}
    assert repeats(roads) == 2


def test_what_leaves_a_repeat_is_kept(osm, check):
    roads = osm(NODES, [(10, [1, 2, 3, 4], {}), (20, [2, 3], {}), (30, [1, 2, 5], {})])
    check(roads)
    assert {p: s[0] for p, s in streets(roads).items() if p[0] < p[1]} == {
        (1, 2): 10,
        (2, 4): 10,
        (2, 5): 30,
    }
    assert repeats(roads) == 2


def test_one_way_streets_in_opposite_directions_are_no_repeats(osm, check):
    roads = osm(NODES, [(10, [1, 2, 3], ONE_WAY), (20, [3, 2, 1], ONE_WAY)])
    check(roads)
    assert streets(roads) == {(1, 3): (10, True, 0), (3, 1): (20, True, 0)}
    assert repeats(roads) == 0


def test_a_one_way_street_drawn_twice_stays_one_way(osm, check):
    roads = osm(NODES, [(10, [1, 2, 3], ONE_WAY), (20, [3, 2, 1], {"oneway": "-1"})])
    check(roads)
    assert streets(roads) == {(1, 3): (10, True, 0), (3, 1): (10, False, AGAINST_ONE_WAY)}
    assert repeats(roads) == 2


def test_a_two_way_street_over_a_one_way_street_gives_the_other_direction_only(osm, check):
    roads = osm(NODES, [(10, [1, 2, 3], ONE_WAY), (20, [1, 2, 3], {})])
    check(roads)
    assert streets(roads) == {(1, 3): (10, True, 0), (3, 1): (20, False, 0)}
    assert repeats(roads) == 2


@pytest.mark.parametrize("refs", [[1, 2, 3], [3, 2, 1]])
def test_the_higher_class_is_kept(osm, check, refs):
    roads = osm(NODES, [(10, refs, SERVICE), (20, [1, 2, 3], {"name": "High Street"})])
    check(roads)
    assert streets(roads) == {(1, 3): (20, True, 0), (3, 1): (20, False, 0)}
    assert not np.any(roads.arrays.edges.service)
    assert repeats(roads) == 2


def test_an_open_street_is_kept_before_a_closed_one(osm, check):
    roads = osm(NODES, [(10, [1, 2, 3], {"access": "no"}), (20, [1, 2, 3], SERVICE)])
    check(roads)
    assert streets(roads) == {(1, 3): (20, True, 0), (3, 1): (20, False, 0)}


def test_a_closed_street_over_an_open_one_way_street_is_its_way_back(osm):
    roads = osm(NODES, [(10, [1, 2, 3], ONE_WAY), (20, [1, 2, 3], {"access": "no"})])
    assert streets(roads) == {(1, 3): (10, True, 0), (3, 1): (20, False, NO_ACCESS)}


def test_a_street_there_and_back_is_one(osm, check):
    roads = osm(NODES, [(10, [1, 2, 3, 2, 1], {})])
    check(roads)
    assert streets(roads) == {(1, 3): (10, True, 0), (3, 1): (10, False, 0)}
    assert repeats(roads) == 2
    both = osm(NODES, [(10, [1, 2, 3, 2, 1], ONE_WAY)])
    assert streets(both) == {(1, 3): (10, True, 0), (3, 1): (10, True, 0)}
    assert repeats(both) == 0


@given(st.data())
def test_what_can_be_driven_is_what_was_drawn(tmp_path_factory, xml, degrees, data):
    kinds = st.sampled_from([{}, ONE_WAY, {"oneway": "-1"}, SERVICE, {"access": "no"}])
    refs = st.lists(st.integers(1, 5), min_size=2, max_size=6)
    drawn = data.draw(st.lists(st.tuples(refs, kinds), min_size=1, max_size=8))
    path = tmp_path_factory.mktemp("map") / "map.osm"
    path.write_text(xml(NODES, [(i, r, tags) for i, (r, tags) in enumerate(drawn, 1)]))
    expected = {}  # whether one may be driven without a rule broken
    for nodes, tags in drawn:
        for u, v in itertools.pairwise(nodes):
            word = tags.get("oneway")
            for pair, legal in (((u, v), word != "-1"), ((v, u), word != "yes")):
                if u != v:
                    fine = legal and "access" not in tags
                    expected[pair] = expected.get(pair, False) or fine
    try:
        roads = RoadMap.from_osm(path)
    except MapError:
        assert not expected
        return
    found = {}
    rule = roads.arrays.edges.rule
    xy = np.array([roads.plane.from_geodetic(*degrees(*p)[::-1]) for p in NODES.values()])
    for e in range(len(roads)):
        line = roads.edge_line(e)
        nodes = [1 + int(np.argmin(np.hypot(*(xy - p).T))) for p in line]
        for pair in itertools.pairwise(nodes):
            assert pair not in found
            found[pair] = rule[e] == 0
    assert found == expected
