"""Loops, U-turns, dead ends and driveways; time, speed and place on every edge."""

import numpy as np
import pandas as pd
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


def wander(rng: np.random.Generator, steps: int) -> np.ndarray:
    """Plane points of crossings passed at random, never turning round."""
    at, step = rng.integers(0, 5, 2), np.zeros(2, int)
    names = [at]
    for _ in range(steps):
        ways = [np.array(way) for way in ((0, 1), (0, -1), (1, 0), (-1, 0))]
        ways = [way for way in ways if np.isin(at + way, range(5)).all() and (way != -step).any()]
        step = ways[rng.integers(len(ways))]
        at = at + step
        names.append(at)
    line = BLOCK * np.array(names, float)
    line[0] += rng.uniform(0.1, 0.9) * (line[1] - line[0])
    line[-1] += rng.uniform(0.1, 0.9) * (line[-2] - line[-1])
    return line


@pytest.mark.parametrize("lag", [None, "full"])
@pytest.mark.parametrize("every", [10.0, 30.0, 60.0])
def test_the_edges_driven_share_the_whole_time_of_a_trip_by_their_lengths(every, lag):
    rng = np.random.default_rng(int(every))
    trips = []
    for k in range(40):
        seen = fixes(wander(rng, 30), every=every, seed=k)
        trips.append(pd.DataFrame({**seen, "trip_id": f"t{k:02}"}))
    tables = whichroad.match_many(pd.concat(trips), roads(), lag=lag)
    path = tables.path.to_pandas()
    points = tables.points.to_pandas()
    whole = 0  # without a gap
    for name, rows in path.groupby("drive_id"):
        following = rows.enter_time.iloc[1:].to_numpy()
        assert (rows.exit_time.iloc[:-1].to_numpy() == following).all(), name
        assert rows.enter_time.is_monotonic_increasing, name
        if rows.broken_rule.eq("gap").any():
            continue
        time = points.time[points.drive_id == name]
        lasted = (time.max() - time.min()).total_seconds()
        assert rows.duration_s.sum() == pytest.approx(lasted, abs=0.01), name
        whole += 1
    assert whole >= 39
    way = path.exit_m - path.enter_m
    assert not ((path.duration_s == 0.0) & (way > 20.0)).any()
    assert path.mean_speed_mps.max() < 25.0  # 10 m/s were driven
    speeds = whichroad.speeds(tables.path, hours=False, drives=tables.drives).to_pandas()
    assert speeds.speed_mps.max() < 25.0
