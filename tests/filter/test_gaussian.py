"""Conditioning, truncating and merging Gaussians, against matrices, SciPy and long decimals."""

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import stats

from oracles import textbook
from strategies import UNITS, Gaussian, gaussians, random_gaussian, seeds
from whichroad.filter.gaussian import (
    condition,
    merge_moments,
    normal_cdf,
    reshape_along,
    reshape_on_map,
    truncated_moments,
    update,
    update_across,
    update_across_in_part,
    update_pair,
    update_state,
    update_state_in_part,
)
from whichroad.filter.state import MX, MY, D, H, N, X, Y

TWO_PI = Decimal("6.28318530717958647692528676655900576839433879875021164194989")


def random_rows(rng: np.random.Generator, k: int) -> np.ndarray:
    return rng.normal(size=(k, N)) / UNITS * (rng.random((k, N)) < 0.5)


def apply(g: Gaussian, rows: np.ndarray, z: np.ndarray, noise: np.ndarray) -> float:
    """Condition on the rows one by one; z is what they observe of the state itself."""
    return sum(
        condition(g.mean, g.cov, row, value - row @ g.mean, variance, 1.0)
        for row, value, variance in zip(rows, z, noise, strict=True)
    )


def assert_same(a: Gaussian, b: Gaussian) -> None:
    """Equal up to rounding, in units of each state."""
    np.testing.assert_allclose(a.mean / UNITS, b.mean / UNITS, atol=1e-9)
    square = np.outer(UNITS, UNITS)
    np.testing.assert_allclose(a.cov / square, b.cov / square, atol=1e-9)


@given(seeds)
def test_rows_one_by_one_are_the_joint_update_of_the_textbook(seed: int):
    rng = np.random.default_rng(seed)
    g = random_gaussian(rng)
    rows, noise = random_rows(rng, 4), rng.uniform(0.01, 4.0, 4)
    innovation = rng.normal(size=4) * 2.0
    mean, cov, log_density = textbook.condition(*g, rows, innovation, np.diag(noise))
    ours = apply(g, rows, innovation + rows @ g.mean, noise)
    assert_same(g, Gaussian(mean, cov))
    assert ours == pytest.approx(log_density, abs=1e-8)


@given(seeds)
def test_two_rows_at_once_are_as_one_after_the_other(seed: int):
    rng = np.random.default_rng(seed)
    a = random_gaussian(rng)
    b = a.copy()
    (h, k), z, (r, q) = random_rows(rng, 2), rng.normal(size=2), rng.uniform(0.01, 4.0, 2)
    first, second = b.cov @ h, b.cov @ k
    s, both = h @ first + r, k @ first
    nu, mu = z - (h @ b.mean, k @ b.mean)
    second -= both / s * first
    t = k @ b.cov @ k + q - both**2 / s
    mu -= both / s * nu
    update_pair(b.mean, b.cov, first, second, (nu / s, mu / t), (s, t), 1.0)
    apply(a, np.array([h, k]), z, np.array([r, q]))
    assert_same(a, b)


def on_map(tx: float, ty: float, lane: float = 0.0) -> np.ndarray:
    """The row t · (p + m) + lane · d."""
    row = np.zeros(N)
    row[[X, MX]], row[[Y, MY]], row[D] = tx, ty, lane
    return row


@given(seeds)
def test_a_place_across_a_road_is_seen_as_by_its_row(seed: int):
    rng = np.random.default_rng(seed)
    a = random_gaussian(rng)
    b = a.copy()
    (nx, ny), nu, r = rng.normal(size=2), rng.normal(), rng.uniform(0.01, 4.0)
    s = update(a.mean, a.cov, on_map(nx, ny, -1.0), nu, r, 1.1)
    assert update_across(b.mean, b.cov, nx, ny, nu, r, 1.1) == pytest.approx(s, rel=1e-9)
    assert_same(a, b)


@given(seeds, st.floats(0.0, 1.0))
def test_a_row_that_holds_in_part_leaves_the_moments_of_both_cases(seed: int, share: float):
    rng = np.random.default_rng(seed)
    before = random_gaussian(rng)
    (nx, ny), r = rng.normal(size=2), rng.uniform(0.01, 4.0)
    for row in (on_map(nx, ny, -1.0), np.eye(N)[H]):
        nu = rng.uniform(-2.9, 2.9) * math.sqrt(row @ before.cov @ row + r)
        with_it, a, b = before.copy(), before.copy(), before.copy()
        update(with_it.mean, with_it.cov, row, nu, r, 1.1)
        merge_moments(a.mean, a.cov, with_it.mean, with_it.cov, 1.0 - share, 1.1)
        if row[H] == 1.0:
            update_state_in_part(b.mean, b.cov, H, nu, r, share, 1.1)
        else:
            update_across_in_part(b.mean, b.cov, (nx, ny), nu, r, share, 1.1)
        wrapped = a.mean[H] - b.mean[H]
        b.mean[H] += 2.0 * math.pi * round(wrapped / (2.0 * math.pi))
        assert_same(a, b)


