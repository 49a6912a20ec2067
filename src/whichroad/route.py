"""From the most probable chain of hypotheses to edges with times of entry and exit."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .core.belief import OFF_ROAD
from .core.epoch import Epochs
from .core.network import Roads
from .core.output import (
    V_S,
)
from .localizer import Recorded
from .records import Array


@dataclass(frozen=True, slots=True)
class Traversal:
    """One edge of the route."""

    edge: int
    enter_time: float  # s
    exit_time: float
    enter_m: float  # abscissa
    exit_m: float
    p: float  # mean filtered probability of the edge while it was driven
    gap: bool  # does not join what came before


def _chain(recorded: Recorded) -> list[tuple[int, int]]:
    """Edges of the route with the number of their node, repeats joined.

    An edge left for the open country and entered again further on is one edge.
    """
    chain: list[tuple[int, int]] = []
    for node, edge in enumerate(recorded.route_edge.tolist()):
        if edge == OFF_ROAD or (chain and chain[-1][0] == edge):
            continue
        chain.append((edge, node))
    return chain


def _joins(roads: Roads, a: int, b: int) -> bool:
    return bool((roads.succ[roads.succ_first[a] : roads.succ_first[a + 1]] == b).any())


def traversals(epochs: Epochs, recorded: Recorded, roads: Roads) -> list[Traversal]:
    """The route's edges, timed by the filtered positions on them.

    An edge's time of entry is interpolated between the last epoch before it and the
    first one on it; the hand-over between hypotheses itself happens a little late or
    early.

    Args:
        epochs: (n,) the drive.
        recorded: The filter's output and chain of edges.
        roads: The network.

    Returns:
        One per edge, in driving order.
    """
    chain = _chain(recorded)
    if not chain:
        return []
    entered = recorded.route_time[[node for _, node in chain]]
    starts = np.searchsorted(epochs.time, entered)
    n = len(epochs.time)
    rows: list[Traversal] = []
    known = np.flatnonzero(recorded.output.live > 0)
    last_epoch = int(known[-1]) if len(known) else n - 1
    for i, (edge, _) in enumerate(chain):
        lo = int(starts[i])
        hi = int(starts[i + 1]) if i + 1 < len(chain) else last_epoch + 1
        on = lo + np.flatnonzero(recorded.output.edge[lo:hi] == edge)
        length = float(roads.length[edge])
        gap = i > 0 and not _joins(roads, chain[i - 1][0], edge)
        last = i + 1 == len(chain)
        gap_after = not last and not _joins(roads, edge, chain[i + 1][0])
        s = recorded.output.value[on, V_S]
        first_s = float(s[0]) if len(on) else 0.0
        last_s = float(s[-1]) if len(on) else length
        p = float(np.mean(_probability(recorded, on, edge))) if len(on) else 0.0
        leave = float(epochs.time[min(hi, n - 1)])
        enter_m = first_s if i == 0 or gap else 0.0
        exit_m = max(last_s, enter_m) if last or gap_after else length
        if i > 0 and roads.opposite[edge] == chain[i - 1][0]:  # turned round on the way
            enter_m = length - rows[-1].exit_m
            exit_m = max(exit_m, enter_m)
        if not last and roads.opposite[edge] == chain[i + 1][0]:
            exit_m = max(min(float(s.max()), length) if len(on) else enter_m, enter_m)
        rows.append(Traversal(edge, float(entered[i]), leave, enter_m, exit_m, p, gap))
    return _timed(rows, epochs, recorded, roads, starts)


def _probability(recorded: Recorded, on: NDArray[np.int64], edge: int) -> Array:
    at = recorded.output.alt_edge[on] == edge
    return np.asarray((recorded.output.alt_p[on] * at).sum(axis=1), float)


def _timed(
    rows: list[Traversal],
    epochs: Epochs,
    recorded: Recorded,
    roads: Roads,
    starts: NDArray[np.int64],
) -> list[Traversal]:
    """Interpolate the times at which the nodes were passed from distances along the route."""
    base = np.concatenate([[0.0], np.cumsum([r.exit_m - r.enter_m for r in rows])])
    at, when = [], []
    for i, r in enumerate(rows):
        lo = int(starts[i])
        hi = int(starts[i + 1]) if i + 1 < len(rows) else len(epochs.time)
        on = lo + np.flatnonzero(recorded.output.edge[lo:hi] == r.edge)
        at.append(base[i] + np.clip(recorded.output.value[on, V_S] - r.enter_m, 0.0, None))
        when.append(epochs.time[on])
    distance, time = np.concatenate(at), np.concatenate(when)
    if len(distance) < 2:
        return rows
    distance = np.maximum.accumulate(distance)
    keep = np.concatenate([[True], np.diff(distance) > 1e-6])
    passed = np.interp(base, distance[keep], time[keep])
    passed[0] = rows[0].enter_time
    passed[-1] = rows[-1].exit_time
    passed = np.maximum.accumulate(passed)
    return [
        replace(r, enter_time=float(passed[i]), exit_time=float(passed[i + 1]))
        for i, r in enumerate(rows)
    ]
