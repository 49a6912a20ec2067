"""Conditional linear Gaussian networks: nodes, their distributions, and what is refused.

A network is a directed acyclic graph of discrete nodes, whose parents are discrete, and
of Gaussian nodes, whose parents are of either kind.  Their product is the joint
distribution of the paper's section 3.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import WhichroadError

Array = NDArray[np.float64]
Value = int | float | Sequence[float] | Array

_SUM = 1e-9  # tolerance of a row's sum of probabilities
_NEGATIVE = 1e-9  # tolerance of negative eigenvalues of a correlation matrix


class NetworkError(WhichroadError, ValueError):
    """A network, its evidence or a question about it makes no sense."""


@dataclass(frozen=True, slots=True)
class Discrete:
    """A discrete node: P(node | parents).

    Attributes:
        name: Of the node.
        table: Probabilities, shape (*K of the parents, K); rows along the last axis sum to one.
        parents: Names of its discrete parents, in the order of the axes.
    """

    name: str
    table: ArrayLike
    parents: Sequence[str] = ()

    @property
    def size(self) -> int:
        """Number of its values."""
        return int(np.shape(self.table)[-1])


@dataclass(frozen=True, slots=True)
class Gaussian:
    """A Gaussian node: a linear regression on its parents, one for each mode.

        node | x, i  ~  N(mean(i) + Σ weights(i) x, cov(i))

    The mode axes may be left out of an array that does not depend on the mode.  A
    covariance may be singular, or zero: a deterministic relation.

    Attributes:
        name: Of the node.
        mean: Shape (*K of the modes, D).
        cov: Shape (*K, D, D), symmetric, positive semi-definite.
        parents: Continuous parent to its weights, shape (*K, D, D of the parent).
        modes: Names of its discrete parents, in the order of the axes.
    """

    name: str
    mean: ArrayLike
    cov: ArrayLike
    parents: Mapping[str, ArrayLike] | None = None
    modes: Sequence[str] = ()

    @property
    def size(self) -> int:
        """Its dimension D."""
        return int(np.shape(self.mean)[-1])


Node = Discrete | Gaussian


class Network:
    """A conditional linear Gaussian network, checked.

    Args:
        nodes: Parents before their children.

    Raises:
        NetworkError: For unknown parents, wrong shapes, rows that do not sum to one,
            negative probabilities or variances, numbers that are not finite.
    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        self.discrete: dict[str, Discrete] = {}
        self.gaussian: dict[str, Gaussian] = {}
        for node in nodes:
            if node.name in self:
                raise NetworkError(f"{node.name}: a node of this name is there already; rename it")
            if isinstance(node, Discrete):
                self.discrete[node.name] = self._checked_discrete(node)
            else:
                self.gaussian[node.name] = self._checked_gaussian(node)

    def __contains__(self, name: str) -> bool:
        return name in self.discrete or name in self.gaussian

    def size(self, name: str) -> int:
        """Number of values of a discrete node, dimension of a Gaussian one."""
        if name not in self:
            raise NetworkError(
                f"{name}: there is no such node; the nodes are "
                f"{', '.join([*self.discrete, *self.gaussian]) or 'none'}"
            )
        found = self.discrete.get(name) or self.gaussian[name]
        return found.size

    def _modes(self, name: str, parents: Sequence[str]) -> tuple[int, ...]:
        for parent in parents:
            if parent in self.gaussian:
                raise NetworkError(
                    f"{name}: {parent} is Gaussian; a discrete node was expected here "
                    "(a discrete node cannot have a Gaussian parent)"
                )
            if parent not in self.discrete:
                raise NetworkError(
                    f"{name}: its parent {parent} is not known; give parents before children"
                )
        if len(set(parents)) < len(parents):
            raise NetworkError(f"{name}: a parent is named twice; name each once")
        return tuple(self.discrete[p].size for p in parents)

    def _checked_discrete(self, node: Discrete) -> Discrete:
        axes = self._modes(node.name, node.parents)
        table = _floats(node.name, "table", node.table)
        if table.ndim != len(axes) + 1 or table.shape[:-1] != axes or table.shape[-1] < 1:
            raise NetworkError(
                f"{node.name}: its table has shape {table.shape}; "
                f"{(*axes, 'K')} was expected, one axis for each parent and its own last"
            )
        if (table < 0.0).any():
            raise NetworkError(
                f"{node.name}: its table holds {table.min():g}; probabilities are not negative"
            )
        total = table.sum(axis=-1)
        if (abs(total - 1.0) > _SUM).any():
            worst = total.flat[int(np.argmax(abs(total - 1.0)))]
            raise NetworkError(
                f"{node.name}: a row of its table sums to {worst:.6g}; "
                "1 was expected; normalise along the last axis"
            )
        return Discrete(node.name, table, tuple(node.parents))

    def _checked_gaussian(self, node: Gaussian) -> Gaussian:
        axes = self._modes(node.name, node.modes)
        mean = _floats(node.name, "mean", node.mean)
        if mean.ndim == 0 or mean.shape[-1] < 1:
            raise NetworkError(
                f"{node.name}: its mean has shape {mean.shape}; {(*axes, 'D')} was expected"
            )
        d = mean.shape[-1]
        mean = _shaped(node.name, "mean", mean, axes, (d,))
        cov = _shaped(node.name, "cov", _floats(node.name, "cov", node.cov), axes, (d, d))
        _check_covariance(node.name, cov)
        weights = {}
        for parent, given in (node.parents or {}).items():
            if parent not in self.gaussian:
                raise NetworkError(
                    f"{node.name}: {parent} is no Gaussian node given before it; "
                    "discrete parents belong into modes, and parents come before children"
                )
            what = f"weights of {parent}"
            weights[parent] = _shaped(
                node.name, what, _floats(node.name, what, given), axes,
                (d, self.gaussian[parent].size),
            )  # fmt: skip
        return Gaussian(node.name, mean, cov, weights, tuple(node.modes))

    def checked_evidence(self, evidence: Mapping[str, Value]) -> dict[str, int | Array]:
        """Observed values by node: a whole number, or a vector of the node's dimension.

        Raises:
            NetworkError: For unknown nodes and values that do not fit them.
        """
        checked: dict[str, int | Array] = {}
        for name, value in evidence.items():
            size = self.size(name)
            seen = _floats(name, "observed value", value)
            if name in self.discrete:
                if seen.ndim != 0 or float(seen) not in range(size):
                    raise NetworkError(
                        f"{name}: {value!r} was observed; a whole number from 0 to {size - 1} "
                        "was expected"
                    )
                checked[name] = int(seen)
            else:
                seen = seen.reshape(1) if seen.ndim == 0 else seen
                if seen.shape != (size,):
                    raise NetworkError(
                        f"{name}: a value of shape {seen.shape} was observed; "
                        f"({size},) was expected"
                    )
                checked[name] = seen
        return checked


