"""Ends that miss each other: how far the table tells they may, and what is joined."""

import geopandas
import numpy as np
import pytest
from typer.testing import CliRunner

from whichroad.cli import app
from whichroad.errors import MapError
from whichroad.roadmap import RoadMap
from whichroad.roadmap.gaps import learnt

SIDE = 10  # crossings of a town, 100 m apart


def _town():
    """(n, 2, 2) the streets of a town, from crossing to crossing."""
    at = [(100.0 * i, 100.0 * j) for i in range(SIDE) for j in range(SIDE)]
    return np.array(
        [(a, b) for a in at for b in at if a < b and np.hypot(*np.subtract(b, a)) < 101]
    )


def _shot(streets, share, by, rng):
    """Some ends by so many metres beyond, or short of, where they were."""
    along = np.diff(streets, axis=1) / 100.0 * [[[-1.0], [1.0]]]
    return streets + by * along * (rng.random((len(streets), 2, 1)) < share)


@pytest.fixture
def build(line):
    def built(streets, more=None, **settings):
        geometry = [line(*s) for s in streets]
        table = geopandas.GeoDataFrame(more or {}, geometry=geometry, crs=4326)
        return RoadMap.from_edges(table, directed=False, **settings)

    return built


def _reasons(roads):
    return {why.split(" by")[0].split(" within")[0] for why in roads.info()["skipped"]}


