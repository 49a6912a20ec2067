"""Odometers that count in coarse steps: where within its step the vehicle is.

J1939's distance counts 5 m a bit, many a tachograph 0.5 m.  Read ten times a second it stands, and
leaps by 50 m/s; read once it is off by half a step.  The step is learnt: all changes are multiples
of it, and it is the greatest length of which that is so.  It is known after
six changes by another number of steps than before: those of a vehicle at one speed are all the
same.  From then on a vehicle that accelerates at random is filtered, and its Gaussian is truncated
to the step that was read, at each reading:

    s ~ N(s + v Δt, F P Fᵀ + Q) on [D, D + step)

A change tells when a step was passed, and that none came tells that the vehicle brakes.
"""

import math
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from ..filter.gaussian import truncated_moments
from ..observations import Array, Distance, Observation, Odometer

Reading = TypeVar("Reading", bound=Observation)

_LEAST = 0.2  # m, of a step that is coarse
_SAME = 0.02  # share of a step by which a change may be off its multiple
_PLENTY = 6  # changes by another number of steps than before, after which it is known
_SURE, _LONG = 30, 20.0  # of these, after which it is sure; steps, more of which tell nothing then
_ODD, _FORGET = 4.0, 0.98  # odd changes that tell another one then; each change forgets some
_ACCELERATION = 1.5  # m²/s³, random walk of the speed
_UNKNOWN = 10.0  # m/s, of a speed that nothing tells
_LONGEST, _FASTEST = 5.0, 90.0  # s without a reading, and m/s, after which it begins anew
_SMOOTHING = 0.5  # s, in which the way that is told takes what a change has shown
_SELDOM = 0.8  # 1/m, times the step: readings in which it does at least; else scales are diluted
_BEHIND = 2.0  # steps that it is behind at most
_FIRM = 6.0  # m/s², by which that way becomes faster or slower at most
_OF_STEP = 0.5  # share of its variance that a step driven adds to the way


def common_measure(change: float, length: float) -> float:
    """The greatest length of which both a change and a length are multiples, m.

    Args:
        change: > 0, m.
        length: Of which earlier changes are; infinite: there was none.
    """
    a, b = (change, 0.0) if length == math.inf else (length, change)
    b = abs(math.remainder(b, a))
    while b > max(_SAME * a, _SAME * _LEAST):
        a, b = b, abs(math.remainder(a, b))
    return a


