"""How the inputs and the service itself are doing, in numbers that do not grow."""

import math
from collections import Counter, deque
from collections.abc import Callable
from itertools import pairwise
from typing import Any

from .message_types import UNKNOWN, LatencyMessage, SensorMessage
from .troubles import Troubles

_BOUNDS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # s, of bins
_WINDOW = 5.0  # s over which rates are averaged
_RECENT = 1000  # sample size of p50 and p99
_MADE = 16  # readings whose own times give their usual spacing
_SILENT = 1.0  # s without a reading after which an input is silent, if that is
_INTERVALS = 5.0  # usual intervals between its readings or more
_ASSUMED = 1.0  # s, interval between readings before two have come: a receiver's usual one


class Health:
    """One input: its rate, and when it last delivered.

    Args:
        name: For people.
        kind: gnss, wheels or file.
        report: Takes a line for the operator, from any thread.

    Attributes:
        count: Observations so far.
        skipped_why: How many records could not be used, by reason, as the source counts them.
        untimely: Readings that the filter refused by their times, and counts by reason itself.
        refused: Fixes and readings of a second sender on its port.
        link: `waiting`, `open`, `lost` or `ended`.
        reason: Why it is lost, for everybody: without a path.
        delay: Typical s between an observation's own time and its arrival; None: not known.
        receiver: What a receiver said of its last fix.
        troubles: What is wrong with what comes.
    """

    def __init__(
        self, name: str, kind: str, report: Callable[[str], None] = lambda line: None
    ) -> None:
        self.name, self.kind, self._report = name, kind, report
        self.reason: str | None = None
        self._told: str | None = None  # the last reason that was told since it spoke
        self.count = self.untimely = self.refused = 0
        self.skipped_why: Counter[str] = Counter()
        self.link = "waiting"
        self.delay: float | None = None
        self.receiver = UNKNOWN
        self.troubles = Troubles(report)
        self._last: float | None = None
        self._interval: float | None = None
        self._made: deque[float] = deque(maxlen=_MADE)
        self._counts: deque[tuple[float, int]] = deque()

    @property
    def skipped(self) -> int:
        """How many records could not be used."""
        return self.skipped_why.total() + self.untimely

    def open(self) -> None:
        """The link is there."""
        self.link, self.reason = "open", None

    def lose(self, reason: str) -> None:
        """The link cannot be opened or is gone; a reason is told once until it speaks again."""
        self.link, self.reason = "lost", reason
        if reason != self._told:
            self._told = reason
            self._report(f"{self.name}: {reason}; it is opened again as soon as that is possible")

    def heard(
        self, count: int, now: float, delay: float | None = None, made: float | None = None
    ) -> None:
        """So many observations came.

        Args:
            count: How many.
            now: When, on a clock of one's own, s.
            delay: s since the last one was made.
            made: That one's own time, s.
        """
        if made is not None:
            self._made.append(made)
        self.count += count
        self._told = None
        paused = self._last is not None and now - self._last > self._patience()
        if paused and len(self._counts) > 1:
            self._counts.clear()  # one pause says nothing about the usual interval
        self._last = now
        if delay is not None:
            known = self.delay if self.delay is not None else delay
            self.delay = known + 0.05 * (delay - known)
        if not self._counts or now - self._counts[-1][0] > 0.1:
            self._counts.append((now, self.count))
            while self._counts[0][0] < now - _WINDOW and len(self._counts) > 2:
                self._counts.popleft()

    @property
    def interval(self) -> float | None:
        """Usual seconds between its readings; None before two have come."""
        if len(self._counts) > 1:
            (begin, first), (end, last) = self._counts[0], self._counts[-1]
            self._interval = (end - begin) / (last - first)
        return self._interval

    @property
    def spacing(self) -> float | None:
        """Usual difference of its readings' own times, s; None before two have come."""
        made = sorted(self._made)
        steps = sorted(b - a for a, b in pairwise(made))
        return steps[len(steps) // 2] if steps else None

    def _patience(self) -> float:
        """Seconds without a reading after which it is silent."""
        interval = self.interval
        return max(_SILENT, _INTERVALS * (_ASSUMED if interval is None else interval))

    def rate(self, now: float) -> float:
        """Observations a second."""
        interval = self.interval
        if len(self._counts) < 2 or not interval:
            return 0.0
        return 1.0 / interval if now - self._counts[-1][0] <= max(_WINDOW, 2.0 * interval) else 0.0

    def age(self, now: float) -> float | None:
        """Seconds since it spoke; None: never."""
        return None if self._last is None else max(now - self._last, 0.0)

    def state(self, now: float) -> str:
        """`waiting`, `ok`, `silent`, `lost` or `ended`."""
        age = self.age(now)
        if self.link in ("lost", "ended"):
            return self.link
        if age is None:
            return "waiting"
        return "silent" if age > self._patience() else "ok"

    def message(self, now: float) -> SensorMessage:
        """What is published of it."""
        age, state = self.age(now), self.state(now)
        return SensorMessage(
            name=self.name,
            kind=self.kind,
            state=state,
            reason=self.reason if state == "lost" else None,
            ok=state == "ok",
            rate_hz=round(self.rate(now), 2),
            age_s=None if age is None else round(age, 3),
            delay_s=None if self.delay is None else round(self.delay, 3),
            count=self.count,
            skipped=self.skipped,
            refused=self.refused,
        )


class Latency:
    """From the arrival of what was observed to the publication of what it means."""

    def __init__(self) -> None:
        self._recent: deque[float] = deque(maxlen=_RECENT)
        self._latest: LatencyMessage = {"p50": None, "p99": None}
        self._latest_at = -math.inf
        self.counts = [0] * (len(_BOUNDS) + 1)
        self.total = 0.0

    def add(self, seconds: float) -> None:
        """One more."""
        self._recent.append(seconds)
        self.total += seconds
        self.counts[sum(seconds > bound for bound in _BOUNDS)] += 1

    def message(self, now: float) -> LatencyMessage:
        """p50 and p99 of the last thousand, made once a second."""
        if now - self._latest_at >= 1.0 and self._recent:
            self._latest_at, ordered = now, sorted(self._recent)
            p50, p99 = (ordered[int(q * (len(ordered) - 1))] for q in (0.5, 0.99))
            self._latest = {"p50": round(1e3 * p50, 3), "p99": round(1e3 * p99, 3)}
        return self._latest

    def histogram(self, name: str) -> list[str]:
        """Lines of a Prometheus histogram."""
        lines, total = [], 0
        for bound, count in zip((*_BOUNDS, math.inf), self.counts, strict=True):
            total += count
            label = "+Inf" if bound == math.inf else f"{bound:g}"
            lines.append(f'{name}_bucket{{le="{label}"}} {total}')
        return [*lines, f"{name}_sum {self.total:.6f}", f"{name}_count {total}"]


def metric(name: str, kind: str, description: str, rows: dict[str, Any]) -> list[str]:
    """Lines of one Prometheus metric; the keys of `rows` are its labels as they are written."""
    head = [f"# HELP {name} {description}", f"# TYPE {name} {kind}"]
    return head + [f"{name}{labels} {value}" for labels, value in rows.items()]


def label(text: str) -> str:
    """Text as the value of a Prometheus label."""
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
