import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from whichroad.experiments.numbers import binomial, median, ratio


@given(st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_interval_of_a_share_is_clopper_and_pearsons(case):
    hits, n = case
    exact = binomtest(hits, n).proportion_ci(0.95, method="exact")
    assert binomial(hits, n) == pytest.approx((exact.low, exact.high), abs=1e-9)


def test_the_interval_of_a_mean_holds_it_in_about_95_of_100_cases():
    """Between 88 and 100: what a binomial of 0.95 leaves with five in ten thousand."""
    random = np.random.default_rng(0)
    held = 0
    for _ in range(100):
        values = random.normal(3.0, 1.0, 60)
        _, (low, high) = ratio(values, np.ones(60))
        held += low < 3.0 < high
    assert held >= 88


def test_a_ratio_is_pooled_over_drives_not_averaged():
    value, _ = ratio([9.0, 0.0], [1.0, 8.0])
    assert value == 1.0
    assert ratio([9.0, 0.0], [1.0, 8.0], root=True)[0] == 1.0


def test_a_median_takes_values_in_groups_and_empty_ones_too():
    value, interval, spread = median([[1.0, 2.0], [], [3.0, 4.0, 5.0]])
    assert value == 3.0
    assert 1.0 <= interval[0] <= value <= interval[1] <= 5.0
    assert spread == pytest.approx((1.1, 4.9))
