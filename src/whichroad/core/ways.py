"""The best way through the graph of merged hypotheses."""

import math

from ._jit import Ints, Vector, entry
from .memory import Memory

_SHARE = 1e-3  # a link of less is no way to go


@entry
def edge_probability(memory: Memory, total: Vector) -> None:
    """Smoothed P of each node's edge at its step, components of one edge added up, (M,)."""
    for step in range(memory.size[0]):
        first = memory.first_node[step]
        last = memory.first_node[step + 1]
        for i in range(first, last):
            total[i] = 0.0
            for j in range(first, last):
                if memory.edge[j] == memory.edge[i]:
                    total[i] += memory.smoothed[j]


@entry
def best_way(
    memory: Memory, weight: Vector, p: Vector, viterbi: bool, score: Vector, back: Ints, way: Ints
) -> None:
    """The chain of linked nodes, one a step, that is best.

    Either the one of the largest Σ weight · P(edge) along links of some share, or (Viterbi)
    the most probable single one, P(last) Π f.

    Args:
        memory: The graph.
        weight: What a step counts, (T,).
        p: P of each node's edge, (M,).
        viterbi: Which.
        score: Scratch, (M,).
        back: Scratch, (M,).
        way: Filled with nodes, (T,).
    """
    steps = memory.size[0]
    best = -1
    for step in range(steps):
        before = best
        best = -1
        then = memory.first_node[step - 1] if step > 0 else 0
        for j in range(memory.first_node[step], memory.first_node[step + 1]):
            back[j] = -1
            top = -math.inf
            heaviest = 0.0
            for link in range(memory.first_link[j], memory.first_link[j + 1]):
                heaviest = max(heaviest, memory.share[link])
            for link in range(memory.first_link[j], memory.first_link[j + 1]):
                share = memory.share[link]
                if share < min(_SHARE, heaviest):
                    continue
                i = then + memory.origin[link]
                value = score[i] + (math.log(share) if viterbi else 0.0)
                if value > top:
                    top = value
                    back[j] = i
            if back[j] < 0:
                back[j] = before
                top = score[before] if before >= 0 else 0.0
            score[j] = top if viterbi else top + weight[step] * p[j]
            value = score[j]
            if viterbi:
                value += math.log(max(memory.p[j], 1e-300))
            if best < 0 or value > score[best] + (
                math.log(max(memory.p[best], 1e-300)) if viterbi else 0.0
            ):
                best = j
    for step in range(steps - 1, -1, -1):
        way[step] = best
        best = back[best]
