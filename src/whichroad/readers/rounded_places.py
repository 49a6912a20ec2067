"""Coordinates that were rounded to few decimals or to a grid: that error is a part of each fix's.

Degrees of four decimals are steps of 11 m.  Those of five, of 1 m, are left as they are.
"""

from typing import NamedTuple

import numpy as np

from ..geodesy.angles import radians
from ..geodesy.units import METRES_PER_DEGREE
from ..observations import ROUNDED, Array, Fixes
from .checks import Bools, Ints
from .grids import Grid, grid_of
from .known_grids import FEW, Lattice, grid_of_table, known_grid

_FULL = 5  # decimals, from which on nothing is done
_FEWEST = 10  # places of a drive, so that it is no chance
_COARSE = 3  # decimals up to which `FEW` places are no chance either
_EXACT = 5e-8  # degrees, up to which a place is at a step
_SINGLE = 6.1e-8  # of a number: the error of one of single precision
_SHARE = 1.0 / 12.0  # of a step's square: a larger one, for numbers cut off, makes levels worse
_APART = 2e-8  # degrees, 2 mm: between fixes at one place


def decimals_of(lat: Array, lon: Array, first: Ints) -> Ints:
    """Decimals of degrees to which the places of each drive were rounded, (d,); 5: or more.

    Args:
        lat: (n,) degrees, drive after drive.
        lon: (n,) degrees.
        first: (d,) where each drive begins.
    """
    found = np.full(len(first), _FULL)
    if not _are_steps(lat[first], lon[first], _FULL - 1).any():  # as of nearly all tables
        return found
    places = _places(lat, lon, first)
    spans = [np.maximum.reduceat(c, first) - np.minimum.reduceat(c, first) for c in (lat, lon)]
    for decimals in reversed(range(_FULL)):
        moved = np.minimum(*spans) > 0.5 * 10.0**-decimals  # what is always the same tells nothing
        some = moved & (places >= (FEW if decimals <= _COARSE else _FEWEST))
        found[some & np.logical_and.reduceat(_are_steps(lat, lon, decimals), first)] = decimals
    return found


def _are_steps(lat: Array, lon: Array, decimals: int) -> Bools:
    """Whether both numbers have no further decimals, but for what single precision takes."""
    return _is_step(lat, decimals) & _is_step(lon, decimals)


def _is_step(degrees: Array, decimals: int) -> Bools:
    single = degrees == degrees.astype(np.float32)
    exact = np.where(single, np.maximum(_EXACT, _SINGLE * np.abs(degrees)), _EXACT)
    return np.asarray(np.abs(degrees - np.round(degrees, decimals)) < exact)


def _places(lat: Array, lon: Array, first: Ints) -> Ints:
    """How many different places each drive has."""
    drive = np.zeros(len(lat), np.int64)
    drive[first[1:]] = 1
    drive = np.cumsum(drive)
    order = np.lexsort((lon, lat, drive))
    new = _changes(lat[order], lon[order], drive[order])
    return np.bincount(drive[order][new], minlength=len(first))


def _changes(*columns: Array | Ints) -> Bools:
    """Whether a row differs from the one before it."""
    new = np.ones(len(columns[0]), np.bool_)
    new[1:] = np.logical_or.reduce([np.diff(column) != 0 for column in columns])
    return new


def _steps(lat: Array, lon: Array, first: Ints, table: Lattice | None = None) -> Grid:
    """Degrees from line to line of the places of each drive, by their decimals or else a grid."""
    decimals = decimals_of(lat, lon, first)
    found = np.where(decimals < _FULL, 10.0**-decimals, 0.0)
    if (found > 0.0).all():
        return Grid(found, found)
    grid = _or(Grid(found, found), grid_of(lat, lon, first))
    grid = _or(grid, known_grid(lat, lon, first))
    return grid if table is None else _or(grid, grid_of_table(table, lat, lon, first))


