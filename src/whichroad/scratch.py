"""What recorded drives are localized on: made once for each thread, as new for each drive.

Making it takes as long as localizing some thirty fixes.
"""

import threading
from typing import Any

import numpy as np

from .core.belief import Belief, Route, new_belief, new_route
from .core.lookback import View, new_view
from .core.memory import Memory, enlarged, new_memory
from .core.switching import Work, new_work

_TREE = 1 << 15  # edges entered, for which there is room at first
_STEPS = 1 << 10  # that are remembered
_MOST_STEPS = 1 << 12  # for which room is kept: 10 MiB
_free = threading.local()  # `scratch`: each thread's, while nobody works on it


class Scratch:
    """Arrays for the kernels."""

    def __init__(self) -> None:
        self._new = {remembered: new_belief(remembered) for remembered in (False, True)}
        self._used = {remembered: new_belief(remembered) for remembered in (False, True)}
        self._work, self._route = new_work(), new_route(_TREE)
        self._view: View | None = None

    @classmethod
    def taken(cls) -> "Scratch":
        """This thread's; whoever asks before it is given back gets another."""
        return _free.__dict__.pop("scratch", None) or cls()

    def give_back(self) -> None:
        """Leave it to the next drive; nothing of it may be looked at any more."""
        _free.scratch = self

    @property
    def empty(self) -> Belief:
        """A belief that nobody writes to."""
        return self._new[False]

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
        if self._view is None:
            self._memory, self._view = new_memory(_STEPS), new_view()
        _renew(self._view.belief[2:], self._new[False][2:])  # the rest is written, then read
        self._memory.size[:] = 0
        self._memory.since[:] = 0.0
        return self._memory, self._view

    def enlarged(self, memory: Memory) -> Memory:
        """The same memory with room for more, kept for the drives to come unless it is huge."""
        larger = enlarged(memory)
        if len(larger.time) <= _MOST_STEPS:
            self._memory = larger
        return larger


def _renew(used: Any, new: Any) -> None:
    """Copy arrays."""
    for mine, its in zip(used, new, strict=True):
        np.copyto(mine, its)


def entered(route: Route) -> Route:
    """The edges that were entered, as arrays of their own."""
    size = max(int(route.size[0]), 1)
    return Route._make(a[:size].copy() for a in route)


def told_of(memory: Memory) -> Memory:
    """What was remembered, as arrays of its own that end with it, without the states.

    These are nine tenths of it, and nobody needs them who has looked back.
    """
    steps, nodes, links = memory.size.tolist()
    room = {len(memory.time): steps, len(memory.edge): nodes, len(memory.origin): links}
    room |= {len(memory.first_node): steps + 1, len(memory.first_link): nodes + 1}
    short = memory._replace(mean=memory.mean[:0], cov=memory.cov[:0])
    kept = (a[: room.get(len(a))].copy() for a in short[:-2])
    return Memory._make([*kept, memory.since.copy(), memory.size.copy()])
