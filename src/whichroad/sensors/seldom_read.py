"""Odometers that are read as seldom as places: a tracker tells both each half minute.

Between such readings nothing tells how the vehicle moved.  They tell how far it drove from fix to
fix, and so which of the routes it took (`filter.sparse.driven`).
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..observations import Array, Drive, Fixes, Odometer
from ..settings import Vehicle
from .even_steps import common_measure

UNFIT = "distance"
SELDOM = 8.0  # s between readings and between fixes, usually, from which on it is seldom;
RARE = 15.0  # and between readings, however often fixes come

_BEYOND = 5.0  # s before the first and after the last reading, in which it goes on as it did
_UNEVEN = 0.5  # of the way to the nearer reading: sigma of a place between two readings
_FASTEST, _MORE = 70.0, 2000.0  # m/s, and m, beyond which an odometer was set anew
_ANEW = 1e7  # m, by which it then goes on: no vehicle drives as far between two fixes
_FINE = 0.2  # m, of steps that do not matter
LEAST = 36.0  # m², of the variance of a way: readings are not quite of the time of the fix
_LONG, _SIGMAS = 300.0, 6.0  # m, beyond sigmas of a fix, of ways that tell whether it fits
_SHORT, _MOST_SHORT = 0.85, 0.2  # of the straight line; share of ways that may be shorter
_FEWEST = 4  # ways
_DETOUR = 4.0  # times the straight line, of half of them


class Seldom:
    """What such an odometer tells; nothing where there is none."""

    def __init__(self, log: Odometer | None, vehicle: Vehicle) -> None:
        self._metres: Array | None = None
        self._time = self._between = np.empty(0)
        if log is None:
            return
        self._time, changes = log.time, vehicle.odometer_scale * np.diff(log.distance)
        self._anew = (changes < 0.0) | (changes > _FASTEST * np.diff(self._time) + _MORE)
        self._step = _step(changes[~self._anew])
        changes[self._anew] = _ANEW
        self._metres = np.concatenate([[1.0], 1.0 + np.cumsum(changes)])

    def between(self, fixes: Fixes | None) -> Array:
        """Times of readings at which there is no fix, which get a row all the same, (m,) s."""
        if fixes is not None:
            self._between = np.setdiff1d(self._time, fixes.time)
        return self._between

    def write_to(self, epochs: Records) -> tuple[str, ...]:
        """Write down what the odometer reads at each epoch.

        Args:
            epochs: (n,) EPOCH, in place.  Who is between two fixes waits for the next one.

        Returns:
            `UNFIT` where it does not fit the fixes and so tells nothing, else nothing.
        """
        own = np.isin(epochs.time, self._between) & (epochs.has_fix == 0)
        epochs.filled[own & (epochs.evidence == 0)] = 1
        if self._metres is None:
            return ()
        epochs.odometer = self._read(epochs.time)
        at = epochs[(epochs.has_fix == 1) & (epochs.filled == 0)]
        if not _contradicts(at):
            return ()
        epochs.odometer = 0.0
        return (UNFIT,)

    def _read(self, time: Array) -> Array:
        """At some times, (n, 2): m, and the variance of the way from the time before, m²."""
        assert self._metres is not None
        when = self._time
        at = np.searchsorted(when, time).clip(1, len(when) - 1)
        share = (time - when[at - 1]) / np.maximum(when[at] - when[at - 1], 1e-9)
        near = np.minimum(abs(share), abs(1.0 - share))
        way = np.where(self._anew[at - 1], 0.0, np.diff(self._metres)[at - 1])
        sigma = _UNEVEN * near * way
        read = np.zeros((len(time), 2))
        read[:, 0] = self._metres[at - 1] + share * np.diff(self._metres)[at - 1]
        read[:, 1] = LEAST + self._step**2 / 6.0 + sigma**2 + np.append(0.0, sigma[:-1]) ** 2
        known = (time >= when[0] - _BEYOND) & (time <= when[-1] + _BEYOND)
        known &= ~(self._anew[at - 1] & (near > 0.0))
        read[~known] = 0.0
        return read


def without_seldom(drive: Drive, fixes: Fixes | None, vehicle: Vehicle) -> tuple[Drive, Seldom]:
    """The drive without an odometer that is read as seldom as places, and that.

    Args:
        drive: With any odometry; what measures turns too is left in it.
        fixes: Its fixes.
        vehicle: The odometer's scale.
    """
    log = drive.odometry
    if not isinstance(log, Odometer) or fixes is None or len(log.time) < 2 or len(fixes) < 2:
        return drive, Seldom(None, vehicle)
    readings, places = (float(np.median(np.diff(t))) for t in (log.time, fixes.time))
    if readings < SELDOM or (places < SELDOM and readings < RARE):
        return drive, Seldom(None, vehicle)
    return replace(drive, odometry=None), Seldom(log, vehicle)


def _contradicts(epochs: Records) -> bool:
    """Whether it does not fit the fixes of epochs: its unit is another one, or it stands still.

    Over ways of some hundred metres no distance is shorter than the straight line.
    """
    unsure = 2.0 * _SIGMAS * epochs.fix[:, 2] + 2.0 * np.sqrt(epochs.odometer[:, 1])
    x, y, _, _, _ = epochs.fix.T.tolist()
    ways, short, begin, read = [], 0, 0, epochs.odometer[:, 0].tolist()
    for row, spare in enumerate(unsure.tolist()):
        driven = read[row] - read[begin]
        if read[row] == 0.0 or read[begin] == 0.0 or driven > _ANEW:
            begin = row
            continue
        straight = math.hypot(x[row] - x[begin], y[row] - y[begin]) - spare
        if straight > _LONG:
            ways.append(driven / straight)
            short += driven < _SHORT * straight
            begin = row
    if len(ways) < _FEWEST:
        return False
    return bool(short > _MOST_SHORT * len(ways) or float(np.median(ways)) > _DETOUR)


def _step(changes: NDArray[np.float64]) -> float:
    """The greatest length of which all changes are multiples, m; 0: there is none."""
    step = math.inf
    for change in np.unique(changes[changes > 0.0]).tolist():
        step = common_measure(change, step)
        if step < _FINE:
            return 0.0
    return 0.0 if math.isinf(step) else step
