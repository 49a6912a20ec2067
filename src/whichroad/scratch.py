"""What recorded drives are localized on: made once for each thread, as new for each drive.

Making it takes as long as localizing some thirty fixes.
"""

import threading

import numpy as np

from .core.belief import Belief, Route, new_belief, new_route
from .core.switching import Work, new_work

_TREE = 1 << 15  # edges entered, for which there is room at first
_free = threading.local()  # `scratch`: each thread's, while nobody works on it


class Scratch:
    """Arrays for the kernels."""

    def __init__(self) -> None:
        self._new = {remembered: new_belief(remembered) for remembered in (False, True)}
        self._used = {remembered: new_belief(remembered) for remembered in (False, True)}
        self._work, self._route = new_work(), new_route(_TREE)

    @classmethod
    def taken(cls) -> "Scratch":
        """This thread's; whoever asks before it is given back gets another."""
        return _free.__dict__.pop("scratch", None) or cls()

    def give_back(self) -> None:
        """Leave it to the next drive; nothing of it may be looked at any more."""
        _free.scratch = self

    def renewed(self, remembered: bool) -> tuple[Belief, Work, Route]:
        """An empty belief, scratch space for the kernels, an empty tree of edges."""
        for name in Belief._fields:
            np.copyto(getattr(self._used[remembered], name), getattr(self._new[remembered], name))
        self._work.row[:] = 0.0
        self._work.root[:] = 0.0
        self._route.size[0] = 0
        return self._used[remembered], self._work, self._route
