"""Between fixes that lie far apart hypotheses move along routes, and nothing gets lost."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from scenes import (
    column,
    context,
    grid_town,
    living,
    localize,
    network,
    parallel_roads,
    steps,
    straight_road,
)
from strategies import seeds
from whichroad._compile import Records
from whichroad.filter.sparse.routing import moments_on_edge, truncate_to_edges
from whichroad.filter.state import CLOCK, OFF_ROAD, new_epochs
from whichroad.graph.network import Roads
from whichroad.settings import Settings

TOWN = network(grid_town(8, 8, 150.0))


HONEST = Settings(gnss_inflation=1.0)  # the receiver errs as it says


def fixes(at: np.ndarray, time: np.ndarray, sigma: float = 5.0) -> Records:
    """Positions alone, (n, 2) m, at (n,) s."""
    epochs = new_epochs(len(time))
    epochs.time[:] = time
    epochs.has_fix[:] = 1
    epochs.fix[:, :2] = at
    epochs.fix[:, 2:4] = sigma
    epochs.speed_sigma[:] = np.inf
    epochs.course_sigma[:] = np.inf
    return epochs


def street(block: float, blocks: int) -> Roads:
    """A straight street of blocks."""
    ends = block * np.arange(blocks + 1)
    return network([np.array([[a, 0.0], [b, 0.0]]) for a, b in pairwise(ends)])


def turns_of(roads: Roads, edge: int) -> Records:
    return roads.turns[roads.edges.first_turn[edge] : roads.edges.end_turn[edge]]


def drive(roads: Roads, seed: int, seconds: float, edges: int = 14) -> tuple[Records, list[int]]:
    """Somebody drives at 10 m/s, turns as most do, and is seen now and then."""
    rng = np.random.default_rng(seed)
    table, vertices = roads.edges, roads.vertices
    route = [int(rng.integers(len(table)))]
    for _ in range(edges):
        turns = turns_of(roads, route[-1])
        turns = turns[turns.edge != table.opposite[route[-1]]]
        p = turns.prior.astype(float)
        route.append(int(rng.choice(turns.edge, p=p / p.sum())))
    ends = np.concatenate([[0.0], np.cumsum(table.length[route])])
    time = np.arange(0.0, ends[-1] / 10.0, seconds)
    piece = np.clip(np.searchsorted(ends, 10.0 * time, side="right") - 1, 0, len(route) - 1)
    share = (10.0 * time - ends[piece]) / table.length[route][piece]
    a, b = vertices[table.first_vertex[route]], vertices[table.last_vertex[route]]
    way = np.array([b.x - a.x, b.y - a.y])[:, piece]
    at = np.array([a.x, a.y])[:, piece] + share * way
    return fixes(at.T + rng.normal(0.0, 3.0, at.T.shape), time), route[: piece[-1] + 1]


@pytest.mark.parametrize("seconds", [5.0, 15.0])
def test_routes_through_a_grid_are_found(seconds: float):
    right = 0
    for seed in range(12):
        epochs, route = drive(TOWN, seed, seconds)
        found = [e for e in localize(TOWN, epochs, mode=CLOCK).chain.edge.tolist() if e >= 0]
        right += len(set(found) & set(route)) / len(set(found) | set(route)) > 0.8
    assert right >= 10


@pytest.mark.parametrize("seconds", [3.0, 10.0, 60.0, 300.0])
@given(seed=seeds)
def test_every_fix_has_an_answer_whose_probabilities_sum_to_one(seconds: float, seed: int):
    rng = np.random.default_rng(seed)
    wild = np.cumsum(rng.normal(0.0, 8.0 * seconds**0.8, (12, 2)), axis=0) + 500.0
    output = localize(TOWN, fixes(wild, seconds * np.arange(12.0)), mode=CLOCK).output
    assert (output.rows.live > 0).all()
    for name in ("x", "y", "heading", "cov", "s", "match_x", "match_y", "map_x", "map_y", "speed"):
        assert np.isfinite(output.rows[name]).all()
    assert (output.rows.alt_p.sum(axis=1) <= 1.0 + 1e-5).all()
    assert (column(output, "xx") > 0).all()
    assert (column(output, "yy") > 0).all()


@given(seed=seeds, seconds=st.sampled_from([10.0, 30.0]))
def test_the_chain_of_edges_is_connected_while_the_map_is(seed: int, seconds: float):
    epochs, _ = drive(TOWN, seed, seconds)
    edges = localize(TOWN, epochs, mode=CLOCK).chain.edge.tolist()
    for a, b in pairwise(edges):
        if OFF_ROAD not in (a, b) and a != b:
            assert b in turns_of(TOWN, a).edge or b == a ^ 1


def test_along_a_straight_road_the_answer_is_between_fix_and_lane():
    roads = network(straight_road())
    time = 10.0 * np.arange(12.0)
    at = np.column_stack([100.0 + 12.0 * time, np.full(12, -1.75)])
    output = localize(roads, fixes(at, time), mode=CLOCK).output
    assert (output.rows.edge[2:] == 0).all()
    assert np.abs(output.rows.x[2:] - at[2:, 0]).max() < 5.0
    assert np.abs(output.rows.y[2:] - at[2:, 1]).max() < 1.0
    assert np.abs(output.rows.s[2:] - at[2:, 0]).max() < 5.0


def test_parallel_roads_that_fixes_cannot_tell_apart_stay_in_doubt():
    roads = network(parallel_roads(8.0))
    time = 20.0 * np.arange(6.0)
    at = np.column_stack([100.0 + 12.0 * time, np.full(6, 4.0)])
    output = localize(roads, fixes(at, time), mode=CLOCK).output
    assert (output.rows.p_edge < 0.75).all()


def wander(rng: np.random.Generator, time: np.ndarray, sigma: float) -> np.ndarray:
    """A receiver's slow error, (n, 2) m, forgotten in a minute and a half."""
    error = rng.normal(0.0, sigma, (len(time), 2))
    for k in range(1, len(time)):
        kept = np.exp((time[k - 1] - time[k]) / 80.0)
        error[k] = kept * error[k - 1] + np.sqrt(1.0 - kept**2) * error[k]
    return error


