"""Looking back through the graph of hypotheses, against every chain counted one by one."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from whichroad.core.angles import wrap
from whichroad.core.belief import KEPT, NOW, ORIGINS, B, D, H, K, N, X, Y, new_belief, new_route
from whichroad.core.epoch import WHEELS, new_epochs
from whichroad.core.gain import new_bench, solve_gain
from whichroad.core.lookback import begin_view, new_view, recall, step_back
from whichroad.core.memory import (
    PACKED,
    enlarged,
    is_full,
    new_memory,
    note_motion,
    remember,
)
from whichroad.core.motion import arc_chord, predict_free
from whichroad.core.reduction import reduce
from whichroad.core.transition import predict_link
from whichroad.core.ways import best_way, edge_probability

from oracles.chains import all_chains, random_memory, share_of
from scenes import network
from strategies import seeds
from whichroad.settings import Settings

ROAD = network([[[0.0, 0.0], [5000.0, 0.0]]])
PAR = Settings().parameters()


def smoothed(memory) -> list[np.ndarray]:
    view, slot = new_view(), 0
    last = int(memory.size[0]) - 1
    begin_view(memory, view, last, slot)
    found = [view.p[slot, : memory.first_node[last + 1] - memory.first_node[last]].copy()]
    for step in range(last, 0, -1):
        step_back(memory, view, ROAD, new_route(1), step, slot, False, WHEELS, 1.0, PAR)
        slot = 1 - slot
        count = memory.first_node[step] - memory.first_node[step - 1]
        found.insert(0, view.p[slot, :count].copy())
    return found


@given(seeds)
def test_smoothed_probabilities_are_sums_over_all_chains(seed: int):
    memory = random_memory(seed)
    chains = all_chains(memory)
    for t, p in enumerate(smoothed(memory)):
        first = int(memory.first_node[t])
        exact = np.bincount(chains.nodes[:, t] - first, chains.p, len(p))
        np.testing.assert_allclose(p, exact, atol=1e-6)
        assert p.sum() == pytest.approx(1.0, abs=1e-9)


@given(seeds)
def test_the_last_step_is_as_filtered(seed: int):
    memory = random_memory(seed)
    last = slice(*memory.first_node[memory.size[0] - 1 : memory.size[0] + 1].tolist())
    np.testing.assert_array_equal(smoothed(memory)[-1], memory.p[last])


@given(seeds)
def test_what_no_link_accounts_for_stays_as_filtered(seed: int):
    memory = random_memory(seed)
    cut = int(memory.size[0]) // 2  # a new beginning there
    nodes = range(*memory.first_node[cut : cut + 2].tolist())
    for j in nodes:
        memory.share[memory.first_link[j] : memory.first_link[j + 1]] = 0.0
    before = slice(*memory.first_node[cut - 1 : cut + 1].tolist())
    np.testing.assert_allclose(smoothed(memory)[cut - 1], memory.p[before], atol=1e-9)


def way_of(memory, *, viterbi: bool) -> np.ndarray:
    steps, nodes, _ = memory.size.tolist()
    p, score = np.zeros((2, nodes))
    way = np.zeros(steps, np.int64)
    edge_probability(memory, p)
    best_way(memory, np.ones(steps), p, viterbi, score, np.zeros(nodes, np.int64), way)
    return way


@given(seeds)
def test_the_most_probable_chain_is_the_best_of_all(seed: int):
    memory = random_memory(seed)
    chains = all_chains(memory)
    way = way_of(memory, viterbi=True)
    at = np.flatnonzero((chains.nodes == way).all(axis=1))
    assert chains.p[at[0]] == pytest.approx(chains.p.max(), rel=1e-6)


@given(seeds)
def test_the_best_way_has_the_most_right_edges_of_all_linked_chains(seed: int):
    memory = random_memory(seed)
    for t, p in enumerate(smoothed(memory)):
        memory.smoothed[memory.first_node[t] : memory.first_node[t + 1]] = p
    chains = all_chains(memory)
    total = np.zeros(int(memory.size[1]))
    edge_probability(memory, total)
    linked = np.array(
        [
            all(share_of(memory, j, i) >= 1e-3 for i, j in itertools.pairwise(c))
            for c in chains.nodes
        ]
    )
    way = way_of(memory, viterbi=False)
    assert total[way].sum() == pytest.approx(total[chains.nodes[linked]].sum(axis=1).max())


def random_state(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A state on the road, and a covariance with correlations."""
    sigma = np.array([3.0, 3.0, 0.05, 0.01, 3e-4, 1.0, 2.0, 2.0, 0.8, 0.8])
    root = rng.normal(size=(N, N)) / np.sqrt(N) + np.eye(N)
    mean = np.array([900.0, -1.5, rng.uniform(-1.0, 1.0), 1.01, 2e-4, 1.5, 1.0, -1.0, 0.3, -0.4])
    return mean, root @ root.T * np.outer(sigma, sigma)


