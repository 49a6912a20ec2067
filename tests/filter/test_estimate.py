"""The estimate of an epoch describes the mixture that the filter holds."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from oracles import textbook
from scenes import context, living, network, straight_road
from strategies import random_gaussian, seeds
from whichroad._compile import Record
from whichroad.filter.state import MX, MY, OFF_ROAD, Belief, H, N, X, Y, new_belief
from whichroad.filter.summary.estimate import new_output, summarise
from whichroad.graph.geometry import wrap

ROAD = network(straight_road())
HH = 5  # the heading's variance in `cov`


def mixture(seed: int, n: int, apart: float = 1.0) -> Belief:
    """Random Gaussians off the roads, their places `apart` times as far from each other."""
    rng = np.random.default_rng(seed)
    belief = new_belief()
    for i in range(n):
        belief.hyp["mu"][i], belief.hyp["cov"][i] = random_gaussian(rng)
        belief.hyp["mu"][i, [X, Y]] *= apart
    weight = rng.dirichlet(np.full(n, 0.5)) + 1e-12
    belief.hyp.edge[:n] = OFF_ROAD
    belief.state[0].count, belief.state[0].scale = n, 1.0
    weigh(belief, weight / weight.sum())
    return belief


def weigh(belief: Belief, weight: object) -> None:
    """Set normalised weights."""
    alive = living(belief)
    alive.weight = weight
    alive.log_weight = np.log(alive.weight)


def estimate(belief: Belief, risk: float = 1e-3, scale: float = 1.0) -> Record:
    """The estimate of one epoch."""
    output = new_output(1, False)
    belief.state[0].scale = scale
    summarise(belief, context(ROAD, protection_risk=risk), output, 0, 0.0)
    return output.rows[0]


def moments(belief: Belief, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of linear functions of the state, under the mixture."""
    alive = living(belief)
    cov = np.array([rows @ c @ rows.T for c in alive["cov"]])
    return textbook.mixture_moments(alive.weight, alive["mu"] @ rows.T, cov)


@given(seeds, st.integers(1, 12), st.floats(0.0, 20.0))
def test_both_places_have_the_moments_of_the_whole_mixture(seed, n, apart):
    """In the world, p, and in the map's frame, p + m."""
    belief = mixture(seed, n, apart)
    value = estimate(belief)
    rows = np.zeros((2, N))
    rows[0, X] = rows[1, Y] = 1.0
    for found, extra in (
        ([value.x, value.y, *value["cov"][[0, 1, 3]]], 0.0),
        ([value.map_x, value.map_y, *value.map_cov], 1.0),
    ):
        rows[0, MX] = rows[1, MY] = extra
        mean, cov = moments(belief, rows)
        expected = [*mean, cov[0, 0], cov[0, 1], cov[1, 1]]
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-8)


@given(seeds, st.integers(1, 8), st.floats(0.999, 1.001))
def test_the_plane_s_scale_stretches_the_places_and_not_their_covariances(seed, n, scale):
    flat, stretched = mixture(seed, n), mixture(seed, n)
    stretched.hyp["mu"][:n, [X, Y]] *= scale
    one, other = estimate(flat), estimate(stretched, scale=scale)
    for name in ("x", "y", "map_x", "map_y"):
        assert other[name] == pytest.approx(scale * one[name], abs=1e-9)
    for name in ("cov", "map_cov", "protection_level", "level_along", "level_across", "heading"):
        rtol = 1e-6 if name.startswith("level") else 1e-9  # floats of 32 bits
        np.testing.assert_allclose(other[name], one[name], rtol=rtol, atol=1e-9)


@given(seeds, st.integers(1, 8), st.floats(-math.pi, math.pi))
def test_turning_all_headings_turns_the_estimate(seed, n, angle):
    """Also where some are opposed, unless they cancel."""
    belief = mixture(seed, n)
    p, headings = living(belief).weight, living(belief)["mu"][:, H]
    assume(abs(p @ np.exp(1j * headings)) > 1e-3)
    before = estimate(belief)
    belief.hyp["mu"][:n, H] = [wrap(h + angle) for h in headings]
    after = estimate(belief)
    assert wrap(after.heading - before.heading - angle) == pytest.approx(0.0, abs=1e-9)
    assert after["cov"][HH] == pytest.approx(before["cov"][HH], rel=1e-9)


