"""Small maps, drawn in metres about a place, and what holds for every map."""

from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
import shapely

from whichroad.core.network import NO_ACCESS, U_TURN
from whichroad.geodesy.plane import Plane
from whichroad.roadmap import RoadMap

PLACE = Plane(49.4, 8.7)


def _degrees(x, y):
    """Longitude and latitude of a point in metres."""
    lat, lon = PLACE.to_geodetic(float(x), float(y))
    return lon, lat


def _xml(nodes, ways, relations=(), node_tags=None):
    """OpenStreetMap XML.

    Args:
        nodes: id -> (x, y) in metres.
        ways: (id, node ids, tags); `highway=residential` where there is none.
        relations: (tags, ((type, id, role), ...)).
        node_tags: id -> tags.
    """
    out = ["<osm version='0.6'>"]

    def tags(values):
        return "".join(f"<tag k={quoteattr(k)} v={quoteattr(v)}/>" for k, v in values.items())

    for number, (x, y) in nodes.items():
        lon, lat = _degrees(x, y)
        inner = tags((node_tags or {}).get(number, {}))
        out.append(f"<node id='{number}' lat='{lat:.7f}' lon='{lon:.7f}'>{inner}</node>")
    for number, refs, values in ways:
        inner = "".join(f"<nd ref='{r}'/>" for r in refs)
        inner += tags({"highway": "residential", **values})
        out.append(f"<way id='{number}'>{inner}</way>")
    for number, (values, members) in enumerate(relations, 1):
        inner = "".join(f"<member type='{t}' ref='{r}' role='{o}'/>" for t, r, o in members)
        out.append(f"<relation id='{number}'>{inner}{tags(values)}</relation>")
    return "\n".join([*out, "</osm>"])


@pytest.fixture
def osm(tmp_path):
    """A function that compiles the map of the arguments of `xml`."""

    def compiled(*args, **kwargs):
        path = tmp_path / "map.osm"
        path.write_text(_xml(*args, **kwargs))
        return RoadMap.from_osm(path)

    return compiled


@pytest.fixture(scope="session")
def xml():
    """The function that writes OpenStreetMap XML."""
    return _xml


@pytest.fixture(scope="session")
def degrees():
    """The function from metres about the place to longitude and latitude."""
    return _degrees


@pytest.fixture(scope="session")
def line(degrees):
    """The function from points in metres to a line in degrees."""
    return lambda *points: shapely.LineString([degrees(*p) for p in points])


@pytest.fixture(scope="session")
def edge():
    """The function that finds an edge by the names of its nodes."""
    return _edge


@pytest.fixture(scope="session")
def turn():
    """The function that finds a turn by the names of its nodes."""
    return _turn


@pytest.fixture(scope="session")
def check():
    """The function that asserts what holds for every map."""
    return _check


def _edge(roads, start, end):
    """The edge from one node to another, by source ids."""
    a = roads.arrays
    pairs = zip(roads.node_ids(a.from_node), roads.node_ids(a.to_node), strict=True)
    [found] = [i for i, pair in enumerate(pairs) if pair == (start, end)]
    return found


def _turn(roads, start, node, end):
    """Prior, angle and broken rules of a turn, by source ids of nodes."""
    a = roads.arrays
    origin, target = _edge(roads, start, node), _edge(roads, node, end)
    for t in range(a.succ_first[origin], a.succ_first[origin + 1]):
        if a.succ[t] == target:
            return float(a.succ_prior[t]), float(a.succ_turn[t]), int(a.succ_rule[t])
    raise AssertionError((start, node, end))


def _check(roads):
    """Assert the laws of a compiled network."""
    a = roads.arrays
    edges = np.arange(len(a.length))
    assert len(a.first) == len(a.succ_first) == len(a.pred_first) == len(edges) + 1
    assert np.all(np.diff(a.first) >= 2)
    start, end = a.first[:-1], a.first[1:] - 1
    assert np.all(a.s[start] == 0)
    assert np.all(a.s[end] == a.length)
    inside = np.ones(len(a.s), bool)
    inside[start] = False
    assert np.all(np.diff(a.s)[inside[1:]] > 0)

    # the two directions are one street
    assert np.all(a.opposite >= 0)
    assert np.all(a.opposite[a.opposite] == edges)
    assert np.all(a.opposite != edges)
    assert np.all(a.from_node[a.opposite] == a.to_node)
    np.testing.assert_allclose(a.length[a.opposite], a.length, rtol=1e-9)
    for edge in edges[:200]:
        line = roads.edge_line(int(edge))
        np.testing.assert_array_equal(line, roads.edge_line(int(a.opposite[edge]))[::-1])
    one_street = roads.way == roads.way[a.opposite]  # else two lie on each other
    closed = a.rule & NO_ACCESS
    assert np.all((closed == closed[a.opposite]) | ~one_street)

    # successors leave where the edge ends, all of them
    origin = np.repeat(edges, np.diff(a.succ_first))
    assert np.all(a.from_node[a.succ] == a.to_node[origin])
    leaving = np.bincount(a.from_node, minlength=a.to_node.max() + 1)
    assert np.all(np.diff(a.succ_first) == leaving[a.to_node])
    total = np.add.reduceat(a.succ_prior.astype(float), a.succ_first[:-1])
    np.testing.assert_allclose(total, 1, atol=1e-6)
    assert np.all(a.succ_prior > 0)
    u_turn = (a.succ_rule & U_TURN) > 0
    assert np.all(u_turn == (a.succ == a.opposite[origin]))
    assert np.all(np.abs(a.succ_turn) <= np.float32(np.pi))

    # predecessors are the same turns, looked at from the other end
    target = np.repeat(edges, np.diff(a.pred_first))
    turns = sorted(zip(origin.tolist(), a.succ.tolist(), strict=True))
    assert turns == sorted(zip(a.pred.tolist(), target.tolist(), strict=True))

    # pieces cover the edge from its start, in order
    first = roads.pieces.first
    assert np.all(np.diff(first) >= 1)
    assert np.all(roads.pieces.start[first[:-1]] == 0)
    for edge in edges[:200]:
        starts = roads.pieces.start[first[edge] : first[edge + 1]]
        assert np.all(np.diff(starts) > 0)
        assert starts[-1] < a.length[edge]
