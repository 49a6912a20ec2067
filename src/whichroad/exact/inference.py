"""Exact posteriors by two sweeps over the strong junction tree.

Collect: from the leaves to the root each clique eliminates its residual, continuous
variables by turning their arcs round, discrete ones by summing, and sends what is left.
Distribute: from the root back each clique extends the separator's posterior by what it
had eliminated.  Observed variables are never eliminated: they travel towards the root
until nothing continuous stands in their tail, and then their density weighs the modes
(Lauritzen & Jensen 2001 call it a push; Cowell 2005 does the same with single variables).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from .gaussian_network import Array, Discrete, Gaussian, Network, NetworkError, Value
from .posterior import Joint, Mixture
from .potentials import Modes, Regression, Table, log_density, reverse, spread_modes, union
from .tree import Clique, cliques, eliminate, moralise

_MOST = 1 << 26  # numbers in one clique: half a gigabyte


@dataclass(frozen=True, slots=True)
class _Collected:
    """What a clique eliminated, given its separator."""

    regressions: list[Regression]  # in the order of elimination
    table: Table  # log P(residual modes | separator)


class _Collect:
    """The sweep to the root."""

    def __init__(self, network: Network, evidence: Mapping[str, int | Array]) -> None:
        self.order = [name for name in network.discrete if name not in evidence]
        self.rank = {name: k for k, name in enumerate(network.gaussian)}
        self.seen = {n: v for n, v in evidence.items() if isinstance(v, np.ndarray)}
        self.picked = {n: v for n, v in evidence.items() if isinstance(v, int)}
        self.log_likelihood = 0.0

    def table(self, node: Discrete) -> Table:
        """The node's distribution, observed values put in."""
        names = (*node.parents, node.name)
        with np.errstate(divide="ignore"):
            log = np.log(cast(Array, node.table))
        modes, log = self._pick(names, log)
        keep = union(self.order, modes)
        return Table(keep, log.transpose([modes.index(m) for m in keep]))

    def regression(self, node: Gaussian) -> Regression:
        """The node's regression, observed values put in."""

        def ready(array: object) -> Array:
            modes, picked = self._pick(tuple(node.modes), cast(Array, array))
            axes = [modes.index(m) for m in union(self.order, modes)]
            return picked.transpose(*axes, *range(len(axes), picked.ndim))

        modes = union(self.order, tuple(node.modes))
        weights = {u: ready(w) for u, w in (node.parents or {}).items()}
        made = Regression(node.name, modes, ready(node.mean), weights, ready(node.cov))
        for name in list(weights):
            if name in self.seen:
                made = made.see(name, self.seen[name])
        return made

    def _pick(self, names: Modes, array: Array) -> tuple[Modes, Array]:
        at = tuple(self.picked.get(n, slice(None)) for n in names)
        return tuple(n for n in names if n not in self.picked), array[at]

    def close(self, regression: Regression) -> Table | None:
        """The density of an observed head with nothing continuous in its tail."""
        if regression.head not in self.seen or regression.weights:
            return None
        log, regular = log_density(regression, self.seen[regression.head])
        if not regular.all():
            raise NetworkError(
                f"{regression.head}: it was observed, but some mode leaves it no freedom (a "
                "singular covariance), so that it has no density; give it some variance"
            )
        return Table(regression.modes, log)

    def eliminate(self, name: str, factors: list[Regression]) -> tuple[Regression, list[Table]]:
        """Turn all arcs that leave a continuous variable, then take it out of the factors."""
        own = next(f for f in factors if f.head == name)
        factors.remove(own)
        children = sorted(
            (f for f in factors if name in f.weights), key=lambda f: self.rank[f.head]
        )
        tables = []
        for child in children:
            factors.remove(child)
            turned, own = reverse(own, child, self.order)
            if turned.head in self.seen:
                own = own.see(turned.head, self.seen[turned.head])
            closed = self.close(turned)
            if closed is None:
                factors.append(turned)
            else:
                tables.append(closed)
        return own, tables

    def clique(
        self, clique: Clique, factors: list[Regression], tables: list[Table], sizes: dict[str, int]
    ) -> tuple[_Collected, Table]:
        """Eliminate a clique's residual; `factors` keeps what is to be sent."""
        done = []
        for name in clique.residual:
            if name in self.rank:
                own, closed = self.eliminate(name, factors)
                done.append(own)
                tables = tables + closed
        modes = union(self.order, tuple(clique.variables))
        log = np.zeros([sizes[m] for m in modes])
        for table in tables:
            log = log + spread_modes(table.log, table.modes, modes)
        message = Table(modes, log).onto(tuple(clique.separator))
        base = np.where(np.isfinite(message.log), message.log, 0.0)
        given = Table(modes, log - spread_modes(base, message.modes, modes))
        return _Collected(done, given), message


