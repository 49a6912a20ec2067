"""What recorded drives are localized on: made once for each thread, as new for each drive.

Making it takes as long as localizing some thirty fixes.
"""

import threading
from typing import Any

import numpy as np

from .core.belief import Belief, Route, new_belief, new_route
from .core.lookback import View, new_view
from .core.memory import Memory, new_memory
from .core.switching import Work, new_work

_TREE = 1 << 15  # edges entered, for which there is room at first
_STEPS = 1 << 10  # that are remembered
_free = threading.local()  # `scratch`: each thread's, while nobody works on it


class Scratch:
    """Arrays for the kernels."""

    def __init__(self) -> None:
        self._new = {remembered: new_belief(remembered) for remembered in (False, True)}
        self._used = {remembered: new_belief(remembered) for remembered in (False, True)}
        self._work, self._route = new_work(), new_route(_TREE)
        self._new_view: View | None = None

    @classmethod
    def taken(cls) -> "Scratch":
        """This thread's; whoever asks before it is given back gets another."""
        return _free.__dict__.pop("scratch", None) or cls()

    def give_back(self) -> None:
        """Leave it to the next drive; nothing of it may be looked at any more."""
        _free.scratch = self

    def renewed(self, remembered: bool) -> tuple[Belief, Work, Route]:
        """An empty belief, scratch space for the kernels, an empty tree of edges."""
        used, new = self._used[remembered], self._new[remembered]
        _renew(used[2:], new[2:])  # rows of mean and cov are written before they are read
        self._work.row[:] = 0.0
        self._work.root[:] = 0.0
        self._route.size[0] = 0
        return used, self._work, self._route

    def back(self) -> tuple[Memory, View]:
        """An empty memory, and scratch space to look back."""
        if self._new_view is None:
            self._memory, self._view, self._new_view = new_memory(_STEPS), new_view(), new_view()
        _renew(self._view, self._new_view)
        self._memory.size[:] = 0
        self._memory.since[:] = 0.0
        return self._memory, self._view


def _renew(used: Any, new: Any) -> None:
    """Copy arrays, also those of the tuples within."""
    for mine, its in zip(used, new, strict=True):
        if isinstance(mine, tuple):
            _renew(mine, its)
        else:
            np.copyto(mine, its)


def trimmed(route: Route, memory: Memory) -> tuple[Route, Memory]:
    """What was entered and remembered, as arrays of its own that end with it."""
    steps, nodes, links = memory.size.tolist()
    room = {len(memory.time): steps, len(memory.edge): nodes, len(memory.origin): links}
    room |= {len(memory.first_node): steps + 1, len(memory.first_link): nodes + 1}
    kept = (a[: room.get(len(a))].copy() for a in memory[:-2])
    size = max(int(route.size[0]), 1)
    return (
        Route._make(a[:size].copy() for a in route),
        Memory._make([*kept, memory.since.copy(), memory.size.copy()]),
    )
