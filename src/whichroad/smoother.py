"""Looking back over a drive: with a lag, or from its end.

The filter keeps a graph of its merged hypotheses (`core.memory`); from it comes what is known
of an epoch after more has been seen, and the route (`ways`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from .core.belief import Route
from .core.epoch import Epochs
from .core.lookback import look_back, new_view
from .core.memory import Memory
from .core.output import V_SPEED, Output
from .core.parameters import Parameters
from .errors import SettingError
from .records import Array
from .roadmap import RoadMap

FULL = "full"
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
        if not 0.0 <= length or isinstance(lag, bool):
            raise SettingError(
                f'lag is {lag!r}; None, seconds from 0 on, "200m" (metres driven) or "{FULL}" was '
                "expected"
            )
        return cls(length, metres)

    def __str__(self) -> str:
        return FULL if math.isinf(self.length) else f"{self.length:g}{'m' if self.metres else 's'}"


class Past(NamedTuple):
    """What looking back needs to know of a drive."""

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


def travelled(past: Past) -> Array:
    """Metres driven at each epoch, by the filter's speeds."""
    dt = np.diff(past.epochs.time, prepend=past.epochs.time[:1])
    return np.asarray(np.cumsum(np.abs(past.filtered.value[:, V_SPEED]) * np.clip(dt, 0.0, None)))


def smooth(past: Past, lag: Lag) -> Output:
    """Answer every epoch by what was known `lag` later.

    A fixed lag may be longer by an eighth, as one look back answers for several epochs.

    Returns:
        What is known of each epoch; of those before the first answer nothing.
    """
    told = Output(*(a.copy() for a in past.filtered))
    steps = int(past.memory.size[0])
    if not steps:
        return told
    epochs = past.epochs
    view = new_view()
    for known, first, last in _looks(past, lag, steps):
        look_back(
            past.memory, view, past.roads.arrays, past.route, epochs, past.filtered, told, known,
            first, last, past.mode, past.side, past.parameters, past.outage_after,
            past.ambiguous_below,
        )  # fmt: skip
    return told


def _looks(past: Past, lag: Lag, steps: int) -> list[tuple[int, int, int]]:
    """Looks back: from which step, and which steps are answered: first, one past the last."""
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

