"""Where the nodes lie that lines name, and which lines name them in the other order."""

import numpy as np
from numpy.typing import NDArray

from .streets import Ints


def drawn_back(node: Ints, place: Ints) -> NDArray[np.bool_]:
    """Which lines are drawn from their second node to their first one.

    The lines of a node have one place in common.  Where more of them agree with the other order
    of a line's nodes, and that order has one of the two in its place, it is the order.

    Args:
        node: (2 n,) numbers of nodes from 0, line by line: the first, the second.
        place: (2 n,) numbers from 0 of the places where the lines begin and end, in that order.

    Returns:
        (n,) whether they are.
    """
    turned = place.reshape(-1, 2)[:, ::-1].ravel()
    pair, of = np.unique(_pairs(node, place, turned), return_inverse=True)
    votes = np.bincount(of, minlength=len(pair)).astype(np.float64)
    # of two orders that fit alike, that of a node's first line
    votes[of[np.unique(node, return_index=True)[1]]] += 0.01
    most = np.zeros(node.max(initial=-1) + 1)
    np.maximum.at(most, np.concatenate([node, node]), votes[of])
    straight, back = votes[of].reshape(2, -1, 2)
    at_home = (back == most[node].reshape(-1, 2)).any(axis=1)
    drawn: NDArray[np.bool_] = at_home & (back.sum(axis=1) > straight.sum(axis=1))
    return drawn


def homes(node: Ints, place: Ints) -> Ints:
    """The end that stands for each node: the first of those where most of its lines have it.

    Args:
        node: (2 n,) numbers of nodes from 0, none left out.
        place: (2 n,) numbers of places from 0.

    Returns:
        (N,) numbers of ends.
    """
    _, first, count = np.unique(_pairs(node, place), return_index=True, return_counts=True)
    order = np.lexsort((first, -count, node[first]))
    best = order[np.unique(node[first[order]], return_index=True)[1]]
    found: Ints = first[best]
    return found


def _pairs(node: Ints, *places: Ints) -> Ints:
    """One number for each node at each of its places."""
    span = len(node) + 1
    return np.concatenate([node * span + place for place in places])
