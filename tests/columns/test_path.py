"""Value oracles for the columns of the path, from drawn streets, truth and points."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

import whichroad
from columns.scene import GEOD, foot
from laws.public import CAR, START, WHEELS, degrees, geo_fixes, readings, road_map
from scenes import Truth, drive_along

Array = NDArray[np.float64]

# source id: line as drawn, from, to
STREETS: dict[int, tuple[list[tuple[float, float]], int, int]] = {
    11: ([(0, 0), (110, 20), (200, 0)], 1, 2),
    12: ([(400, 0), (300, -15), (200, 0)], 3, 2),  # against the drive
    13: ([(400, 0), (400, 200)], 3, 4),
    14: ([(400, 200), (600, 230)], 4, 5),
    21: ([(200, 0), (200, -100)], 2, 6),
    22: ([(400, 0), (430, -100)], 3, 7),
    23: ([(400, 200), (380, 300)], 4, 8),
}
WAY = [11, 12, 13, 14]
NODES = [1, 2, 3, 4, 5]


@cache
def town() -> whichroad.RoadMap:
    return road_map(
        [line for line, _, _ in STREETS.values()],
        id=list(STREETS),
        **{"from": [a for _, a, _ in STREETS.values()], "to": [b for _, _, b in STREETS.values()]},
    )


def driven(source: int) -> Array:
    """Longitude and latitude of a street's vertices, in driving direction."""
    line, start, _ = STREETS[source]
    way = np.array(line, float)
    return np.column_stack(degrees(*(way if start in NODES[:-1] and source != 12 else way[::-1]).T))


@cache
def truth() -> Truth:
    corners = np.vstack([STREETS[11][0], STREETS[12][0][::-1][1:], STREETS[13][0][1:],
                         STREETS[14][0][1:]])  # fmt: skip
    line = shapely.LineString(corners).offset_curve(-1.75, join_style="mitre")
    return drive_along(np.array(line.coords), radius=8.0, margin=25.0)


@cache
def answer() -> whichroad.Result:
    t = truth()
    rng = np.random.default_rng(1)
    fix = np.column_stack([t.x, t.y, np.full((len(t.x), 2), 1.0), np.zeros(len(t.x))])
    fix[:, :2] += rng.normal(0.0, 1.0, (len(t.x), 2))
    at = np.arange(0, len(t.x), 10)
    seen = [*geo_fixes(t, fix, at, doppler=True), *readings(t, WHEELS)]
    return whichroad.match(seen, town(), vehicle=CAR)


def column(name: str) -> list[Any]:
    return list(answer().path_arrow()[name].to_pylist())


def seconds(name: str) -> Array:
    """Of a column of times, since the drive's first epoch."""
    return answer().path_arrow()[name].cast("int64").to_numpy() * 1e-6 - START


def crossed() -> Array:
    """When the vehicle passed each junction, s, (3,)."""
    t = truth()
    places = [STREETS[11][0][-1], STREETS[12][0][0], STREETS[13][0][-1]]
    return np.array([t.time[np.argmin(np.hypot(t.x - x, t.y - y))] for x, y in places])


def test_the_streets_driven_come_in_order_with_their_names_and_nodes():
    assert column("drive_id") == ["drive"] * 4
    assert column("seq") == [0, 1, 2, 3]
    assert column("source_id") == [str(s) for s in WAY]
    assert column("forward") == [True, False, True, True]
    assert town().node_ids(column("from_node")) == NODES[:-1]
    assert town().node_ids(column("to_node")) == NODES[1:]
    assert column("broken_rule") == [None] * 4


def test_an_edge_s_number_is_its_number_in_the_map():
    edges = town().edges_table().set_index("edge_id")
    rows = map(column, ("edge_id", "source_id", "forward"))
    for edge, source, forward in zip(*rows, strict=True):
        assert str(edges.source_id[edge]) == source
        assert edges.forward[edge] == forward


