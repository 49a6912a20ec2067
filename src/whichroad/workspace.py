"""Buffers that recorded drives are filtered with: kept by the process, reset per drive.

Allocating them takes as long as filtering some hundred fixes.
"""

from collections import deque
from collections.abc import Callable

import numpy as np

from ._compile import Records
from .filter.evidence.evidence_kinds import NO_EVIDENCE, Evidence
from .filter.lookback.history import History, enlarged, new_history
from .filter.lookback.smoother import SmootherBuffers, new_buffers
from .filter.state import Belief, Context, Path, new_belief, new_path, new_work
from .graph.network import Roads, bytes_of, clear, copied
from .settings import Settings, Vehicle, parameters

_ENTRIES = 1 << 15  # of the path tree, initial capacity
_STEPS = 1 << 10  # of the history, likewise
_MOST_STEPS = 1 << 12  # of a history that is kept for the next drive: 10 MiB
_MOST_KEPT = 16  # of them
_free: "deque[Workspace]" = deque(maxlen=_MOST_KEPT)  # those that no drive uses now


class Workspace:
    """Buffers for the kernels."""

    def __init__(self) -> None:
        self._empty = new_belief()
        self._beliefs = {lineage: new_belief(lineage) for lineage in (False, True)}
        self._work, self._path = new_work(), new_path(_ENTRIES)
        self._smoother: SmootherBuffers | None = None
        self._history = new_history(0)

    @classmethod
    def taken(cls) -> "Workspace":
        """One that nobody uses until it is given back."""
        try:
            return _free.pop()
        except IndexError:
            return cls()

    def give_back(self) -> None:
        """Leave it to the next drive; none of its arrays may be used any more."""
        _free.append(self)

    @property
    def empty(self) -> Belief:
        """A belief that nobody writes to."""
        return self._empty

    def belief(self, lineage: bool) -> Belief:
        """An empty belief, with lineage where its history is stored."""
        belief = self._beliefs[lineage]
        bytes_of(belief.state)[:] = bytes_of(self._empty.state)
        return belief

    def path(self) -> Path:
        """An empty path tree."""
        self._path.size[0] = 0
        return self._path

    def context(
        self, roads: Roads, settings: Settings, vehicle: Vehicle, mode: int,
        evidence: Evidence = NO_EVIDENCE,
    ) -> Context:  # fmt: skip
        """What is constant over a drive, with cleared buffers, and what further sensors say."""
        self._work.row[:] = 0.0
        work = self._work if evidence is NO_EVIDENCE else self._work._replace(evidence=evidence)
        return Context(parameters(settings, vehicle, mode), roads, work)

    def smoothing(self) -> tuple[History, SmootherBuffers]:
        """An empty history, and buffers to smooth it."""
        if self._smoother is None:
            self._history, self._smoother = new_history(_STEPS), new_buffers()
        for table in self._of_a_drive():
            clear(table)
        return self._history, self._smoother

    def _of_a_drive(self) -> tuple[Records, ...]:
        """What smoothing begins anew with each drive."""
        history = self._history
        state = () if self._smoother is None else (self._smoother.belief.state,)
        return (*state, history.count, history.since, history.reference)

    def begin_anew(self) -> Callable[[], None]:
        """What empties the buffers of a drive with lineage for the next one, without new views."""
        state, empty = (bytes_of(b.state) for b in (self._beliefs[True], self._empty))
        cleared = [np.asarray(bytes_of(table)) for table in self._of_a_drive()]
        cleared.append(self._work.row)
        size = self._path.size

        def empty_all() -> None:
            state[:] = empty
            size[0] = 0
            for table in cleared:
                table.fill(0)

        return empty_all

    def enlarged(self, history: History) -> History:
        """The same history with more capacity, kept for the drives to come unless it is huge."""
        larger = enlarged(history)
        if len(larger.steps) <= _MOST_STEPS:
            self._history = larger
        return larger


def entries_of(path: Path) -> Path:
    """The entries in use, as arrays of their own."""
    size = max(int(path.size[0]), 1)
    return Path(_first(path.entry, size), path.size.copy())


def without_states(history: History) -> History:
    """The rows in use, as arrays of their own, without the Gaussians.

    These are nine tenths of it, and a smoothed history needs them no more.
    """
    steps, nodes, links = history.count[0].tolist()
    return History(
        _first(history.steps, steps), _first(history.nodes, nodes), history.states[:0].copy(),
        _first(history.links, links), copied(history.since), copied(history.reference),
        copied(history.count),
    )  # fmt: skip


def _first(table: Records, rows: int) -> Records:
    """The first rows of a table, as an array of their own."""
    return copied(table.view(np.ndarray)[:rows])
