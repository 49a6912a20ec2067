"""Gaussians with modes as the cliques hold them after both sweeps, and as users get them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .potentials import Array, Modes, Regression, Table, log_sum, spread_modes, union


@dataclass(frozen=True, slots=True)
class Mixture:
    """A Gaussian for each joint value of some discrete nodes.

    Attributes:
        modes: Names of the discrete nodes, one leading axis each.
        probability: Posterior of the modes, sums to one, shape (*K,).
        mean: Shape (*K, D).
        cov: Shape (*K, D, D).
    """

    modes: Modes
    probability: Array
    mean: Array
    cov: Array

    def moments(self) -> tuple[Array, Array]:
        """Mean (D,) and covariance (D, D) of the whole mixture."""
        p = self.probability.reshape(-1)
        means = self.mean.reshape(len(p), -1)
        d = means.shape[1]
        mean = p @ means
        apart = means - mean
        inside = np.tensordot(p, self.cov.reshape(len(p), d, d), 1)
        return mean, inside + (p[:, None] * apart).T @ apart


@dataclass(frozen=True, slots=True)
class Joint:
    """Posterior of some modes, and of some continuous variables given them.

    Arrays may have modes of length one, on which they do not depend.
    """

    modes: Modes
    log: Array  # (*modes,) posterior of the modes
    place: Mapping[str, slice]  # variable -> its components
    mean: Array  # (*modes, n)
    cov: Array  # (*modes, n, n)

    @staticmethod
    def nothing() -> "Joint":
        """No modes, no variables."""
        return Joint((), np.zeros(()), {}, np.zeros(0), np.zeros((0, 0)))

    def onto(self, names: Sequence[str], modes: Modes) -> "Joint":
        """The marginal of some variables and modes; modes are collapsed by moments."""
        sizes = [self.place[n].stop - self.place[n].start for n in names]
        ends = np.cumsum([0, *sizes])
        place = {n: slice(int(a), int(b)) for n, a, b in zip(names, ends, ends[1:], strict=False)}
        at = np.concatenate([np.r_[self.place[n]] for n in names] or [np.zeros(0)]).astype(int)
        mean, cov = self.mean[..., at], self.cov[..., at[:, None], at]
        axes = tuple(k for k, m in enumerate(self.modes) if m not in modes)
        left = tuple(m for m in self.modes if m in modes)
        if not axes:
            return Joint(left, self.log, place, mean, cov)
        log = log_sum(self.log, axes)
        share = self._shares(log, axes)
        middle = (share[..., None] * mean).sum(axis=axes, keepdims=True)
        apart = mean - middle
        cov = cov + apart[..., :, None] * apart[..., None, :]
        cov = (share[..., None, None] * cov).sum(axis=axes)
        return Joint(left, log, place, middle.squeeze(axes), cov)

    def _shares(self, log: Array, axes: tuple[int, ...]) -> Array:
        """P(modes that go | modes that stay); equal ones where nothing is possible."""
        whole = np.expand_dims(log, axes)
        possible = np.isfinite(whole)
        equal = 1.0 / np.prod([self.log.shape[a] for a in axes])
        share = np.exp(np.where(possible, self.log, 0.0) - np.where(possible, whole, 0.0))
        shares: Array = np.where(possible, share, equal)
        return shares

    def with_modes(self, table: Table, order: Sequence[str]) -> "Joint":
        """Extend by modes whose conditional log-table given the present ones is known."""
        modes = union(order, self.modes, table.modes)
        log, mean, cov = (
            spread_modes(a, self.modes, modes) for a in (self.log, self.mean, self.cov)
        )
        return Joint(
            modes, log + spread_modes(table.log, table.modes, modes), self.place, mean, cov
        )

    def extend(self, regression: Regression) -> "Joint":
        """Add a variable by its regression on those that are there."""
        r = regression.over(self.modes)
        n, d = self.mean.shape[-1], r.mean.shape[-1]
        shape = np.broadcast_shapes(self.mean.shape[:-1], r.mean.shape[:-1])
        rows = np.zeros((*shape, d, n))
        for u, w in r.weights.items():
            rows[..., self.place[u]] = w
        cross = rows @ self.cov
        mean = np.zeros((*shape, n + d))
        mean[..., :n] = self.mean
        mean[..., n:] = r.mean + (rows @ self.mean[..., None])[..., 0]
        cov = np.zeros((*shape, n + d, n + d))
        cov[..., :n, :n] = self.cov
        cov[..., n:, :n] = cross
        cov[..., :n, n:] = np.swapaxes(cross, -1, -2)
        cov[..., n:, n:] = cross @ np.swapaxes(rows, -1, -2) + r.cov
        return Joint(self.modes, self.log, {**self.place, r.head: slice(n, n + d)}, mean, cov)

    def mixture(self, sizes: Mapping[str, int]) -> Mixture:
        """With all modes written out."""
        shape = tuple(sizes[m] for m in self.modes)
        n = self.mean.shape[-1]
        return Mixture(
            self.modes,
            np.broadcast_to(np.exp(self.log), shape).copy(),
            np.broadcast_to(self.mean, (*shape, n)).copy(),
            np.broadcast_to(self.cov, (*shape, n, n)).copy(),
        )