@given(seeds)
def test_an_offset_that_jumps_is_not_averaged_with_the_one_before(seed: int):
    g = random_gaussian(np.random.default_rng(seed))
    x = g.mean[X]
    sigma = math.sqrt(g.cov[X, X])
    update_across_in_part(g.mean, g.cov, (0.0, -1.0), 1e4, 0.5, 1.0, 1.0)
    assert g.mean[X] == pytest.approx(x, abs=0.1 * sigma)


@given(seeds)
def test_a_place_along_a_road_is_reshaped_as_by_its_row(seed: int):
    rng = np.random.default_rng(seed)
    a = random_gaussian(rng)
    b = a.copy()
    (tx, ty), shift, shrink = rng.normal(size=2), rng.normal(), rng.uniform(0.1, 1.2)
    reshape_along(a.mean, a.cov, on_map(tx, ty), shift, shrink, 1.1)
    reshape_on_map(b.mean, b.cov, tx, ty, shift, shrink, 1.1)
    assert_same(a, b)


def exact_cdf(z: float) -> float:
    """Of the standard normal: its power series about 0, of which sixty digits are kept."""
    if abs(z) > 9.0:
        return float(z > 0.0)
    with localcontext(prec=60):
        x, total, k = Decimal(z), Decimal(0), 0
        term = x  # (-1)^k x^(2k+1) / (2^k k!)
        while abs(term) > Decimal("1e-40"):
            total += term / (2 * k + 1)
            k += 1
            term *= -x * x / (2 * k)
        return float(Decimal("0.5") + total / TWO_PI.sqrt())


@given(st.floats(-50.0, 50.0))
@example(0.8865413484327931)  # where SciPy's differs by 2.2e-16
def test_the_distribution_function_is_exact_to_the_last_digit(z: float):
    assert normal_cdf(z) == pytest.approx(exact_cdf(z), abs=2e-16)


@given(seeds, st.permutations(range(4)))
def test_the_order_of_independent_rows_does_not_matter(seed: int, order: list[int]):
    rng = np.random.default_rng(seed)
    a = random_gaussian(rng)
    b = a.copy()
    rows, z, noise = random_rows(rng, 4), rng.normal(size=4), rng.uniform(0.01, 4.0, 4)
    first = apply(a, rows, z, noise)
    second = apply(b, rows[order], z[order], noise[order])
    assert_same(a, b)
    assert first == pytest.approx(second, abs=1e-8)


def test_after_ten_thousand_rows_the_covariance_is_symmetric_and_positive():
    rng = np.random.default_rng(1)
    g = random_gaussian(rng)
    for _ in range(10_000):
        g.cov[np.diag_indices(N)] += 1e-6 * UNITS**2
        row = random_rows(rng, 1)[0]
        condition(g.mean, g.cov, row, rng.normal(), 10.0 ** rng.uniform(-6, 2), 1.0)
    assert (g.cov == g.cov.T).all()
    assert np.linalg.eigvalsh(g.cov / np.outer(UNITS, UNITS)).min() > 0


@given(gaussians, st.floats(0.9, 1.1))
def test_the_plane_s_scale_stretches_only_the_steps_of_x_and_y(g: Gaussian, scale: float):
    row = 1.0 / UNITS
    flat = g.copy()
    scaled = g.copy()
    same = condition(flat.mean, flat.cov, row, 1.3, 0.7, 1.0)
    assert condition(scaled.mean, scaled.cov, row, 1.3, 0.7, scale) == same
    step, longer = flat.mean - g.mean, scaled.mean - g.mean
    np.testing.assert_allclose(longer[[X, Y]], scale * step[[X, Y]], atol=1e-12)
    np.testing.assert_array_equal(longer[2:], step[2:])
    np.testing.assert_array_equal(scaled.cov, flat.cov)


