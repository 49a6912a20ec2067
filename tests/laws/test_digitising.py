"""However a road is drawn, in few pieces or many, it is as probable as it is."""

import functools
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given

from laws.drives import AS_REPORTED, LEARNT, between_parallels, law, said, sensed, way_through
from laws.geodetic import answer, degrees, drive, fixes, road_map
from scenes import (
    On,
    belief_on,
    context,
    drive_along,
    edge_weights,
    gnss,
    grid_town,
    network,
    parallel_roads,
)
from strategies import bent_line, bent_lines, seeds
from whichroad.filter.hypotheses.births import exchange_off_road
from whichroad.filter.state import CLOCK, DISTANCE, OFF_ROAD, WHEELS
from whichroad.graph.network import U_TURN, Roads
from whichroad.settings import Settings

TOWN = grid_town()
LENGTH = 2000.0  # m, of the parallel roads
MODES = pytest.mark.parametrize("mode", [WHEELS, DISTANCE, CLOCK])
EXACT = 1e-9  # rounding of some hundred updates, see test_world.py
SPEED = 9.7  # m/s: not a multiple of the spacing of looks at the map, which rounding would decide
A_HUNDREDTH = 0.01  # what the model promises of nodes that say nothing
TURN_ROUND = 1e-4  # prior of turning round at one


