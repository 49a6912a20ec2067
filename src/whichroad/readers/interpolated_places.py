"""Places on lines between others: rows that were made up, as by interpolation to every second.

They look like many fixes that agree.  Each drive is judged by its own rows.
"""

import numpy as np

from ..geodesy.angles import radians, wrap_degrees
from ..geodesy.units import METRES_PER_DEGREE
from ..observations import Array
from .checks import Bools, Ints
from .coarse_lines import STEP, TOLERANCE, lined_up

FEWEST = 20  # rows of a drive that is judged
_STEPS = (1e-8, 1e-7, 1e-6)  # degrees, of coordinates that were written with 8 to 6 decimals
_EXACT = 1e-9  # degrees, up to which a place lies on a line where all decimals are given
_DIGITS, _ROUNDING = 1e-3, 1.05  # steps: up to which a place is at one; that rounding moves it
MOST = 0.5  # of the moving rows, from which on they are made up
_COARSE = 0.8  # of all rows, the same where places have five decimals
_KINKS = 5  # rows off the lines, and tolerances by which they are,
_OFF = 5.0  # so that a smooth drive is none
_BENDS = 0.03  # m/s², below which no drive follows a chord by itself
_PACES = 3.0  # tolerances by which steps from row to row differ from line to line,
_EVEN = 0.02  # and share of them: a sphere differs from the ellipsoid by less


def interpolated(time: Array, lat: Array, lon: Array, first: Ints) -> Bools | None:
    """Which places lie on the lines between others, in drives most of whose places do.

    A real drive has such rows by chance only, or it is smooth throughout.  So the other rows
    have to be far off the lines, and speeds have to differ from line to line.  Rows at the end
    that repeat the last fix are among those that are found.

    Args:
        time: (n,) s, drive after drive.
        lat: (n,) degrees, as they were written.
        lon: (n,) degrees.
        first: (d,) where each drive begins.

    Returns:
        (n,); None: there is none.
    """
    if len(lat) < FEWEST:
        return None
    size = np.diff(first, append=len(lat))
    two = np.column_stack([lat[first], lat[np.minimum(first + 1, len(lat) - 1)]])
    near = np.zeros(len(lat), np.bool_)
    off = _off_line(lat, _shares(time))
    near[1:-1] = off <= np.repeat(_tolerances(two), size)[1:-1]
    lined = np.add.reduceat(near, first, dtype=np.int64)
    found: Bools | None = None
    exact = (size >= FEWEST) & (lined > MOST * size)
    coarse = (size >= FEWEST) & _are_steps(two, STEP)
    if coarse.any():
        near[1:-1] = (off <= TOLERANCE) & (_off_line(lon, _shares(time)) <= TOLERANCE)
        coarse &= np.add.reduceat(near, first, dtype=np.int64) > _COARSE * size
    for drive in np.flatnonzero(exact | coarse).tolist():
        own = slice(first[drive], first[drive] + size[drive])
        between = _between(time[own], lat[own], lon[own]) if exact[drive] else None
        if (
            between is None
            and coarse[drive]
            and _are_steps(np.concatenate([lat[own], lon[own]])[None], STEP).all()
        ):
            between = lined_up(time[own], lat[own], lon[own])
        if between is not None:
            found = np.zeros(len(lat), np.bool_) if found is None else found
            found[own] = between
    return found


def _shares(time: Array) -> Array:
    """Where the inner rows are between the rows around them, of their time, 0 to 1."""
    step = np.diff(time)
    with np.errstate(invalid="ignore", divide="ignore"):  # from drive to drive
        return np.asarray(step[:-1] / (step[:-1] + step[1:]))


def _off_line(value: Array, share: Array) -> Array:
    """How far the inner values are off the lines between those before and behind, (n - 2,)."""
    step = np.diff(value)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.abs(share * (step[:-1] + step[1:]) - step[:-1]))


def _between(time: Array, lat: Array, lon: Array) -> Bools | None:
    """Which places of one drive, (n,), were made up from others; None: it is no such drive."""
    tolerance = float(_tolerances(np.concatenate([lat, lon])[None])[0])
    share = _shares(time)
    off = np.zeros(len(time))
    off[1:-1] = np.maximum(_off_line(lat, share), _off_line(lon, share))
    kinks = np.flatnonzero(off > tolerance)
    if not _KINKS <= len(kinks) < MOST * len(time):
        return None
    if are_mostly_below(off[kinks], _OFF * tolerance):
        return None
    still = np.concatenate([[False], (np.diff(lat) == 0.0) & (np.diff(lon) == 0.0), [False]])
    moves = ~(still[:-1] & still[1:])
    made = (off <= tolerance) & moves
    made[[0, -1]] = False
    sure = made if tolerance == _EXACT else made & _on_chords(time, lat, lon, kinks, tolerance)
    if sure.sum() <= MOST * moves.sum() or not _changes_pace(time, lat, lon, made, tolerance):
        return None
    last = int(np.flatnonzero(~still[:-1])[-1])  # where the last place is first
    if len(time) - last <= np.diff(kinks).max():
        made[last + 1 :] = True
    return np.asarray(made)


def _tolerances(degrees: Array) -> Array:
    """Degrees by which rounding moves a place off its line, by the decimals of each row, (n,)."""
    found = np.full(len(degrees), _EXACT)
    for step in _STEPS:
        found[_are_steps(degrees, step)] = _ROUNDING * step
    return found


def _are_steps(degrees: Array, step: float) -> Bools:
    """Whether all numbers of a row are multiples of a step, (n,)."""
    off = np.abs(degrees / step - np.round(degrees / step))
    return np.asarray((off < _DIGITS).all(axis=1))


def _on_chords(time: Array, lat: Array, lon: Array, kinks: Ints, tolerance: float) -> Bools:
    """Which rows lie on the chord between the rows off the lines around them.

    Chords are as long as needed to tell a line from a smooth drive whose decimals are few.
    """
    kinks = np.concatenate([[0], kinks, [len(time) - 1]])
    after = np.searchsorted(kinks, np.arange(len(time))).clip(1)
    a, b = kinks[after - 1], kinks[after]
    share = (time - time[a]) / (time[b] - time[a])
    off = np.maximum(*(np.abs(c[a] + share * (c[b] - c[a]) - c) for c in (lat, lon)))
    bends = tolerance * METRES_PER_DEGREE / (0.5 * (time[b] - time[a])) ** 2
    return np.asarray((off <= tolerance) & (bends < _BENDS))


def _changes_pace(time: Array, lat: Array, lon: Array, made: Bools, tolerance: float) -> bool:
    """Whether speeds differ from line to line: a drive that was computed has one speed."""
    begin = np.flatnonzero(made[1:] & ~made[:-1])  # the row before each line
    if len(begin) <= _KINKS:
        return False
    step = np.diff(time)[begin]
    speed = np.hypot(*metres(lat, lon, begin, begin + 1)) / step
    least = _PACES * tolerance * METRES_PER_DEGREE / float(np.median(step))
    least = max(least, _EVEN * float(np.median(speed)))
    return bool(np.median(np.abs(np.diff(speed))) > least)


def are_mostly_below(values: Array, limit: float) -> bool:
    """Whether the median is, in a third of the time that a median takes."""
    return bool(2 * np.count_nonzero(values <= limit) >= len(values))


def metres(lat: Array, lon: Array, a: Ints, b: Ints) -> tuple[Array, Array]:
    """Metres east and north from places to others."""
    east = wrap_degrees(lon[b] - lon[a]) * np.cos(radians(lat[a]))
    return METRES_PER_DEGREE * east, METRES_PER_DEGREE * (lat[b] - lat[a])
