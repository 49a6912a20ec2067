"""OpenLR references: read by `openlr`, followed by `openlr_dereferencer` to the same edges."""

import openlr
import pyarrow as pa
import pytest
from benchmarks.openlr_map import OurMap
from benchmarks.openlr_paths import compare, followed, path_of

from whichroad.errors import MapError
from whichroad.roadmap import RoadMap


@pytest.mark.data
@pytest.mark.slow
def test_paths_of_a_city_are_followed_to_the_same_edges(data_folder):
    roads = RoadMap.from_osm(data_folder / "maps" / "heidelberg.osm.pbf",
                             bbox=(8.66, 49.39, 8.72, 49.43))  # fmt: skip
    made, same, exact, stubs = compare(roads, 100, seed=2)
    assert same >= made - stubs - 1  # stubs are shorter than the step of coordinates in the bytes
    assert same >= 0.98 * made
    assert exact >= 0.93 * same


NODES = {1: (0, 0), 2: (300, 0), 3: (300, 200), 4: (0, 200), 5: (150, 400), 6: (600, 0)}
WAYS = [
    (10, [1, 2], {"highway": "primary"}), (20, [2, 3], {}), (30, [3, 4], {}), (40, [4, 1], {}),
    (50, [4, 5, 3], {"highway": "tertiary"}), (60, [2, 6], {"oneway": "yes"}),
]  # fmt: skip


def test_a_detour_has_a_point_where_it_leaves_the_shortest_way(osm, edge):
    roads = osm(NODES, WAYS)
    [north] = [e for e in range(len(roads)) if roads.source(e, 1.0) == (30, False)]
    detour = [edge(roads, 1, 4), north, edge(roads, 3, 2)]
    straight = [edge(roads, 1, 2), edge(roads, 2, 6)]
    ends = [float(roads.arrays.edges.length[route[-1]]) for route in (detour, straight)]
    codes = [roads.openlr(path_of(roads, r, 0.0, end), by="stretch")[0]
             for r, end in zip((detour, straight), ends, strict=True)]  # fmt: skip
    reader = OurMap(roads)
    assert [followed(reader, code)[0] for code in codes] == [detour, straight]
    points = [openlr.binary_decode(code).points for code in codes]
    assert [len(p) for p in points] == [2, 2]
    assert (points[1][0].frc, points[1][0].fow) == (2, 3)
    assert points[1][0].bear == pytest.approx(90.0, abs=11.25)  # east
    assert points[1][0].dnp == pytest.approx(600, abs=60)
    loop = [*detour, edge(roads, 2, 1)]
    code = roads.openlr(path_of(roads, loop, 0.0, 300.0), by="stretch")[0]
    assert len(openlr.binary_decode(code).points) > 2
    assert followed(reader, code)[0] == loop


def test_rows_have_references_of_their_own_and_what_is_against_a_rule_has_none(osm, edge):
    roads = osm(NODES, WAYS)
    route = [edge(roads, 1, 2), edge(roads, 2, 6), edge(roads, 6, 2)]
    codes = roads.openlr(path_of(roads, route, 10.0, 200.0))
    reader = OurMap(roads)
    assert [followed(reader, code)[0] for code in codes[:2]] == [[e] for e in route[:2]]
    assert followed(reader, codes[0])[1] == pytest.approx(10.0, abs=2.0)
    assert codes[2] is None


def test_what_is_no_path_is_refused_and_a_frame_is_taken(osm, edge):
    roads = osm(NODES, WAYS)
    path = path_of(roads, [edge(roads, 1, 2)], 0.0, 300.0)
    assert roads.openlr(path.to_pandas()) == roads.openlr(path)
    with pytest.raises(MapError, match="'row' or 'stretch'"):
        roads.openlr(path, by="edge")
    with pytest.raises(MapError, match="columns are edge_id"):
        roads.openlr(path.select(["edge_id"]))
    far = path.set_column(0, "edge_id", pa.array([10_000]))
    with pytest.raises(MapError, match="beyond"):
        roads.openlr(far)


def test_without_the_package_the_remedy_is_named(osm, edge, monkeypatch):
    roads = osm(NODES, WAYS)
    monkeypatch.setitem(__import__("sys").modules, "openlr", None)
    with pytest.raises(MapError, match=r'pip install "whichroad\[openlr\]"'):
        roads.openlr(path_of(roads, [edge(roads, 1, 2)], 0.0, 300.0))
