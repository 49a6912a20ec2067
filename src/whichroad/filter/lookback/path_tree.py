"""The path tree: the edges that hypotheses have entered."""

from typing import Annotated, NamedTuple

import numpy as np

from ..._compile import Array, Ints, Records, kernel
from ...graph.network import records

_NO_EDGE = -2

PATH_ENTRY = np.dtype(
    [
        ("parent", "i8"),  # entry, -1: none
        ("time", "f8"),  # when the edge was entered, s
        ("along", "f8"),  # where, m
        ("edge", "i4"),
        ("share", "f4"),  # of the likely routes between two fixes that pass the edge; else 1
        ("route", "f4"),  # of these routes that is the one it belongs to; else 1
    ],
    align=True,
)


class Path(NamedTuple):
    """Tree of edges entered: follow `parent` back to get a hypothesis' path."""

    entry: Annotated[Records, Array(PATH_ENTRY, 1)]  # (n,)
    size: Ints  # (1,)


def new_path(capacity: int) -> Path:
    """An empty path tree."""
    entry = records(capacity, PATH_ENTRY)
    entry.edge = _NO_EDGE
    entry.parent = -1
    return Path(entry, np.zeros(1, np.int64))


@kernel
def enter(
    path: Path, edge: int, parent: int, time: float, along: float, share: float = 1.0,
    route: float = 1.0,
) -> int:  # fmt: skip
    """Add an entry to the path tree; returns its number, the parent when it is full."""
    new = int(path.size[0])
    if new >= len(path.entry):
        return parent
    entry = path.entry[new]
    entry.edge = edge
    entry.parent = parent
    entry.time = time
    entry.along = along
    entry.share = share
    entry.route = route
    path.size[0] = new + 1
    return new
