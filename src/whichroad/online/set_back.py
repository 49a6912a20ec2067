"""Clocks that step by some seconds, as NTP does: the filter's own goes on."""

import math
from bisect import bisect_right
from collections import deque
from dataclasses import replace
from itertools import islice, pairwise
from statistics import median
from typing import Any

from ..diagnosis.finding import Finding
from ..diagnosis.sensors import set_ahead_finding, set_back_finding
from ..observations import (
    Distance,
    GeoFix,
    Observation,
    SensorReading,
    SpeedYaw,
    WheelSpeed,
    WheelTicks,
    YawRate,
)  # fmt: skip
from .localizer_state import Reading

_FEWEST, _FOR = 3, 0.25  # readings and s of them through times that were gone through before
_MOST = 10.0  # s; after a larger step the filter begins anew
_KEPT, _USUAL = 1024, 32  # readings that are remembered; those that tell the usual interval,
_FIRST = 4  # at first
_GAP = 1.5  # usual intervals between two readings, from which on one is missing there
_NEWS = 0.1  # share of a new latency in the usual one
_QUIET, _BETWEEN = 15.0, 60.0  # s without odometry through times of before; s between two steps
_SAME = 1e-3  # s between two stamps of one speed, at most
_LEAST, _UNSURE, _AGREE = 1.0, 0.4, 3  # s of a step ahead, its share in which fixes agree, these
_STEADY, _APART = 0.15, 0.9  # s by which these may differ, and between them: no queue empties
_NAMED, _APART_BY = 5.0, 0.5  # s after a step ahead, and s between clocks, to be named
_ODOMETRY, _FIXES, _FURTHER, _GYRO = range(4)


def _kind(observation: Observation) -> int:
    if isinstance(observation, GeoFix):
        return _FIXES
    if isinstance(observation, YawRate):
        return _GYRO
    return _FURTHER if isinstance(observation, SensorReading) else _ODOMETRY


def _speed(reading: Reading) -> float:
    """Of a reading that is a speed, m/s; 0: it counts."""
    if isinstance(reading, SpeedYaw):
        return reading.speed
    return 0.5 * (reading.left + reading.right) if isinstance(reading, WheelSpeed) else 0.0


def _repeats(reading: Any, *sides: Any) -> bool:
    """Whether it says what was read at its time before.

    Args:
        reading: Of odometry.
        sides: What was taken before and after that time.
    """
    if isinstance(reading, WheelTicks | Distance):
        names = ("left", "right") if isinstance(reading, WheelTicks) else ("distance",)
        counts = [[getattr(one, name) for name in names] for one in sides]
        least, most = map(min, *counts), map(max, *counts)
        now = [getattr(reading, name) for name in names]
        return all(low <= one <= high for low, one, high in zip(least, now, most, strict=True))
    return any(
        abs(one.time - reading.time) <= _SAME and _speed(one) == _speed(reading) for one in sides
    )


