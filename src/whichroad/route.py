"""From the most probable chain of hypotheses to edges with times of entry and exit."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .core.belief import OFF_ROAD
from .core.epoch import Epochs
from .core.network import Roads
from .core.output import V_S
from .core.passage import drive_edges, turn_rules
from .localizer import Recorded
from .records import Array


class Traversal(NamedTuple):
    """One edge of the route."""

    edge: int
    enter_time: float  # s
    exit_time: float
    enter_m: float  # abscissa
    exit_m: float
    p: float  # mean probability of the edge while it was driven
    gap: bool  # does not join what came before
    rules: int = 0  # that driving into it and along it broke, see `core.network`


class Traversals(NamedTuple):
    """The edges of a route in driving order, (r,) each; see `Traversal`."""

    edge: NDArray[np.int64]
    enter_time: Array
    exit_time: Array
    enter_m: Array
    exit_m: Array
    p: Array
    gap: NDArray[np.bool_]
    rules: NDArray[np.int64]

    def rows(self) -> list[Traversal]:
        """One by one."""
        return [Traversal(*row) for row in zip(*(c.tolist() for c in self), strict=True)]


def _chain(recorded: Recorded) -> NDArray[np.int64]:
    """Places of the route's edges in its chain, repeats joined.

    An edge left for the open country and entered again further on is one edge.
    """
    on = np.flatnonzero(recorded.route_edge != OFF_ROAD)
    edge = recorded.route_edge[on]
    return np.asarray(on[np.append(True, edge[1:] != edge[:-1])[: len(on)]])


def traversals(epochs: Epochs, recorded: Recorded, roads: Roads) -> Traversals:
    """The route's edges, timed by the positions on them.

    Args:
        epochs: (n,) the drive.
        recorded: The filter's output and chain of edges.
        roads: The network.

    Returns:
        One per edge, in driving order.
    """
    chain = _chain(recorded)
    rows, n = len(chain), len(epochs.time)
    edge = recorded.route_edge[chain].astype(np.int64)
    entered = recorded.route_time[chain]
    first = np.append(np.searchsorted(epochs.time, entered), n).astype(np.int64)
    enter_time, exit_time, enter_m, exit_m, p = np.zeros((5, rows))
    gap, rules = np.zeros(rows, np.uint8), roads.rule[edge].astype(np.int64)
    if rows:
        turn_rules(roads, edge, rules)
        output = recorded.output
        known = np.flatnonzero(output.live > 0)
        drive_edges(
            roads, edge, entered, recorded.route_abscissa[chain], first, epochs.time, output.edge,
            np.ascontiguousarray(output.value[:, V_S]), output.alt_edge, output.alt_p,
            int(known[-1]) if len(known) else n - 1,
            enter_time, exit_time, enter_m, exit_m, p, gap,
        )  # fmt: skip
    return Traversals(edge, enter_time, exit_time, enter_m, exit_m, p, gap > 0, rules)