def put(belief, i: int, mean: np.ndarray, cov: np.ndarray, edge: int = 0) -> None:
    belief.mean[i], belief.cov[i], belief.edge[i] = mean, cov, edge
    belief.abscissa[i], belief.probability[i], belief.log_weight[i] = mean[X], 1.0, 0.0
    belief.size[0] = max(belief.size[0], i + 1)


@given(seeds)
def test_links_are_predicted_as_the_wheels_moved_the_filter(seed: int):
    """Many small movements at once, by the equations of each, to second order in their noise."""
    rng = np.random.default_rng(seed)
    mean, cov = random_state(rng)
    belief, memory, epochs = new_belief(True), new_memory(4), new_epochs(8)
    put(belief, 0, mean, cov)
    remember(belief, memory, 0, True, 0.0)
    belief.clock[NOW] = 1.0
    for k in range(8):
        arc, turn = rng.uniform(0.0, 1.5), rng.normal(0.0, 0.05)
        epochs.arc[k], epochs.turn[k] = arc, turn
        epochs.forward[k], epochs.left[k] = arc_chord(arc, turn)
        note_motion(memory, epochs, k, 0.1, 10.0, WHEELS)
        predict_free(
            belief.mean[0], belief.cov[0], epochs.forward[k], epochs.left[k], turn, arc, 1.0,
            PAR.along_noise**2 * arc, PAR.lateral_noise**2 * arc,
            PAR.heading_noise**2 * arc + PAR.turn_noise**2 * 0.5 * np.pi * abs(turn),
            1e-10 * arc, PAR.yaw_bias_noise**2 * arc,
        )  # fmt: skip
    remember(belief, memory, 7, True, 0.0)
    bench = new_bench()
    predict_link(
        bench, np.zeros(N), memory, ROAD, new_route(1), 1, 0, 1, mean, cov, WHEELS, 1.0, 1.0, PAR
    )
    sigma = np.sqrt(np.diag(belief.cov[0]))
    off = bench.mean - belief.mean[0]
    off[H] = wrap(off[H])
    np.testing.assert_allclose(off / sigma, 0.0, atol=2e-3)
    np.testing.assert_allclose(
        bench.cov / np.outer(sigma, sigma), belief.cov[0] / np.outer(sigma, sigma), atol=1e-2
    )
    assert (np.diff(memory.share[: memory.size[2]]) == 0).all()


@given(seeds, st.booleans())
def test_the_gain_is_that_of_the_normal_equations(seed: int, silent: bool):
    rng = np.random.default_rng(seed)
    _, cov = random_state(rng)
    bench = new_bench()
    bench.cov[:] = cov
    bench.cross[:] = cov @ rng.normal(size=(N, N))  # in the span of what varies
    if silent:  # a state that nobody uses
        for a in (B, D):
            bench.cov[a], bench.cov[:, a], bench.cross[a] = 0.0, 0.0, 0.0
    solve_gain(bench)
    sigma = np.sqrt(np.where(np.diag(bench.cov) > 0.0, np.diag(bench.cov), 1.0))
    scaled = bench.cov / np.outer(sigma, sigma)
    expected = bench.cross.T / sigma @ np.linalg.pinv(scaled, hermitian=True) / sigma
    np.testing.assert_allclose(
        bench.gain.T * sigma, expected * sigma, atol=1e-6 * np.abs(expected * sigma).max()
    )


