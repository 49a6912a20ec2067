"""The best path through the graph of merged hypotheses."""

import math

from ..._compile import Ints, Vector, entry, kernel
from .history import History

_LEAST_SHARE = 1e-3  # share of a node's weight up to which a link is not part of a path


@entry
def edge_probability(history: History, total: Vector) -> None:
    """Smoothed P of each node's edge at its step, components of one edge added up, (M,)."""
    nodes = history.nodes
    for step in range(history.count[0].steps):
        first = history.steps[step].first_node
        last = history.steps[step].end_node
        for i in range(first, last):
            total[i] = 0.0
            for j in range(first, last):
                if nodes[j].edge == nodes[i].edge:
                    total[i] += nodes[j].smoothed


@entry
def best_path(
    history: History, weight: Vector, p: Vector, score: Vector, back: Ints, path: Ints
) -> None:
    """The chain of linked nodes, one a step, of the largest Σ weight · P(edge).

    Links of hardly any share are left out.

    Args:
        history: The graph.
        weight: Of each step, (T,).
        p: P of each node's edge, (M,).
        score: Buffer, (M,).
        back: Buffer, (M,).
        path: Filled with nodes, (T,).
    """
    steps = history.count[0].steps
    best = -1
    for step in range(steps):
        before = best
        best = -1
        then = history.steps[step - 1].first_node if step > 0 else 0
        for j in range(history.steps[step].first_node, history.steps[step].end_node):
            top = _best_origin(history, then, j, score, back)
            if back[j] < 0:
                back[j] = before
                top = score[before] if before >= 0 else 0.0
            score[j] = top + weight[step] * p[j]
            if best < 0 or score[j] > score[best]:
                best = j
    for step in range(steps - 1, -1, -1):
        path[step] = best
        best = back[best]


@kernel
def _best_origin(history: History, then: int, j: int, score: Vector, back: Ints) -> float:
    """The best score of the nodes that node j came from; `back` of j is set, -1: none."""
    first = history.nodes[j].first_link
    end = history.nodes[j].end_link
    back[j] = -1
    top = -math.inf
    heaviest = 0.0
    for at in range(first, end):
        heaviest = max(heaviest, history.links[at].share)
    for at in range(first, end):
        share = history.links[at].share
        if share < min(_LEAST_SHARE, heaviest):
            continue
        i = then + history.links[at].origin
        if score[i] > top:
            top = score[i]
            back[j] = i
    return top
