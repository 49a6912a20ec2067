"""Grids that are known beforehand: geohashes, seconds, minutes, and that of a whole table."""

from typing import NamedTuple

import numpy as np

from ..observations import Array
from .checks import Ints
from .grids import COARSE, Grid, errors_of


class Lattice(NamedTuple):
    """Lines of latitude and longitude, degrees."""

    lat: float  # from line to line
    lon: float
    lat_line: float = 0.0  # one of the lines
    lon_line: float = 0.0
    lat_span: float = np.inf  # over which it was measured; inf: it is known
    lon_span: float = np.inf


_EIGHTH = 45.0  # degrees, of a turn


def _cells(letters: int) -> Lattice:
    """The middles of the cells of a geohash."""
    east = (5 * letters + 1) // 2  # of its bits; the others are of the latitude
    lat, lon = 0.5 ** (5 * letters - east - 2) * _EIGHTH, 0.5 ** (east - 3) * _EIGHTH
    return Lattice(lat, lon, 0.5 * lat - 90.0, 0.5 * lon - 180.0)


_KNOWN = (
    *(_cells(letters) for letters in (8, 7, 6, 5)),
    *(Lattice(step, step) for step in (1 / 6000, 1 / 3600, 1 / 600, 1 / 60)),
)
FEW = 4  # places of a drive, so that a coarse grid is no chance
_LOOSEST = 1e-5  # degrees, by which places may be off their lines: written with 5 decimals


def known_grid(lat: Array, lon: Array, first: Ints) -> Grid:
    """The grid on which all places of each drive are: the coarsest of those that are known.

    They are the middles of cells of a geohash, hundredths and tenths of minutes, and seconds.
    It takes `FEW` crossings of lines, and two lines of each kind.

    Args:
        lat: (n,) degrees, drive after drive.
        lon: (n,) degrees.
        first: (d,) where each drive begins.
    """
    found = Grid(np.zeros(len(first)), np.zeros(len(first)))
    for lattice in _KNOWN:
        _add(found, lattice, lat, lon, first, FEW)
    return found


def grid_of_table(lattice: Lattice, lat: Array, lon: Array, first: Ints) -> Grid:
    """The same of the grid of their table alone, of which one place tells."""
    found = Grid(np.zeros(len(first)), np.zeros(len(first)))
    _add(found, lattice, lat, lon, first, 1)
    return found


def _add(found: Grid, lattice: Lattice, lat: Array, lon: Array, first: Ints, places: int) -> None:
    """Note a grid for the drives all of whose places are on it."""
    end = np.append(first[1:], len(lat))
    ends = np.concatenate([first, end - 1])  # of nearly all tables none is near a line
    near = (_away(lattice, lat[ends], lon[ends])[0] < _LOOSEST).all(axis=0)
    for drive in np.flatnonzero(near.reshape(2, -1).all(axis=0)).tolist():
        own = slice(first[drive], end[drive])
        errors = [errors_of(one[own], np.zeros(1, np.int64)) for one in (lat, lon)]
        away, far = _away(lattice, lat[own], lon[own])
        allowed = np.array(errors) * far
        on = (away < allowed).all() and min(lattice.lat, lattice.lon) > COARSE * allowed.max()
        if on and _has_places(lattice, lat[own], lon[own], places):
            found.lat[drive], found.lon[drive] = lattice.lat, lattice.lon


def _has_places(lattice: Lattice, lat: Array, lon: Array, places: int) -> bool:
    """Whether places are at so many crossings of lines, not all on one of them."""
    if places == 1:
        return True
    north, east = (lat - lattice.lat_line) / lattice.lat, (lon - lattice.lon_line) / lattice.lon
    lines = np.round(np.column_stack([north, east]))
    lines -= lines[0]
    return len(np.unique(lines, axis=0)) >= places and bool(lines.any(axis=0).all())


def _away(lattice: Lattice, lat: Array, lon: Array) -> tuple[Array, Array]:
    """Of (n,) places from the next line of each kind: degrees; errors that are allowed, (2, n)."""
    away, far = [], []
    for degrees, step, line, span in zip(
        (lat, lon), lattice[:2], lattice[2:4], lattice[4:], strict=True
    ):
        number = (degrees - line) / step
        away.append(step * np.abs(number - np.round(number)))
        far.append(np.ones(len(lat)) if np.isinf(span) else 2.0 + np.abs(degrees - line) / span)
    return np.array(away), np.array(far)