@pytest.mark.parametrize("share", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("by", [-2.0, -1.0, 1.0, 2.0])
def test_ends_that_fell_short_or_ran_over_meet(build, check, by, share):
    rng = np.random.default_rng(7)
    roads = build(_shot(_town(), share, by, rng))
    check(roads)
    exact = build(_town())
    assert abs(roads.info()["nodes"] - exact.info()["nodes"]) <= 1
    assert abs(len(roads) - len(exact)) <= 4
    said = roads.info()["skipped"]
    [joined] = [count for why, count in said.items() if why.startswith("ends that missed others")]
    assert joined > 0.7 * share * 2 * len(_town())


@pytest.mark.parametrize("sigma", [0.4, 0.7, 1.0])
def test_ends_that_scatter_meet_in_their_middle(build, check, sigma):
    streets = _town()
    roads = build(streets + np.random.default_rng(8).normal(0.0, sigma, streets.shape))
    check(roads)
    assert abs(roads.info()["nodes"] - build(streets).info()["nodes"]) <= 2
    assert abs(np.median(roads.arrays.edges.length) - 100.0) < sigma
    [why] = [why for why in roads.info()["skipped"] if why.startswith("ends that missed others")]
    assert "up to" in why
    assert ", median " in why


def test_rows_of_one_direction_each_meet_as_well(build, check):
    one = _shot(_town(), 0.1, -2.0, np.random.default_rng(9))
    streets = np.concatenate([one, one[:, ::-1]])
    roads = build(streets, {"id": range(len(streets)), "oneway": ["yes"] * len(streets)})
    check(roads)
    assert roads.info()["nodes"] == build(_town()).info()["nodes"]
    assert np.all(roads.arrays.edges.rule == 0)


def test_sides_that_fall_short_of_a_road_or_run_over_it_meet_it(build, line, check):
    """A road without ends at its side roads, a bend behind an end that ran over."""
    rng = np.random.default_rng(10)
    at = 60.0 * np.arange(1, 40)
    over = rng.choice([-1.8, 1.5], len(at))
    sides = [[(x, -y), (x, 90.0)] for x, y in zip(at, over, strict=True)]
    sides.append([(30.0, -2.0), (30.4, -1.0), (30.0, 5.0), (30.0, 90.0)])
    roads = build([[(0.0, 0.0), (2400.0, 0.0)], *sides])
    check(roads)
    assert roads.info()["nodes"] == 2 + 2 * len(sides)
    assert len(roads) == 2 * (2 * len(sides) + 1)
    said = roads.info()["skipped"]
    assert {why.split(" by")[0] for why in said} == {
        "ends that missed a line", "ends that ran over a line"
    }  # fmt: skip
    assert sum(said.values()) == len(sides)
    on = [e for e in range(len(roads)) if roads.source(e, 1.0) == (0, True)]
    assert sum(roads.arrays.edges.length[on]) == pytest.approx(2400.0, abs=0.01)


@pytest.mark.parametrize("share", [0.0, 0.02])
def test_dead_ends_beside_roads_stay_dead_ends_of_a_table_that_is_drawn_well(build, share):
    rng = np.random.default_rng(11)
    culs = [[(100.0 * i + 50.0, 100.0 * j + y), (100.0 * i + 50.0, 100.0 * j + 50.0)]
            for i in range(SIDE - 1) for j in range(SIDE - 1)
            for y in (float(rng.uniform(3.0, 5.0)),)]  # fmt: skip
    stubs = [[(100.0 * i, 100.0 * j), (100.0 * i + 30.0, 100.0 * j + 3.5)]
             for i in range(SIDE - 1) for j in range(SIDE - 1)]  # fmt: skip
    streets = [*_town().tolist(), *culs, *stubs]
    roads, before = build(streets), build(streets, gap_m=0)
    assert roads.fingerprint == before.fingerprint
    assert not before.info()["skipped"]


def test_what_is_far_off_is_not_joined_but_said(build):
    streets = _town()
    streets = streets + np.random.default_rng(12).normal(0.0, 4.0, streets.shape)
    roads = build(streets)
    assert roads.fingerprint == build(streets, gap_m=0).fingerprint
    why = "ends that miss roads by up to 8 m (not joined; gap_m joins)"
    assert roads.info()["skipped"][why] > 100


def _over(rng):
    """A town drawn by eye, and a bridge of two parts over one of its streets."""
    streets = _town() + rng.normal(0.0, 0.4, _town().shape)
    bridge = [[(50.0, -60.0), (50.0, 1.0)], [(50.0, 2.0), (50.0, 160.0)]]
    return [*streets.tolist(), *bridge], len(streets)


@pytest.mark.parametrize("what", [{"bridge": "yes"}, {"tunnel": "yes"}, {"layer": 1}])
def test_levels_stay_apart(build, check, what):
    streets, n = _over(np.random.default_rng(13))
    [(name, word)] = what.items()
    more = {"id": range(len(streets)), name: [None] * n + [word] * 2}
    roads = build(streets, more)
    check(roads)
    own = [e for e in range(len(roads)) if roads.source(e, 1.0)[0] in (n, n + 1)]
    assert len(own) == 2  # both parts are one edge, which meets nothing else
    nodes = set(roads.arrays.edges.from_node[own])
    others = set(range(len(roads))) - set(own)
    assert not nodes & set(roads.arrays.edges.from_node[sorted(others)])
    assert len(nodes) == 2


def test_a_bridge_goes_on_on_the_ground(build, check):
    streets = _town() + np.random.default_rng(14).normal(0.0, 0.4, _town().shape)
    bridge = ["no"] * len(streets)
    for k in range(0, len(streets), 7):
        bridge[k] = "yes"
    roads = build(streets, {"bridge": bridge})
    check(roads)
    assert abs(roads.info()["nodes"] - build(_town(), {"bridge": bridge}).info()["nodes"]) <= 1


def test_ends_of_told_levels_stay_apart(build):
    rng = np.random.default_rng(15)
    streets = _shot(_town(), 0.3, -1.0, rng)
    level = (np.arange(len(streets)) % 2).tolist()
    roads = build(streets, {"F_ZLEV": level, "T_ZLEV": level})
    ends = {lv: set() for lv in (0, 1)}
    edges = roads.arrays.edges
    for e in range(len(roads)):
        ends[int(roads.source(e, 1.0)[0]) % 2] |= {int(edges.from_node[e]), int(edges.to_node[e])}
    assert not ends[0] & ends[1]


def test_a_short_street_between_two_places_keeps_them_apart(build):
    streets = _town().tolist()
    gapped = _shot(np.array(streets), 0.2, -2.0, np.random.default_rng(16)).tolist()
    short = [[(0.0, 0.0), (-1.5, 0.0)], [(-1.5, 0.0), (-90.0, 5.0)], [(-1.5, 0.0), (-80.0, -50.0)]]
    roads = build(gapped + short)
    exact = build(streets + short)
    assert len(roads) == len(exact)
    assert roads.info()["nodes"] == exact.info()["nodes"]


def test_a_gap_may_be_given(build):
    streets = [[(0.0, 0.0), (100.0, 0.0)], [(103.0, 0.0), (200.0, 80.0)]]
    assert len(build(streets)) == 4
    assert len(build(streets, gap_m=0)) == 4
    assert len(build(streets, gap_m=2.9)) == 4
    joined = build(streets, gap_m=3.1)
    assert len(joined) == 2
    assert joined.info()["skipped"] == {
        "ends that missed others by up to 1.5 m, median 1.5 m (joined)": 2
    }
    short = _shot(_town(), 0.3, -2.0, np.random.default_rng(17))
    assert not build(short, gap_m=0).info()["skipped"]


def test_a_given_gap_is_the_largest_distance(build):
    for away, edges in ((1.9, 2), (2.1, 4)):
        facing = [[(0.0, 0.0), (100.0, 0.0)], [(100.0 + away, 0.0), (200.0, 0.0)]]
        assert len(build(facing, gap_m=2.0)) == edges


def test_by_a_learnt_gap_ends_that_face_each_other_may_both_have_missed(build):
    short = _shot(_town(), 0.1, -2.0, np.random.default_rng(7)).tolist()
    for away, edges in ((3.9, 2), (4.1, 4)):
        facing = [[(0.0, 2e3), (100.0, 2e3)], [(100.0 + away, 2e3), (200.0, 2e3)]]
        assert len(build(short + facing)) - len(build(short)) == edges


@pytest.mark.parametrize("apart", [2.0, 3.0])
@pytest.mark.parametrize("sloppy", [False, True])
def test_carriageways_that_end_beside_each_other_stay_two(build, apart, sloppy):
    pairs = [[(0.0, 2000.0 + 60.0 * k + y), (300.0, 2000.0 + 60.0 * k + y)]
             for k in range(30) for y in (0.0, apart)]  # fmt: skip
    streets = _town() + np.random.default_rng(19).normal(0.0, 0.7, _town().shape)
    streets = streets.tolist() if sloppy else []
    roads = build(streets + pairs)
    own = [e for e in range(len(roads)) if roads.source(e, 1.0)[0] >= len(streets)]
    assert len(own) == 120
    assert len(set(roads.arrays.edges.from_node[own])) == 120
    said = roads.info()["skipped"]
    [count] = [count for why, count in said.items() if "that they do not point at" in why]
    assert count >= 120


@pytest.mark.parametrize("gap", [-1, 20.5, float("nan")])
def test_a_gap_that_is_none_is_refused(build, gap):
    with pytest.raises(MapError, match="gap_m"):
        build([[(0.0, 0.0), (100.0, 0.0)]], gap_m=gap)


def test_few_ends_tell_nothing():
    rng = np.random.default_rng(18)
    assert learnt(np.array([2.0] * 4), 1000) == 0.0
    assert learnt(np.array([2.0] * 9), 1000) == 0.0
    assert learnt(np.array([2.0] * 99), 10_000) == 0.0
    assert learnt(rng.uniform(0.5, 2.0, 200), 10_000) == 2.25
    assert learnt(rng.uniform(0.0, 8.0, 300), 10_000) == 0.0
    assert learnt(np.concatenate([np.full(200, 2.0), rng.uniform(0.0, 8.0, 300)]), 10_000) == 2.5


def test_the_command_takes_a_gap_and_says_what_was_joined(line, tmp_path):
    lines = [line((0, 0), (100, 0)), line((102, 0), (200, 80))]
    table = tmp_path / "roads.geojson"
    geopandas.GeoDataFrame({"oneway": ["no"] * 2}, geometry=lines, crs=4326).to_file(table)
    out = str(tmp_path / "roads.map")
    done = CliRunner().invoke(app, ["map", "build", str(table), "--gap", "2.5", "-o", out])
    assert done.exit_code == 0, done.output
    assert "skipped: ends that missed others by up to 1.0 m" in done.output
    assert "2 directed edges" in done.output
    box = ["--gap", "1", "--bbox", "0,0,1,1", "--force"]
    assert CliRunner().invoke(app, ["map", "build", str(table), "-o", out, *box]).exit_code == 2
