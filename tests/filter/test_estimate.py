"""What is said of an epoch is true of the mixture that is believed."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from whichroad.core.angles import wrap
from whichroad.core.belief import GNSS_SCALE, MX, MY, OFF_ROAD, Belief, H, X, Y, new_belief
from whichroad.core.output import (
    V_GNSS_SCALE,
    V_H,
    V_HH,
    V_MAP_X,
    V_MAP_XX,
    V_MAP_XY,
    V_MAP_Y,
    V_MAP_YY,
    V_PROTECTION,
    V_X,
    V_XX,
    V_XY,
    V_Y,
    V_YY,
    new_output,
    say,
)

from oracles import textbook
from scenes import call, network, straight_road
from strategies import random_gaussian, seeds

ROAD = network(straight_road())


def mixture(seed: int, n: int, apart: float = 1.0) -> Belief:
    """Random Gaussians off the roads, their places `apart` times as far from each other."""
    rng = np.random.default_rng(seed)
    belief = new_belief()
    for i in range(n):
        belief.mean[i], belief.cov[i] = random_gaussian(rng)
        belief.mean[i, [X, Y]] *= apart
    weight = rng.dirichlet(np.full(n, 0.5)) + 1e-12
    belief.probability[:n] = weight / weight.sum()
    belief.log_weight[:n] = np.log(belief.probability[:n])
    belief.edge[:n] = OFF_ROAD
    belief.size[0] = n
    return belief


def said(belief: Belief, risk: float = 1e-3, scale: float = 1.0) -> np.ndarray:
    """The values that are written for one epoch."""
    output = new_output(1, False)
    call(
        say, belief=belief, roads=ROAD, output=output, k=0, outage_after=3.0, ambiguous_below=0.95,
        risk=risk, chi2=0.0, scale=scale,
    )  # fmt: skip
    return output.value[0]


def moments(belief: Belief, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of linear functions of the state, under the mixture."""
    n = belief.size[0]
    cov = np.array([rows @ c @ rows.T for c in belief.cov[:n]])
    return textbook.mixture_moments(belief.probability[:n], belief.mean[:n] @ rows.T, cov)


@given(seeds, st.integers(1, 12), st.floats(0.0, 20.0))
def test_both_places_have_the_moments_of_the_whole_mixture(seed, n, apart):
    """In the world, p, and in the map's frame, p + m."""
    belief = mixture(seed, n, apart)
    value = said(belief)
    rows = np.zeros((2, 10))
    rows[0, X] = rows[1, Y] = 1.0
    for named, extra in (
        ([V_X, V_Y, V_XX, V_XY, V_YY], 0.0),
        ([V_MAP_X, V_MAP_Y, V_MAP_XX, V_MAP_XY, V_MAP_YY], 1.0),
    ):
        rows[0, MX] = rows[1, MY] = extra
        mean, cov = moments(belief, rows)
        expected = [*mean, cov[0, 0], cov[0, 1], cov[1, 1]]
        np.testing.assert_allclose(value[named], expected, rtol=1e-9, atol=1e-8)


@given(seeds, st.integers(1, 8), st.floats(0.999, 1.001))
def test_the_plane_s_scale_stretches_the_places_and_not_their_covariances(seed, n, scale):
    flat, stretched = mixture(seed, n), mixture(seed, n)
    stretched.mean[:n, [X, Y]] *= scale
    one, other = said(flat), said(stretched, scale=scale)
    for v in (V_X, V_Y, V_MAP_X, V_MAP_Y):
        assert other[v] == pytest.approx(scale * one[v], abs=1e-9)
    same = [V_XX, V_XY, V_YY, V_MAP_XX, V_MAP_XY, V_MAP_YY, V_PROTECTION, V_H]
    np.testing.assert_allclose(other[same], one[same], rtol=1e-9, atol=1e-9)