@pytest.mark.parametrize("seconds", [3.0, 6.0])
def test_who_stands_before_a_crossing_does_not_creep_over_it(seconds: float):
    roads = street(100.0, 20)
    time = seconds * np.arange(1.0 + 120.0 // seconds)
    x = 596.0 - 10.0 * np.maximum(60.0 - time, 0.0)  # stands from 60 s on
    late, speed = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        at = np.column_stack([x, np.full(len(x), -1.75)]) + wander(rng, time, 4.0)
        output = localize(roads, fixes(at, time, 4.0), settings=HONEST, mode=CLOCK).output
        late.append(output.rows.x[-1] - at[-1, 0])
        speed.append(output.rows.speed[-1])
    assert abs(np.mean(late)) < 2.0
    assert np.mean(speed) < 0.5


def test_offsets_across_the_road_tell_how_much_of_the_error_is_new_with_every_fix():
    roads = network(straight_road(4000.0))
    time = 5.0 * np.arange(40.0)
    line = np.column_stack([100.0 + 12.0 * time, np.full(40, -1.75)])
    seen: dict[str, list[float]] = {"new": [], "lasting": []}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        for kind, error in (
            ("new", rng.normal(0.0, 5.0, line.shape)), ("lasting", wander(rng, time, 5.0))
        ):  # fmt: skip
            rows = fixes(line + error, time, 5.0)
            *_, (_, belief, _) = steps(roads, rows, mode=CLOCK)
            seen[kind].append(float(belief.state[0].white_factor))
    assert 0.7 < np.mean(seen["new"]) < 1.2
    assert np.mean(seen["lasting"]) < 0.3


@given(
    s=st.floats(-40.0, 140.0),
    sigma=st.floats(2.0, 40.0),
    length=st.floats(3.0, 200.0),
    is_junction=st.booleans(),
    driven=st.sampled_from([1.0, 80.0, 900.0, 1e6]),
)
@example(s=-23.0, sigma=14.0, length=39.0, is_junction=True, driven=1.0)
def test_the_moments_of_a_place_on_an_edge_are_those_of_its_density(
    s: float, sigma: float, length: float, is_junction: bool, driven: float
):
    u = np.linspace(s - 60.0 - 6.0 * sigma, s + 60.0 + 6.0 * sigma, 200_001)

    def normal(mean: float, width: float, u: np.ndarray = u) -> np.ndarray:
        return np.exp(-0.5 * ((u - mean) / width) ** 2) / width / np.sqrt(2.0 * np.pi)

    before = normal(length - 6.0, math.hypot(6.0, math.sqrt(driven)), np.array(s))
    stand = 30.0 * min(1.0, length / 12.0) * is_junction
    where = ((u >= 0.0) & (u <= length)) + stand * normal(length - 6.0, 6.0)
    density = normal(s, sigma) * where * (u[1] - u[0])
    density /= 1.0 + stand * max(1.0 / length, float(before))
    mass = density.sum()
    assume(mass > 0.01)
    mean = (u * density).sum() / mass
    found = moments_on_edge(s, sigma, length, is_junction, driven)
    assert found[0] == pytest.approx(mass, rel=5e-3, abs=2e-3)
    assert found[1] == pytest.approx(mean, abs=0.1 * sigma)
    variance = ((u - mean) ** 2 * density).sum() / mass
    assert found[2] == pytest.approx(variance, rel=0.15, abs=0.5 + 1e-3 * sigma**2)


def before_the_node(lines: list[np.ndarray]) -> float:
    """P(first edge) of who was seen at its start, and half a minute later over its end."""
    rows = fixes(np.array([[100.0, 0.0], [300.0, 0.0]]), np.array([0.0, 30.0]))
    *_, (_, belief, _) = steps(network(lines), rows, mode=CLOCK)
    return float(living(belief).weight[living(belief).edge == 0].sum())


@pytest.mark.parametrize("s", [-900.0, 900.0])
def test_who_is_far_off_an_edge_has_moments_there(s: float):
    found = moments_on_edge(s, 5.0, 40.0, True, 80.0)
    assert np.isfinite(found).all()
    assert found[0] >= 0.0


def test_vehicles_stand_before_junctions():
    road = [np.array([[0.0, 0.0], [300.0, 0.0]]), np.array([[300.0, 0.0], [600.0, 0.0]])]
    side = np.array([[300.0, 0.0], [300.0, 300.0]])
    assert before_the_node([*road, side]) > before_the_node(road) + 0.1


def test_before_a_junction_is_no_more_probable_for_who_was_foreseen_there():
    foreseen, found = (moments_on_edge(294.0, 3.0, 300.0, True, v)[0] for v in (1.0, 1e6))
    assert foreseen == pytest.approx(1.0, abs=0.15)
    assert found > 1.5 * foreseen


def test_who_stands_is_placed_before_a_junction_once():
    road = [np.array([[0.0, 0.0], [300.0, 0.0]]), np.array([[300.0, 0.0], [600.0, 0.0]])]
    side = np.array([[300.0, 0.0], [300.0, 300.0]])
    roads = network([*road, side])
    rows = fixes(np.array([[100.0, -1.75], [294.0, -1.75]]), np.array([0.0, 30.0]), 3.0)
    *_, (_, belief, _) = steps(roads, rows, settings=HONEST, mode=CLOCK)
    best = living(belief)[np.argmax(living(belief).weight)]
    changed = []
    for driven in (0.0, 1e6):
        best.travel_variance = driven
        before = float(best.log_weight)
        truncate_to_edges(belief, context(roads))
        changed.append(best.log_weight - before)
    assert abs(changed[0]) < 0.1
    assert changed[1] > 0.4


@pytest.mark.parametrize("seconds", [4.0, 10.0])
def test_looking_back_over_sparse_fixes_finds_the_place_better(seconds: float):
    roads = street(4000.0, 3)
    squares: dict[str, list[float]] = {"filtered": [], "smoothed": []}
    inside = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        time = seconds * np.arange(40.0)
        speed = 9.0 + np.cumsum(rng.normal(0.0, 0.5, 40))
        x = 500.0 + np.cumsum(speed * seconds)
        at = np.column_stack([x, np.full(40, -1.75)])
        rows = fixes(at + rng.normal(0.0, 8.0, at.shape), time, 8.0)
        found = localize(roads, rows, mode=CLOCK, lag="full")
        for name, output in (("filtered", found.past.filtered), ("smoothed", found.output)):
            off = output.rows.x[15:] - x[15:]
            squares[name] += (off**2).tolist()
        inside += (off**2 < 5.99 * column(output, "xx")[15:]).tolist()
    assert np.mean(squares["smoothed"]) < 0.9 * np.mean(squares["filtered"])
    assert np.mean(inside) > 0.95


def test_who_has_just_stopped_was_not_there_at_the_fix_before():
    roads = network(straight_road(2000.0))
    time = 10.0 * np.arange(9.0)
    x = np.array([100.0, 200.0, 300.0, 400.0, 409.0, 409.0, 409.0, 500.0, 600.0])
    rows = fixes(np.column_stack([x, np.full(9, -1.75)]), time, 3.0)
    rows.speed[:] = [10.0, 10.0, 10.0, 2.0, 0.6, 0.6, 0.6, 10.0, 10.0]
    rows.speed_sigma[:] = 0.3
    found = localize(roads, rows, mode=CLOCK, lag="full").output
    assert np.abs(found.rows.x[1:] - x[1:]).max() < 3.0


def test_the_matched_point_is_the_place_of_the_most_probable_edge_nearest_to_the_pose():
    roads = street(55.0, 40)
    time = 5.0 * np.arange(40.0)
    at = np.column_stack([100.0 + 9.5 * time, np.full(40, -1.75)])
    found = localize(roads, fixes(at, time), mode=CLOCK).output
    doubtful = np.flatnonzero(found.rows.p_edge < 0.9)
    assert len(doubtful) > 3
    for k in doubtful[doubtful > 2]:
        edge = roads.edges[found.rows.edge[k]]
        start = roads.vertices.x[edge.first_vertex]
        nearest = np.clip(found.rows.map_x[k] - start, 0.0, edge.length)
        assert found.rows.s[k] == pytest.approx(nearest, abs=0.5)
        assert found.rows.match_x[k] == pytest.approx(start + found.rows.s[k], abs=0.05)


def test_a_car_that_stands_for_ten_minutes_between_two_fixes_is_where_it_was():
    roads = network(straight_road())
    time = np.array([0.0, 20.0, 40.0, 640.0, 660.0])
    x = np.array([100.0, 300.0, 500.0, 510.0, 700.0])
    output = localize(roads, fixes(np.column_stack([x, 0 * x]), time), mode=CLOCK).output
    assert (output.rows.edge[1:] == 0).all()
    assert np.abs(output.rows.x[1:] - x[1:]).max() < 8.0


def test_a_missing_road_is_a_gap_and_the_drive_goes_on():
    roads = network([[[0.0, 0.0], [1000.0, 0.0]], [[1500.0, 800.0], [3000.0, 800.0]]])
    time = 20.0 * np.arange(14.0)
    x = 100.0 + 10.0 * time
    y = np.interp(x, [1000.0, 1500.0], [0.0, 800.0])
    recorded = localize(roads, fixes(np.column_stack([x, y]), time), mode=CLOCK)
    assert recorded.output.rows.edge[3] == 0
    assert (recorded.output.rows.edge[-3:] == 2).all()
    assert {0, 2} <= set(recorded.chain.edge.tolist())


@pytest.mark.parametrize("tunnel", [8.0, 40.0, 90.0])
def test_one_trace_may_be_dense_and_sparse_and_dense_again(tunnel: float):
    roads = network(straight_road())
    time = np.concatenate([np.arange(40.0), 40.0 + tunnel + np.arange(40.0)])
    at = np.column_stack([100.0 + 12.0 * time, np.full(80, -1.75)])
    recorded = localize(roads, fixes(at, time), mode=CLOCK)
    assert (recorded.output.rows.edge[5:] == 0).all()
    assert np.abs(recorded.output.rows.x[5:] - at[5:, 0]).max() < 6.0
    assert set(recorded.chain.edge.tolist()) == {0}


def test_settings_hold_for_sparse_fixes_too():
    epochs, _ = drive(TOWN, 3, 10.0)
    near = localize(TOWN, epochs, mode=CLOCK, settings=Settings(prune=1e-4)).output
    few = localize(TOWN, epochs, mode=CLOCK, settings=Settings(prune=0.05)).output
    assert few.rows.live.mean() <= near.rows.live.mean()


@pytest.mark.parametrize("seconds", [5.0, 10.0, 20.0])
def test_who_has_turned_on_the_way_drives_on_the_opposite_edge(seconds: float):
    """Out at 12 m/s, round between two fixes, back: nobody drives backwards for 700 m."""
    roads = street(400.0, 4)
    time = np.arange(0.0, 160.0, seconds)
    along = 100.0 + 12.0 * np.minimum(time, 163.0 - time)
    noise = np.random.default_rng(3).normal(0.0, 3.0, (len(time), 2))
    at = np.column_stack([along, np.zeros(len(time))]) + noise
    rows = localize(roads, fixes(at, time), mode=CLOCK).output.rows
    back = time > 81.5 + seconds
    heading = np.cos(rows.heading)
    assert (heading[(time > 0.0) & (time < 81.5)] > 0.9).all()
    assert (heading[back] < -0.9).all()
    assert (rows.p_edge[back][1:] > 0.5).all()
