"""What a walk along a graph reaches."""

import numpy as np
from numpy.typing import NDArray

from ..ragged import row_and_place
from .streets import Ints


def reached(seed: int, first: Ints, heads: Ints) -> NDArray[np.bool_]:
    """The nodes that a walk from `seed` reaches, itself among them.

    Args:
        seed: Where the walk begins.
        first: (n + 1,) bounds in `heads` of the links from each node.
        heads: Where each link leads.

    Returns:
        (n,) True for the nodes.
    """
    seen = np.zeros(len(first) - 1, dtype=bool)
    seen[seed] = True
    front: Ints = np.array([seed])
    while len(front):
        row, place = row_and_place(first[front + 1] - first[front])
        found = np.unique(heads[first[front][row] + place])
        front = found[~seen[found]]
        seen[front] = True
    return seen
