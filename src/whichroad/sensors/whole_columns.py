"""Odometry of a recorded drive that is wrong throughout, as only the whole of it shows.

Tables are filled wrongly: with zeros, with one wheel in the columns of both, with the other sign.
On line this is found out while driving (`filter.vetting`); here nothing need go wrong before.
"""

import math

import numpy as np

from ..geodesy.plane import Plane
from ..observations import Array, Fixes
from .odometry import Motion

STANDS, TURNLESS, BACKWARDS = "stands still", "no turns", "sign of distance"

_FEWEST = 10  # fixes
_MOVED = 300.0  # m, and
_SIGMAS = 20.0  # of the usual fix, that most fixes are apart where the vehicle moves
_MOST = (5.0, 95.0)  # per cent of them
_BACK = 200.0  # m, net, backwards
_NET = 0.8  # share of all distances that are, then
_NO_TURN = 1e-6  # rad from reading to reading
_LEG, _BENDS = 50.0, 0.6  # m, and rad between such a leg and the whole way
_LEGS, _PART = 4, 0.1  # of them that bend, and of all


def less_wrong(
    motion: Motion, fixes: Fixes | None, plane: Plane
) -> tuple[Motion | None, tuple[str, ...]]:
    """Odometry without what is wrong throughout, and what that was.

    Args:
        motion: Of the whole drive.
        fixes: Of the same drive: where they do not move, nothing is known.
        plane: The map's.

    Returns:
        None where nothing of it is left; and `STANDS`, `TURNLESS`, `BACKWARDS`.
    """
    steps = np.diff(motion.distance)
    way = float(np.abs(steps).sum())
    backwards = -steps.sum() > max(_BACK, _NET * way)
    turnless = motion.turn is not None and motion.by is None and _never(motion.turn)
    if fixes is None or not (way == 0.0 or backwards or turnless):
        return motion, ()
    place, sigma = _places(fixes, motion.time[0], motion.time[-1], plane)
    if len(place) < _FEWEST or not _moves(place, sigma):
        return motion, ()
    if way == 0.0:
        return None, (STANDS,)
    wrong = []
    if backwards:
        motion = motion._replace(distance=-motion.distance)
        wrong.append(BACKWARDS)
    if turnless and _turns(place, sigma):
        motion = motion._replace(turn=None, gyro=False)
        wrong.append(TURNLESS)
    return motion, tuple(wrong)


def _never(turn: Array) -> bool:
    return bool((np.abs(np.diff(turn)) < _NO_TURN).all())


def _places(fixes: Fixes, begin: float, end: float, plane: Plane) -> tuple[Array, float]:
    """Places between two times, complex, m, and the usual sigma, m."""
    part = slice(*np.searchsorted(fixes.time, (begin, end)))
    x, y = plane.from_geodetic(fixes.lat_deg[part], fixes.lon_deg[part])
    variance = (fixes.cov_ee + fixes.cov_nn)[part]
    return x + 1j * y, math.sqrt(float(np.median(variance))) if len(x) else 0.0


def _moves(place: Array, sigma: float) -> bool:
    """Whether most fixes are far apart."""
    sides = [np.diff(np.percentile(axis, _MOST))[0] for axis in (place.real, place.imag)]
    return bool(math.hypot(*sides) > max(_MOVED, _SIGMAS * sigma))


def _turns(place: Array, sigma: float) -> bool:
    """Whether the way of the fixes bends: several of its legs go another way than it does.

    A receiver that jumps away and back makes two such legs.
    """
    least, ends = max(_LEG, _SIGMAS * sigma), [place[0]]
    for one in place:
        if abs(one - ends[-1]) > least:
            ends.append(one)
    legs = np.diff(ends)
    legs /= np.abs(legs)
    off = np.abs(np.angle(legs * legs.sum().conj())) > _BENDS
    return bool(off.sum() >= _LEGS and off.mean() > _PART)