def redrawn(line: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The same polyline with up to five more vertices somewhere on it."""
    at = np.arange(len(line), dtype=float)
    more = np.sort(np.concatenate([at, rng.uniform(0.0, at[-1], rng.integers(1, 6))]))
    return np.column_stack([np.interp(more, at, line[:, k]) for k in (0, 1)])


@MODES
@given(seed=seeds)
@law
def test_vertices_that_bend_nothing_change_nothing_in_a_town(mode: int, seed: int):
    rng = np.random.default_rng(seed)
    truth = drive_along(way_through(seed, 5), speed=SPEED)
    fix = gnss(truth, sigma=rng.uniform(1.0, 6.0), seed=seed)
    epochs = sensed(truth, fix, np.arange(0, len(truth.time), 10), mode)
    each = [[e] for e in range(2 * len(TOWN))]
    fine = network([redrawn(line, rng) for line in TOWN])
    base, other = (said(roads, epochs, each, mode=mode) for roads in (network(TOWN), fine))
    np.testing.assert_allclose(other.p, base.p, rtol=0.0, atol=EXACT)
    np.testing.assert_allclose(other.off, base.off, rtol=0.0, atol=EXACT)
    np.testing.assert_allclose(other.place, base.place, rtol=EXACT, atol=EXACT)


@MODES
@example(seed=18062, line=bent_line(630, 2))  # two hypotheses face each other there
@given(seed=seeds, line=bent_lines())
@law
def test_vertices_that_bend_nothing_change_nothing_on_a_winding_road(mode, seed, line):
    """Two such roads side by side, the vehicle on or beside the first."""
    rng = np.random.default_rng(seed)
    other = line + rng.uniform(8.0, 30.0) * np.array([0.6, 0.8])
    truth = drive_along(np.vstack([line[:-1], line[-1]]), radius=0.5, margin=0.3, speed=SPEED)
    fix = gnss(truth, sigma=rng.uniform(1.0, 6.0), seed=seed)
    epochs = sensed(truth, fix, np.arange(0, len(truth.time), 5), mode)
    each = [[0], [1], [2], [3]]
    fine = network([redrawn(line, rng), redrawn(other, rng)])
    base, drawn = (said(r, epochs, each, mode=mode) for r in (network([line, other]), fine))
    np.testing.assert_allclose(drawn.p, base.p, rtol=0.0, atol=EXACT)
    np.testing.assert_allclose(drawn.place, base.place, rtol=EXACT, atol=EXACT)


@MODES
@given(seed=seeds)
@law
def test_a_street_in_one_row_of_the_table_or_in_many_is_one_street(mode: int, seed: int):
    """Nodes between two rows of one kind are no junctions: the map is the same one."""
    rng = np.random.default_rng(seed)
    gap = rng.uniform(8.0, 30.0)
    truth, fix = between_parallels(seed, gap)
    at = np.arange(0, len(truth.time), 10)
    cuts = np.concatenate([[0.0], np.sort(rng.uniform(1.0, LENGTH - 1.0, 4)), [LENGTH]])
    vertices = degrees([[x, 0.0] for x in cuts])
    far = degrees([[0.0, gap], [LENGTH, gap]])
    whole = road_map([vertices, far])
    cut = road_map([far, *(vertices[k : k + 2][:: rng.choice([-1, 1])] for k in range(5))])
    log = drive(truth, fixes(truth, fix, at), mode)
    one, many = answer(log, whole), answer(log, cut)
    np.testing.assert_allclose(many.p_of(cut, 0), one.p_of(whole, 1), atol=1e-6)  # as 32 bits
    for a, b in zip(one[3:8], many[3:8], strict=True):
        np.testing.assert_allclose(b, a, rtol=EXACT, atol=EXACT)


def with_nodes(cuts: np.ndarray, gap: float) -> tuple[Roads, list]:
    """Parallel roads, the first one with nodes; the edges of each road and direction."""
    ends = np.concatenate([[0.0], cuts, [LENGTH]])
    pieces = [[[a, 0.0], [b, 0.0]] for a, b in pairwise(ends)]
    n = 2 * len(pieces)
    roads = network([*pieces, [[0.0, gap], [LENGTH, gap]]])
    count = roads.edges.end_turn - roads.edges.first_turn
    on_the_way = np.repeat(count, count)
    back = (roads.turns.rule & U_TURN > 0) & (on_the_way == 2)
    prior = np.where(back, TURN_ROUND, np.where(on_the_way == 2, 1.0 - TURN_ROUND, 1.0))
    roads.turns.prior = prior  # as maps are compiled
    return roads, [range(0, n, 2), range(1, n, 2), [n], [n + 1]]


def nodes_change(mode: int, par: Settings, seed: int) -> float:
    """By how much nodes along one of two parallel roads change any probability of a drive."""
    rng = np.random.default_rng(seed)
    gap = rng.uniform(8.0, 30.0)
    truth, fix = between_parallels(seed, gap)
    epochs = sensed(truth, fix, np.arange(0, len(truth.time), 10), mode)
    roads, groups = with_nodes(np.sort(rng.uniform(1.0, LENGTH - 1.0, 9)), gap)
    whole = said(
        network(parallel_roads(gap)), epochs, [[0], [1], [2], [3]], mode=mode, settings=par
    )
    cut = said(roads, epochs, groups, mode=mode, settings=par)
    return float(max(np.abs(cut.p - whole.p).max(), np.abs(cut.off - whole.off).max()))


@pytest.mark.parametrize(
    ("mode", "par"), [(WHEELS, AS_REPORTED), (WHEELS, LEARNT), (DISTANCE, LEARNT), (CLOCK, LEARNT)]
)
def test_nodes_along_one_of_two_parallel_roads_change_its_probability_by_a_hundredth(
    mode: int, par: Settings
):
    assert max(nodes_change(mode, par, seed) for seed in range(33)) <= A_HUNDREDTH


@pytest.mark.xfail(strict=True, reason="in one drive of a hundred by more: 0.0183 and 0.0102")
@pytest.mark.parametrize(("mode", "seed"), [(WHEELS, 101), (DISTANCE, 808)])
def test_nodes_change_the_probability_of_no_drive_by_more_than_a_hundredth(mode: int, seed: int):
    assert nodes_change(mode, LEARNT, seed) <= A_HUNDREDTH


@functools.cache
def stubs_change(mode: int, seed: int) -> float:
    """By how much stubs along one of two parallel roads change the other's probability."""
    rng = np.random.default_rng(seed)
    gap = rng.uniform(8.0, 30.0)
    truth, fix = between_parallels(seed, gap)
    log = drive(truth, fixes(truth, fix, np.arange(0, len(truth.time), 10)), mode)
    at = np.sort(rng.uniform(400.0, 1200.0, 3))
    lines = [[[0.0, 0.0], *([x, 0.0] for x in at), [LENGTH, 0.0]], [[0.0, gap], [LENGTH, gap]]]
    stubs = [[[x, 0.0], [x, -rng.uniform(5.0, 30.0)]] for x in at]
    kinds = ["residential"] * 2 + ["service"] * 3
    bare = road_map([degrees(line) for line in lines], highway=kinds[:2])
    full = road_map([degrees(line) for line in lines + stubs], highway=kinds)
    without, with_them = answer(log, bare), answer(log, full)
    return float(np.abs(with_them.p_of(full, 1) - without.p_of(bare, 1)).max())


@pytest.mark.xfail(strict=True, reason="stubs are junctions, near which rows say less: 0.07")
@MODES
def test_stubs_along_one_of_two_parallel_roads_change_the_others_probability_by_a_hundredth(
    mode: int,
):
    assert max(stubs_change(mode, seed) for seed in range(30)) <= A_HUNDREDTH


@MODES
def test_stubs_do_so_in_all_drives_but_one_of_thirty(mode: int):
    assert sorted(stubs_change(mode, seed) for seed in range(30))[-2] <= A_HUNDREDTH


@pytest.mark.parametrize("node", [0.0, 2.0, 10.0, 40.0])
def test_a_node_beside_a_vehicle_off_the_roads_does_not_draw_it_back_to_its_road(node: float):
    """Midway between two roads it comes back to either; a hundredth of a road is elsewhere."""
    roads, (first, _, other, _) = with_nodes(np.array([1000.0 + node]), 20.0)
    belief = belief_on(roads, [On(OFF_ROAD, 1000.0, 1.0, -10.0)])
    belief.state.since_exit = 10.0
    exchange_off_road(belief, context(roads))
    shares = edge_weights(belief)
    back = [sum(shares.get(e, 0.0) for e in edges) for edges in (first, other)]
    assert back[0] == pytest.approx(back[1], rel=0.02)
