"""A part of an OpenStreetMap extract: what lies in a box."""

import math

import numpy as np
import pytest

from whichroad.errors import MapError
from whichroad.roadmap import RoadMap


def ladder(xml):
    """A street of 1 km to the east, a node every 100 m, with a street to the north at each."""
    nodes = {k: (100.0 * k, 0.0) for k in range(11)}
    nodes |= {100 + k: (100.0 * k, 300.0) for k in range(11)}
    ways = [(1, list(range(11)), {"name": "East"})]
    ways += [(10 + k, [k, 100 + k], {}) for k in range(11)]
    return xml(nodes, ways)


def box_of(degrees, west, south, east, north):
    """Metres to west, south, east, north in degrees."""
    return (*degrees(west, south), *degrees(east, north))


def test_a_box_keeps_the_segments_that_reach_into_it(xml, degrees, check, tmp_path):
    path = tmp_path / "ladder.osm.xml"
    path.write_text(ladder(xml))
    roads = RoadMap.from_osm(path, bbox=box_of(degrees, 350.0, -50.0, 650.0, 250.0))
    check(roads)
    kept = {roads.source(e, 1.0)[0] for e in range(len(roads))}
    assert kept == {1, 14, 15, 16}
    east = [e for e in range(len(roads)) if roads.name(e) == "East"]
    # from the node before the box to the one behind it
    assert roads.arrays.edges.length[east].sum() == pytest.approx(2 * 400.0, rel=1e-4)
    assert roads.info()["skipped"]["ways outside the box"] == 8
    everything = box_of(degrees, -50.0, -50.0, 1050.0, 350.0)
    whole, own = RoadMap.from_osm(path, bbox=everything), RoadMap.from_osm(path)
    np.testing.assert_array_equal(whole.arrays.edges, own.arrays.edges)


def test_a_street_that_leaves_a_box_and_comes_back_is_two(xml, degrees, check, tmp_path):
    nodes = {1: (0, 0), 2: (100, 0), 3: (100, 900), 4: (200, 900), 5: (200, 0), 6: (300, 0)}
    path = tmp_path / "loop.osm"
    path.write_text(xml(nodes, [(1, [1, 2, 3, 4, 5, 6], {})]))
    roads = RoadMap.from_osm(path, bbox=box_of(degrees, -50.0, -50.0, 350.0, 500.0))
    check(roads)
    assert len(roads) == 4
    assert set(roads.node_ids(roads.arrays.edges.from_node)) == {1, 3, 4, 6}


def test_a_segment_longer_than_a_box_is_kept(xml, degrees, tmp_path):
    path = tmp_path / "long.osm"
    path.write_text(xml({1: (-5000, 0), 2: (5000, 0)}, [(1, [1, 2], {})]))
    assert len(RoadMap.from_osm(path, bbox=box_of(degrees, -10.0, -10.0, 10.0, 10.0))) == 2


@pytest.mark.parametrize(
    ("box", "said"),
    [
        (
            (10.0, 50.0, 10.1, 50.1),
            r"no drivable way is in the box .* lie within 8\.7000, 49\.4000",
        ),
        ((8.8, 49.3, 8.6, 49.5), "west, south, east, north in degrees were expected"),
        ((1.0, 2.0), "bbox is"),
        (("a", "b", "c", "d"), "bbox is"),
        (7, "bbox is"),
        ((math.nan, 0.0, 1.0, 1.0), "bbox is"),
    ],
)
def test_what_is_no_box_or_an_empty_one_is_refused(xml, tmp_path, box, said: str):
    path = tmp_path / "ladder.osm"
    path.write_text(ladder(xml))
    with pytest.raises(MapError, match=said):
        RoadMap.from_osm(path, bbox=box)
