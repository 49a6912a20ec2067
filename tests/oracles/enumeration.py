"""Switching models and conditional Gaussian networks, summed over every mode sequence.

    P(S, X | Y) = Σ over all sequences of one Kalman filter each, in logarithms

Nothing is shared with `whichroad.exact`: the filter is the textbook's, the smoother
Rauch, Tung and Striebel's, a network one big Gaussian.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .textbook import mixture_moments

Array = NDArray[np.float64]


class Sequences(NamedTuple):
    """All mode sequences of a window of T slices, Q = K^T of them."""

    modes: NDArray[np.int64]  # (Q, T)
    probability: Array  # (Q,) posterior
    mean: Array  # (T, Q, D) smoothed
    cov: Array  # (T, Q, D, D)
    log_likelihood: float

    def of_mode(self, t: int, modes: int) -> Array:
        """P(S_t | Y), (K,), t from 0."""
        return np.bincount(self.modes[:, t], self.probability, modes)

    def moments(self, t: int, mode: int | None = None) -> tuple[Array, Array]:
        """Mean and covariance of X_t, of one mode of S_t or of all."""
        p = self.probability * (1.0 if mode is None else self.modes[:, t] == mode)
        return mixture_moments(p / p.sum(), self.mean[t], self.cov[t])


def _each(array: Any, rank: int, modes: NDArray[np.int64]) -> Array:
    """The array of each sequence's mode."""
    array = np.asarray(array, float)
    return array[modes] if array.ndim > rank else np.broadcast_to(array, (len(modes), *array.shape))


def _times(matrix: Array, vector: Array) -> Array:
    return np.einsum("qij,qj->qi", matrix, vector)


def _t(matrix: Array) -> Array:
    return np.swapaxes(matrix, -1, -2)


def enumerate_window(model: Any, window: Sequence[Mapping[str, Any]]) -> Sequences:
    """Filter and smooth a window along every mode sequence.

    Args:
        model: What `whichroad.exact.SwitchingModel` holds.
        window: For each slice, sensor to value.
    """
    k = len(model.initial)
    modes = np.array(list(itertools.product(range(k), repeat=len(window))))
    with np.errstate(divide="ignore"):
        initial, transition = np.log(model.initial), np.log(model.transition)
    log = initial[modes[:, 0]]
    predicted, filtered = [], []
    for t, seen in enumerate(window):
        s = modes[:, t]
        if t == 0:
            m, p = _each(model.mean, 1, s), _each(model.cov, 2, s)
        else:
            a = _each(model.a, 2, s)
            log = log + transition[modes[:, t - 1], s]
            m = _times(a, m) + _each(model.mu, 1, s)
            p = a @ p @ _t(a) + _each(model.q, 2, s)
        predicted.append((m, p))
        for name, value in seen.items():
            if value is not None:
                m, p, density = _update(m, p, model.sensors[name], s, np.atleast_1d(value))
                log = log + density
        filtered.append((m, p))
    top = log.max()
    total = top + math.log(np.exp(log - top).sum())
    mean, cov = _smooth(model, modes, predicted, filtered)
    return Sequences(modes, np.exp(log - total), mean, cov, total)


def _update(
    m: Array, p: Array, sensor: Any, s: NDArray[np.int64], value: Array
) -> tuple[Array, Array, Array]:
    c, r = _each(sensor.c, 2, s), _each(sensor.r, 2, s)
    nu = value - _times(c, m) - _each(sensor.nu, 1, s)
    spread = c @ p @ _t(c) + r
    gain = _t(np.linalg.solve(spread, c @ p))
    chi2 = np.einsum("qi,qi->q", nu, np.linalg.solve(spread, nu[..., None])[..., 0])
    density = -0.5 * (chi2 + np.linalg.slogdet(2.0 * math.pi * spread)[1])
    return m + _times(gain, nu), p - gain @ spread @ _t(gain), density