def _floats(name: str, what: str, given: object) -> Array:
    try:
        array = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise NetworkError(f"{name}: its {what} is no array of numbers; give one") from None
    if not np.isfinite(array).all():
        raise NetworkError(f"{name}: its {what} is not finite; finite numbers were expected")
    return array


def _shaped(
    name: str, what: str, array: Array, axes: tuple[int, ...], rest: tuple[int, ...]
) -> Array:
    """The array with all its mode axes."""
    if array.shape not in (rest, axes + rest):
        expected = f"{axes + rest}" + (f" or {rest}" if axes else "")
        raise NetworkError(f"{name}: its {what} has shape {array.shape}; {expected} was expected")
    return np.broadcast_to(array, axes + rest)


def _check_covariance(name: str, cov: Array) -> None:
    variance = np.diagonal(cov, axis1=-2, axis2=-1)
    if (variance < 0.0).any():
        raise NetworkError(
            f"{name}: its cov holds a variance of {variance.min():g}; 0 or more was expected"
        )
    sigma = np.sqrt(variance)
    unit = np.where(sigma > 0.0, sigma, 1.0)
    correlation = cov / (unit[..., :, None] * unit[..., None, :])
    if (abs(correlation - np.swapaxes(correlation, -1, -2)) > _NEGATIVE).any():
        raise NetworkError(f"{name}: its cov is not symmetric; a covariance matrix was expected")
    if (np.linalg.eigvalsh(correlation) < -_NEGATIVE * cov.shape[-1]).any():
        raise NetworkError(
            f"{name}: its cov has a negative eigenvalue; a positive semi-definite matrix was "
            "expected"
        )
