"""Every chain through a small graph of hypotheses, one by one.

P(chain) = p(last) Π f,      f the shares along it
"""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from whichroad.core.belief import KEPT
from whichroad.core.memory import Memory, new_memory

Array = NDArray[np.float64]


class Chains(NamedTuple):
    """All chains, each a node of every step, and their probabilities."""

    nodes: NDArray[np.int64]  # (C, T)
    p: Array  # (C,)


def random_memory(seed: int, steps: int = 6, most: int = 4, edges: int = 4) -> Memory:
    """A graph of a few hypotheses a step with random shares, some of them none."""
    rng = np.random.default_rng([seed, 5])
    memory = new_memory(steps)
    before = node = link = 0
    for t in range(steps):
        count = int(rng.integers(1, most + 1))
        memory.first_node[t], memory.time[t], memory.epoch[t] = node, float(t), t
        p = rng.dirichlet(np.ones(count))
        for i in range(count):
            memory.p[node] = memory.smoothed[node] = p[i]
            memory.edge[node] = rng.integers(edges)
            memory.first_link[node] = link
            if t:
                share = rng.dirichlet(np.ones(before))
                share[(rng.random(before) < 0.4) & (share < share.max())] = 0.0
                for a in np.flatnonzero(share):
                    memory.origin[link], memory.share[link] = a, share[a] / share.sum()
                    link += 1
            node += 1
        before = count
    memory.first_node[steps], memory.first_link[node] = node, link
    memory.size[:] = steps, node, link
    assert node + KEPT <= len(memory.edge) + KEPT
    return memory


def share_of(memory: Memory, j: int, i: int) -> float:
    """f(j <- i), with i counted in all nodes."""
    step = int(np.searchsorted(memory.first_node[: memory.size[0] + 1], j, side="right")) - 1
    links = slice(memory.first_link[j], memory.first_link[j + 1])
    at = memory.origin[links] == i - memory.first_node[step - 1]
    return float(memory.share[links][at].sum())


def all_chains(memory: Memory) -> Chains:
    """Enumerate."""
    steps = int(memory.size[0])
    layers = [range(*memory.first_node[t : t + 2].tolist()) for t in range(steps)]
    nodes = np.array(list(itertools.product(*layers)))
    p = memory.p[nodes[:, -1]].copy()
    for t in range(1, steps):
        p *= [share_of(memory, j, i) for i, j in zip(nodes[:, t - 1], nodes[:, t], strict=True)]
    return Chains(nodes, p / p.sum())
