"""Odometry that reads 0 below a speed: which one, as its readings tell, and what a 0 of it means.

As a vehicle starts or stops, a reading between 0 and the speed of the next one but it is as likely
as any other.  Where none is seen below a speed again and again, the sensor tells nothing there.
Steps of counters and of rounded speeds are no such sign, nor is hard braking that is read seldom.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..observations import (
    Array,
    Observation,
    OdometryLog,
    SpeedYaw,
    SpeedYawRate,
    WheelSpeed,
    WheelSpeeds,
    WithGyro,
)

LEAST, MOST = 0.4, 1.5  # m/s, of such a speed
_SELDOM, _SELDOM_COUNTED = 0.25, 0.15  # s between readings, from which on they tell nothing
_RESTS = 0.5  # s of zeros, of a stop
_EDGES, _KEPT, _SURE = 4, 40, 9.0  # starts and stops, at least, and at most; nats for it
_CHANCE = 0.05  # least P that one of them is so by chance
_TICKS = 2.0  # wheels whose ticks are in a way
_NO_STEP = 1e-6  # m/s, up to which speeds are the same
_STEPS = 2.5  # steps of a reading's resolution that the speed is, at least


class Rate(NamedTuple):
    """A speed that was read: at a moment, or over the time since the reading before."""

    time: float  # s
    speed: float  # m/s, not negative


class Edge(NamedTuple):
    """The speed beside a stop, the first whole one of a counter, m/s."""

    speed: float
    change: float  # to the next one beyond it
    counted: bool  # it is half of that at least, of a sensor that counts down to 0


class DeadBand:
    """The speed below which odometry reads 0, reading by reading.

    Args:
        told: That speed, m/s; 0: it is not known.
    """

    def __init__(self, told: float = 0.0) -> None:
        self.told, self._found = told, 0.0
        self._last: list[Rate] = []  # three at most
        self._slowest = self._step = math.inf  # least speed but 0, and least change of it, m/s
        self._zeros: float | None = None  # s, when they began
        self._stop: Edge | None = None  # the edge at which they did
        self._edges: list[Edge] = []
        self._tick, self._moved = math.inf, -math.inf  # least way that was counted, m; when, s

    @property
    def least(self) -> float:
        """That speed, m/s; 0: there is none."""
        return self.told or self._found

    @property
    def found(self) -> float:
        """The same, where it is known by the readings alone."""
        return 0.0 if self.told else self._found

    def take(self, before: Observation, reading: Observation, arc: float) -> bool:
        """Take a reading of odometry.

        Args:
            before: The one before it.
            reading: Of the same kind.
            arc: Between them, m.

        Returns:
            Whether the vehicle may have crept meanwhile: both read 0, and that tells nothing.
        """
        if not self.told and self._slowest < LEAST:  # there is none, whatever comes
            return False
        dt, speed = reading.time - before.time, _speed(reading)
        counted = speed is None
        rests = arc == 0.0 if counted else speed == 0.0 and _speed(before) == 0.0
        if not self.told and dt > 0.0:
            self.watch(reading.time, abs(arc) / dt if speed is None else speed, counted)
        if arc != 0.0:
            self._moved = reading.time
            self._tick = min(self._tick, abs(arc)) if counted else 0.0
        since = reading.time - self._moved  # for which a counter of coarse ticks may read nothing
        tick = _TICKS * self._tick if self._tick < math.inf else 0.0
        return bool(rests and self.least and since * self.least > tick)

    def watch(self, time: float, speed: float, counted: bool) -> None:
        """Look for a dead band in one more speed, m/s.

        Args:
            time: s, of its reading.
            speed: Without its sign.
            counted: Whether it is a way over a time; then a start or stop splits one.
        """
        last = self._last
        held = not counted and speed != 0.0 and last and last[-1].speed == speed
        if held and 0.0 < time - last[-1].time < _SELDOM:  # one that is read again
            return
        if last and not 0.0 < time - last[-1].time < _longest(counted):
            last.clear()
            self._zeros = self._stop = None
        last.append(Rate(time, speed))
        skip = 1 if counted else 0
        if speed == 0.0:
            if self._zeros is None:
                self._zeros = time
                self._stop = _edge([one.speed for one in last[-2 - skip :: -1]], counted)
            del last[:-1]
            return
        del last[: -3 - skip]
        if self._zeros is not None and len(last) == 3 + skip:
            if last[0].time - self._zeros >= _RESTS:
                start = _edge([one.speed for one in last[1 + skip :]], counted)
                self._edges = [*self._edges, *filter(None, (self._stop, start))][-_KEPT:]
                self._judge()
            self._zeros = self._stop = None
        self._slow(counted)

    def _slow(self, counted: bool) -> None:
        """The least speed, and the least change of it, but for steps that a stop splits."""
        speeds = [one.speed for one in self._last[-3:]]
        if counted and (len(speeds) < 3 or not all(speeds)):
            return
        slow = speeds[1] if counted else speeds[-1]
        if len(speeds) > 1 and speeds[-2] and (step := self._change(counted)) > _NO_STEP:
            self._step = min(self._step, step)
        if slow < self._slowest:
            self._slowest = slow
            self._judge()

    def _change(self, counted: bool) -> float:
        """By how much the last speed differs from the one before, m/s.

        Of a counter it is the change of what was counted: times that jitter make no steps.
        """
        first, last = self._last[-2:]
        if not counted:
            return abs(last.speed - first.speed)
        dt, before = last.time - first.time, first.time - self._last[-3].time
        return abs(last.speed * dt - first.speed * before) / dt

    def _judge(self) -> None:
        """Whether there is one, and which."""
        least, self._found = self._slowest, 0.0
        edges = [one for one in self._edges if one.speed <= MOST]
        if len(edges) < _EDGES or not LEAST <= least <= MOST or least < _STEPS * self._step:
            return
        nats = sum(math.log(_by_chance(least, one, self._step)) for one in edges)
        if -nats >= _SURE:
            self._found = least

    def kept(self) -> list[Any]:
        """All that is remembered, as numbers."""
        numbers = [self._found, self._slowest, self._step, self._tick, self._moved]
        edges = [list(one) for one in self._edges]
        stop = None if self._stop is None else list(self._stop)
        return [numbers, self._zeros, stop, edges, [list(one) for one in self._last]]

    def restore(self, kept: list[Any]) -> None:
        """Remember that and nothing else."""
        numbers, self._zeros, stop, edges, last = kept
        self._found, self._slowest, self._step, self._tick, self._moved = numbers
        self._stop = Edge(*stop) if stop else None
        self._edges = [Edge(*one) for one in edges]
        self._last = [Rate(*one) for one in last]


def _longest(counted: bool) -> float:
    return _SELDOM_COUNTED if counted else _SELDOM


def _edge(speeds: list[float], counted: bool) -> Edge | None:
    """The speed beside a stop, and by how much the next one beyond it differs, m/s."""
    if len(speeds) < 2 or not all(speeds):
        return None
    return Edge(speeds[0], abs(speeds[1] - speeds[0]), counted)


def _by_chance(least: float, edge: Edge, step: float) -> float:
    """P(the speed beside a stop is not below that), of a sensor that reads down to 0 in steps."""
    change = edge.change + (step if step < math.inf else 0.0)
    slowest = 0.5 * change if edge.counted else 0.0
    return min(max(1.0 - (least - slowest) / max(change, 1e-9), _CHANCE), 1.0)


def _speed(reading: Observation) -> float | None:
    """Of a sensor of speeds, m/s, without its sign; None: it counts."""
    if isinstance(reading, WheelSpeed):
        return max(abs(reading.left), abs(reading.right))
    return abs(reading.speed) if isinstance(reading, SpeedYaw) else None


def is_counted(log: OdometryLog) -> bool:
    """Whether a log counts ways; else it tells speeds."""
    if isinstance(log, WithGyro):
        log = log.distance
    return not isinstance(log, WheelSpeeds | SpeedYawRate)


def whole_dead_band(log: OdometryLog, motion: tuple[Array, Array], told: float) -> float:
    """The speed below which a recorded log reads 0, m/s; 0: there is none.

    Args:
        log: As it was recorded.
        motion: Times (s) and cumulative distances (m) of its motion, as `motion_of` gives them.
        told: That of the vehicle; 0: it is found by the readings.
    """
    if isinstance(log, WithGyro):
        log = log.distance
    if told or len(log.time) < 2:
        return told
    counted = is_counted(log)
    time = motion[0] if counted else log.time
    if isinstance(log, WheelSpeeds):
        speed = np.maximum(np.abs(log.left), np.abs(log.right))[1:]
    elif isinstance(log, SpeedYawRate):
        speed = np.abs(log.speed)[1:]
    else:
        steps = np.diff(time)
        speed = np.abs(np.diff(motion[1])) / np.where(steps > 0.0, steps, np.inf)
    if np.median(np.diff(log.time)) >= _longest(counted) or not _may_have(speed, counted):
        return 0.0
    band = DeadBand()
    for at, one in zip(time[1:].tolist(), speed.tolist(), strict=True):
        band.watch(at, one, counted)
    return band.found


def _may_have(speed: Array, counted: bool) -> bool:
    """Whether no speed is too low for a dead band; most sensors have such."""
    moves = speed > 0.0
    if counted:
        moves[1:-1] &= moves[:-2] & moves[2:]
        moves[[0, -1]] = False
    return bool(moves.any() and not moves.all() and (speed[moves] >= LEAST).all())


def below(time: Array, distance: Array, least: float, counted: bool) -> NDArray[np.bool_]:
    """Over which steps to each reading the vehicle may have crept, (n,).

    Args:
        time: (n,) of the readings, s.
        distance: (n,) cumulative, m.
        least: The speed below which they are 0, m/s; more than 0.
        counted: Whether it comes of a counter.
    """
    steps = np.abs(np.diff(distance, prepend=distance[:1]))
    rests = steps == 0.0
    tick = _TICKS * float(steps[~rests].min()) if counted and not rests.all() else 0.0
    moved = np.maximum.accumulate(np.where(rests, -np.inf, time))
    return np.asarray(rests & ((time - moved) * least > tick))