@given(seeds, st.integers(1, 8))
def test_headings_within_a_radian_have_the_moments_of_the_mixture(seed, n):
    belief = mixture(seed, n)
    belief.hyp["mu"][:n, H] = np.random.default_rng(seed).uniform(-0.5, 0.5, n)
    row = np.zeros((1, N))
    row[0, H] = 1.0
    mean, cov = moments(belief, row)
    value = estimate(belief)
    assert value.heading == pytest.approx(mean[0], abs=1e-12)
    assert value["cov"][HH] == pytest.approx(cov[0, 0])


@given(seeds, st.integers(1, 12), st.floats(0.0, 20.0), st.sampled_from([0.3, 0.05, 0.01]))
def test_the_protection_level_bounds_the_error_at_its_risk(seed, n, apart, risk):
    """20,000 draws of the mixture; six standard errors of their share, so as never to fail."""
    belief = mixture(seed, n, apart)
    value = estimate(belief, risk)
    rng = np.random.default_rng(seed)
    beyond, draws = 0, 20_000
    alive = living(belief)
    for hyp, count in zip(alive, rng.multinomial(draws, alive.weight), strict=True):
        place = rng.multivariate_normal(hyp["mu"][:2], hyp["cov"][:2, :2], count)
        beyond += (np.hypot(*(place - [value.x, value.y]).T) > value.protection_level).sum()
    assert beyond / draws <= risk + 6.0 * math.sqrt(risk / draws)


@given(seeds, st.integers(1, 12), st.floats(0.0, 20.0), st.sampled_from([0.3, 0.05, 0.01]))
def test_the_levels_along_and_across_bound_the_error_in_their_direction(seed, n, apart, risk):
    belief = mixture(seed, n, apart)
    value = estimate(belief, risk)
    rng = np.random.default_rng(seed)
    beyond, draws = np.zeros(2), 20_000
    c, s = math.cos(value.heading), math.sin(value.heading)
    alive = living(belief)
    for hyp, count in zip(alive, rng.multinomial(draws, alive.weight), strict=True):
        place = rng.multivariate_normal(hyp["mu"][:2], hyp["cov"][:2, :2], count)
        away = (place - [value.x, value.y]) @ [[c, -s], [s, c]]
        beyond += (np.abs(away) > [value.level_along, value.level_across]).sum(axis=0)
    assert (beyond / draws <= risk + 6.0 * math.sqrt(risk / draws)).all()


@given(seeds, st.floats(1e-7, 0.3))
def test_of_a_single_gaussian_the_levels_are_those_of_its_sigmas_in_their_direction(seed, risk):
    belief = mixture(seed, 1)
    value = estimate(belief, risk)
    heading = np.array([math.cos(value.heading), math.sin(value.heading)])
    for level, e in (
        (value.level_along, heading), (value.level_across, np.array([-heading[1], heading[0]])),
    ):  # fmt: skip
        sigma = math.sqrt(e @ belief.hyp["cov"][0, :2, :2] @ e)
        assert level == pytest.approx(sigma * math.sqrt(-2.0 * math.log(risk)), rel=1e-6)


@given(seeds, st.floats(1e-7, 0.3))
def test_of_a_single_gaussian_the_protection_level_is_that_of_its_longer_axis(seed, risk):
    """A circle's exact radius, sigma sqrt(-2 log risk), is at least that of any ellipse in it."""
    belief = mixture(seed, 1)
    major = math.sqrt(np.linalg.eigvalsh(belief.hyp["cov"][0, :2, :2])[-1])
    exact = major * math.sqrt(-2.0 * math.log(risk))
    assert estimate(belief, risk).protection_level == pytest.approx(exact, rel=1e-9)


@given(seeds, st.integers(1, 12), st.floats(0.0, 20.0))
def test_less_risk_asks_for_more_room(seed, n, apart):
    belief = mixture(seed, n, apart)
    levels = [estimate(belief, risk).protection_level for risk in (0.1, 1e-2, 1e-4, 1e-7)]
    assert (np.diff(levels) > 0.0).all()


def test_two_places_far_apart_are_both_protected_against():
    """The lighter place, of more than the risk, lies inside; one of less need not."""
    belief = mixture(0, 2)
    belief.hyp["cov"][:2, :2, :2] = np.eye(2)
    belief.hyp["mu"][:2, :2] = [[0.0, 0.0], [300.0, 0.0]]
    for light, inside in ((0.01, True), (1e-5, False)):
        weigh(belief, [1.0 - light, light])
        value = estimate(belief)
        assert (value.protection_level > 300.0 - value.x) == inside


@given(st.floats(1.0, 400.0))
def test_the_gnss_scale_is_the_root_of_the_factor_on_variances(factor):
    belief = mixture(0, 1)
    belief.state[0].gnss_factor = factor
    assert estimate(belief).gnss_scale == pytest.approx(math.sqrt(factor))
