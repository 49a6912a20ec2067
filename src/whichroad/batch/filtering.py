"""Drives of fixes alone, filtered one after the other in one call: its cost is paid once."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from .._compile import Records
from ..filter.lookback.history import new_history
from ..filter.lookback.passage import TRAVERSAL
from ..filter.many import Drives, localize_each, time_each
from ..filter.state import CLOCK
from ..filter.summary.estimate import Output, new_output
from ..graph.network import records
from ..lookback.traversals import Traversals, trimmed
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle
from ..workspace import Workspace

_EDGES = 16  # driven from one epoch to the next, that the table holds
_MORE_EDGES = 1 << 12  # added to it
_NO_HISTORY = new_history(0)


class Batch(NamedTuple):
    """Drives and their estimates."""

    epochs: Records  # (n,) EPOCH of all, one after the other
    output: Output  # (n,)
    first: list[int]  # (d + 1,) the epoch at which each begins, and n
    driven: Traversals  # (r,) of all
    first_edge: list[int]  # (d + 1,) where each path begins in it, and r

    def each(self) -> "list[Batch]":
        """One by one."""
        return [
            Batch(
                self.epochs[low:high],
                Output(self.output.rows[low:high], self.output.alt_pose[low:high]),
                [0, high - low],
                self.driven[a:b],
                [0, b - a],
            )
            for (low, high), (a, b) in zip(
                pairwise(self.first), pairwise(self.first_edge), strict=True
            )
        ]


def one_batch(batches: Sequence[Batch]) -> Batch:
    """Batches one after the other."""
    if len(batches) == 1:
        return batches[0]
    return Batch(
        _concatenated([b.epochs for b in batches]),
        Output(
            _concatenated([b.output.rows for b in batches]),
            np.concatenate([b.output.alt_pose for b in batches]),
        ),
        _bounds([b.first for b in batches]),
        _concatenated([b.driven for b in batches]),
        _bounds([b.first_edge for b in batches]),
    )


def _concatenated(parts: Sequence[Records]) -> Any:
    """Tables one after the other."""
    table = records(sum(map(len, parts)), parts[0].dtype)
    np.concatenate(parts, out=table)
    return table


def _bounds(parts: Sequence[list[int]]) -> list[int]:
    """Where things begin, each part counting from the end of the one before."""
    counts = np.concatenate([np.diff(part) for part in parts])
    return [0, *map(int, np.cumsum(counts))]


def filter_batch(
    roads: RoadMap, epochs: Records, first: list[int], vehicle: Vehicle, settings: Settings
) -> Batch | None:
    """Filter drives from their first fixes, as `localize_recorded` does each.

    Args:
        roads: The map.
        epochs: (n,) EPOCH of the drives, each with a fix in every epoch and no odometry.
        first: (d + 1,) the epoch at which each begins, and n.
        vehicle: Of all.
        settings: The model's numbers.

    Returns:
        The first of the drives, up to one that the workspace is too small for; None: that
        is the first of them.
    """
    workspace = Workspace.taken()
    n = len(epochs)
    output, bounds = new_output(n, False), np.array(first)
    drives = Drives(
        bounds, np.zeros(len(first), np.int64), records(_EDGES * n + _MORE_EDGES, TRAVERSAL)
    )
    ctx = workspace.context(roads.arrays, settings, vehicle, CLOCK)
    done = localize_each(
        workspace.belief(False), workspace.empty, workspace.path(), _NO_HISTORY, epochs, output,
        ctx, drives,
    )  # fmt: skip
    workspace.give_back()
    if not done:
        return None
    if first[done] < n:
        n = first[done]
        epochs, output = epochs[:n], Output(output.rows[:n], output.alt_pose[:n])
    rows = int(drives.first_edge[done])
    drives = Drives(bounds[: done + 1], drives.first_edge[: done + 1], drives.driven[:rows].copy())
    time_each(roads.arrays, epochs, output.rows, drives, np.zeros(rows + 1, np.int64))
    driven, first_edge = trimmed(drives.driven, drives.first_edge)
    return Batch(epochs, output, drives.first_epoch.tolist(), driven, first_edge.tolist())
