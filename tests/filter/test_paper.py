"""One step of the paper's filter is the textbook's sum over all pairs of hypotheses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracles import textbook
from scenes import context, grid_town, living, network, parallel_roads, straight_road
from strategies import seeds
from whichroad.filter.paper import observe_segment, switch, transition
from whichroad.filter.state import (
    NO_EDGE,
    Belief,
    Context,
    H,
    K,
    X,
    Y,
    new_belief,
    new_work,
    normalise,
)  # fmt: skip
from whichroad.graph.network import Roads

STAY, WIDTH, HEADING = 0.9, 3.5, 0.1

STREET, TWO, TOWN = (
    network(straight_road(100.0)),
    network(parallel_roads(12.0)),
    network(grid_town()),
)


def context_of(roads: Roads) -> Context:
    ctx = context(
        roads, paper_stay=STAY, paper_radius=30.0, paper_width=WIDTH, paper_heading_sigma=HEADING
    )
    return ctx._replace(work=new_work(paper=True))


def belief_of(poses, cov, weight, edges) -> Belief:
    """Hypotheses (x, y, heading) of one covariance, (3, 3)."""
    belief = new_belief()
    for i, (pose, w, edge) in enumerate(zip(poses, weight, edges, strict=True)):
        hyp = belief.hyp[i]
        hyp["mu"][[X, Y, H]] = pose
        hyp["mu"][K] = 1.0
        hyp["cov"][:3, :3] = cov
        hyp.log_weight, hyp.edge = np.log(w), edge
    belief.state[0].count, belief.state[0].scale = len(poses), 1.0
    normalise(belief)
    return belief


def random_cov(seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(3, 3)) * [[3.0], [3.0], [0.05]]
    return root @ root.T + np.diag([0.1, 0.1, 1e-4])


def see(belief: Belief, roads: Roads, edge: int, s: float = 0.0) -> float:
    return observe_segment(belief.hyp[0], context_of(roads), edge, s, 1.0)


def map_observation(roads: Roads, edge: int, pose) -> tuple[np.ndarray, np.ndarray]:
    """Y_carto and Q^carto (Figures 3 and 4) of an edge of one segment."""
    a, b = roads.vertices[roads.edges[edge].first_vertex :][:2]
    start = np.array([a.x, a.y])
    leg = np.array([b.x, b.y]) - start
    length, angle = np.hypot(*leg), math.atan2(leg[1], leg[0])
    part = np.clip((pose[:2] - start) @ leg / length**2, 0.0, 1.0)
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    q = np.diag([0.0, 0.0, HEADING**2])
    q[:2, :2] = turn @ np.diag([length**2, WIDTH**2]) @ turn.T
    return np.array([*(start + part * leg), angle]), q


def continued(roads: Roads, edge: int, pose, cov) -> tuple[np.ndarray, np.ndarray, float]:
    """A hypothesis after the map observation of an edge: mean, covariance, log-density."""
    y, q = map_observation(roads, edge, pose)
    nu = y - pose
    nu[2] = math.remainder(nu[2], 2 * math.pi)
    return textbook.condition(pose, cov, np.eye(3), nu, q)


# The map observation


@given(seeds, st.floats(-150, 250), st.floats(-60, 60), st.floats(-1.5, 1.5), st.integers(0, 1))
def test_a_segment_is_the_joint_update_with_the_ellipse_of_figure_4(seed, x, y, heading, edge):
    pose, cov = np.array([x, y, heading + edge * math.pi]), random_cov(seed)
    mean, after, log_density = continued(STREET, edge, pose, cov)
    belief = belief_of([pose], cov, [1.0], [edge])
    hyp = belief.hyp[0]
    assert see(belief, STREET, edge) == pytest.approx(log_density, rel=1e-9, abs=1e-9)
    np.testing.assert_allclose(hyp["mu"][:2], mean[:2], atol=1e-8)
    assert math.remainder(hyp["mu"][H] - mean[2], 2 * math.pi) == pytest.approx(0.0, abs=1e-8)
    np.testing.assert_allclose(hyp["cov"][:3, :3], after, atol=1e-9)


def test_inside_a_segment_the_position_along_it_stays_and_its_sigma_shrinks():
    belief = belief_of([(40.0, 5.0, 0.0)], np.diag([9.0, 9.0, 0.01]), [1.0], [0])
    see(belief, STREET, 0)
    assert belief.hyp["mu"][0, X] == 40.0
    assert belief.hyp["cov"][0, X, X] == pytest.approx(9.0 * 100.0**2 / (9.0 + 100.0**2))


def test_beyond_the_end_the_extremity_draws_back():
    belief = belief_of([(120.0, 0.0, 0.0)], np.diag([9.0, 9.0, 0.01]), [1.0], [0])
    see(belief, STREET, 0)
    assert 119.9 < belief.hyp["mu"][0, X] < 120.0


def test_of_a_bent_edge_only_the_closest_segment_is_observed():
    bent = network([[(0.0, 0.0), (50.0, 0.0), (50.0, 50.0)]])
    belief = belief_of([(51.0, 30.0, 0.5 * math.pi)], np.diag([9.0, 9.0, 0.01]), [1.0], [0])
    see(belief, bent, 0, 80.0)
    assert belief.hyp["mu"][0, Y] == pytest.approx(30.0)
    assert 50.0 < belief.hyp["mu"][0, X] < 51.0


# S_k


@given(st.integers(1, 40), st.integers(0, 39), st.booleans(), st.floats(0.01, 0.9999))
def test_the_rows_of_b_sum_to_one(count, i, held, stay):
    row = [transition(held and j == i % count, held, count, stay) for j in range(count)]
    assert sum(row) == pytest.approx(1.0)


@given(seeds, st.booleans(), st.integers(1, 4))
def test_a_step_is_the_sum_over_all_pairs_merged_by_moments(seed, town, n):
    roads = TOWN if town else TWO
    rng = np.random.default_rng(seed)
    middle = rng.uniform([20.0, 0.0, -math.pi], [400.0, 12.0, math.pi])
    poses = middle + rng.normal(size=(n, 3)) * [4.0, 4.0, 0.3]
    cov, weight = random_cov(seed), rng.dirichlet(np.full(n, 2.0))
    edges = rng.integers(0, 4, n)
    belief = belief_of(poses, cov, weight, edges)
    switch(belief, context_of(roads))
    after_step = living(belief)
    candidates = after_step.edge.tolist()
    if candidates == [NO_EDGE]:
        return
    count, total = len(candidates), np.zeros(len(candidates))
    for j, edge in enumerate(candidates):
        pairs = [continued(roads, edge, pose, cov) for pose in poses]
        chance = [
            1.0 / count if e not in candidates or count == 1
            else STAY if e == edge else (1.0 - STAY) / (count - 1)
            for e in edges
        ]  # fmt: skip
        w = weight * chance * np.exp([p[2] for p in pairs])
        total[j] = w.sum()
        if total[j] < 1e-200:
            continue
        means = np.array([p[0] for p in pairs])
        means[:, 2] = (
            means[0, 2] + np.remainder(means[:, 2] - means[0, 2] + np.pi, 2 * np.pi) - np.pi
        )
        mean, after = textbook.mixture_moments(w / w.sum(), means, np.array([p[1] for p in pairs]))
        if np.ptp(means[:, 2]) < 1.0:  # moments on a circle are those of a line when near
            np.testing.assert_allclose(after_step["mu"][j, :2], mean[:2], atol=1e-7)
            np.testing.assert_allclose(after_step["cov"][j, :3, :3], after, atol=1e-7)
    np.testing.assert_allclose(after_step.weight, total / total.sum(), atol=1e-9)


def test_candidates_that_were_none_before_have_equal_chances():
    belief = belief_of([(1000.0, 6.0, 0.0)], np.diag([9.0, 9.0, 0.01]), [1.0], [NO_EDGE])
    switch(belief, context_of(TWO))
    p = dict(zip(belief.hyp.edge[:4].tolist(), belief.hyp.weight[:4], strict=True))
    assert p[0] == pytest.approx(p[2])
    assert p[0] + p[2] == pytest.approx(1.0)  # the way back would be a turn by 180 degrees


def test_where_no_segment_is_near_the_most_probable_goes_on_alone():
    poses = [(1000.0, 60.0, 0.0), (1000.0, 5.0, 0.0)]
    belief = belief_of(poses, np.diag([9.0, 9.0, 0.01]), [0.7, 0.3], [2, 0])
    switch(belief, context_of(TWO))
    assert belief.state[0].count == 1
    assert belief.hyp.edge[0] == NO_EDGE
    assert belief.hyp.weight[0] == 1.0
    np.testing.assert_array_equal(belief.hyp["mu"][0, :3], poses[0])


def test_cutting_a_road_into_ten_pieces_makes_it_ten_times_as_likely():
    roads = network([*straight_road(1000.0), [(x, 12.0) for x in np.linspace(0.0, 1000.0, 11)]])
    belief = belief_of([(550.0, 6.0, 0.0)], np.diag([1.0, 1.0, 0.01]), [1.0], [NO_EDGE])
    switch(belief, context_of(roads))
    p = dict(zip(belief.hyp.edge[:4].tolist(), belief.hyp.weight[:4], strict=True))
    assert p[2] / p[0] == pytest.approx(10.0, rel=1e-3)
