"""The strong junction tree: moralise, eliminate the continuous first, collect the cliques.

Lauritzen (1992): an elimination order in which every continuous variable comes before
every discrete one triangulates the moral graph strongly, so that each clique can send
towards the root without approximation.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from .gaussian_network import Network

Graph = dict[str, set[str]]


@dataclass(frozen=True, slots=True)
class Clique:
    """One clique, parents before children in the list that holds it.

    Attributes:
        variables: All of them.
        residual: Those that are eliminated here, in this order: continuous, then discrete.
        separator: The rest, shared with the parent.
        parent: Its number, -1 for the root of a component.
    """

    variables: frozenset[str]
    residual: tuple[str, ...]
    separator: frozenset[str]
    parent: int


def moralise(network: Network, observed: Collection[str]) -> Graph:
    """Join each node to its parents and these to one another; then leave out what is observed.

    In this order: the parents of an observed child depend on one another.
    """
    families = [{d.name, *d.parents} for d in network.discrete.values()]
    families += [{g.name, *g.modes, *(g.parents or {})} for g in network.gaussian.values()]
    graph: Graph = {name: set() for family in families for name in family}
    for family in families:
        for name in family:
            graph[name] |= family
    return {
        name: joined - {name} - set(observed)
        for name, joined in graph.items()
        if name not in observed
    }


def eliminate(
    graph: Graph, network: Network, first: Sequence[str]
) -> tuple[list[str], dict[str, set[str]]]:
    """A strong elimination order, and each variable's neighbours when it is eliminated.

    After those of `first`, always the one with the smallest clique: discrete
    configurations, then continuous dimension, then the network's order.
    """
    graph = {name: set(joined) for name, joined in graph.items()}
    order: list[str] = []
    neighbours: dict[str, set[str]] = {}

    def weight(name: str) -> tuple[int, int]:
        clique = {name, *graph[name]}
        return (
            math.prod(network.size(v) for v in clique if v in network.discrete),
            sum(network.size(v) for v in clique if v in network.gaussian),
        )

    for kind in (network.gaussian, network.discrete):
        left = [name for name in kind if name in graph]
        queue = [name for name in first if name in left]
        while left:
            name = queue.pop(0) if queue else min(left, key=weight)
            left.remove(name)
            joined = graph.pop(name)
            order.append(name)
            neighbours[name] = joined
            for other in joined:
                graph[other] |= joined
                graph[other] -= {name, other}
    return order, neighbours


def cliques(order: Sequence[str], neighbours: Mapping[str, set[str]]) -> list[Clique]:
    """Maximal cliques as a tree, parents first; the last one eliminated is in a strong root.

    A variable whose neighbours are the whole clique of the one eliminated next among
    them makes no clique of its own.
    """
    home: dict[str, int] = {}
    made: list[tuple[frozenset[str], list[str], frozenset[str], int]] = []
    place = {name: k for k, name in enumerate(order)}
    for name in reversed(order):
        joined = frozenset(neighbours[name])
        up = home[min(joined, key=place.__getitem__)] if joined else -1
        if up >= 0 and joined == made[up][0]:
            variables, residual, separator, parent = made[up]
            made[up] = (variables | {name}, [name, *residual], separator, parent)
            home[name] = up
        else:
            home[name] = len(made)
            made.append((joined | {name}, [name], joined, up))
    return [Clique(v, tuple(r), s, p) for v, r, s, p in made]
