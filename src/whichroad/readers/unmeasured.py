"""Speeds and courses of a receiver that were not measured at their rows: held, or 0 for none.

Who fills a table forward repeats a speed or a course until the next one comes.  Phones write
0 where they know no speed.  Each drive is judged by its own rows.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geodesy.angles import wrap_degrees
from ..observations import HELD_COURSE, HELD_SPEED, ZERO_SPEED, Array
from .checks import Bools, Ints
from .interpolated_places import FEWEST, MOST, are_mostly_below, metres

_MOVES = 1.0  # m/s from place to place, of a row that moves
_REPEATS = 0.125  # of the rows, below which no column is held
_STEP = 1e-6  # of a column, m/s or degrees, at least
_JUMPS = 3.0  # steps of the column by which a held one changes
_CLOSE = 2.5  # s between fixes, up to which zeros are judged
_HARD, _FAST = 8.0, 3.0  # m/s² and m/s, beyond which a zero between two speeds is none
_WENT = 0.5  # of the way by the smaller of them, that the places go
_PROVEN = 0.02  # of the rows, from which on a drive's zeros say nothing


class Unmeasured(NamedTuple):
    """Speeds and courses that were not measured at their rows."""

    flags: NDArray[np.uint16]  # (n,) HELD_SPEED, HELD_COURSE and ZERO_SPEED of `Fixes.flags`
    pace: Array | None  # m/s, those that were measured, and lines between where they repeat

    @property
    def no_speed(self) -> Bools:
        """Which speeds were not measured, (n,)."""
        return (self.flags & (HELD_SPEED | ZERO_SPEED)) > 0

    @property
    def no_course(self) -> Bools:
        """Which courses were not, (n,)."""
        return (self.flags & HELD_COURSE) > 0


def unmeasured(
    time: Array, lat: Array, lon: Array, speed: Array | None, course: Array | None, first: Ints
) -> Unmeasured | None:
    """Speeds and courses that repeat the row before, and speeds of 0 of a vehicle that drives.

    Args:
        time: (n,) s, drive after drive.
        lat: (n,) degrees.
        lon: (n,) degrees.
        speed: (n,) m/s, NaN where absent; None: there is none.
        course: (n,) degrees, likewise.
        first: (d,) where each drive begins.

    Returns:
        None: all of them were measured.
    """
    size = np.diff(first, append=len(time))
    suspects = [
        *((drive, HELD_SPEED) for drive in _repeating(speed, first, size)),
        *((drive, HELD_COURSE) for drive in _repeating(course, first, size)),
        *((drive, ZERO_SPEED) for drive in _stopping(time, speed, first, size)),
    ]
    flags = np.zeros(len(time), np.uint16)
    pace = speed
    for drive, flag in suspects:
        own = slice(first[drive], first[drive] + size[drive])
        column = course if flag == HELD_COURSE else speed
        assert column is not None  # it has suspects
        judge = _zeros if flag == ZERO_SPEED else partial(_held, turns=flag == HELD_COURSE)
        wrong = judge(time[own], lat[own], lon[own], column[own])
        flags[own][wrong] |= flag
        if flag == HELD_SPEED and wrong.any():
            pace = np.array(pace)
            pace[own] = _between_those(column[own], wrong)
    return Unmeasured(flags, pace) if flags.any() else None


def _between_those(speed: Array, wrong: Bools) -> Array:
    """Speeds of one drive, wrong ones on lines between the others."""
    known = np.flatnonzero(~wrong & np.isfinite(speed))
    return np.where(wrong, np.interp(np.arange(len(speed)), known, speed[known]), speed)


def _repeating(column: Array | None, first: Ints, size: Ints) -> list[int]:
    """Drives in which enough rows repeat a number other than 0."""
    if column is None:
        return []
    again = np.zeros(len(column), np.bool_)
    again[1:] = (column[1:] == column[:-1]) & (column[1:] != 0.0)
    if not again.any():
        return []
    counts = np.add.reduceat(again, first, dtype=np.int64)
    return np.flatnonzero((size >= FEWEST) & (counts > _REPEATS * size)).tolist()


def _held(time: Array, lat: Array, lon: Array, column: Array, turns: bool) -> Bools:
    """Which numbers of one drive, (n,), repeat the row before, where most do that should not."""
    again = np.zeros(len(time), np.bool_)
    change = np.diff(column)
    again[1:] = change == 0.0
    change = np.abs(wrap_degrees(change) if turns else change)
    steps = change[change > _STEP]
    if not len(steps) or are_mostly_below(steps, _JUMPS * steps.min()):
        return again & False
    moves, known = np.zeros((2, len(time)), np.bool_)
    row = np.arange(1, len(time))
    moves[1:] = np.hypot(*metres(lat, lon, row - 1, row)) > _MOVES * np.diff(time)
    known[1:] = moves[1:] & np.isfinite(change)
    steps = change[(known & ~again)[1:]]
    if known.sum() < FEWEST or again[known].mean() <= MOST or not len(steps):
        return again & False
    if are_mostly_below(steps, _JUMPS * steps[steps > _STEP].min()):
        return again & False
    # a vehicle that stands for longer has the speed of 0, but for the last one before it drives
    first = np.append(np.flatnonzero(~again), len(time))
    rows = np.diff(first)
    behind = np.repeat(first[1:], rows) - np.arange(len(time))  # rows up to the next number
    usual = np.median(rows[column[first[:-1]] != 0.0])
    return np.asarray(again & ((column != 0.0) | (behind < usual)))


def _stopping(time: Array, speed: Array | None, first: Ints, size: Ints) -> list[int]:
    """Drives in which a speed falls to 0 as no vehicle brakes."""
    if speed is None:
        return []
    falls = np.flatnonzero((speed[1:] == 0.0) & (speed[:-1] > _FAST)) + 1
    falls = falls[speed[falls - 1] > _HARD * (time[falls] - time[falls - 1])]
    drives = set((np.searchsorted(first, falls, side="right") - 1).tolist())
    return [drive for drive in sorted(drives) if size[drive] >= FEWEST]


def _zeros(time: Array, lat: Array, lon: Array, speed: Array) -> Bools:
    """Which speeds of one drive, (n,), are 0, where that cannot be true of too many."""
    zero = speed == 0.0
    begin = np.flatnonzero(zero[1:] & ~zero[:-1])  # the row before each run
    end = np.flatnonzero(zero[:-1] & ~zero[1:]) + 1  # and behind it
    end = end[np.searchsorted(end, begin[0] + 1) :] if len(begin) else end
    begin = begin[: len(end)]
    v, w = speed[begin], speed[end]
    apart = np.concatenate([[0], np.cumsum(np.diff(time) > _CLOSE)])
    braked = v > np.maximum(_HARD * (time[begin + 1] - time[begin]), _FAST)
    braked &= w > np.maximum(_HARD * (time[end] - time[end - 1]), _FAST)
    went = np.hypot(*metres(lat, lon, begin, end))
    braked &= went > _WENT * np.minimum(v, w) * (time[end] - time[begin])
    braked &= apart[begin] == apart[end]
    proven = int((end - begin - 1)[braked].sum())
    return np.asarray(zero if proven > _PROVEN * len(time) else zero & False)
