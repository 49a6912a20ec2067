"""Maps as OSMnx makes and stores them, by OSMnx itself."""

from pathlib import Path
from types import ModuleType

import geopandas
import networkx
import numpy as np
import pytest
import shapely

import whichroad
from whichroad import RoadMap
from whichroad.errors import MapError
from whichroad.graph.network import AGAINST_ONE_WAY
from whichroad.simulate import draw_town


@pytest.fixture(scope="module")
def osmnx() -> ModuleType:
    """Imported where it is used: it brings scikit-learn, which takes a second in every worker."""
    import osmnx

    return osmnx


@pytest.fixture(scope="module")
def extract(tmp_path_factory) -> Path:
    """The town that the simulator draws, as an extract."""
    path = tmp_path_factory.mktemp("osmnx") / "town.osm.xml"
    path.write_text(draw_town(), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def graph(extract, osmnx) -> networkx.MultiDiGraph:
    """The same as OSMnx reads it, streets joined between junctions."""
    return osmnx.graph_from_xml(extract, simplify=True)


@pytest.fixture(scope="module")
def roads(graph) -> RoadMap:
    return RoadMap.from_edges(graph)


def legal_km(one: RoadMap) -> float:
    return float(one.arrays.edges.length[one.arrays.edges.rule == 0].sum()) / 1e3


def same(one: RoadMap, two: RoadMap, *, names: bool = True) -> None:
    """That two maps have the same junctions, edges and rules, whatever order they are in."""

    def edges(of: RoadMap) -> list:
        table = of.edges_table()
        columns = [table.from_node, table.to_node, table.length_m.round(3), table.against_one_way]
        if names:
            columns += [table.name.fillna(""), table.speed_limit_kmh.fillna(0.0)]
        return sorted(zip(*columns, strict=True))

    assert edges(one) == edges(two)


def test_a_graph_of_osmnx_is_the_extract_that_it_was_made_of(extract, graph, roads):
    own = RoadMap.from_osm(extract)
    # OSMnx keeps classes that no car drives on, too
    assert set(roads.info()["highway"]) <= set(own.info()["highway"])
    assert legal_km(roads) == pytest.approx(legal_km(own), rel=1e-3)
    assert set(roads.node_ids(roads.arrays.edges.from_node)) <= set(graph.nodes)
    once = [(u, v) for u, v, tags in graph.edges(data=True) if tags["oneway"]]
    table = roads.edges_table()
    rule = dict(zip(zip(table.from_node, table.to_node, strict=True),
                    roads.arrays.edges.rule, strict=True))  # fmt: skip
    assert once
    for u, v in once:
        if (u, v) in rule:  # a junction of OSMnx that is none here joins two
            assert rule[u, v] == 0
            assert rule[v, u] == AGAINST_ONE_WAY


def test_graphml_and_geopackage_are_the_same_map(graph, roads, tmp_path, osmnx):
    osmnx.save_graphml(graph, tmp_path / "town.graphml")
    osmnx.save_graph_geopackage(graph, tmp_path / "town.gpkg", directed=True)
    osmnx.save_graph_geopackage(graph, tmp_path / "once.gpkg")
    for name in ("town.graphml", "town.gpkg"):
        same(RoadMap.from_edges(tmp_path / name), roads)
    # of two directions of a joined street OSMnx keeps one, whose lists are in another order
    same(RoadMap.from_edges(tmp_path / "once.gpkg"), roads, names=False)
    for table in (osmnx.graph_to_gdfs(graph, nodes=False), osmnx.project_graph(graph)):
        same(RoadMap.from_edges(table), roads)


def test_a_drive_is_matched_to_whatever_osmnx_gives(graph, roads, tmp_path, osmnx):
    drive = whichroad.simulate_drive(roads, seed=2, length_m=800.0).drive
    answer = whichroad.match(drive, roads).to_arrow()
    osmnx.save_graphml(graph, tmp_path / "town.graphml")
    for one in (graph, tmp_path / "town.graphml"):
        found = whichroad.match(drive, one).to_arrow()
        np.testing.assert_allclose(found["lat"], answer["lat"], atol=1e-9)
        np.testing.assert_allclose(found["p_road"], answer["p_road"], atol=1e-6)


def test_a_graph_without_places_or_edges_is_refused(tmp_path):
    graph = networkx.MultiDiGraph()
    with pytest.raises(MapError, match="graph: it has no edges"):
        RoadMap.from_edges(graph)
    graph.add_edge("a", "b")
    with pytest.raises(MapError, match="graph: node 'a' has no position"):
        RoadMap.from_edges(graph)
    networkx.write_graphml(graph, tmp_path / "bare.graphml")
    with pytest.raises(MapError, match=r"bare\.graphml: node 'a' has no position"):
        RoadMap.from_edges(tmp_path / "bare.graphml")
    graph.nodes["a"].update(x=8.7, y=49.4)
    graph.nodes["b"].update(x=8.701, y=49.4)
    assert len(RoadMap.from_edges(graph)) == 2
    assert RoadMap.from_edges(graph).arrays.edges.rule.tolist().count(0) == 1


def test_an_undirected_graph_is_driven_both_ways():
    graph = networkx.MultiGraph(crs="EPSG:4326")
    graph.add_node(1, x=8.7, y=49.4)
    graph.add_node(2, x=8.701, y=49.4)
    graph.add_edge(1, 2, highway="residential")
    assert RoadMap.from_edges(graph).arrays.edges.rule.tolist() == [0, 0]


def test_edges_of_an_undirected_graph_may_name_their_nodes_in_any_order(graph, roads, osmnx):
    once = osmnx.graph_to_gdfs(osmnx.convert.to_undirected(graph), nodes=False).reset_index()
    assert (once.u != once["from"]).any()
    same(RoadMap.from_edges(once.drop(columns=["from", "to"])), roads, names=False)


def test_a_graph_made_directed_keeps_both_directions_of_each_line():
    graph = networkx.MultiGraph(crs="EPSG:4326")
    places = [(8.7, 49.4), (8.701, 49.4), (8.701, 49.401)]
    for node, (x, y) in enumerate(places):
        graph.add_node(node, x=x, y=y)
    for node in (0, 1):
        graph.add_edge(node, node + 1, geometry=shapely.LineString(places[node : node + 2]))
    made = RoadMap.from_edges(graph.to_directed())
    same(made, RoadMap.from_edges(graph))
    assert not made.arrays.edges.rule.any()


def test_damaged_graphml_is_refused_by_name_or_is_a_sound_map(graph, check, tmp_path, osmnx):
    whole = tmp_path / "town.graphml"
    osmnx.save_graphml(graph, whole)
    good = whole.read_bytes()
    rng = np.random.default_rng(3)
    refused = 0
    for k in range(40):
        data = bytearray(good[: rng.integers(1, len(good))] if k % 2 else good)
        for _ in range(20):
            data[rng.integers(len(data))] = rng.integers(256)
        path = tmp_path / "bad.graphml"
        path.write_bytes(data)
        said = ""
        try:
            check(RoadMap.from_edges(path))
        except MapError as error:
            said = str(error)
        assert not said or "bad.graphml" in said
        refused += bool(said)
    assert refused > 20


def test_of_several_layers_that_with_the_lines_is_read(roads, tmp_path, graph, osmnx):
    nodes, edges = osmnx.graph_to_gdfs(graph)
    edges = edges[["geometry", "oneway"]].reset_index()
    nodes[["geometry"]].to_file(tmp_path / "own.gpkg", layer="places")
    edges.to_file(tmp_path / "own.gpkg", layer="ways")
    assert legal_km(RoadMap.from_edges(tmp_path / "own.gpkg")) == pytest.approx(legal_km(roads))
    edges.to_file(tmp_path / "own.gpkg", layer="rails")
    with pytest.raises(MapError, match="layers places, ways, rails, of which 2 may hold lines"):
        RoadMap.from_edges(tmp_path / "own.gpkg")
    frame = geopandas.read_file(tmp_path / "own.gpkg", layer="ways")
    assert legal_km(RoadMap.from_edges(frame)) == pytest.approx(legal_km(roads))
