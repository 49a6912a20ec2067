"""Every chain through a small graph of hypotheses, one by one.

P(chain) = p(last) Π f,      f the shares along it
"""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whichroad.filter.lookback.history import History, new_history

Array = NDArray[np.float64]


class Chains(NamedTuple):
    """All chains, each a node of every step, and their probabilities."""

    nodes: NDArray[np.int64]  # (C, T)
    p: Array  # (C,)


def random_history(seed: int, steps: int = 6, most: int = 4, edges: int = 4) -> History:
    """A graph of a few hypotheses a step with random shares, some of them none."""
    rng = np.random.default_rng([seed, 5])
    history = new_history(steps)
    before = node = link = 0
    for t in range(steps):
        count = int(rng.integers(1, most + 1))
        step = history.steps[t]
        step.first_node, step.end_node, step.time, step.epoch = node, node + count, float(t), t
        p = rng.dirichlet(np.ones(count))
        for i in range(count):
            row = history.nodes[node]
            row.p, row.smoothed, row.edge = p[i], p[i], rng.integers(edges)
            row.first_link = link
            if t:
                share = rng.dirichlet(np.ones(before))
                share[(rng.random(before) < 0.4) & (share < share.max())] = 0.0
                for a in np.flatnonzero(share):
                    history.links[link] = a, share[a] / share.sum()
                    link += 1
            row.end_link = link
            node += 1
        before = count
    history.count[0] = steps, node, link
    return history


def shares_of(history: History) -> Array:
    """f(j <- i) of all pairs of nodes, (n, n); 0 where no link is."""
    steps, count, _ = history.count[0].tolist()
    shares = np.zeros((count, count))
    for before, step in itertools.pairwise(history.steps[:steps]):
        for j in range(step.first_node, step.end_node):
            node = history.nodes[j]
            links = history.links[node.first_link : node.end_link]
            np.add.at(shares[j], before.first_node + links.origin, links.share)
    return shares


def all_chains(history: History) -> Chains:
    """Enumerate."""
    steps = history.steps[: history.count[0].steps]
    layers = [range(int(step.first_node), int(step.end_node)) for step in steps]
    nodes = np.array(list(itertools.product(*layers)))
    p = history.nodes.p[nodes[:, -1]] * shares_of(history)[nodes[:, 1:], nodes[:, :-1]].prod(axis=1)
    return Chains(nodes, p / p.sum())
