"""Smoothing over the graph of hypotheses, against every chain counted one by one."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracles.chains import all_chains, random_history, shares_of
from scenes import context, network
from strategies import seeds
from whichroad._compile import Record, Records
from whichroad.filter.hypotheses.lane_offset import redraw_lane
from whichroad.filter.hypotheses.reduction import reduce
from whichroad.filter.lookback.best_path import best_path, edge_probability
from whichroad.filter.lookback.history import (
    PACKED,
    History,
    accumulate_motion,
    accumulate_noise,
    enlarged,
    is_full,
    load,
    new_history,
    store,
)  # fmt: skip
from whichroad.filter.lookback.link_motion import LINK_MODEL, inflate_strange, predict_link
from whichroad.filter.lookback.link_road import Link
from whichroad.filter.lookback.smoother import begin, new_buffers, solve_gain, step_back
from whichroad.filter.motion import arc_chord, increment_of, predict_plane, wheel_noise
from whichroad.filter.state import (
    KEPT,
    WHEELS,
    B,
    Belief,
    Context,
    D,
    H,
    K,
    N,
    X,
    Y,
    new_belief,
    new_epochs,
    new_path,
)  # fmt: skip
from whichroad.filter.vetting.windows import BY_GYRO, BY_WHEELS
from whichroad.graph.geometry import wrap
from whichroad.graph.network import records
from whichroad.settings import Settings

CTX = context(network([[[0.0, 0.0], [5000.0, 0.0]]]), prune=1e-4, merge=0.05, components=2)
NO_PATH = new_path(1)


def smoothed(history: History) -> list[np.ndarray]:
    """Smoothed probabilities of each step's nodes."""
    buffers, slot = new_buffers(), 0
    last = int(history.count[0].steps) - 1
    begin(buffers, history, last, slot)
    found = [buffers.nodes[slot].p[: len(nodes_of(history, last))].copy()]
    for step in range(last, 0, -1):
        step_back(buffers, history, NO_PATH, CTX, step, slot, False)
        slot = 1 - slot
        found.insert(0, buffers.nodes[slot].p[: len(nodes_of(history, step - 1))].copy())
    return found


def nodes_of(history: History, step: int) -> Records:
    return history.nodes[history.steps[step].first_node : history.steps[step].end_node]


@given(seeds)
def test_smoothed_probabilities_are_sums_over_all_chains(seed: int):
    history = random_history(seed)
    chains = all_chains(history)
    for t, p in enumerate(smoothed(history)):
        first = int(history.steps[t].first_node)
        exact = np.bincount(chains.nodes[:, t] - first, chains.p, len(p))
        np.testing.assert_allclose(p, exact, atol=1e-6)
        assert p.sum() == pytest.approx(1.0, abs=1e-9)


@given(seeds)
def test_the_last_step_is_as_filtered(seed: int):
    history = random_history(seed)
    last = nodes_of(history, int(history.count[0].steps) - 1)
    np.testing.assert_array_equal(smoothed(history)[-1], last.p)


@given(seeds)
def test_what_no_link_accounts_for_stays_as_filtered(seed: int):
    history = random_history(seed)
    cut = int(history.count[0].steps) // 2  # the filter starts anew there
    for node in nodes_of(history, cut):
        history.links.share[node.first_link : node.end_link] = 0.0
    before = nodes_of(history, cut - 1)
    np.testing.assert_allclose(smoothed(history)[cut - 1], before.p, atol=1e-9)


def path_of(history: History) -> np.ndarray:
    steps, nodes, _ = history.count[0].tolist()
    p, score = np.zeros((2, nodes))
    path = np.zeros(steps, np.int64)
    edge_probability(history, p)
    best_path(history, np.ones(steps), p, score, np.zeros(nodes, np.int64), path)
    return path


