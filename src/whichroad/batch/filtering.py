"""Drives of fixes alone, filtered one after the other in the same buffers: a call is paid once."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from .._compile import Record, Records
from ..diagnosis.off_roads import off_road_findings
from ..diagnosis.sensors import sensor_findings
from ..diagnosis.snapped_places import snapped_findings
from ..epochs import Timeline, is_interpolated
from ..filter.lookback.history import new_history
from ..filter.lookback.passage import TRAVERSAL
from ..filter.lookback.smoother import smooth_span
from ..filter.many import Drives, localize_each, time_each
from ..filter.state import CLOCK
from ..filter.step import run
from ..filter.summary.estimate import Output, new_output
from ..filter.vetting.motion_sources import VETTING
from ..graph.network import records
from ..lookback.path import BestChains, Chain, heaviest_chain
from ..lookback.smoothing import Lag, spans_of
from ..lookback.traversals import Traversals, trimmed, untimed, without_glances, without_touches
from ..recorded import is_sparse
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle
from ..workspace import Workspace

_EDGES = 16  # driven from one epoch to the next, that the table holds
_MORE_EDGES = 1 << 12  # added to it
_VETTED = 64  # drives of which a sensor was withheld, in one call
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
    roads: RoadMap, epochs: Records, first: list[int], vehicle: Vehicle, settings: Settings,
    lag: Lag | None,
) -> tuple[Batch, list[tuple[str, ...]]] | None:  # fmt: skip
    """Filter drives from their first fixes, as `localize_recorded` does each.

    Args:
        roads: The map.
        epochs: (n,) EPOCH of the drives, each with a fix in every epoch and no odometry.
        first: (d + 1,) the epoch at which each begins, and n.
        vehicle: Of all.
        settings: The model's numbers.
        lag: By how much later knowledge epochs are answered; None: by what was known then.

    Returns:
        The first of the drives, up to one that the workspace is too small for, and what is said
        of the sensors of each; None: that is the first of them.
    """
    workspace = Workspace.taken()
    if lag is None:
        output, drives = _filtered(workspace, roads, epochs, first, vehicle, settings)
        notes = [
            _notes(drives.vetting[row], epochs[low:high]) if row >= 0 else ()
            for row, (low, high) in zip(drives.vetted.tolist(), pairwise(first), strict=False)
        ]
    else:
        smoother = _Smoother(workspace, roads, epochs, vehicle, settings, lag)
        output, drives, notes = smoother.smoothed(first)
    workspace.give_back()
    done = len(drives.first_epoch) - 1
    if not done:
        return None
    n = first[done]
    for findings in (off_road_findings, snapped_findings):
        for drive, finding in findings(
            epochs, output.rows, first[: done + 1], roads.arrays
        ).items():
            notes[drive] = (*notes[drive], finding.note)
    if n < len(epochs):
        epochs, output = epochs[:n], Output(output.rows[:n], output.alt_pose[:n])
    driven, first_edge = without_glances(drives.driven, drives.first_edge, roads.arrays)
    drives = drives._replace(driven=driven, first_edge=first_edge)
    time_each(roads.arrays, epochs, output.rows, drives, np.zeros(len(drives.driven) + 1, np.int64))
    driven, first_edge = trimmed(drives.driven, drives.first_edge)
    driven, first_edge = without_touches(driven, first_edge, roads.arrays)
    return Batch(epochs, output, drives.first_epoch.tolist(), driven, first_edge.tolist()), notes


def _filtered(
    workspace: Workspace, roads: RoadMap, epochs: Records, first: list[int], vehicle: Vehicle,
    settings: Settings,
) -> tuple[Output, Drives]:  # fmt: skip
    """Estimates and edges of the drives that the tables have room for, in one call."""
    n = len(epochs)
    output, bounds = new_output(n, False), np.array(first)
    drives = Drives(
        bounds, np.zeros(len(first), np.int64), records(_EDGES * n + _MORE_EDGES, TRAVERSAL),
        records(_VETTED, VETTING), np.zeros(len(first) - 1, np.int64),
    )  # fmt: skip
    ctx = workspace.context(roads.arrays, settings, vehicle, CLOCK)
    done = localize_each(
        workspace.belief(False), workspace.empty, workspace.path(), _NO_HISTORY, epochs, output,
        ctx, drives,
    )  # fmt: skip
    rows = int(drives.first_edge[done])
    vetted = drives.vetted[:done]
    return output, Drives(
        bounds[: done + 1], drives.first_edge[: done + 1], drives.driven[:rows].copy(),
        drives.vetting[: int(vetted.max(initial=-1)) + 1], vetted,
    )  # fmt: skip


def _notes(vetting: Record, epochs: Records) -> tuple[str, ...]:
    """What is said of the sensors of a drive."""
    if is_interpolated(epochs):  # a reader has said so
        vetting.repeats.seconds = 0.0
    return tuple(finding.note for finding in sensor_findings(vetting))


class _Smoother:
    """Drives filtered and smoothed one after the other in the same tables.

    The pointers to these are taken once, which takes longer than filtering some fixes.
    """

    def __init__(
        self, workspace: Workspace, roads: RoadMap, epochs: Records, vehicle: Vehicle,
        settings: Settings, lag: Lag,
    ) -> None:  # fmt: skip
        self._epochs, self._lag = epochs, lag
        ctx = workspace.context(roads.arrays, settings, vehicle, CLOCK)
        self._belief, self._path = workspace.belief(True), workspace.path()
        self._history, buffers = workspace.smoothing()
        self._begin_anew = workspace.begin_anew()
        self._filtered = filtered = new_output(len(epochs), False)
        self._output = output = new_output(len(epochs), False)
        self._vetting = self._belief.state[0].vetting
        self._run = run.bind(
            self._belief, self._path, self._history, epochs, filtered, ctx, ..., ...
        )
        self._smooth = smooth_span.bind(
            buffers, self._history, self._path, ctx, epochs, filtered, output, ...
        )
        self._chains = BestChains(self._history, self._path, roads.arrays)

    def smoothed(self, first: list[int]) -> tuple[Output, Drives, list[tuple[str, ...]]]:
        """Estimates and edges of the drives that there is room for, and notes on their sensors."""
        chains, notes = list[Chain](), list[tuple[str, ...]]()
        for low, high in pairwise(first):
            if not self._take(low, high):
                break
            chains.append(self._chain(low, high))
            notes.append(_notes(self._vetting, self._epochs[low:high]))
        driven, first_edge = untimed(chains)
        drives = Drives(
            np.array(first[: len(chains) + 1]), first_edge, driven, records(0, VETTING),
            np.full(len(chains), -1),
        )  # fmt: skip
        return self._output, drives, notes

    def _take(self, low: int, high: int) -> bool:
        """Filter and smooth the drive of these epochs; False: the tables are too small for it."""
        self._begin_anew()
        if self._run(low, high) < high:
            return False
        history, filtered = self._history, self._filtered.rows[low:high]
        self._output.rows[low:high] = filtered
        count = history.count[0]
        steps = int(count.steps)
        if steps == len(history.steps):
            return False
        if steps:
            own = self._epochs[low:high]
            spans = spans_of(self._lag, history, own, filtered, low)
            # the last step lasts until the next one: the drive's end stands for it meanwhile
            history.steps[steps].epoch = high
            count.steps = steps + 1
            for span in spans:
                self._smooth(span)
            count.steps = steps
        return True

    def _chain(self, low: int, high: int) -> Chain:
        """The most probable path of the drive taken last."""
        timeline = Timeline(self._epochs[low:high], CLOCK, 0)
        if not self._history.count[0].steps or is_sparse(timeline):
            return heaviest_chain(self._path, self._belief)
        return self._chains.found()