def _smooth(
    model: Any, modes: NDArray[np.int64], predicted: list[Any], filtered: list[Any]
) -> tuple[Array, Array]:
    """Rauch, Tung, Striebel, along every sequence."""
    m, p = filtered[-1]
    means, covs = [m], [p]
    for t in range(len(filtered) - 2, -1, -1):
        a = _each(model.a, 2, modes[:, t + 1])
        (pm, pp), (fm, fp) = predicted[t + 1], filtered[t]
        gain = fp @ _t(a) @ np.linalg.pinv(pp, hermitian=True)
        m = fm + _times(gain, m - pm)
        p = fp + gain @ (p - pp) @ _t(gain)
        means.insert(0, m)
        covs.insert(0, p)
    return np.array(means), np.array(covs)


class Configurations(NamedTuple):
    """All joint values of a network's discrete nodes, and the Gaussian that each leaves."""

    value: list[dict[str, int]]
    probability: Array  # (Q,) posterior
    mean: dict[str, Array]  # node -> (Q, D)
    cov: dict[str, Array]  # node -> (Q, D, D)
    log_likelihood: float


def enumerate_network(network: Any, evidence: Mapping[str, Any]) -> Configurations:
    """Posterior of a small network, one joint Gaussian for each configuration.

    Args:
        network: A `whichroad.exact.Network`, of which only the nodes' numbers are read.
        evidence: Node to value.
    """
    names = list(network.discrete)
    values, logs, means, covs = [], [], [], []
    for at in itertools.product(*(range(network.discrete[n].size) for n in names)):
        config = dict(zip(names, at, strict=True))
        if any(config[n] != evidence[n] for n in names if n in evidence):
            continue
        prior = 1.0
        for n in names:
            node = network.discrete[n]
            prior *= node.table[(*(config[p] for p in node.parents), config[n])]
        place, mean, cov = _joint(network, config)
        seen = [n for n in place if n in evidence]
        density, mean, cov = _condition(place, mean, cov, seen, evidence)
        values.append(config)
        logs.append(density + (math.log(prior) if prior > 0.0 else -math.inf))
        means.append({n: mean[place[n]] for n in place})
        covs.append({n: cov[place[n], place[n]] for n in place})
    log = np.array(logs)
    total = log.max() + math.log(np.exp(log - log.max()).sum())
    return Configurations(
        values,
        np.exp(log - total),
        {n: np.array([m[n] for m in means]) for n in network.gaussian},
        {n: np.array([c[n] for c in covs]) for n in network.gaussian},
        total,
    )


def _joint(network: Any, config: Mapping[str, int]) -> tuple[dict[str, slice], Array, Array]:
    """The joint Gaussian of all Gaussian nodes in one configuration."""
    place: dict[str, slice] = {}
    mean, cov = np.zeros(0), np.zeros((0, 0))
    for name, node in network.gaussian.items():
        at = tuple(config[m] for m in node.modes)
        n, d = len(mean), node.size
        rows = np.zeros((d, n))
        for parent, weights in node.parents.items():
            rows[:, place[parent]] = weights[at]
        mean = np.concatenate([mean, node.mean[at] + rows @ mean])
        side = rows @ cov
        cov = np.block([[cov, side.T], [side, side @ rows.T + node.cov[at]]])
        place[name] = slice(n, n + d)
    return place, mean, cov


def _condition(
    place: dict[str, slice], mean: Array, cov: Array, seen: list[str], evidence: Mapping[str, Any]
) -> tuple[float, Array, Array]:
    """Log-density of what was seen, and the Gaussian conditioned on it."""
    if not seen:
        return 0.0, mean, cov
    at = np.concatenate([np.r_[place[n]] for n in seen])
    nu = np.concatenate([np.atleast_1d(evidence[n]) for n in seen]) - mean[at]
    spread = cov[np.ix_(at, at)]
    gain = np.linalg.solve(spread, cov[at]).T
    _, log_det = np.linalg.slogdet(2.0 * math.pi * spread)
    density = -0.5 * (nu @ np.linalg.solve(spread, nu) + log_det)
    return float(density), mean + gain @ nu, cov - gain @ cov[at]
