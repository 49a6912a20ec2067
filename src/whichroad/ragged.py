"""Lists of unequal length, laid end to end in one array."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def row_and_place(count: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each item of the lists stands.

    Args:
        count: (n,) items of each list.

    Returns:
        By item: the number of its list, and its place in the list, from 0.
    """
    row = np.repeat(np.arange(len(count)), count)
    return row, np.arange(len(row)) - (np.cumsum(count) - count)[row]
