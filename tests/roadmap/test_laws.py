"""Laws that every map made of an extract keeps."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.errors import MapError
from whichroad.graph.network import U_TURN
from whichroad.roadmap import RoadMap


@given(st.data())
def test_random_maps_keep_the_laws(tmp_path_factory, xml, check, data):
    count = data.draw(st.integers(2, 9))
    place = st.tuples(st.integers(-5, 5), st.integers(-5, 5))
    nodes = {i: tuple(20 * c for c in data.draw(place)) for i in range(1, count + 1)}
    kind = st.sampled_from(
        [{}, {"oneway": "yes"}, {"oneway": "-1"}, {"highway": "service"}, {"access": "no"}]
    )
    refs = st.lists(st.integers(1, count + 1), min_size=1, max_size=6)  # the last is missing
    ways = data.draw(st.lists(st.tuples(refs, kind), min_size=1, max_size=6))
    ways = [(10 * i, nodes_, tags) for i, (nodes_, tags) in enumerate(ways, 1)]
    path = tmp_path_factory.mktemp("map") / "map.osm"
    path.write_text(xml(nodes, ways))
    try:
        check(RoadMap.from_osm(path))
    except MapError:
        drawn = {
            (nodes[a], nodes[b])
            for _, r, _ in ways
            for a, b in itertools.pairwise(r)
            if a in nodes and b in nodes
        }
        assert all(a == b for a, b in drawn)


@given(st.floats(-180, 180))
def test_turning_the_world_turns_no_turn(tmp_path_factory, xml, angle):
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    nodes = {1: (0, 0), 2: (300, 20), 3: (-40, 250), 4: (-200, -30), 5: (310, 400)}
    ways = [
        (10, [1, 2, 5], {}),
        (20, [1, 3], {"oneway": "yes"}),
        (30, [4, 1], {"highway": "service"}),
    ]
    folder = tmp_path_factory.mktemp("map")
    maps = []
    for name, (cos, sin) in {"a": (1, 0), "b": (c, s)}.items():
        turned = {i: (cos * x - sin * y, sin * x + cos * y) for i, (x, y) in nodes.items()}
        (folder / f"{name}.osm").write_text(xml(turned, ways))
        maps.append(RoadMap.from_osm(folder / f"{name}.osm").arrays)
    one, two = maps
    for table, name in (
        ("edges", "length"), ("vertices", "s"), ("turns", "prior"), ("edges", "speed"),
    ):  # fmt: skip
        a, b = (getattr(m, table)[name] for m in maps)
        np.testing.assert_allclose(a, b, atol=0.05)
    np.testing.assert_array_equal(one.turns.edge, two.turns.edge)
    u_turn = one.turns.rule & U_TURN > 0
    np.testing.assert_allclose(one.turns.angle[~u_turn], two.turns.angle[~u_turn], atol=0.005)


@pytest.mark.data
@pytest.mark.parametrize("name", ["heidelberg", "monaco", "andorra"])
def test_real_extracts_keep_the_laws(data_folder, check, name):
    path = data_folder / "maps" / f"{name}.osm.pbf"
    if not path.is_file():
        pytest.skip(f"the real map is not here: {path}")
    check(RoadMap.from_osm(path))
