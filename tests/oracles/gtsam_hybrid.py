"""The same window by gtsam's hybrid elimination, an independent library."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import gtsam
import numpy as np
from gtsam.symbol_shorthand import S, X, Y
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Eliminated(NamedTuple):
    """Posterior of a window of T slices over its Q = K^T mode sequences."""

    probability: Array  # (Q,), the last slice's mode running fastest
    mean: Array  # (T, Q, D)
    cov: Array  # (T, Q, D, D)


def _conditional(key: int, mean: Array, cov: Array, parent: int, weights: Array) -> Any:
    """X | u ~ N(mean + weights u, cov) as R x + S u = d with unit noise."""
    root = np.linalg.inv(np.linalg.cholesky(cov))
    unit = gtsam.noiseModel.Unit.Create(len(mean))
    # Conditionals of gtsam are upper triangular, with a positive diagonal: turn the root so.
    upper = np.linalg.qr(root)[1]
    upper *= np.sign(np.diag(upper))[:, None]
    if parent < 0:
        return gtsam.GaussianConditional(key, upper @ mean, upper, unit)
    return gtsam.GaussianConditional(key, upper @ mean, upper, parent, -upper @ weights, unit)


def _of_modes(array: Any, rank: int, k: int) -> Array:
    array = np.asarray(array, float)
    return array if array.ndim > rank else np.broadcast_to(array, (k, *array.shape))


def _graph(model: Any, window: Sequence[Mapping[str, Any]]) -> Any:
    k = len(model.initial)
    graph = gtsam.HybridGaussianFactorGraph()
    for t, seen in enumerate(window):
        s = (S(t), k)
        if t == 0:
            graph.push_back(gtsam.DecisionTreeFactor(s, list(model.initial)))
            mean, cov = _of_modes(model.mean, 1, k), _of_modes(model.cov, 2, k)
            moves = [_conditional(X(0), mean[i], cov[i], -1, mean) for i in range(k)]
        else:
            rows = np.ravel(model.transition).tolist()
            graph.push_back(gtsam.DecisionTreeFactor([(S(t - 1), k), s], rows))
            a, mu, q = (_of_modes(m, r, k) for m, r in ((model.a, 2), (model.mu, 1), (model.q, 2)))
            moves = [_conditional(X(t), mu[i], q[i], X(t - 1), a[i]) for i in range(k)]
        graph.push_back(gtsam.HybridGaussianConditional(s, moves))
        for number, (name, value) in enumerate(seen.items()):
            if value is None:
                continue
            sensor, y = model.sensors[name], Y(10 * t + number)
            c, nu, r = (
                _of_modes(m, d, k) for m, d in ((sensor.c, 2), (sensor.nu, 1), (sensor.r, 2))
            )
            spoke = [_conditional(y, nu[i], r[i], X(t), c[i]) for i in range(k)]
            values = gtsam.VectorValues()
            values.insert(y, np.atleast_1d(np.asarray(value, float)))
            graph.push_back(gtsam.HybridGaussianConditional(s, spoke).likelihood(values))
    return graph


def eliminate_window(model: Any, window: Sequence[Mapping[str, Any]]) -> Eliminated:
    """Eliminate continuous variables first, then the modes.

    Args:
        model: What `whichroad.exact.SwitchingModel` holds; no covariance is singular.
        window: For each slice, sensor to value.
    """
    k, length, d = len(model.initial), len(window), np.shape(model.mean)[-1]
    order = gtsam.Ordering()
    for key in [X(t) for t in range(length)] + [S(t) for t in range(length)]:
        order.push_back(key)
    net = _graph(model, window).eliminateSequential(order)
    modes = net.discreteMarginal()
    ps, means, covs = [], [], []
    for sequence in itertools.product(range(k), repeat=length):
        values = gtsam.DiscreteValues()
        for t, mode in enumerate(sequence):
            values[S(t)] = mode
        ps.append(modes.evaluate(values))
        chosen = net.choose(values)
        best = chosen.optimize()
        upper, _ = chosen.matrix()
        inverse = np.linalg.inv(upper)
        full = inverse @ inverse.T
        means.append([best.at(X(t)) for t in range(length)])
        covs.append([full[d * t : d * (t + 1), d * t : d * (t + 1)] for t in range(length)])
    p = np.array(ps)
    return Eliminated(p / p.sum(), np.array(means).swapaxes(0, 1), np.array(covs).swapaxes(0, 1))
