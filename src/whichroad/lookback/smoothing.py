"""Smoothing a drive: with a lag, or from its end.

The filter keeps a graph of its merged hypotheses (`filter.lookback.history`).  From it come the
estimates of an epoch after more was observed, and the path (`path`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from .._compile import Records
from ..errors import SettingError
from ..filter.lookback.best_path import edge_probability
from ..filter.lookback.history import History, enlarged, is_full, new_history
from ..filter.lookback.smoother import SmootherBuffers, Span, new_buffers, smooth_span, smooth_step
from ..filter.state import Belief, Context, Path
from ..filter.summary.estimate import Estimates, Output, new_output
from ..graph.network import copied
from ..observations import Array
from ..roadmap import RoadMap
from .path import Alternative, alternatives, tidied

FULL = "full"
SURE = 0.999  # P(edge) from which on it is decided
_WINDOW = 120.0  # s, shortest history kept on line
_SPARE_ENTRIES = 2048  # entries of the path tree that one epoch may need
_SLACK = 0.125  # largest excess over the lag, relative, so that one pass serves several epochs


class Lag(NamedTuple):
    """How much later than an epoch its estimate is given: infinite for the drive's end."""

    length: float
    metres: bool = False

    @classmethod
    def of(cls, lag: Any) -> "Lag | None":
        """A lag from None, seconds, "full", "10s" or "200m".

        Raises:
            SettingError: It is something else.
        """
        if lag is None or isinstance(lag, Lag):
            return lag
        text = str(lag).strip().lower()
        if text == FULL:
            return cls(math.inf)
        metres = text.endswith("m")
        try:
            length = float(text.removesuffix("m").removesuffix("s"))
        except ValueError:
            length = -1.0
        if isinstance(lag, bool) or not length >= 0.0:  # not a number: neither
            raise SettingError(
                f'lag is {lag!r}; seconds (10), metres driven ("200m") or "{FULL}" was expected'
            )
        return cls(length, metres)

    def __str__(self) -> str:
        return FULL if math.isinf(self.length) else f"{self.length:g}{'m' if self.metres else 's'}"


class Past(NamedTuple):
    """What smoothing needs to know of a drive; its states may be dropped afterwards."""

    roads: RoadMap
    history: History
    path: Path
    epochs: Records  # (n,) EPOCH
    filtered: Output
    lag: Lag

    def alternatives(self, *, told: bool = True) -> list[Alternative]:
        """The parts of the drive with their competing routes; `told` as in `path.alternatives`."""
        return alternatives(self.history, self.path, self.roads.arrays, told=told)

    def decided_until(self) -> float | None:
        """Seconds from the drive's start up to which the road is decided; None: nowhere."""
        steps, nodes, _ = self.history.count[0].tolist()
        p = np.zeros(nodes)
        edge_probability(self.history, p)
        top = np.maximum.reduceat(p, self.history.steps.first_node[:steps])
        sure = np.flatnonzero(top >= SURE)
        if not len(sure):
            return None
        return float(self.history.steps.time[sure[-1]] - self.epochs.time[0])