def _or(grid: Grid, other: Grid) -> Grid:
    """A grid, and another for the drives that are not on it."""
    found = grid.lat > 0.0
    return Grid(*(np.where(found, one, two) for one, two in zip(grid, other, strict=True)))


def lattice_of(lat: Array, lon: Array) -> Lattice | None:
    """The lines on which the places of many drives together are; None: they are on none.

    Args:
        lat: (n,) degrees, n > 0.
        lon: (n,) degrees.
    """
    first = np.zeros(1, np.int64)
    if decimals_of(lat, lon, first)[0] < _FULL:
        step = 10.0 ** -int(decimals_of(lat, lon, first)[0])
        return Lattice(step, step)
    steps = _steps(lat, lon, first)
    if steps.lat[0] == 0.0:
        return None
    spans = (float(np.ptp(column)) for column in (lat, lon))
    return Lattice(float(steps.lat[0]), float(steps.lon[0]), float(lat[0]), float(lon[0]), *spans)


class Rounding(NamedTuple):
    """What the rounding of places adds to them, (n,) each."""

    lat_deg: Array  # less than 3 mm
    ee: Array  # m², variance eastwards; 0: not rounded
    nn: Array


def rounding(lat: Array, lon: Array, first: Ints, table: Lattice | None = None) -> Rounding | None:
    """What the rounding of the places of drives adds to them; None: they are not rounded.

    Its error is uniform over a step.  A place that is that of the fix before it again is moved by
    millimetres: the filter takes fixes that are the same to the digit for no measurements.

    Args:
        lat: (n,) degrees, drive after drive.
        lon: (n,) degrees.
        first: (d,) where each drive begins.
        table: The grid of the table of which these are drives: few places show none.
    """
    steps = _steps(lat, lon, first, table)
    if not (steps.lat > 0.0).any():
        return None
    drive = np.repeat(np.arange(len(first)), np.diff(first, append=len(lat)))
    row = np.arange(len(lat))
    again = row - np.maximum.accumulate(np.where(_changes(lat, lon, drive), row, 0))
    moved = np.where((steps.lat[drive] > 0.0) & (again % 2 == 1), _APART, 0.0)
    ee, nn = ((METRES_PER_DEGREE * step[drive]) ** 2 * _SHARE for step in (steps.lon, steps.lat))
    return Rounding(moved, ee * np.cos(radians(lat)) ** 2, nn)


def rounding_notes(fixes: Fixes | None, first: int = 0, end: int | None = None) -> tuple[str, ...]:
    """What is to be said of the fixes of one drive, from `first` on, whose places were rounded."""
    rounded = () if fixes is None else np.flatnonzero(fixes.flags[first:end] & ROUNDED) + first
    if fixes is None or not len(rounded):
        return ()
    lat, lon = fixes.lat_deg[rounded], fixes.lon_deg[rounded]
    new = (np.abs(np.diff(lat, prepend=np.inf)) > 1.5 * _APART) | (
        np.diff(lon, prepend=np.inf) != 0
    )
    lat, lon, only = lat[new], lon[new], np.zeros(1, np.int64)
    decimals, steps = int(decimals_of(lat, lon, only)[0]), _steps(lat, lon, only)
    if steps.lat[0] == 0.0:
        return (
            "coordinates are rounded or on a grid, as those of the first drives of the table: the "
            "error of that was added to the sigmas of the fixes; give all decimals",
        )
    north, east = (METRES_PER_DEGREE * float(step[0]) for step in (steps.lat, steps.lon))
    what = f"rounded to {decimals} decimals, steps of {north:.3g} m"
    if decimals == _FULL:
        east *= float(np.cos(radians(lat[0])))
        what = f"on a grid, {north:.3g} m from south to north and {east:.3g} m from west to east"
    return (
        f"coordinates are {what}: {north * _SHARE**0.5:.2g} m were added to the sigmas of the "
        "fixes; give all decimals",
    )