@given(seeds)
def test_one_link_is_smoothed_as_the_textbook_does(seed: int):
    rng = np.random.default_rng(seed)
    mean, cov = random_state(rng)
    belief, memory, epochs = new_belief(True), new_memory(4), new_epochs(1)
    put(belief, 0, mean, cov)
    remember(belief, memory, 0, True, 0.0)
    epochs.arc[0] = epochs.forward[0] = 5.0
    note_motion(memory, epochs, 0, 0.5, 10.0, WHEELS)
    bench = new_bench()
    belief.mean[0, X] += 5.0 * np.cos(mean[H])
    belief.mean[0, Y] += 5.0 * np.sin(mean[H])
    belief.mean[0] += 0.5 * np.sqrt(np.diag(cov)) * rng.normal(size=N)  # an observation
    belief.cov[0] *= 0.4
    remember(belief, memory, 0, True, 0.0)
    predict_link(
        bench, np.zeros(N), memory, ROAD, new_route(1), 1, 0, 1, mean, cov, WHEELS, 1.0, 1.0, PAR
    )
    gain = bench.cross.T @ np.linalg.inv(bench.cov)
    off = memory.mean[1] - bench.mean
    off[H] = wrap(off[H])
    view = new_view()
    begin_view(memory, view, 1, 0)
    step_back(memory, view, ROAD, new_route(1), 1, 0, True, WHEELS, 1.0, PAR)
    sigma = np.sqrt(np.diag(cov))
    np.testing.assert_allclose((view.mean[1, 0] - mean - gain @ off) / sigma, 0.0, atol=1e-5)
    exact = cov + gain @ (belief.cov[0] - bench.cov) @ gain.T
    np.testing.assert_allclose(
        view.cov[1, 0] / np.outer(sigma, sigma), exact / np.outer(sigma, sigma), atol=1e-5
    )


def test_merged_hypotheses_owe_their_weight_to_both():
    rng = np.random.default_rng(3)
    belief, memory = new_belief(True), new_memory(4)
    mean, cov = random_state(rng)
    for i, p in enumerate((0.5, 0.3, 0.2)):
        put(belief, i, mean, cov, edge=i % 2)
        belief.probability[i], belief.log_weight[i] = p, np.log(p)
    remember(belief, memory, 0, True, 0.0)
    assert belief.clock[ORIGINS] == 3
    reduce(belief, new_route(100), 1.0, 1e-4, 0.05, 2)
    belief.clock[NOW] = 1.0
    remember(belief, memory, 1, True, 0.0)
    assert memory.first_node[2] - memory.first_node[1] == 2
    links = {
        (int(memory.edge[j]), int(memory.origin[at])): float(memory.share[at])
        for j in range(memory.first_node[1], memory.first_node[2])
        for at in range(memory.first_link[j], memory.first_link[j + 1])
    }
    assert links == pytest.approx({(0, 0): 5 / 7, (0, 2): 2 / 7, (1, 1): 1.0})


@given(seeds, st.integers(0, 4), st.booleans())
def test_a_larger_memory_remembers_the_same(seed: int, drop: int, grow: bool):
    memory = random_memory(seed)
    memory.mean[:], memory.cov[:] = 1.5, 2.5
    larger = enlarged(memory, drop, grow=grow)
    steps, nodes, links = larger.size.tolist()
    first = int(memory.first_node[drop])
    assert steps == memory.size[0] - drop
    np.testing.assert_array_equal(larger.time[:steps], memory.time[drop : memory.size[0]])
    np.testing.assert_array_equal(larger.p[:nodes], memory.p[first : memory.size[1]])
    assert larger.first_node[steps] == nodes
    assert larger.first_link[nodes] == links
    assert not is_full(larger) or not grow
    assert larger.cov.shape[1] == PACKED
    for before, after in zip(smoothed(memory)[drop:], smoothed(larger), strict=True):
        np.testing.assert_allclose(before, after, atol=1e-12)


def test_a_state_is_recalled_as_it_was():
    mean, cov = random_state(np.random.default_rng(1))
    belief, memory = new_belief(True), new_memory(1)
    put(belief, 0, mean, cov)
    remember(belief, memory, 0, True, 0.0)
    again, again_cov = np.zeros(N), np.zeros((N, N))
    recall(memory, 0, again, again_cov)
    np.testing.assert_array_equal(again, mean)
    np.testing.assert_allclose(again_cov, cov, rtol=1e-12)
    assert belief.share.shape[1] == KEPT
    assert mean[K] > 0