def test_edges_are_entered_where_they_begin_and_left_where_they_end():
    enter, leave = np.array(column("enter_m")), np.array(column("exit_m"))
    length = [GEOD.inv(*driven(s)[:-1].T, *driven(s)[1:].T)[2].sum() for s in WAY]
    np.testing.assert_allclose(enter[1:], 0.0, atol=1e-9)
    np.testing.assert_allclose(leave[:-1], length[:-1], atol=0.02)
    t = truth()
    first, last = (foot(*degrees(t.x[k], t.y[k]), driven(s)) for k, s in ((0, 11), (-1, 14)))
    assert enter[0] == pytest.approx(first.along, abs=4.0)
    assert leave[-1] == pytest.approx(last.along, abs=4.0)


def test_the_place_on_the_source_counts_from_the_start_of_its_street_as_drawn():
    enter, leave = np.array(column("enter_m")), np.array(column("exit_m"))
    length = np.array([GEOD.inv(*driven(s)[:-1].T, *driven(s)[1:].T)[2].sum() for s in WAY])
    drawn = np.array(column("forward"))
    for end, along in (("enter", enter), ("exit", leave)):
        place = np.where(drawn, along, length - along)
        np.testing.assert_allclose(column(f"source_{end}_m"), place, atol=0.02)
        np.testing.assert_allclose(column(f"source_{end}_share"), place / length, atol=1e-4)


def test_edges_are_entered_and_left_when_the_junction_is_passed():
    enter, leave = seconds("enter_time"), seconds("exit_time")
    t = truth().time
    assert [enter[0], leave[-1]] == pytest.approx([t[0], t[-1]], abs=1e-3)
    np.testing.assert_allclose(enter[1:], leave[:-1], atol=1e-6)
    np.testing.assert_allclose(leave[:-1], crossed(), atol=0.6)  # s; corners are cut


def test_duration_and_mean_speed_are_those_between_entry_and_exit():
    duration = seconds("exit_time") - seconds("enter_time")
    np.testing.assert_allclose(column("duration_s"), duration, atol=2e-6)
    way = np.array(column("exit_m")) - np.array(column("enter_m"))
    np.testing.assert_allclose(column("mean_speed_mps"), way / duration, rtol=1e-6)
    np.testing.assert_allclose(column("mean_speed_mps"), 10.0, atol=1.0)


def test_the_geometry_is_the_part_of_the_street_that_was_driven():
    shapes = answer().path.geometry
    for line, source, enter, leave in zip(
        shapes, WAY, column("enter_m"), column("exit_m"), strict=True
    ):
        street, drawn = driven(source), np.array(line.coords)
        feet = [foot(*place, street) for place in drawn]
        assert max(f.away for f in feet) < 0.01
        along = [f.along for f in feet]
        assert along == sorted(along)
        assert [along[0], along[-1]] == pytest.approx([enter, leave], abs=0.02)
        inside = [foot(*place, street).along for place in street]
        inside = [a for a in inside if enter + 0.1 < a < leave - 0.1]
        assert along[1:-1] == pytest.approx(inside, abs=0.02)  # no vertex is left out


def test_p_is_the_mean_probability_while_the_edge_is_the_most_probable():
    """Beside a parallel street."""
    t = drive_along([[100.0, 1.0], [700.0, 1.0]])
    roads = road_map([[[0.0, y], [800.0, y]] for y in (0.0, 9.0)])
    rng = np.random.default_rng(3)
    fix = np.column_stack([t.x, t.y, np.full((len(t.x), 2), 3.0), np.zeros(len(t.x))])
    fix[:, :2] += rng.normal(0.0, 1.5, (len(t.x), 2))
    at = np.arange(0, len(t.x), 10)
    result = whichroad.match(geo_fixes(t, fix, at, doppler=True), roads, vehicle=CAR)
    points, path = result.to_arrow().to_pylist(), result.path_arrow().to_pylist()
    assert len(path) == 1
    edge = path[0]["edge_id"]
    p = [a["p"] for row in points if row["edge_id"] == edge
         for a in row["alternatives"] if a["edge_id"] == edge]  # fmt: skip
    assert path[0]["p"] == pytest.approx(np.mean(p), abs=1e-6)
    assert 0.5 < path[0]["p"] < 0.97
    assert np.ptp(p) > 0.02


