"""Places on a grid: in whole hundredths of minutes or arc seconds, or in the middle of cells.

Latitudes and longitudes have a step each, of 2 m or more.
"""

from typing import NamedTuple

import numpy as np

from ..observations import Array
from .checks import Ints

_LEAST = 2e-5  # degrees, 2.2 m: of finer grids nothing is said
_FEWEST = 6  # lines of each kind on which a drive has places, so that it is no chance
_PLACES = 10  # and at crossings of lines
_EXACT = 5e-8  # degrees, up to which a place is on a line
_SINGLE = 8e-8  # of a number: the error of one of single precision, and of a fit
_WRITTEN = 0.7  # of the last decimal: the error of a number that was written with few, and of a fit
COARSE = 10.0  # such errors that a step has at least
_ASKED = 32  # gaps between lines that tell the step
_DIGITS = 1e-4  # of the last decimal, up to which a number has no further ones
_TURNS = 0.2  # of the moves, from which on differ from the one before: else it is one speed


class Grid(NamedTuple):
    """Degrees from line to line, (d,) each; 0: a drive is on no grid."""

    lat: Array
    lon: Array


def grid_of(lat: Array, lon: Array, first: Ints) -> Grid:
    """The grid on which all places of each drive are.

    Args:
        lat: (n,) degrees, drive after drive.
        lon: (n,) degrees.
        first: (d,) where each drive begins.
    """
    found = Grid(np.zeros(len(first)), np.zeros(len(first)))
    coarse = np.diff(first, append=len(lat)) >= _PLACES
    moved = []
    for column in (lat, lon):
        moved.append(_moved(column, first))
        coarse &= np.minimum.reduceat(moved[-1], first) > _LEAST - 2.0 * _EXACT
        if not coarse.any():  # as of nearly all tables of a fix a second
            return found
    errors = [errors_of(column, first) for column in (lat, lon)]
    end = np.append(first[1:], len(lat))
    for drive in np.flatnonzero(coarse).tolist():
        own = slice(first[drive], end[drive])
        told = zip(moved, errors, strict=True)
        if not all(_common(_first_of(steps[own]), error[drive]) for steps, error in told):
            continue
        north, east = (_lines(lat[own], errors[0][drive]), _lines(lon[own], errors[1][drive]))
        if north and east and _is_wide(north.number, east.number):
            found.lat[drive], found.lon[drive] = north.step, east.step
    return found


def _moved(degrees: Array, first: Ints) -> Array:
    """How far each place is from the one before it, (n,); infinite where there is none, or 0."""
    moved = np.empty(len(degrees))
    np.abs(np.diff(degrees), out=moved[1:])
    moved[first] = np.inf
    moved[moved <= _EXACT] = np.inf
    return moved


def _first_of(steps: Array) -> Array:
    """Some of the steps of a drive that are known, the smallest first; none: a single 0."""
    known = steps[np.isfinite(steps)][:_ASKED]
    known.sort()
    return known if len(known) else np.zeros(1)


def errors_of(degrees: Array, first: Ints) -> Array:
    """By how much the numbers of each drive may be off their lines, as they are written."""
    size = np.abs(degrees)
    single = np.logical_and.reduceat(degrees == degrees.astype(np.float32), first)
    errors = np.where(single, _SINGLE * np.maximum.reduceat(size, first), 0.0)
    for decimals in (6, 5):
        digits = size * 10.0**decimals
        written = np.logical_and.reduceat(np.abs(digits - np.round(digits)) < _DIGITS, first)
        errors = np.where(written, np.maximum(errors, _WRITTEN * 10.0**-decimals), errors)
    return np.maximum(errors, _EXACT)


class _Lines(NamedTuple):
    """The lines on which the places of a drive are."""

    step: float  # degrees
    number: Ints  # (n,) of the line of each place


def _lines(degrees: Array, error: float) -> _Lines | None:
    """The evenly spaced lines on which numbers are; None: they are on none."""
    lines, back = np.unique(degrees, return_inverse=True)
    gaps = np.diff(lines)
    new = gaps > 2.0 * error
    if np.count_nonzero(new) < _FEWEST - 1:
        return None
    step = _common(np.unique(gaps[new])[:_ASKED], error)
    if step == 0.0:
        return None
    number = np.append(0, np.cumsum(np.round(gaps / step).astype(np.int64)))
    step, begin = np.polyfit(number, lines - lines[0], 1)
    if np.abs(lines - lines[0] - begin - step * number).max() > error:
        return None
    return _Lines(float(step), number[back])


def _common(gaps: Array, error: float) -> float:
    """The largest number of which gaps are multiples, by Euclid's algorithm; 0: it is too small.

    Args:
        gaps: (n,) degrees.
        error: Of the ends of each.
    """
    least = 0.95 * max(_LEAST, COARSE * error)
    step, off = float(gaps[0]), 2.0 * error  # and how far it may be off
    for gap in gaps[1:].tolist():
        rest, of_rest = gap, 2.0 * error
        while True:
            number = round(rest / step)
            left, of_left = abs(rest - number * step), of_rest + number * off
            if left <= of_left:
                break
            rest, of_rest, step, off = step, off, left, of_left
            if step < least:
                return 0.0
        if number and of_rest / number < off:
            step, off = rest / number, of_rest / number
    return step if step >= least else 0.0


def _is_wide(north: Ints, east: Ints) -> bool:
    """Whether a drive has enough places, and moves that differ from one to the next.

    Who drives straight on at one speed has places on a grid of his own.
    """
    places = np.column_stack([north, east])
    moves = np.diff(places, axis=0)
    moves = moves[(moves != 0).any(axis=1)]
    differ = (np.diff(moves, axis=0) != 0).any(axis=1)
    many = len(np.unique(places, axis=0)) >= _PLACES
    return bool(many and np.mean(differ) >= _TURNS)
