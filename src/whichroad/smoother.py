"""Looking back over a drive: with a lag, or from its end.

The filter keeps a graph of its merged hypotheses (`core.memory`); from it comes what is known
of an epoch after more has been seen, and the route (`ways`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from .core.belief import ORIGINS, Belief, Route
from .core.epoch import Epochs
from .core.lookback import View, look_at, look_back, new_view
from .core.memory import Memory, enlarged, is_full, new_memory
from .core.output import V_SPEED, Output, new_output
from .core.parameters import Parameters
from .core.ways import edge_probability
from .errors import SettingError
from .records import Array
from .roadmap import RoadMap
from .settings import Settings
from .ways import Alternative, alternatives, tidied

FULL = "full"
SURE = 0.999  # P(edge) from which on it is decided
_WINDOW = 120.0  # s that are remembered on line, at least
_ROOM = 2048  # nodes of the route tree that one epoch may need
_HOP = 0.125  # of the lag, by which it may be longer: so many answers come from one look back


class Lag(NamedTuple):
    """How much later than an epoch its answer is given: infinite for the drive's end."""

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
                f'lag is {lag!r}; None, seconds from 0 on, "200m" (metres driven) or "{FULL}" was '
                "expected"
            )
        return cls(length, metres)

    def __str__(self) -> str:
        return FULL if math.isinf(self.length) else f"{self.length:g}{'m' if self.metres else 's'}"


class Past(NamedTuple):
    """What looking back needs to know of a drive; its states are let go once it has been done."""

    roads: RoadMap
    memory: Memory
    route: Route
    epochs: Epochs
    filtered: Output
    mode: int
    side: float
    parameters: Parameters
    outage_after: float
    ambiguous_below: float
    lag: Lag

    def ways(self) -> list[Alternative]:
        """The parts of the drive with the ways that compete."""
        return alternatives(self.memory, self.route, self.roads.arrays)

    def decided_until(self) -> float | None:
        """Seconds from the drive's start up to which the road is decided; None: nowhere."""
        steps, nodes, _ = self.memory.size.tolist()
        p = np.zeros(nodes)
        edge_probability(self.memory, p)
        top = np.maximum.reduceat(p, self.memory.first_node[:steps])
        sure = np.flatnonzero(top >= SURE)
        return float(self.memory.time[sure[-1]] - self.epochs.time[0]) if len(sure) else None


class Window:
    """The last seconds of a drive on line, to be looked back over.

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
        self.memory = new_memory(1 << 8)
        self._view, self._told = new_view(), new_output(1, False)

    def make_room(self, belief: Belief, route: Route) -> Route:
        """Forget what is older than anyone will ask for, before the next epoch.

        Args:
            belief: The filter's.
            route: Its tree of edges.

        Returns:
            The tree, or a tidy one.
        """
        memory = self.memory
        steps = int(memory.size[0])
        if is_full(memory):
            oldest = memory.time[steps - 1] - max(2.0 * self.lag, _WINDOW)
            drop = int(np.searchsorted(memory.time[:steps], oldest))
            self.memory = memory = enlarged(memory, min(drop, steps - 1), grow=2 * drop < steps)
        if len(route.edge) - route.size[0] < _ROOM:
            users = belief.node[: belief.size[0]], memory.tree[: memory.size[1]]
            route = tidied(route, *users)
        return route

    def forget_after(self, time: float, belief: Belief) -> None:
        """Take back the steps after a time to which the filter was taken back.

        Args:
            time: s.
            belief: The filter's, as it was then.
        """
        memory = self.memory
        steps = int(np.searchsorted(memory.time[: memory.size[0]], time, side="right"))
        nodes = memory.first_node[steps] if steps else 0
        memory.size[:] = steps, nodes, memory.first_link[nodes]
        first = memory.first_node[steps - 1] if steps else 0
        if nodes - first != belief.clock[ORIGINS]:
            belief.clock[ORIGINS] = 0.0
            memory.size[:] = 0

    def look(
        self, roads: RoadMap, route: Route, now: float, mode: int, side: float,
        settings: Settings, back: bool,
    ) -> tuple[Belief, Output, float | None] | None:  # fmt: skip
        """What is known of the moment the lag ago, and until when the road is decided.

        Args:
            roads: The map.
            route: The filter's tree of edges.
            now: Time of the last epoch, s.
            mode: What moves the vehicle.
            side: 1 where one drives on the right, −1 on the left.
            settings: The model's numbers.
            back: Whether the moment is asked for, or the decision alone.

        Returns:
            The belief and the output of one row, and the time; None where nothing reaches back
            so far.
        """
        memory = self.memory
        steps = int(memory.size[0])
        step = int(np.searchsorted(memory.time[:steps], now - self.lag, side="right")) - 1
        if steps == 0 or (back and step < 0):
            return None
        decided = look_at(
            memory, self._view, roads.arrays, route, self._told, step if back else -1, mode, side,
            settings.parameters(), settings.outage_after_s, settings.ambiguous_below, SURE,
        )  # fmt: skip
        until = float(memory.time[decided]) if decided >= 0 else None
        return self._view.belief, self._told, until


def travelled(past: Past) -> Array:
    """Metres driven at each epoch, by the filter's speeds."""
    dt = np.diff(past.epochs.time, prepend=past.epochs.time[:1])
    return np.asarray(np.cumsum(np.abs(past.filtered.value[:, V_SPEED]) * np.clip(dt, 0.0, None)))


def smooth(past: Past, view: View | None = None) -> Output:
    """Answer every epoch by what was known the lag later.

    A fixed lag may be longer by an eighth, as one look back answers for several epochs.

    Args:
        past: The drive.
        view: Scratch space, as new; None: it is made.

    Returns:
        What is known of each epoch; of those before the first answer nothing.
    """
    told = Output._make(a.copy() for a in past.filtered)
    steps = int(past.memory.size[0])
    if not steps or past.lag.length == 0.0:
        return told
    epochs = past.epochs
    view = view or new_view()
    for known, first, last in _looks(past, steps):
        look_back(
            past.memory, view, past.roads.arrays, past.route, epochs, past.filtered, told, known,
            first, last, past.mode, past.side, past.parameters, past.outage_after,
            past.ambiguous_below,
        )  # fmt: skip
    return told


def _looks(past: Past, steps: int) -> list[tuple[int, int, int]]:
    """Looks back: from which step, and which steps are answered: first, one past the last."""
    lag = past.lag
    if math.isinf(lag.length):
        return [(steps - 1, 0, steps)]
    epoch = past.memory.epoch[:steps]
    at = travelled(past)[epoch] if lag.metres else past.memory.time[:steps]
    looks = []
    first = 0
    while first < steps:
        known = int(np.searchsorted(at, at[first] + (1.0 + _HOP) * lag.length))
        last = steps
        if known < steps - 1:
            last = int(np.searchsorted(at, at[known] - lag.length, side="right"))
        last = max(min(last, known + 1), first + 1)
        looks.append((min(known, steps - 1), first, last))
        first = last
    return looks
