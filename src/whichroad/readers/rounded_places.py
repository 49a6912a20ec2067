"""Coordinates that were rounded to few decimals: the error of that is a part of each fix's.

Degrees of four decimals are steps of 11 m.  Those of five, of 1 m, are left as they are.
"""

from typing import NamedTuple

import numpy as np

from ..geodesy.angles import radians
from ..geodesy.units import METRES_PER_DEGREE
from ..observations import ROUNDED, Array, Fixes
from .checks import Bools, Ints

_FULL = 5  # decimals, from which on nothing is done
_FEWEST = 10  # places of a drive, so that it is no chance
_EXACT = 5e-8  # degrees, up to which a place is at a step
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
    enough = _places(lat, lon, first) >= _FEWEST
    for column in (lat, lon):  # one that is always the same tells nothing
        enough &= np.maximum.reduceat(column, first) > np.minimum.reduceat(column, first)
    for decimals in reversed(range(_FULL)):
        found[enough & np.logical_and.reduceat(_are_steps(lat, lon, decimals), first)] = decimals
    return found


def _are_steps(lat: Array, lon: Array, decimals: int) -> Bools:
    """Whether both numbers have no further decimals."""
    return np.asarray(
        (np.abs(lat - np.round(lat, decimals)) < _EXACT)
        & (np.abs(lon - np.round(lon, decimals)) < _EXACT)
    )


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


class Rounding(NamedTuple):
    """What the rounding of places adds to them, (n,) each."""

    lat_deg: Array  # less than 3 mm
    ee: Array  # m², variance eastwards; 0: not rounded
    nn: Array


def rounding(lat: Array, lon: Array, first: Ints) -> Rounding | None:
    """What the rounding of the places of drives adds to them; None: they are not rounded.

    Its error is uniform over a step.  A place that is that of the fix before it again is moved by
    millimetres: the filter takes fixes that are the same to the digit for no measurements.

    Args:
        lat: (n,) degrees, drive after drive.
        lon: (n,) degrees.
        first: (d,) where each drive begins.
    """
    decimals = decimals_of(lat, lon, first)
    if (decimals == _FULL).all():
        return None
    drive = np.repeat(np.arange(len(first)), np.diff(first, append=len(lat)))
    step = np.where(decimals < _FULL, METRES_PER_DEGREE * 10.0**-decimals, 0.0)[drive]
    row = np.arange(len(lat))
    again = row - np.maximum.accumulate(np.where(_changes(lat, lon, drive), row, 0))
    moved = np.where((step > 0.0) & (again % 2 == 1), _APART, 0.0)
    north = step**2 / 12.0
    return Rounding(moved, north * np.cos(radians(lat)) ** 2, north)


def rounding_notes(fixes: Fixes | None, first: int = 0, end: int | None = None) -> tuple[str, ...]:
    """What is to be said of the fixes of one drive, from `first` on, whose places were rounded."""
    rounded = () if fixes is None else np.flatnonzero(fixes.flags[first:end] & ROUNDED) + first
    if fixes is None or not len(rounded):
        return ()
    lat, lon = fixes.lat_deg[rounded], fixes.lon_deg[rounded]
    decimals = int(decimals_of(lat, lon, np.zeros(1, np.int64))[0])
    step = METRES_PER_DEGREE * 10.0**-decimals
    return (
        f"coordinates are rounded to {decimals} decimals, steps of {step:.3g} m: "
        f"{step / 12**0.5:.2g} m were added to the sigmas of the fixes; give all decimals",
    )
