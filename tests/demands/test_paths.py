"""Loops, U-turns, dead ends and driveways; time, speed and place on every edge."""

import numpy as np
import pytest

import whichroad
from demands.town import BLOCK, along, corners, fixes, roads, streets


def edges_of(result: whichroad.Result) -> list[str]:
    middle = 0.5 * (result.path.enter_m + result.path.exit_m)
    rows = zip(result.path.edge_id, middle, strict=True)
    return [roads().attributes(int(e), s)["name"] for e, s in rows]


def test_a_block_driven_round_twice_is_there_twice():
    twice = ("11", "12", "22", "21", "11", "12", "22", "21", "11", "10")
    line = corners(*twice)
    line[0] += [40.0, 0.0]
    result = whichroad.match(fixes(line, sigma=2.0), roads())
    assert streets(result) == list(twice[1:-1])


def test_turning_round_in_a_dead_end_is_found():
    out = [[2 * BLOCK, 3 * BLOCK + 50.0], [2 * BLOCK, 4 * BLOCK + 230.0]]
    back = [[2 * BLOCK, 4 * BLOCK], [BLOCK, 4 * BLOCK], [BLOCK - 60.0, 4 * BLOCK]]
    result = whichroad.match(fixes([*out, *back], sigma=2.0), roads())
    names = edges_of(result)
    assert names.count("Dead end") == 2
    assert names[-1] == "Row 4"


@pytest.mark.parametrize("seed", range(6))
def test_noise_makes_no_u_turns(seed):
    line = corners("20", "21", "22", "23", "24")
    line[-1] -= [40.0, 0.0]
    slow = fixes(line, speed=3.0, sigma=6.0, seed=seed, white=True)
    result = whichroad.match(slow, roads())
    assert streets(result) == ["21", "22", "23"]


def test_a_driveway_is_off_the_roads_and_the_street_is_found():
    yard = [[2.5 * BLOCK, 2.5 * BLOCK], [2.5 * BLOCK, 2 * BLOCK], [4 * BLOCK, 2 * BLOCK]]
    result = whichroad.match(fixes(yard, speed=5.0, sigma=2.0), roads())
    assert edges_of(result)[-1] == "Row 2"
    assert set(edges_of(result)[1:]) == {"Row 2"}
    assert result.points.status.iloc[3:8].eq("off_road").all()


def test_each_edge_says_when_it_was_driven_and_how_fast():
    line = corners("20", "21", "22", "23", "24")
    result = whichroad.match(fixes(line, speed=12.0, sigma=1.0), roads())
    path = result.path
    inner = path.iloc[1:-1]
    assert inner.duration_s.to_numpy() == pytest.approx(BLOCK / 12.0, abs=1.0)
    assert inner.mean_speed_mps.to_numpy() == pytest.approx(12.0, abs=1.2)
    seconds = (path.exit_time - path.enter_time).dt.total_seconds()
    assert path.duration_s.to_numpy() == pytest.approx(seconds.to_numpy(), abs=1e-5)
    assert (path.exit_time[:-1].to_numpy() == path.enter_time[1:].to_numpy()).all()


def test_sources_and_places_along_them_are_told():
    line = corners("20", "21", "22")
    line[0] += [40.0, 0.0]
    time, place = along(line)
    points = whichroad.match(fixes(line, sigma=1.0), roads()).points
    edge = points.edge_id.to_numpy().astype(int)
    ways = [roads().source(e, s) for e, s in zip(edge, points.abscissa_m, strict=True)]
    assert [str(way) for way, _ in ways] == points.source_id.tolist()
    assert len(set(points.source_id)) == 1
    offset = np.array([place[k][0] % BLOCK for k in range(len(time))])
    inside = (offset > 10.0) & (offset < BLOCK - 10.0) & (time > 5.0)
    assert points.abscissa_m.to_numpy()[inside] == pytest.approx(offset[inside], abs=5.0)


@pytest.mark.parametrize("every", [10.0, 20.0])
def test_fixes_far_apart_are_joined_by_the_streets_between(every):
    way = ("00", "01", "02", "12", "22", "32", "33", "34")
    line = corners(*way)
    line[0] += [30.0, 0.0]
    line[-1] -= [30.0, 0.0]
    result = whichroad.match(fixes(line, every=every, sigma=3.0), roads())
    assert streets(result) == list(way[1:-1])
    path = result.path
    assert (path.to_node[:-1].to_numpy() == path.from_node[1:].to_numpy()).all()
