"""The town of our own, and the paper's drive in it."""

import itertools

import numpy as np
import pytest

from whichroad.errors import MapError
from whichroad.graph.network import TURN_BANNED
from whichroad.roadmap import RoadMap
from whichroad.simulate import (
    demo_drive,
    demo_route,
    demo_scenes,
    draw_town,
    drivable,
    simulate_drive,
)
from whichroad.simulate.town import places


def junction(town, name):
    return int(np.searchsorted(town.node_id, places()[name]))


def edges_between(town, a, b):
    edges = town.arrays.edges
    begins, ends = edges.from_node == junction(town, a), edges.to_node == junction(town, b)
    return np.flatnonzero(begins & ends)


def assert_legal(town, route):
    """Neither an edge nor a turn of the route breaks a rule."""
    edges, turns = town.arrays.edges, town.arrays.turns
    assert (edges.rule[route] == 0).all()
    for a, b in itertools.pairwise(route):
        out = turns[edges.first_turn[a] : edges.end_turn[a]]
        assert out.rule[out.edge.tolist().index(b)] == 0


def test_the_same_seed_draws_the_same_town_and_another_seed_another():
    assert draw_town(4) == draw_town(4)
    assert draw_town(4) != draw_town(5)


def test_nothing_of_the_town_is_lost_when_it_is_compiled(town):
    info = town.info()
    assert info["skipped"] == {}
    assert {"residential", "secondary", "tertiary", "service"} <= set(info["highway"])
    assert 10 < info["km"] < 30
    assert (np.asarray(town.column("roundabout")) == 1).any()


def test_turn_restrictions_are_in_force(town):
    assert (town.arrays.turns.rule & TURN_BANNED).any()


def test_one_can_drive_on_for_ever_nearly_everywhere(town):
    legal = town.arrays.edges.rule == 0
    assert drivable(town.arrays, np.random.default_rng(0)).sum() > 0.9 * legal.sum()


def test_the_boulevards_three_roads_are_twelve_to_fifteen_metres_apart(town):
    (main,) = edges_between(town, "eastbound 1520", "eastbound 2000")
    x, y, _ = town.at(int(main), 240.0)
    near = town.near(x, y, 30.0)
    beside = near.distance[near.edge != main]
    beside = beside[(town.arrays.edges.rule[near.edge[near.edge != main]] == 0) & (beside > 1.0)]
    assert len(beside) == 2  # the other direction, and the side lane
    assert ((beside > 12.0) & (beside < 15.0)).all()


def test_the_fork_parts_at_ten_degrees(town):
    headings = [town.at(int(e), 5.0)[2] for e in edges_between(town, "fork", "end")]
    assert np.degrees(abs(headings[0] - headings[1])) == pytest.approx(10.0, abs=2.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_drives_in_town_are_legal(town, seed):
    drive = simulate_drive(town, seed=seed, length_m=4000.0)
    assert_legal(town, drive.route)


def test_map_positions_lie_on_their_edges(town):
    truth = simulate_drive(town, seed=3, length_m=4000.0).truth
    for k in range(0, len(truth), 97):
        near = town.near(float(truth.map_x[k]), float(truth.map_y[k]), 25.0)
        mine = near.edge == truth.edge[k]
        assert mine.any()
        assert near.distance[mine].min() < 10.0
        assert abs(near.s[mine] - truth.along[k]).min() < 12.0  # corners are cut


def test_the_demo_is_legal_and_four_to_six_kilometres_long(town):
    drive = demo_drive(town)
    edges = town.arrays.edges
    assert 4000 < drive.truth.travelled[-1] < 6000
    assert (edges.to_node[drive.route[:-1]] == edges.from_node[drive.route[1:]]).all()
    assert_legal(town, drive.route)


def test_the_demos_mask_is_1500_m_with_junctions_and_turns(town):
    drive = demo_drive(town)
    t = drive.truth
    begin, end = drive.outages[0]
    inside = (t.time > begin) & (t.time < end)
    assert np.ptp(t.travelled[inside]) == pytest.approx(1500, abs=3)
    assert len(np.unique(t.edge[inside])) >= 5
    turn = np.abs(np.angle(np.exp(1j * (t.heading[inside][50:] - t.heading[inside][:-50]))))
    assert turn.max() > np.radians(70)
    assert not ((drive.drive.fixes.time > begin) & (drive.drive.fixes.time < end)).any()


@pytest.mark.parametrize("seed", range(1, 9))
def test_the_first_fixes_after_the_mask_lie_on_the_road_beside(tmp_path, seed):
    (tmp_path / "town.osm").write_text(draw_town(seed), encoding="utf-8")
    town = RoadMap.from_osm(tmp_path / "town.osm")
    drive = demo_drive(town, seed=seed)
    t, fixes = drive.truth, drive.drive.fixes
    after = np.searchsorted(fixes.time, drive.outages[0][1]) + np.arange(3)
    x, y = town.plane.from_geodetic(fixes.lat_deg[after], fixes.lon_deg[after])
    names = []
    for k, (px, py) in enumerate(zip(x, y, strict=True)):
        near = town.near(float(px), float(py), 40.0)
        names.append(town.attributes(int(near.edge[0]))["name"])
        true = int(t.edge[np.searchsorted(t.time, fixes.time[after[k]])])
        assert town.attributes(true)["name"] == "Boulevard de la Marne"
    # the receiver's own slow error (2.5 m) may take one back, half a road's distance is 6.5 m
    assert names.count("Contre-allée") >= 2


def test_the_fork_is_passed_without_gps(town):
    drive = demo_drive(town)
    t = drive.truth
    fork = t.time[np.flatnonzero(t.edge == drive.route[-1])[0]]
    begin, end = drive.outages[1]
    assert begin < fork < end
    scenes = demo_scenes(town)
    assert scenes.mask[1] == scenes.parallel[0] < scenes.parallel[1] < scenes.junction[0]


def test_the_demo_refuses_another_map(hand_made, tmp_path):
    (tmp_path / "other.osm").write_text(
        """<osm version="0.6"><node id="1" version="1" lat="49.0" lon="2.0"/>
        <node id="2" version="1" lat="49.01" lon="2.0"/>
        <way id="1" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="primary"/></way>
        </osm>""",
        encoding="utf-8",
    )
    with pytest.raises(MapError, match="demo's junctions are not there"):
        demo_route(RoadMap.from_osm(tmp_path / "other.osm"))
