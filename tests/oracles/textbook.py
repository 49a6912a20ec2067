"""Gaussians in matrices: conditioning, merging and cutting as the textbooks write them."""

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]


def condition(
    mean: Array, cov: Array, rows: Array, innovation: Array, noise: Array
) -> tuple[Array, Array, float]:
    """Joint Kalman update on all rows at once: mean, covariance, log-density.

    Args:
        mean: (n,).
        cov: (n, n).
        rows: (k, n) observation matrix.
        innovation: (k,).
        noise: (k, k).
    """
    s = rows @ cov @ rows.T + noise
    gain = np.linalg.solve(s, rows @ cov).T
    log_density = float(stats.multivariate_normal(np.zeros(len(s)), s).logpdf(innovation))
    return mean + gain @ innovation, cov - gain @ s @ gain.T, log_density


def mixture_moments(weight: Array, mean: Array, cov: Array) -> tuple[Array, Array]:
    """Mean and covariance of a mixture: weights (k,), means (k, n), covariances (k, n, n)."""
    middle = weight @ mean
    apart = mean - middle
    return middle, np.einsum("k,kij->ij", weight, cov + apart[:, :, None] * apart[:, None, :])


def jacobian(function, at: Array, step: Array) -> Array:  # type: ignore[no-untyped-def]
    """Central differences of a vector function, steps (n,)."""
    columns = []
    for j, h in enumerate(step):
        d = np.zeros(len(at))
        d[j] = h
        columns.append((function(at + d) - function(at - d)) / (2.0 * h))
    return np.array(columns).T
