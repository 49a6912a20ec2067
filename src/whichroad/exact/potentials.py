"""What the cliques of the tree hold and send: log-tables and Gaussian regressions.

Both are families over discrete modes.  A mode is an axis in front of the arrays; names
of axes stand beside the array, always in the network's order, so that two potentials
combine by adding the axes that they lack.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Modes = tuple[str, ...]

_LOG_2PI = math.log(2.0 * math.pi)
_RANK = 1e-13  # eigenvalue of a correlation matrix that counts as zero


def spread_modes(array: Array, own: Modes, all_modes: Modes) -> Array:
    """The array with axes of length one for the modes that it does not depend on."""
    lacking = tuple(k for k, mode in enumerate(all_modes) if mode not in own)
    return np.expand_dims(array, lacking)


def union(order: Sequence[str], *modes: Modes) -> Modes:
    """All the modes named, in the network's order."""
    named = set().union(*modes)
    return tuple(m for m in order if m in named)


def log_sum(table: Array, axes: tuple[int, ...]) -> Array:
    """Log Σ exp over some axes, without overflow; minus infinity where all are."""
    if not axes:
        return table
    top = table.max(axis=axes, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        total = np.log(np.exp(table - top).sum(axis=axes))
    return np.asarray(total + np.squeeze(top, axes))


@dataclass(frozen=True, slots=True)
class Table:
    """A discrete potential: logarithms, one axis for each mode."""

    modes: Modes
    log: Array

    def onto(self, modes: Modes) -> "Table":
        """Sum out all modes but these."""
        axes = tuple(k for k, mode in enumerate(self.modes) if mode not in modes)
        return Table(tuple(m for m in self.modes if m in modes), log_sum(self.log, axes))


@dataclass(frozen=True, slots=True)
class Regression:
    """p(head | tail, modes) = N(mean + Σ weights[u] u, cov), arrays as in `network.Gaussian`."""

    head: str
    modes: Modes
    mean: Array  # (*modes, D)
    weights: Mapping[str, Array]  # tail -> (*modes, D, D of the tail)
    cov: Array  # (*modes, D, D)

    def see(self, name: str, value: Array) -> "Regression":
        """Put in the value of a variable of the tail."""
        if name not in self.weights:
            return self
        rest = {u: w for u, w in self.weights.items() if u != name}
        shift = (self.weights[name] @ value[:, None])[..., 0]
        return Regression(self.head, self.modes, self.mean + shift, rest, self.cov)

    def over(self, modes: Modes) -> "Regression":
        """The same with axes for more modes."""
        m, c = (spread_modes(a, self.modes, modes) for a in (self.mean, self.cov))
        weights = {u: spread_modes(w, self.modes, modes) for u, w in self.weights.items()}
        return Regression(self.head, modes, m, weights, c)


def pseudo_inverse(cov: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Moore-Penrose inverses of covariances, and which of them are regular.

    They are scaled to correlations first, so that metres and radians have equal rights.
    """
    sigma = np.sqrt(np.maximum(np.diagonal(cov, axis1=-2, axis2=-1), 0.0))
    unit = np.where(sigma > 0.0, sigma, 1.0)
    scale = unit[..., :, None] * unit[..., None, :]
    values, vectors = np.linalg.eigh(cov / scale)
    good = values > _RANK * np.maximum(values[..., -1:], _RANK)
    inverse = np.where(good, 1.0 / np.where(good, values, 1.0), 0.0)
    product = (vectors * inverse[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return product / scale, good.all(axis=-1)


def reverse(
    parent: Regression, child: Regression, order: Sequence[str]
) -> tuple[Regression, Regression]:
    """Turn the arc parent → child round; their product stays the same.

    With x ~ N(a + B u, P) the parent, z ~ N(c + F x + G u, R) the child:

        z | u     ~ N(c + F a + (F B + G) u, S),          S = F P Fᵀ + R
        x | z, u  ~ N(a + B u + K (z − E z), P'),         K = P Fᵀ S⁺
        P' = (1 − K F) P (1 − K F)ᵀ + K R Kᵀ

    This is the exchange of Lauritzen & Jensen (2001); it divides by no density, and
    S may be singular.  No other directed path may lead from parent to child.

    Args:
        parent: Of x.
        child: Of z, with x in its tail.
        order: All modes, in the network's order.

    Returns:
        The regressions of z, without x, and of x, with z.
    """
    modes = union(order, parent.modes, child.modes)
    x, z = parent.over(modes), child.over(modes)
    f = z.weights[x.head]
    ft = np.swapaxes(f, -1, -2)
    s = f @ x.cov @ ft + z.cov
    s = 0.5 * (s + np.swapaxes(s, -1, -2))
    gain = x.cov @ ft @ pseudo_inverse(s)[0]
    mean = z.mean + (f @ x.mean[..., None])[..., 0]
    weights: dict[str, Array] = {u: w for u, w in z.weights.items() if u != x.head}
    for u, w in x.weights.items():
        weights[u] = weights[u] + f @ w if u in weights else f @ w
    back = {u: -gain @ w for u, w in weights.items()}
    for u, w in x.weights.items():
        back[u] = back[u] + w
    back[z.head] = gain
    keep = np.eye(x.mean.shape[-1]) - gain @ f
    cov = keep @ x.cov @ np.swapaxes(keep, -1, -2) + gain @ z.cov @ np.swapaxes(gain, -1, -2)
    return (
        Regression(z.head, modes, mean, weights, s),
        Regression(x.head, modes, x.mean - (gain @ mean[..., None])[..., 0], back, cov),
    )


def log_density(regression: Regression, value: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Log N(value; mean, cov) for each mode, and where the covariance is regular."""
    nu = value - regression.mean
    inverse, regular = pseudo_inverse(regression.cov)
    chi2 = (nu[..., None, :] @ inverse @ nu[..., None])[..., 0, 0]
    _, log_det = np.linalg.slogdet(regression.cov)
    return -0.5 * (chi2 + log_det + len(value) * _LOG_2PI), regular
