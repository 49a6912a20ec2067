"""One big Gaussian over everything that happens on a drive, solved at once.

    x₀ ~ N(m₀, P₀),   xₖ₊₁ = F xₖ + c + wₖ,   z = h xₖ + v

All x are linear in ξ = (x₀, w₁, w₂, …), so the observations are jointly Gaussian: their
density is the evidence of a hypothesis, and the last state follows by conditioning.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]


class Joint:
    """States and observations of one hypothesis, as rows over ξ.

    Args:
        mean: Of the first state, (n,).
        cov: Of the first state, (n, n).
    """

    def __init__(self, mean: Array, cov: Array) -> None:
        self._n = len(mean)
        self._state, self._mean = np.eye(self._n), mean.copy()
        self._blocks = [cov.copy()]
        self._seen: list[tuple[Array, float, float]] = []  # row over ξ, residual, variance

    def move(self, transition: Array, constant: Array, noise: Array) -> None:
        """One step: x ← F x + c + w, w ~ N(0, noise)."""
        self._state = np.hstack([transition @ self._state, np.eye(self._n)])
        self._mean = transition @ self._mean + constant
        self._blocks.append(noise)

    def see(self, row: Array, value: float, variance: float) -> None:
        """One observation of the present state: value = row x + v."""
        self._seen.append((row @ self._state, value - float(row @ self._mean), variance))

    def solve(self) -> tuple[Array, Array, float]:
        """Mean and covariance of the last state, and the log-density of all observations."""
        width, n = self._state.shape[1], self._n
        rows = np.zeros((len(self._seen) + n, width))
        for k, (row, _, _) in enumerate(self._seen):
            rows[k, : len(row)] = row
        rows[-n:] = self._state
        spread = np.hstack([rows[:, n * k : n * (k + 1)] @ q for k, q in enumerate(self._blocks)])
        together = spread @ rows.T  # of all observations, noiseless, and the last state
        total = together[:-n, :-n] + np.diag([v for _, _, v in self._seen])
        residual = np.array([r for _, r, _ in self._seen])
        cross = together[-n:, :-n]
        gain = np.linalg.solve(total, cross.T).T
        density = stats.multivariate_normal(np.zeros(len(total)), total).logpdf(residual)
        return self._mean + gain @ residual, together[-n:, -n:] - gain @ cross.T, float(density)