class EvenSteps:
    """Such an odometer, reading by reading."""

    def __init__(self) -> None:
        self.unsure = 0.0  # m², of the way that was told last, beyond what is usual
        self._length, self._changes = math.inf, 0  # m; of those that tell it
        self._change, self._odd = 0.0, 0.0  # the last one, m; odd ones of late
        self._read: list[float] = []  # time and distance of the last reading
        self._told, self._pace, self._way = 0.0, 0.0, 1.0  # m, m/s as told; -1: backwards
        self._place, self._speed = 0.0, 0.0  # m, m/s
        self._cov = [0.0, 0.0, 0.0]  # of these: m², m²/s, m²/s²

    @property
    def step(self) -> float:
        """m; 0: it is fine, or not known."""
        return self._length if self._changes >= _PLENTY and not self.fine else 0.0

    @property
    def coarsest(self) -> float:
        """m, of which its step is no more, as far as its changes tell; 0: it is fine."""
        return 0.0 if self.fine or self._length == math.inf else self._length

    @property
    def fine(self) -> bool:
        """Whether it has none, whatever comes."""
        return self._length < (1.0 - _SAME) * _LEAST

    def even(self, reading: Reading) -> Reading:
        """The reading, with the place within its step.

        Args:
            reading: As it was read; what is no distance is given back as it is.
        """
        self.unsure = 0.0
        if not isinstance(reading, Distance):
            return reading
        before, self._read = self._read, [reading.time, reading.distance]
        if self.fine:
            return reading
        if not before:
            self._begin(reading.distance)
            return reading
        dt, change = reading.time - before[0], reading.distance - before[1]
        step = self.step
        if dt > 0.0 or change != 0.0:  # what comes twice has not stood
            self._learn(change)
        if not self.step:
            return reading
        if self.step != step or dt > _LONGEST or abs(change) > _FASTEST * dt + step:
            self._begin(reading.distance)
            self.unsure = self.step**2 / 6.0
        elif dt > 0.0:
            self._move(dt, change, reading.distance)
        return replace(reading, distance=self._told)

    def _learn(self, change: float) -> None:
        """The greatest common measure of all changes."""
        before, self._change = self._change, change
        same = abs(change - before) <= _SAME * _LEAST
        if same or change == 0.0 or (self._changes >= _SURE and self._is_odd(change)):
            return
        a = self._length = common_measure(abs(change), self._length)
        self._changes += round(abs(change) / a) != round(abs(before) / a)

    def _is_odd(self, change: float) -> bool:
        """Whether a change says nothing against a step that many have shown."""
        step = self._length
        if self.fine:
            return False
        if abs(change) > _LONG * step:  # what the step is off by adds up
            return True
        self._odd *= _FORGET
        self._odd += abs(math.remainder(change, step)) > max(_SAME * step, _SAME * _LEAST)
        return 0.0 < self._odd < _ODD

    def _begin(self, distance: float) -> None:
        """Nothing is known but the step."""
        step = self.step or 1.0
        self._place, self._speed = distance + 0.5 * step, 0.0
        self._cov = [step * step / 12.0, 0.0, _UNKNOWN**2]
        self._told, self._pace = distance, 0.0

    def _move(self, dt: float, change: float, distance: float) -> None:
        """Drive on for dt s, to what was read."""
        pp, pv, vv = self._cov
        before, q = pp, _ACCELERATION * dt
        pp += dt * (2.0 * pv + dt * (vv + q / 3.0))
        pv += dt * (vv + 0.5 * q)
        vv += q
        at = self._place + self._speed * dt
        place, variance = truncated_moments(at, math.sqrt(pp), distance, distance + self.step)
        gain, less = pv / pp, 1.0 - variance / pp
        if change != 0.0:
            self._way = math.copysign(1.0, change)
        speed = self._speed + gain * (place - at)
        self._speed = self._way * max(self._way * speed, 0.0)
        self._place = place
        self._cov = [variance, pv * (1.0 - less), vv - gain * pv * less]
        told, ahead = self._told, self._speed * dt
        ahead += (place - told - ahead) * (
            1.0 - math.exp(-dt / max(_SMOOTHING, _SELDOM * dt * self.step))
        )
        firm = _FIRM * dt
        pace = min(max(ahead / dt, self._pace - firm), self._pace + firm)
        apart, most = self._way * (place - told), _BEHIND * self.step  # it may begin at speed
        pace = min(max(self._way * pace, (apart - most) / dt), (apart + most) / dt)
        self._pace = self._way * max(pace, 0.0)
        self._told += self._pace * dt
        share = min(abs(self._told - told) / self.step, 1.0)
        behind = (self._told - place) ** 2
        grown = max(variance - before, 0.0) + _OF_STEP * share * (variance + behind)
        self.unsure = min(dt, 1.0) * grown  # it does not add up from reading to reading

    def kept(self) -> list[Any]:
        """All that is remembered, as numbers."""
        known = [self._length, self._changes, self._change, self._odd]
        told = [self._told, self._pace, self._way]
        return [known, told, self._read, [self._place, self._speed, *self._cov]]

    def restore(self, kept: list[Any]) -> None:
        """Remember that and nothing else."""
        known, told, self._read, (self._place, self._speed, *self._cov) = kept
        self._length, self._changes, self._change, self._odd = known
        self._told, self._pace, self._way = told


def even_log(log: Odometer) -> tuple[Odometer, Array | None]:
    """A recorded odometer as it is told on line.

    Args:
        log: As it was recorded.

    Returns:
        The log, and the variance of the way to each reading beyond what is usual, m², (n,); None
        where its steps are fine.
    """
    steps, told, unsure = EvenSteps(), log.distance.copy(), np.zeros(len(log.time))
    rows = zip(log.time.tolist(), log.distance.tolist(), strict=True)
    for k, (time, distance) in enumerate(rows):
        told[k], unsure[k] = steps.even(Distance(time, distance)).distance, steps.unsure
        if steps.fine:
            return log, None
    return (Odometer(log.time, told), unsure) if steps.step else (log, None)
