"""Small maps, drawn in metres about a place, and what holds for every map."""

from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
import shapely

from whichroad.geodesy.plane import Plane
from whichroad.graph.network import NO_ACCESS, U_TURN
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
    edges = roads.arrays.edges
    pairs = zip(roads.node_ids(edges.from_node), roads.node_ids(edges.to_node), strict=True)
    [found] = [i for i, pair in enumerate(pairs) if pair == (start, end)]
    return found


def _turn(roads, start, node, end):
    """Prior, angle and broken rules of a turn, by source ids of nodes."""
    origin, target = _edge(roads, start, node), _edge(roads, node, end)
    edge = roads.arrays.edges[origin]
    for turn in roads.arrays.turns[edge.first_turn : edge.end_turn]:
        if turn.edge == target:
            return float(turn.prior), float(turn.angle), int(turn.rule)
    raise AssertionError((start, node, end))


def _check(roads):
    """Assert the laws of a compiled network."""
    arrays = roads.arrays
    v, e, t = arrays.vertices, arrays.edges, arrays.turns
    number = np.arange(len(e))
    ranges = (
        (e.first_vertex, e.last_vertex + 1, len(v)),
        (e.first_turn, e.end_turn, len(t)),
        (e.first_predecessor, e.end_predecessor, len(arrays.predecessors)),
    )
    for first, beyond, count in ranges:  # one behind the other, from none to all
        assert first[0] == 0
        assert np.all(first[1:] == beyond[:-1])
        assert beyond[-1] == count
    assert np.all(e.last_vertex > e.first_vertex)
    start, end = e.first_vertex, e.last_vertex
    assert np.all(v.s[start] == 0)
    assert np.all(v.s[end] == e.length)
    inside = np.ones(len(v.s), bool)
    inside[start] = False
    assert np.all(np.diff(v.s)[inside[1:]] > 0)

    # the two directions are one street
    assert np.all(e.opposite >= 0)
    assert np.all(e.opposite[e.opposite] == number)
    assert np.all(e.opposite != number)
    assert np.all(e.from_node[e.opposite] == e.to_node)
    np.testing.assert_allclose(e.length[e.opposite], e.length, rtol=1e-9)
    for edge in number[:200]:
        line = roads.edge_line(int(edge))
        np.testing.assert_array_equal(line, roads.edge_line(int(e.opposite[edge]))[::-1])
    one_street = roads.way == roads.way[e.opposite]  # else two lie on each other
    closed = e.rule & NO_ACCESS
    assert np.all((closed == closed[e.opposite]) | ~one_street)

    # successors leave where the edge ends, all of them
    origin = np.repeat(number, e.end_turn - e.first_turn)
    assert np.all(e.from_node[t.edge] == e.to_node[origin])
    leaving = np.bincount(e.from_node, minlength=e.to_node.max() + 1)
    assert np.all(e.end_turn - e.first_turn == leaving[e.to_node])
    total = np.add.reduceat(t.prior.astype(float), e.first_turn)
    np.testing.assert_allclose(total, 1, atol=1e-6)
    assert np.all(t.prior > 0)
    u_turn = (t.rule & U_TURN) > 0
    assert np.all(u_turn == (t.edge == e.opposite[origin]))
    assert np.all(np.abs(t.angle) <= np.float32(np.pi))

    # predecessors are the same turns, looked at from the other end
    target = np.repeat(number, e.end_predecessor - e.first_predecessor)
    turns = sorted(zip(origin.tolist(), t.edge.tolist(), strict=True))
    assert turns == sorted(zip(arrays.predecessors.tolist(), target.tolist(), strict=True))

    # pieces cover the edge from its start, in order
    first = roads.pieces.first
    assert np.all(np.diff(first) >= 1)
    assert np.all(roads.pieces.start[first[:-1]] == 0)
    for edge in number[:200]:
        starts = roads.pieces.start[first[edge] : first[edge + 1]]
        assert np.all(np.diff(starts) > 0)
        assert starts[-1] < e.length[edge]