@given(seeds, st.integers(1, 8), st.floats(-math.pi, math.pi))
def test_turning_all_headings_turns_the_one_that_is_said(seed, n, angle):
    """Also where some are opposed, unless they cancel."""
    belief = mixture(seed, n)
    p, headings = belief.probability[:n], belief.mean[:n, H]
    assume(abs(p @ np.exp(1j * headings)) > 1e-3)
    before = said(belief)
    belief.mean[:n, H] = [wrap(h + angle) for h in headings]
    after = said(belief)
    assert wrap(after[V_H] - before[V_H] - angle) == pytest.approx(0.0, abs=1e-9)
    assert after[V_HH] == pytest.approx(before[V_HH], rel=1e-9)


@given(seeds, st.integers(1, 8))
def test_headings_within_a_radian_have_the_moments_of_the_mixture(seed, n):
    belief = mixture(seed, n)
    belief.mean[:n, H] = np.random.default_rng(seed).uniform(-0.5, 0.5, n)
    row = np.zeros((1, 10))
    row[0, H] = 1.0
    mean, cov = moments(belief, row)
    value = said(belief)
    assert value[V_H] == pytest.approx(mean[0], abs=1e-12)
    assert value[V_HH] == pytest.approx(cov[0, 0])


@given(seeds, st.integers(1, 12), st.floats(0.0, 20.0), st.sampled_from([0.3, 0.05, 0.01]))
def test_the_protection_level_bounds_the_error_at_its_risk(seed, n, apart, risk):
    """20,000 draws of the mixture; six standard errors of their share, so as never to fail."""
    belief = mixture(seed, n, apart)
    value = said(belief, risk)
    rng = np.random.default_rng(seed)
    beyond, draws = 0, 20_000
    for i, count in enumerate(rng.multinomial(draws, belief.probability[:n])):
        place = rng.multivariate_normal(belief.mean[i, :2], belief.cov[i, :2, :2], count)
        beyond += (np.hypot(*(place - value[[V_X, V_Y]]).T) > value[V_PROTECTION]).sum()
    assert beyond / draws <= risk + 6.0 * math.sqrt(risk / draws)


@given(seeds, st.floats(1e-7, 0.3))
def test_of_a_single_gaussian_the_protection_level_is_that_of_its_longer_axis(seed, risk):
    """A circle's exact radius, sigma sqrt(-2 log risk), is at least that of any ellipse in it."""
    belief = mixture(seed, 1)
    major = math.sqrt(np.linalg.eigvalsh(belief.cov[0, :2, :2])[-1])
    exact = major * math.sqrt(-2.0 * math.log(risk))
    assert said(belief, risk)[V_PROTECTION] == pytest.approx(exact, rel=1e-9)


@given(seeds, st.integers(1, 12), st.floats(0.0, 20.0))
def test_less_risk_asks_for_more_room(seed, n, apart):
    belief = mixture(seed, n, apart)
    levels = [said(belief, risk)[V_PROTECTION] for risk in (0.1, 1e-2, 1e-4, 1e-7)]
    assert (np.diff(levels) > 0.0).all()


def test_two_places_far_apart_are_both_protected_against():
    """The lighter place, of more than the risk, lies inside; one of less need not."""
    belief = mixture(0, 2)
    belief.cov[:2, :2, :2] = np.eye(2)
    belief.mean[:2, :2] = [[0.0, 0.0], [300.0, 0.0]]
    for light, inside in ((0.01, True), (1e-5, False)):
        belief.probability[:2] = 1.0 - light, light
        belief.log_weight[:2] = np.log(belief.probability[:2])
        value = said(belief)
        assert (value[V_PROTECTION] > 300.0 - value[V_X]) == inside


@given(st.floats(1.0, 400.0))
def test_the_scale_of_fixes_is_said_of_their_sigmas(factor):
    belief = mixture(0, 1)
    belief.clock[GNSS_SCALE] = factor
    assert said(belief)[V_GNSS_SCALE] == pytest.approx(math.sqrt(factor))
