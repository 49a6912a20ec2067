"""Drives of fixes alone, localized one behind the other: what a call costs is paid once."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from .core.epoch import CLOCK, Epochs
from .core.fleet import Chains, Passages, localize_each, pass_each
from .core.output import V_S, Output, new_output
from .localizer import NOTHING, lever_of, side_of
from .roadmap import RoadMap
from .route import Traversals
from .scratch import Scratch
from .settings import Settings, Vehicle

_EDGES = 16  # driven from one epoch to the next, for which there is room, and
_MORE_EDGES = 1 << 12


class Fleet(NamedTuple):
    """Drives, localized."""

    epochs: Epochs  # (n,) of all, one behind the other
    output: Output  # (n,)
    first: list[int]  # (d + 1,) the epoch at which each begins, and n
    way: Traversals  # (r,) of all
    first_edge: list[int]  # (d + 1,) where each route begins in it, and r

    def each(self) -> "list[Fleet]":
        """One by one."""
        return [
            Fleet(
                Epochs._make(column[low:high] for column in self.epochs),
                Output._make(column[low:high] for column in self.output),
                [0, high - low],
                Traversals._make(column[a:b] for column in self.way),
                [0, b - a],
            )
            for (low, high), (a, b) in zip(
                pairwise(self.first), pairwise(self.first_edge), strict=True
            )
        ]


def one_fleet(fleets: Sequence[Fleet]) -> Fleet:
    """Fleets one behind the other."""
    if len(fleets) == 1:
        return fleets[0]
    return Fleet(
        Epochs._make(map(np.concatenate, zip(*(f.epochs for f in fleets), strict=True))),
        Output._make(map(np.concatenate, zip(*(f.output for f in fleets), strict=True))),
        _bounds([f.first for f in fleets]),
        Traversals._make(map(np.concatenate, zip(*(f.way for f in fleets), strict=True))),
        _bounds([f.first_edge for f in fleets]),
    )


def _bounds(parts: Sequence[list[int]]) -> list[int]:
    """Where things begin, each part counting from the end of the one before."""
    counts = np.concatenate([np.diff(part) for part in parts])
    return [0, *map(int, np.cumsum(counts))]


def localize_fleet(
    roads: RoadMap, epochs: Epochs, first: list[int], vehicle: Vehicle, settings: Settings
) -> Fleet | None:
    """Localize drives on line, from their first fixes, as `localize_recorded` does each.

    Args:
        roads: The map.
        epochs: (n,) of the drives, each with a fix in every epoch and no odometry.
        first: (d + 1,) the epoch at which each begins, and n.
        vehicle: Of all.
        settings: The model's numbers.

    Returns:
        The first of the drives, up to one that needs more room than there is here; None: that
        is the first of them.
    """
    scratch = Scratch.taken()
    belief, work, route = scratch.renewed(False)
    n = len(epochs.time)
    room = _EDGES * n + _MORE_EDGES
    output, bounds = new_output(n, False), np.array(first)
    chains = Chains(
        np.zeros(len(first), np.int64), np.empty(room, np.int64), np.empty(room), np.empty(room)
    )
    done = localize_each(
        belief, scratch.empty, roads.arrays, route, work, epochs, output, bounds, chains, CLOCK,
        side_of(vehicle), lever_of(vehicle), settings.parameters(), settings.outage_after_s,
        settings.ambiguous_below, NOTHING,
    )  # fmt: skip
    scratch.give_back()
    if not done:
        return None
    if first[done] < n:
        n = first[done]
        epochs = Epochs._make(column[:n] for column in epochs)
        output = Output._make(column[:n] for column in output)
    bounds, begins = bounds[: done + 1], chains.first[: done + 1]
    rows = int(begins[-1])
    told = _passages(rows)
    pass_each(
        roads.arrays, epochs, output, np.ascontiguousarray(output.value[:, V_S]), bounds,
        chains._replace(first=begins), np.zeros(rows + 1, np.int64), told,
    )  # fmt: skip
    way = Traversals(
        chains.edge[:rows].copy(), told.enter_time, told.exit_time, told.enter_m, told.exit_m,
        told.p, told.gap > 0, told.rules,
    )  # fmt: skip
    return Fleet(epochs, output, bounds.tolist(), way, begins.tolist())


def _passages(rows: int) -> Passages:
    enter_time, exit_time, enter_m, exit_m, p = np.zeros((5, rows))
    gap, rules = np.zeros(rows, np.uint8), np.zeros(rows, np.int64)
    return Passages(enter_time, exit_time, enter_m, exit_m, p, gap, rules)