class Window:
    """The last seconds of a drive on line, to be smoothed.

    Args:
        lag: Seconds.

    Raises:
        SettingError: It is no number of seconds.
    """

    def __init__(self, lag: Any) -> None:
        given = Lag.of(lag)
        if given is None or given.metres or math.isinf(given.length):
            raise SettingError(f"lag is {lag!r}; a number of seconds was expected on line")
        self.lag = given.length
        self.history = new_history(1 << 8)
        self._buffers, self._output = new_buffers(), new_output(1, False)

    def ensure_capacity(self, belief: Belief, path: Path) -> Path:
        """Drop what is older than can be asked for, before the next epoch.

        Args:
            belief: The filter's.
            path: Its tree of edges entered.

        Returns:
            The tree, or a tidied copy.
        """
        history = self.history
        steps = int(history.count[0].steps)
        if is_full(history):
            oldest = history.steps.time[steps - 1] - max(2.0 * self.lag, _WINDOW)
            drop = int(np.searchsorted(history.steps.time[:steps], oldest))
            self.history = history = enlarged(history, min(drop, steps - 1), grow=2 * drop < steps)
        if len(path.entry) - path.size[0] < _SPARE_ENTRIES:
            path = tidied(path, *entries_in_use(belief, history))
        return path

    def forget_after(self, time: float, belief: Belief) -> None:
        """Take back the steps after a time to which the filter was taken back.

        Args:
            time: s.
            belief: The filter's, as it was then.
        """
        history = self.history
        count = history.count[0]
        steps = int(np.searchsorted(history.steps.time[: count.steps], time, side="right"))
        first = int(history.steps[steps - 1].first_node) if steps else 0
        nodes = int(history.steps[steps - 1].end_node) if steps else 0
        links = int(history.nodes[nodes - 1].end_link) if nodes else 0
        count.steps, count.nodes, count.links = steps, nodes, links
        if nodes - first != belief.state[0].parents:
            belief.state[0].parents = 0
            count.steps, count.nodes, count.links = 0, 0, 0

    def smoothed_at(
        self, ctx: Context, path: Path, now: float, back: bool
    ) -> tuple[Belief, Output, float | None] | None:
        """What is known of the moment the lag ago, and until when the road is decided.

        Args:
            ctx: The filter's constants.
            path: Its tree of edges entered.
            now: Time of the last epoch, s.
            back: Whether the moment is asked for, or the decision alone.

        Returns:
            The belief and the output of one row, and the time; None where the history does not
            reach back so far.
        """
        history = self.history
        steps = int(history.count[0].steps)
        time = history.steps.time[:steps]
        step = int(np.searchsorted(time, now - self.lag, side="right")) - 1
        if steps == 0 or (back and step < 0):
            return None
        decided = smooth_step(
            self._buffers, history, path, ctx, self._output, step if back else -1, SURE
        )
        until = float(time[decided]) if decided >= 0 else None
        return self._buffers.belief, self._output, until


def entries_in_use(belief: Belief, history: History) -> tuple[Any, Any]:
    """Entries of the path tree that hypotheses and nodes refer to, as views of the records."""
    count = int(belief.state[0].count)
    return belief.hyp.path_entry[:count], history.nodes.path_entry[: history.count[0].nodes]


def travelled(epochs: Records, filtered: Estimates) -> Array:
    """Metres driven at each epoch, by the filter's speeds."""
    dt = np.diff(epochs.time, prepend=epochs.time[:1])
    return np.asarray(np.cumsum(np.abs(filtered.speed) * np.clip(dt, 0.0, None)))


def smooth(past: Past, ctx: Context, buffers: SmootherBuffers | None = None) -> Output:
    """Estimate every epoch by what was known the lag later.

    A fixed lag may be longer by an eighth, as one backward pass serves several epochs.

    Args:
        past: The drive.
        ctx: The constants that it was filtered with.
        buffers: Buffers, as new; None: they are made.

    Returns:
        An estimate of each epoch; those before the first estimate stay empty.
    """
    output = Output(copied(past.filtered.rows), past.filtered.alt_pose.copy())
    if not past.history.count["steps"][0]:
        return output
    buffers = buffers or new_buffers()
    smooth_one = smooth_span.bind(
        buffers, past.history, past.path, ctx, past.epochs, past.filtered, output, ...
    )
    for span in spans_of(past.lag, past.history, past.epochs, past.filtered.rows):
        smooth_one(span)
    return output


def spans_of(
    lag: Lag, history: History, epochs: Records, filtered: Estimates, first: int = 0
) -> list[Span]:
    """The backward passes that together estimate all steps of a drive.

    Args:
        lag: Later than each by so much.
        history: The graph; it has steps.
        epochs: (n,) EPOCH of the drive.
        filtered: (n,) the filter's estimates.
        first: By what number its steps know the first epoch.
    """
    steps = int(history.count["steps"][0])
    if lag.length == 0.0:
        return []
    if math.isinf(lag.length):
        return [Span(steps - 1, 0, steps)]
    at = np.ascontiguousarray(history.steps.time[:steps])
    if lag.metres:
        at = travelled(epochs, filtered)[history.steps.epoch[:steps] - first]
    spans = []
    step = 0
    while step < steps:
        known = int(np.searchsorted(at, at[step] + (1.0 + _SLACK) * lag.length))
        last = steps
        if known < steps - 1:
            last = int(np.searchsorted(at, at[known] - lag.length, side="right"))
        last = max(min(last, known + 1), step + 1)
        spans.append(Span(min(known, steps - 1), step, last))
        step = last
    return spans