def test_without_duration_the_mean_speed_is_null():
    lon, lat = degrees(60.0, 10.0)
    one = whichroad.GeoFix(START, float(lat), float(lon), 1.0, 0.0, 1.0)
    result = whichroad.match([one], town())
    row = result.path_arrow().to_pylist()[0]
    assert row["duration_s"] == 0.0
    assert row["mean_speed_mps"] is None


# nodes and ways of the town where rules are broken, metres
PLACES = {1: (0, 0), 2: (200, 0), 3: (400, 0), 4: (400, 200), 5: (600, 200), 6: (200, -150),
          7: (430, -150), 8: (380, 350), 9: (5000, 0), 10: (5400, 0)}  # fmt: skip
WAYS: dict[int, tuple[list[int], dict[str, str]]] = {
    11: ([1, 2], {}), 12: ([3, 2], {"oneway": "yes"}), 13: ([3, 4], {}),
    14: ([4, 5], {"access": "no"}), 21: ([2, 6], {}), 22: ([3, 7], {}), 23: ([4, 8], {}),
    31: ([9, 10], {}),
}  # fmt: skip


@pytest.fixture
def ruled(tmp_path: Path) -> whichroad.RoadMap:
    """An OpenStreetMap extract with a one-way street, a closed one and a banned turn."""
    lines = ['<?xml version="1.0"?><osm version="0.6">']
    for node, (x, y) in PLACES.items():
        lon, lat = degrees(x, y)
        lines.append(f'<node id="{node}" lat="{lat:.9f}" lon="{lon:.9f}" version="1"/>')
    for way, (nodes, tags) in WAYS.items():
        lines.append(f'<way id="{way}" version="1">')
        lines += [f'<nd ref="{n}"/>' for n in nodes]
        lines += [f'<tag k="{k}" v="{v}"/>' for k, v in {"highway": "residential", **tags}.items()]
        lines.append("</way>")
    lines.append('<relation id="1" version="1"><member type="way" ref="12" role="from"/>'
                 '<member type="node" ref="3" role="via"/><member type="way" ref="13" role="to"/>'
                 '<tag k="type" v="restriction"/><tag k="restriction" v="no_left_turn"/>'
                 "</relation></osm>")  # fmt: skip
    path = tmp_path / "ruled.osm"
    path.write_text("\n".join(lines))
    return whichroad.RoadMap.from_osm(path)


def fixes_along(corners: list[tuple[float, float]], start: float = 0.0) -> list[whichroad.GeoFix]:
    """A fix a second at 10 m/s, of a receiver without an error."""
    line = shapely.LineString(corners)
    found = []
    for k, s in enumerate(np.arange(10.0, line.length - 10.0, 10.0)):
        lon, lat = degrees(*np.array(line.interpolate(s).coords[0]))
        found.append(whichroad.GeoFix(START + start + k, float(lat), float(lon), 1.0, 0.0, 1.0))
    return found


def test_broken_rules_are_named(ruled: whichroad.RoadMap):
    corners = [PLACES[n] for n in (1, 2, 3, 4, 5, 4, 8)]
    seen = fixes_along(corners)
    seen += fixes_along([PLACES[9], PLACES[10]], start=seen[-1].time - START + 3600.0)
    rows = whichroad.match(seen, ruled).path_arrow().to_pylist()
    broken = {(row["source_id"], row["forward"]): row["broken_rule"] for row in rows}
    assert broken == {
        ("11", True): None,
        ("12", False): "against_one_way",
        ("13", True): "turn_banned",
        ("14", True): "no_access",
        ("14", False): "no_access,u_turn",
        ("23", True): None,
        ("31", True): "gap",
    }