@given(st.floats(-1e3, 1e3), st.floats(0.1, 50.0), st.floats(-4.9, 4.0), st.floats(0.5, 9.0))
def test_a_truncated_gaussian_has_the_moments_that_scipy_gives(mean, sigma, low, width):
    high = low + width
    ours = truncated_moments(mean, sigma, mean + low * sigma, mean + high * sigma)
    cut = stats.truncnorm(low, high, loc=mean, scale=sigma)
    assert ours[0] == pytest.approx(cut.mean(), abs=1e-6 * sigma)
    assert ours[1] == pytest.approx(cut.var(), abs=1e-6 * sigma**2)


@given(st.floats(-40.0, 40.0), st.floats(0.01, 80.0))
def test_a_truncated_gaussian_lies_in_its_interval(low: float, width: float):
    mean, variance = truncated_moments(0.0, 1.0, low, low + width)
    assert low <= mean <= low + width
    assert 0.0 < variance <= 1.0


@pytest.mark.parametrize("high", [-1.0, -1.9, -2.0 - 1e-12, -4.0])
def test_an_interval_whose_ends_have_changed_places_moves_nothing_far_away(high: float):
    mean, variance = truncated_moments(0.0, 1.0, -2.0, high)
    assert -4.0 <= mean <= 0.0
    assert 0.0 < variance <= 1.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_tail_beyond_five_sigma_joins_on_without_a_jump(side: float):
    ends = [sorted((side * a, side * (a + 10.0))) for a in (4.999, 5.001)]
    (mean, variance), (tail_mean, tail_variance) = (truncated_moments(0.0, 1.0, *e) for e in ends)
    assert tail_mean == pytest.approx(mean, abs=0.03)
    assert math.sqrt(tail_variance) == pytest.approx(math.sqrt(variance), rel=0.15)


@given(gaussians, seeds, st.floats(-3.0, 3.0), st.floats(0.05, 1.0))
def test_reshaping_gives_one_direction_new_moments_and_the_rest_follows(
    g: Gaussian, seed: int, shift: float, shrink: float
):
    row = np.random.default_rng(seed).normal(size=N) / UNITS
    old = g.copy()
    reshape_along(g.mean, g.cov, row, shift, shrink, 1.0)
    variance = row @ old.cov @ row
    assert row @ g.mean == pytest.approx(row @ old.mean + shift, abs=1e-9)
    assert row @ g.cov @ row == pytest.approx(shrink * variance, rel=1e-8)

    def given_row(a: Gaussian) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Regression of the state on h·x, what it predicts at h·x = 0, and what is left."""
        slope = a.cov @ row / (row @ a.cov @ row)
        rest = a.cov - np.outer(slope, slope) * (row @ a.cov @ row)
        return (
            slope / UNITS,
            (a.mean - slope * (row @ a.mean)) / UNITS,
            rest / np.outer(UNITS, UNITS),
        )

    for before, after in zip(given_row(old), given_row(g), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-8)


@given(seeds, st.floats(0.001, 0.999), st.floats(0.95, 1.05))
def test_merging_conserves_mean_and_covariance(seed: int, share: float, scale: float):
    rng = np.random.default_rng(seed)
    a, b = random_gaussian(rng), random_gaussian(rng)
    b.mean[H] = a.mean[H] + rng.uniform(-3.0, 3.0)  # across the wrap, too
    plane = np.ones(N)
    plane[[X, Y]] = scale
    mean, cov = textbook.mixture_moments(
        np.array([share, 1.0 - share]),
        np.array([a.mean, b.mean]) / plane,
        np.array([a.cov, b.cov]),
    )
    b.mean[H] = math.remainder(b.mean[H], 2.0 * math.pi)
    merge_moments(a.mean, a.cov, b.mean, b.cov, share, scale)
    assert -math.pi < a.mean[H] <= math.pi
    mean[H] += 2.0 * math.pi * round((a.mean[H] - mean[H]) / (2.0 * math.pi))
    assert_same(Gaussian(a.mean / plane, a.cov), Gaussian(mean, cov))
    assert (a.cov == a.cov.T).all()


@given(seeds)
def test_a_row_of_one_state_is_a_row(seed: int):
    rng = np.random.default_rng(seed)
    g = random_gaussian(rng)
    ours = Gaussian(g.mean.copy(), g.cov.copy())
    state = int(rng.integers(N))
    row = np.zeros(N)
    row[state] = 1.0
    s = update(g.mean, g.cov, row, 0.7, 0.3, 1.1)
    assert update_state(ours.mean, ours.cov, state, 0.7, 0.3, 1.1) == s
    np.testing.assert_array_equal(ours.mean, g.mean)
    np.testing.assert_array_equal(ours.cov, g.cov)