@given(seeds)
def test_the_best_path_has_the_most_right_edges_of_all_linked_chains(seed: int):
    history = random_history(seed)
    for t, p in enumerate(smoothed(history)):
        nodes_of(history, t).smoothed = p
    chains = all_chains(history)
    total = np.zeros(int(history.count[0].nodes))
    edge_probability(history, total)
    nodes = chains.nodes
    linked = (shares_of(history)[nodes[:, 1:], nodes[:, :-1]] >= 1e-3).all(axis=1)
    path = path_of(history)
    assert total[path].sum() == pytest.approx(total[nodes[linked]].sum(axis=1).max())


def random_state(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A state on the road, and a covariance with correlations."""
    sigma = np.array([3.0, 3.0, 0.05, 0.01, 3e-4, 1.0, 2.0, 2.0, 0.8, 0.8, 0.0, 0.0])
    root = rng.normal(size=(N, N)) / np.sqrt(N) + np.eye(N)
    mean = np.zeros(N)
    mean[:10] = 900.0, -1.5, rng.uniform(-1.0, 1.0), 1.01, 2e-4, 1.5, 1.0, -1.0, 0.3, -0.4
    return mean, root @ root.T * np.outer(sigma, sigma)


def sigmas(cov: np.ndarray) -> np.ndarray:
    """Roots of the variances; 1 of states without variance."""
    variance = np.diag(cov)
    return np.sqrt(np.where(variance > 0.0, variance, 1.0))


def put(belief: Belief, i: int, mean: np.ndarray, cov: np.ndarray, edge: int = 0) -> None:
    hyp = belief.hyp[i]
    hyp["mu"], hyp["cov"], hyp.edge = mean, cov, edge
    hyp.along, hyp.weight, hyp.log_weight = mean[X], 1.0, 0.0
    belief.state[0].count = max(belief.state[0].count, i + 1)
    belief.state[0].scale = 1.0


def link_model(history: History, mean: np.ndarray, cov: np.ndarray, ctx: Context = CTX) -> Record:
    """The process model of the link from node 0 of step 0 to node 1 of step 1."""
    model = new_buffers().model[0]
    model.then_mean, model.then_cov, model.scale = mean, cov, 1.0
    predict_link(model, history, NO_PATH, ctx, Link(1, 0, 1))
    return model


@pytest.mark.parametrize("gyro", [BY_WHEELS, BY_GYRO])
@given(seeds)
def test_the_motion_of_a_link_is_that_of_the_filter_over_its_epochs(gyro: int, seed: int):
    """Many small movements at once, by the equations of each, to second order in their noise."""
    rng = np.random.default_rng(seed)
    mean, cov = random_state(rng)
    belief, history, epochs = new_belief(True), new_history(4), new_epochs(8)
    put(belief, 0, mean, cov)
    store(belief, history, 0, True, 0.0)
    belief.state[0].time = 1.0
    hyp = belief.hyp[0]
    for epoch in epochs:
        epoch.arc, epoch.turn = rng.uniform(0.0, 1.5), rng.normal(0.0, 0.05)
        epoch.forward, epoch.left = arc_chord(epoch.arc, epoch.turn)
        epoch.gyro = gyro
        move = increment_of(epoch, 1, 0.1)
        noise = wheel_noise(CTX.par[0], epoch.arc, epoch.turn)
        accumulate_motion(history, epoch, 0.1, 10.0, WHEELS)
        accumulate_noise(history, move, noise)
        predict_plane(hyp["mu"], hyp["cov"], move, 1.0, noise)
    store(belief, history, 7, True, 0.0)
    model = link_model(history, mean, cov)
    sigma = sigmas(hyp["cov"])
    off = model["mu"] - hyp["mu"]
    off[H] = wrap(off[H])
    np.testing.assert_allclose(off / sigma, 0.0, atol=2e-3)
    square = np.outer(sigma, sigma)
    np.testing.assert_allclose(model["cov"] / square, hyp["cov"] / square, atol=1e-2)


@pytest.mark.parametrize("turn", [0.0, 0.15, -0.22, 0.25, -0.29, 0.4, 1.6])
def test_the_lane_of_a_link_to_another_road_is_kept_as_far_as_the_filter_keeps_it(turn: float):
    far = [100.0 + 100.0 * math.cos(turn), 100.0 * math.sin(turn)]
    roads = network([[[0.0, 0.0], [100.0, 0.0]], [[100.0, 0.0], far]])
    mean, cov = random_state(np.random.default_rng(0))
    belief, history, epochs = new_belief(True), new_history(4), new_epochs(1)
    put(belief, 0, mean, cov)
    store(belief, history, 0, True, 0.0)
    accumulate_motion(history, epochs[0], 0.5, 10.0, WHEELS)
    redraw_lane(belief.hyp["mu"][0], belief.hyp["cov"][0], turn, 1.75, 1.75, Settings().lane_sigma)
    belief.hyp.edge[0] = 2
    store(belief, history, 0, True, 0.0)
    model = link_model(history, mean, cov, context(roads))
    assert model.mu[D] == pytest.approx(belief.hyp["mu"][0, D])
    assert model["cov"][D, D] == pytest.approx(belief.hyp["cov"][0, D, D])


@given(seeds, st.booleans())
def test_the_gain_is_that_of_the_normal_equations(seed: int, silent: bool):
    rng = np.random.default_rng(seed)
    _, cov = random_state(rng)
    model = new_buffers().model[0]
    model["cov"] = cov
    model["cross"] = cov @ rng.normal(size=(N, N))  # in the span of what varies
    if silent:  # a state that nobody uses
        for a in (B, D):
            model["cov"][a], model["cov"][:, a], model["cross"][a] = 0.0, 0.0, 0.0
    solve_gain(model)
    sigma = sigmas(model["cov"])
    scaled = model["cov"] / np.outer(sigma, sigma)
    expected = model["cross"].T / sigma @ np.linalg.pinv(scaled, hermitian=True) / sigma
    np.testing.assert_allclose(
        model["gain"].T * sigma, expected * sigma, atol=1e-6 * np.abs(expected * sigma).max()
    )


@given(seeds)
def test_one_link_is_smoothed_as_the_textbook_does(seed: int):
    rng = np.random.default_rng(seed)
    mean, cov = random_state(rng)
    belief, history, epochs = new_belief(True), new_history(4), new_epochs(1)
    put(belief, 0, mean, cov)
    store(belief, history, 0, True, 0.0)
    epochs.arc[0] = epochs.forward[0] = 5.0
    accumulate_motion(history, epochs[0], 0.5, 10.0, WHEELS)
    accumulate_noise(history, increment_of(epochs[0], 1, 0.5), wheel_noise(CTX.par[0], 5.0, 0.0))
    hyp = belief.hyp[0]
    hyp["mu"][X] += 5.0 * np.cos(mean[H])
    hyp["mu"][Y] += 5.0 * np.sin(mean[H])
    hyp["mu"] += 0.5 * np.sqrt(np.diag(cov)) * rng.normal(size=N)  # an observation
    hyp["cov"] *= 0.4
    store(belief, history, 0, True, 0.0)
    model = link_model(history, mean, cov)
    gain = model.cross.T @ np.linalg.pinv(model["cov"], hermitian=True)
    off = history.states["mu"][1] - model["mu"]
    off[H] = wrap(off[H])
    buffers = new_buffers()
    begin(buffers, history, 1, 0)
    step_back(buffers, history, NO_PATH, CTX, 1, 0, True)
    sigma = sigmas(cov)
    node = buffers.nodes[1, 0]
    np.testing.assert_allclose((node["mu"] - mean - gain @ off) / sigma, 0.0, atol=1e-5)
    exact = cov + gain @ (hyp["cov"] - model["cov"]) @ gain.T
    square = np.outer(sigma, sigma)
    np.testing.assert_allclose(node["cov"] / square, exact / square, atol=1e-5)


def test_a_merged_hypothesis_has_links_to_both_of_its_origins():
    rng = np.random.default_rng(3)
    belief, history = new_belief(True), new_history(4)
    mean, cov = random_state(rng)
    for i, p in enumerate((0.5, 0.3, 0.2)):
        put(belief, i, mean, cov, edge=i % 2)
        belief.hyp.weight[i], belief.hyp.log_weight[i] = p, np.log(p)
    store(belief, history, 0, True, 0.0)
    assert belief.state[0].parents == 3
    reduce(belief, new_path(100), CTX)
    belief.state[0].time = 1.0
    store(belief, history, 1, True, 0.0)
    assert len(nodes_of(history, 1)) == 2
    links = {
        (int(node.edge), int(link.origin)): float(link.share)
        for node in nodes_of(history, 1)
        for link in history.links[node.first_link : node.end_link]
    }
    assert links == pytest.approx({(0, 0): 5 / 7, (0, 2): 2 / 7, (1, 1): 1.0})


@given(seeds, st.integers(0, 4), st.booleans())
def test_a_larger_history_holds_the_same(seed: int, drop: int, grow: bool):
    history = random_history(seed)
    history.states["mu"], history.states["cov"] = 1.5, 2.5
    larger = enlarged(history, drop, grow=grow)
    steps, nodes, links = larger.count[0].tolist()
    first = int(history.steps[drop].first_node)
    assert steps == history.count[0].steps - drop
    before = history.steps[drop : history.count[0].steps]
    np.testing.assert_array_equal(larger.steps.time[:steps], before.time)
    np.testing.assert_array_equal(
        larger.nodes.p[:nodes], history.nodes.p[first : history.count[0].nodes]
    )
    assert larger.steps[steps - 1].end_node == nodes
    assert larger.nodes[nodes - 1].end_link == links
    assert not is_full(larger) or not grow
    assert larger.states["cov"].shape[1] == PACKED
    for p, again in zip(smoothed(history)[drop:], smoothed(larger), strict=True):
        np.testing.assert_allclose(p, again, atol=1e-12)


def test_a_stored_state_is_loaded_as_it_was():
    mean, cov = random_state(np.random.default_rng(1))
    belief, history = new_belief(True), new_history(1)
    put(belief, 0, mean, cov)
    store(belief, history, 0, True, 0.0)
    again, again_cov = np.zeros(N), np.zeros((N, N))
    load(history, 0, again, again_cov)
    np.testing.assert_array_equal(again, mean)
    np.testing.assert_allclose(again_cov, cov, rtol=1e-12)
    assert belief.lineage.shape[1] == KEPT
    assert mean[K] > 0


@pytest.mark.parametrize("away", [50.0, 1e4, 1e7])
def test_a_gain_above_one_does_not_let_what_nothing_predicted_grow(away: float):
    model = records(1, LINK_MODEL)[0]
    model.scale = 1.0
    model.f[:] = np.eye(N)
    model.f[:2, :2] = [[0.0, 1.0], [-1.0, 0.0]]  # round a corner; the speed tells more across it
    model.f[X, K], model.f[K, K] = -4.5, 0.8
    model.then_cov[:] = np.eye(N)
    model.then_cov[X, X], model.then_cov[Y, Y], model.then_cov[K, K] = 4600.0, 25.0, 21.8
    model.then_cov[X, K] = model.then_cov[K, X] = -220.0
    model.then_cov[X, Y] = model.then_cov[Y, X] = 64.0
    model.cross[:] = model.f @ model.then_cov
    model.cov[:] = model.cross @ model.f.T + np.diag([80.0, 1.4e5, 0.03, 9.0] + [0.1] * (N - 4))
    later = np.zeros(N)
    later[X] = away
    solve_gain(model)
    grown = float(np.abs(np.array(model.gain).T @ later)[X])
    inflate_strange(model, later)
    solve_gain(model)
    moved = float(np.abs(np.array(model.gain).T @ later)[X])
    sigma = math.sqrt(4600.0)
    assert moved < 4.0 * sigma
    assert grown > away
    assert away < 1e3 or moved < 1e-2 * grown
