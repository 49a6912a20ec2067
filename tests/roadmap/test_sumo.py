"""SUMO's networks: edges, attributes and connections are those that sumolib reads."""

import gzip
import subprocess

import numpy as np
import pytest

from whichroad.errors import MapError
from whichroad.graph.network import AGAINST_ONE_WAY, TURN_BANNED, U_TURN
from whichroad.roadmap import RoadMap
from whichroad.roadmap.open_map import open_map

sumolib = pytest.importorskip("sumolib")

UTM = "+proj=utm +zone=32 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
OFFSET = (-478_000.0, -5_472_000.0)
JUNCTIONS = {"W": (0, 50), "C": (100, 50), "E": (200, 60), "N": (100, 150), "S": (95, -40)}
CAR = 'speed="13.89" length="90"'


def row(identity, begin, end, *, lanes=f'<lane id="ID_0" index="0" {CAR}/>', **more):
    rest = "".join(f' {key}="{value}"' for key, value in more.items())
    inside = lanes.replace("ID", identity)
    return f'<edge id="{identity}" from="{begin}" to="{end}"{rest}>{inside}</edge>'


EDGES = [
    row("wc", "W", "C", type="highway.primary", name="Main &amp; Co"),
    row("-wc", "C", "W", type="highway.primary", name="Main &amp; Co"),
    row("ce", "C", "E", shape="100,50 150,50 200,60",
         lanes=f'<lane id="ID_0" index="0" {CAR} width="3.0"/>'
               f'<lane id="ID_1" index="1" {CAR} width="3.5" disallow="bus tram"/>'),
    row("cn", "C", "N", lanes=f'<lane id="ID_0" index="0" {CAR} disallow="pedestrian"/>'),
    row("nc", "N", "C"),
    row("sc", "S", "C", lanes=f'<lane id="ID_0" index="0" {CAR} allow="bus passenger"/>'),
    row("path", "S", "W", lanes=f'<lane id="ID_0" index="0" {CAR} allow="pedestrian"/>'),
    row("rail", "S", "E", lanes=f'<lane id="ID_0" index="0" {CAR} disallow="all"/>'),
    f'<edge id=":C_0" function="internal"><lane id=":C_0_0" index="0" {CAR}/></edge>',
]  # fmt: skip
CONNECTIONS = [("wc", "ce"), ("wc", "-wc"), ("nc", "-wc"), ("nc", "ce"), ("sc", "cn"), ("sc", "ce")]


def net_text(projection=UTM):
    places = "".join(
        f'<junction id="{name}" type="priority" x="{x}" y="{y}" incLanes="" intLanes="" '
        f'shape="{x},{y}"/>'
        for name, (x, y) in JUNCTIONS.items()
    )
    links = "".join(
        f'<connection from="{a}" to="{b}" fromLane="0" toLane="0" dir="s" state="M"/>'
        for a, b in CONNECTIONS
    )
    return (
        f'<net version="1.20"><location netOffset="{OFFSET[0]},{OFFSET[1]}" '
        f'convBoundary="0,0,200,150" origBoundary="0,0,1,1" projParameter="{projection}"/>'
        f"{''.join(EDGES)}{places}{links}</net>"
    )


@pytest.fixture
def net(tmp_path):
    path = tmp_path / "town.net.xml"
    path.write_text(net_text())
    return path


