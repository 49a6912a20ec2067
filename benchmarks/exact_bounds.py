"""Exact 95 % bounds of a rate, from how often something was seen."""

from scipy.stats import beta


def clopper_pearson(bad: int, n: int) -> tuple[float, float]:
    """Two-sided interval."""
    low = float(beta.ppf(0.025, bad, n - bad + 1)) if bad else 0.0
    high = float(beta.ppf(0.975, bad + 1, n - bad)) if bad < n else 1.0
    return low, high


def upper_bound(bad: int, n: int) -> float:
    """One-sided upper bound: three in n where nothing bad was seen."""
    return float(beta.ppf(0.95, bad + 1, n - bad)) if bad < n else 1.0