class Clocks:
    """How far the clock of each kind of sensor is behind the filter's, which never goes back.

    Odometry that goes on through times which it had before tells a step, where it did not do so
    lately: else it is of two sources.  The first reading of another kind tells whether its clock
    made the same one.  Where odometry alone steps ahead,
    nothing is heard for as long as fixes come late from then on: their clock is behind.

    Attributes:
        steps: How often the clock was set back.
        last: By how much at last, s.
        ahead: By how much odometry's clock alone stepped ahead in all, s.
        stirred: Whether a clock stepped, or may have done so.
        tied: Whether odometry comes after fixes of its time; None: not known yet.
        unsure: Way of a step ahead that speeds told and nobody drove, m, until it is set to 0.
    """

    __slots__ = (
        "_again", "_agree", "_by", "_count", "_gap", "_interval", "_judged", "_late", "_left",
        "_open", "_ran", "_since", "_trusted", "_usual", "_way", "ahead", "last", "steps",
        "stirred", "tied", "unsure",
    )  # fmt: skip

    def __init__(self) -> None:
        self.steps, self.last, self.ahead = 0, 0.0, 0.0
        self._since = 0.0  # when it stepped ahead, by the filter's clock, s
        self._gap, self._agree = 0.0, 0  # s that odometry may have stepped ahead; fixes that agree
        self._way = self.unsure = 0.0
        self.stirred = False
        self.tied: bool | None = None
        self._late = 0.0  # s of the last fix that agreed
        self._judged = 0.0  # when a fix agreed at last, by the filter's clock, s
        self._by = [0.0] * 4  # s by kind
        self._open = [0.0] * 4  # s of a step that a kind may have made too
        self._usual = [0.0] * 4  # s that a kind usually comes later than the newest reading
        self._count = [0] * 4  # of readings that tell it
        self._ran: deque[Reading] = deque(maxlen=_KEPT)  # odometry that was taken
        self._again: list[float] = []  # times of that which goes through the same times again
        self._trusted = 0.0  # from when on it tells a step, by the filter's clock, s
        self._left, self._interval = _FIRST, 0.0  # readings until it is renewed; 0: not known yet

    @property
    def behind(self) -> float:
        """The fixes' clock, until one has come that of odometry, is behind the filter's, s."""
        return self._by[_ODOMETRY if self._open[_FIXES] else _FIXES]

    @property
    def latest(self) -> float:
        """How late a fix is, at most, while the clock may have been set back, s."""
        may = self._again and self._ran[-1].time >= self._trusted
        return self._usual[_FIXES] + _FOR if may else float("inf")

    def took(self, observation: Observation, late: float) -> None:
        """A reading was taken.

        Args:
            observation: At the filter's time.
            late: By so much it was behind the newest one, s.
        """
        kind = _kind(observation)
        self._count[kind] += 1
        share = max(_NEWS, 1.0 / self._count[kind])
        self._usual[kind] += share * (max(late, 0.0) - self._usual[kind])

    def moved(self, reading: Reading, late: float) -> None:
        """The same of odometry."""
        ran = self._ran
        if not ran:
            self._trusted, self._left, self._interval = reading.time + _QUIET, _FIRST, 0.0
        elif reading.time - ran[-1].time >= _LEAST:
            self._watch_gap(reading, late)
        ran.append(reading)
        self._left -= 1
        if not self._left:
            self._left = min(len(ran), _USUAL)
            times = [one.time for one in islice(reversed(ran), _USUAL)]
            self._interval = median(a - b for a, b in pairwise(times))
        if self._again:  # two that take turns, or some that overtook
            self._again.clear()
            self._trusted = max(self._trusted, reading.time + _QUIET)

    def at_filter_time(self, observation: Any, now: float) -> Any:
        """The same observation by the filter's clock.

        Args:
            observation: By the sensor's clock.
            now: The filter's time, s.
        """
        kind = _kind(observation)
        if self._gap and kind == _FIXES:
            self._judge_gap(now, now - observation.time - self._by[kind] - self._usual[kind])
        if self.steps or self.ahead:
            step = self._open[kind]
            if step:
                self._open[kind] = 0.0
                if now - observation.time - self._by[kind] - self._usual[kind] > 0.5 * step:
                    self._by[kind] += step
            if self._by[kind]:
                observation = replace(observation, time=observation.time + self._by[kind])
        if kind == _ODOMETRY and self._ran and observation.time < self._ran[-1].time:
            step = self._step(observation)
            if step:
                observation = replace(observation, time=observation.time + step)
        return observation

    def _step(self, reading: Reading) -> float:
        """By how much odometry's clock was set back, s; 0: it was not, or it is not known yet."""
        if not self._runs_again(reading):
            return 0.0
        if self._again and reading.time <= self._again[-1]:
            self._again.clear()
        self._again.append(reading.time)
        now, first = self._ran[-1].time, self._again[0]
        step = now + self._interval - first
        if len(self._again) < _FEWEST or reading.time - first < _FOR or step > _MOST:
            return 0.0
        self._again.clear()
        if now < self._trusted:
            self._trusted = max(self._trusted, now + _QUIET)  # of two sources, in batches
            return 0.0
        self.steps, self.last, self.stirred = self.steps + 1, step, True
        self._trusted = now + step + _BETWEEN
        self._by[_ODOMETRY] += step
        self._open = [before + step for before in self._open]
        self._open[_ODOMETRY] = 0.0
        return step

    def _watch_gap(self, reading: Any, late: float) -> None:
        """Note odometry after a time in which nothing was heard: its clock may have stepped."""
        time, interval = reading.time, self._interval
        gap = time - self._ran[-1].time
        step = gap - interval
        heard = gap + late  # s after the odometry before
        known = interval > 0.0 and _LEAST <= step <= _MOST and heard <= interval
        self._gap, self._agree, self._since = step if known else 0.0, 0, time
        self._way, self._judged = abs(_speed(reading)) * step, -math.inf
        self.stirred = self.stirred or known

    def _judge_gap(self, now: float, late: float) -> None:
        """A fix came at a time (s): as much later than usual as after a step, or it was none."""
        queue = self._agree and abs(late - self._late) > _STEADY  # that is being worked off
        if queue or abs(late - self._gap) > _UNSURE * self._gap:
            self._gap = 0.0
            self.stirred = bool(self.steps or self.ahead)
            return
        if now - self._judged < _APART:  # of one burst
            return
        self._agree, self._judged, self._late = self._agree + 1, now, late
        if self._agree >= _AGREE:
            self.ahead += self._gap
            self._by[_FIXES] += self._gap
            self._open[_FURTHER] = self._open[_GYRO] = self._gap
            self._gap, self.unsure = 0.0, self._way

    def _runs_again(self, reading: Reading) -> bool:
        """Whether odometry was there before, and this is neither a repeat nor one that overtook."""
        ran = self._ran
        if type(ran[-1]) is not type(reading) or reading.time < ran[0].time:
            return False
        after = bisect_right(ran, reading.time, key=lambda one: one.time)
        sides = ran[after - 1], ran[after]
        if sides[1].time - sides[0].time > _GAP * self._interval:
            return False
        return not _repeats(reading, *sides)

    def findings(self, now: float) -> tuple[Finding, ...]:
        """That a clock stepped, if one did; now: the filter's time, s."""
        found = (set_back_finding(self.last, self.steps),) if self.steps else ()
        apart = self._by[_FIXES] - self._by[_ODOMETRY]
        if self.ahead and apart > _APART_BY and now - self._since >= _NAMED:
            return (*found, set_ahead_finding(apart))
        return found

    def kept(self) -> list[Any]:
        """What it knows of the clocks, as numbers."""
        numbers = [self.steps, self.last, self.ahead, self._since]
        return [*numbers, list(self._by), list(self._open), list(self._usual), self.tied]

    def restore(self, kept: list[Any]) -> None:
        """Remember that and nothing else."""
        self.steps, self.last, self.ahead, self._since = kept[:4]
        self._by, self._open, self._usual = map(list, kept[4:7])
        self.tied = kept[7]
        self._count = [round(1.0 / _NEWS)] * 4
        self._gap = self.unsure = 0.0
        self.stirred = bool(self.steps or self.ahead)
        self._ran.clear()
        self._again.clear()