def agree(roads, path):
    """Assert that a map is what sumolib reads; returns how many edges and pairs were compared."""
    theirs = sumolib.net.readNet(str(path))
    edges, turns, plane = roads.arrays.edges, roads.arrays.turns, roads.plane
    cars = {e.getID(): e for e in theirs.getEdges() if e.allows("passenger")}
    begin, end = {}, {}  # our edges by the edge of SUMO with which they begin and end
    at_start = roads.sources(np.arange(len(roads)), np.zeros(len(roads)))[0]
    at_end = roads.sources(np.arange(len(roads)), edges.length - 1e-6)[0]
    legal = edges.rule == 0
    for e in np.flatnonzero(legal).tolist():
        begin[at_start[e]], end[at_end[e]] = e, e
    found = {
        roads._values("source_id" if f else "back_id", np.array([w]))[0]
        for w, f in zip(roads.pieces.way.tolist(), roads.pieces.forward.tolist(), strict=True)
        if f or (("back_id" in roads.ways) and roads.ways["paired"][w])
    }
    assert found == set(cars)
    for name, e in begin.items():
        x, y = cars[name].getFromNode().getCoord()
        lon, lat = theirs.convertXY2LonLat(x, y)
        px, py = plane.from_geodetic(np.array([lat]), np.array([lon]))
        sx, sy, _ = roads.at(e, 0.0)
        assert np.hypot(px[0] - sx, py[0] - sy) < 1.0
        limit = cars[name].getSpeed() * 3.6
        assert roads.attributes(e, 0.0)["speed_limit_kmh"] == pytest.approx(limit, abs=0.01)
    pairs = 0
    for name, e in end.items():
        into = {t.getID() for t in cars[name].getAllowedOutgoing("passenger")}
        for k in range(edges.first_turn[e], edges.end_turn[e]):
            f = int(turns.edge[k])
            if not legal[f] or turns.rule[k] & U_TURN:
                continue
            target = at_start[f]
            if cars[target].getToNode() is cars[name].getFromNode():
                continue  # back to where it came from
            assert (turns.rule[k] & TURN_BANNED == 0) == (target in into), (name, target)
            pairs += 1
    return len(begin), pairs


def test_a_network_is_what_sumolib_reads(net, check):
    roads = open_map(net)
    check(roads)
    compared = agree(roads, net)
    assert compared == (6, 7)
    assert roads.info()["skipped"] == {"edges not for cars": 2}


def test_directions_names_and_lanes_are_those_of_the_edges(net, edge):
    roads = RoadMap.from_edges(net)
    there, back = edge(roads, "W", "C"), edge(roads, "C", "W")
    assert roads.sources([there, back], [1.0, 1.0])[0] == ["wc", "-wc"]
    assert roads.name(there) == "Main & Co"
    assert roads.column("highway")[there] == "primary"
    east = edge(roads, "C", "E")
    assert roads.attributes(east)["lanes"] == 2
    assert roads.attributes(east)["width"] == pytest.approx(6.5)
    assert roads.arrays.edges.rule[edge(roads, "E", "C")] == AGAINST_ONE_WAY
    assert roads.arrays.edges.rule[back] == 0


def test_a_packed_network_is_the_same_and_a_saved_one_too(net, tmp_path):
    roads = RoadMap.from_edges(net)
    (tmp_path / "b.net.xml.gz").write_bytes(gzip.compress(net.read_bytes()))
    roads.save(tmp_path / "a.map")
    for other in (open_map(tmp_path / "b.net.xml.gz"), RoadMap.open(tmp_path / "a.map")):
        assert len(other) == len(roads)
        assert other.column("source_id") == roads.column("source_id")


def test_without_a_projection_the_reference_system_is_asked_for(tmp_path):
    path = tmp_path / "town.net.xml"
    path.write_text(net_text("!"))
    with pytest.raises(MapError, match=r"no projection .*give crs="):
        open_map(path)
    assert len(RoadMap.from_edges(path, crs="EPSG:32632")) == 8


@pytest.mark.parametrize("text", ["<net>", "", "<osm/>", '<net><edge id="a"/></net>'])
def test_what_is_no_network_is_refused(tmp_path, text):
    path = tmp_path / "town.net.xml"
    path.write_text(text)
    with pytest.raises(MapError, match="SUMO"):
        open_map(path)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_generated_networks_are_what_sumolib_reads(tmp_path, seed):
    sumo = pytest.importorskip("sumo")
    path = tmp_path / "random.net.xml"
    subprocess.run(
        [f"{sumo.SUMO_HOME}/bin/netgenerate", "--rand", "-o", str(path), "--seed", str(seed),
         "--rand.iterations", "60", "--rand.random-lanenumber", "-L", "2",
         "--random-type", "--bidi-probability", "0.7", "--no-warnings"],
        check=True, capture_output=True,
    )  # fmt: skip
    projected = path.read_text().replace('projParameter="!"', f'projParameter="{UTM}"')
    path.write_text(projected.replace('netOffset="0.00,0.00"', 'netOffset="-478000,-5472000"'))
    edges, pairs = agree(open_map(path), path)
    assert edges > 50
    assert pairs > 50