class Posterior:
    """Posterior of every node given the evidence; made by `infer`.

    Attributes:
        log_likelihood: log p(evidence), a density in its continuous part.
        cliques: The strong junction tree, parents before children.
    """

    def __init__(
        self, network: Network, evidence: Mapping[str, int | Array], order: Sequence[str]
    ) -> None:
        self._network, self._evidence = network, evidence
        graph = moralise(network, evidence)
        sequence, neighbours = eliminate(graph, network, order)
        self.cliques = cliques(sequence, neighbours)
        self._sizes = {n: network.size(n) for n in graph}
        self._modes = [n for n in network.discrete if n in graph]
        self._check_size()
        self._home = {n: k for k, c in enumerate(self.cliques) for n in c.residual}
        self._place = {n: k for k, n in enumerate(sequence)}
        self._collect()
        self._joints: list[Joint] = []
        for k, clique in enumerate(self.cliques):
            above = self._joints[clique.parent] if clique.parent >= 0 else Joint.nothing()
            self._joints.append(
                self._descend(k, above, union(self._modes, tuple(clique.separator)))
            )

    def _check_size(self) -> None:
        for clique in self.cliques:
            modes = [n for n in clique.variables if n in self._network.discrete]
            values = math.prod(self._sizes[m] for m in modes)
            width = sum(self._sizes[n] for n in clique.variables if n in self._network.gaussian)
            if values * max(width, 1) ** 2 > _MOST:
                raise NetworkError(
                    f"a clique of the tree joins {len(modes)} discrete nodes of {values:,} "
                    f"combinations and {width} continuous dimensions; at most {_MOST:,} numbers "
                    "were expected; shorten the window or observe more"
                )

    def _collect(self) -> None:
        sweep = _Collect(self._network, self._evidence)
        factors: list[list[Regression]] = [[] for _ in self.cliques]
        tables: list[list[Table]] = [[] for _ in self.cliques]
        total = 0.0

        def put_table(table: Table, at: int) -> float:
            if at < 0 or not table.modes:
                return float(table.log)
            tables[at].append(table)
            return 0.0

        for node in self._network.discrete.values():
            table = sweep.table(node)
            total += put_table(table, self._first(table.modes))
        for gaussian in self._network.gaussian.values():
            made = sweep.regression(gaussian)
            closed = sweep.close(made)
            if closed is not None:
                total += put_table(closed, self._first(closed.modes))
            else:
                free = [n for n in (made.head, *made.weights) if n not in self._evidence]
                factors[self._first((*made.modes, *free))].append(made)
        self._collected: list[_Collected] = []
        for k in range(len(self.cliques) - 1, -1, -1):
            done, message = sweep.clique(self.cliques[k], factors[k], tables[k], self._sizes)
            self._collected.insert(0, done)
            up = self.cliques[k].parent
            total += put_table(message, up)
            if up >= 0:
                factors[up] += factors[k]
        if total == -math.inf:
            raise NetworkError(
                "the evidence has probability zero in this network; is there a typo?"
            )
        self.log_likelihood = total

    def _first(self, names: Sequence[str]) -> int:
        """The clique in which the first of these is eliminated; it holds them all."""
        return self._home[min(names, key=self._place.__getitem__)] if names else -1

    def _descend(self, k: int, above: Joint, keep: Modes) -> Joint:
        """A clique's posterior from its parent's, with the modes `keep` distinguished."""
        clique, done = self.cliques[k], self._collected[k]
        names = tuple(n for n in clique.separator if n in self._network.gaussian)
        joint = above.onto(names, keep).with_modes(done.table, self._modes)
        for regression in reversed(done.regressions):
            joint = joint.extend(regression)
        return joint

    def probability(self, *nodes: str) -> Array:
        """P(nodes | evidence).

        Args:
            nodes: Discrete nodes that share a clique; neighbours in a chain do.

        Returns:
            One axis for each node, in this order.

        Raises:
            NetworkError: For other nodes.
        """
        for node in nodes:
            if node not in self._network.discrete:
                raise NetworkError(f"{node}: a discrete node of the network was expected")
        free = tuple(dict.fromkeys(n for n in nodes if n not in self._evidence))
        if len(set(nodes)) < len(nodes):
            raise NetworkError(f"{', '.join(nodes)}: a node is named twice; name each once")
        joint = self._holding(free)
        if joint is None:
            raise NetworkError(
                f"{', '.join(free)}: no clique of the tree holds them all; ask for fewer nodes"
            )
        table = joint.onto((), union(self._modes, free))
        p = np.exp(table.log).transpose([table.modes.index(n) for n in free])
        out = np.zeros([self._network.size(n) for n in nodes])
        out[tuple(cast(int, self._evidence[n]) if n in self._evidence else slice(None)
                  for n in nodes)] = p  # fmt: skip
        return out

    def _holding(self, names: Sequence[str]) -> Joint | None:
        for clique, joint in zip(self.cliques, self._joints, strict=True):
            if clique.variables.issuperset(names):
                return joint
        return None if names else Joint.nothing()

    def moments(self, node: str, given: Sequence[str] = ()) -> Mixture:
        """Mean and covariance of a Gaussian node for each value of some discrete ones.

        They are the exact moments, of what may itself be a mixture (see `mixture`).
        A mode of probability zero has some finite moments without a meaning.

        Args:
            node: A Gaussian node.
            given: Discrete nodes whose values are distinguished; unobserved.

        Raises:
            NetworkError: For other nodes.
        """
        modes = union(self._modes, tuple(given))
        if len(modes) < len(given):
            odd = next(g for g in given if g not in modes or list(given).count(g) > 1)
            raise NetworkError(f"{odd}: an unobserved discrete node, named once, was expected")
        if node in self._evidence:
            return self._observed(node)
        joint = self._holding((self._gaussian(node), *modes))
        if joint is None:
            joint = self._extended(self._home[node])
            if not set(modes) <= set(joint.modes):
                raise NetworkError(
                    f"{node} given {', '.join(given)}: no clique joins them; ask for fewer nodes"
                )
        return joint.onto((node,), modes).mixture(self._sizes)

    def mixture(self, node: str) -> Mixture:
        """The exact density of a Gaussian node: one Gaussian for each joint mode.

        Raises:
            NetworkError: When the node is not Gaussian.
        """
        if node in self._evidence:
            return self._observed(node)
        joint = self._extended(self._home[self._gaussian(node)])
        return joint.onto((node,), joint.modes).mixture(self._sizes)

    def _gaussian(self, node: str) -> str:
        if node not in self._network.gaussian:
            raise NetworkError(f"{node}: a Gaussian node of the network was expected")
        return node

    def _observed(self, node: str) -> Mixture:
        value = cast(Array, self._evidence[self._gaussian(node)])
        return Mixture((), np.ones(()), value, np.zeros((len(value), len(value))))

    def _extended(self, k: int) -> Joint:
        """A clique's posterior with all modes distinguished that its variables depend on."""
        clique = self.cliques[k]
        if not any(n in self._network.gaussian for n in clique.separator):
            return self._joints[k]
        above = self._extended(clique.parent)
        return self._descend(k, above, above.modes)


def infer(
    network: Network, evidence: Mapping[str, Value] | None = None, order: Sequence[str] = ()
) -> Posterior:
    """The exact posterior of a network by its strong junction tree.

    Args:
        network: A conditional linear Gaussian network.
        evidence: Node to observed value: a whole number, or a number or vector.
        order: Gaussian nodes to eliminate first, where that is known to be good.

    Raises:
        NetworkError: When a value does not fit its node, the evidence is impossible, or
            a clique is too large.
    """
    return Posterior(network, network.checked_evidence(evidence or {}), order)
