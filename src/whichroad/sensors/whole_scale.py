"""Scales of an odometer and of its turns over a whole recorded drive, by the fixes.

On line a wrong one is found out while driving (`filter.vetting.scales`).  Of a
recorded drive it is known before it begins, where it is the same throughout.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..filter.vetting.motion_sources import BELOW
from ..filter.vetting.windows import BY_WHEELS
from ..geodesy.angles import wrap
from ..geodesy.plane import Plane
from ..observations import Array

_SHORTEST, _LEAST_TIME, _MOST_TIME = 150.0, 15.0, 60.0  # m, s, s of a chord
_STRAIGHT = 0.9  # least chord over way
_SIDE, _SIDE_TIME = 40.0, 12.0  # m, most s of a chord before or behind a corner
_TURN = (0.5, 2.2)  # rad, of corners
_FEWEST = 8  # chords, or corners
_WORTH = 0.04  # least difference from what is said
_LEAST, _MOST = 0.6, 1.6  # beyond is another unit, or a counter that is broken
_LOOSE, _ERROR = 0.02, 0.5  # of a ratio; m, of a chord beside what fixes report
_AGREE = 0.8  # share of the ratios that must agree with the middle one
_PARTS = 4  # of the drive, none of which may tell otherwise
_SURE = 4.0  # times the error of the middle one


class Scales(NamedTuple):
    """True metres for a metre of the odometer, and turns for one that is measured; 1.0: as said.

    Where two wheels measure the turn, theirs comes beside that of their ways.
    """

    way: float
    turn: float


class _Drive(NamedTuple):
    """A drive at its fixes, by odometry and by fixes, (n,) or (n, 2)."""

    time: Array
    reckoned: Array
    way: Array
    gaps: Array  # epochs before it whose motion was not measured
    seen: Array
    sigma: Array


def whole_scales(epochs: Records, plane: Plane) -> Scales:
    """Scales that are others throughout a drive.

    Args:
        epochs: (n,) EPOCH of a drive with distance and turn.
        plane: The map's.
    """
    drive = _at_fixes(epochs, plane)
    way = _scale(*_chords(drive))
    ratio, error = _corners(drive)
    wheels = np.mean(epochs.gyro == BY_WHEELS) > 0.5
    return Scales(way, _scale(ratio / way, error) if wheels else _scale(ratio, error))


def _scale(ratio: Array, error: Array) -> float:
    """The middle of some ratios, where it differs from 1 and they all say so."""
    if len(ratio) < _FEWEST:
        return 1.0
    middle = float(np.median(ratio))
    off = np.abs(ratio - middle)
    usual = float(np.median(error))
    spread = max(1.48 * float(np.median(off)), 1.25 * usual) / np.sqrt(len(ratio))
    chance = 3.0 * usual / np.sqrt(len(ratio) / _PARTS)
    parts = [float(np.median(part)) for part in np.array_split(ratio, _PARTS)]
    if (
        not _LEAST <= middle <= _MOST
        or abs(middle - 1.0) < max(_WORTH, _SURE * spread)
        or np.mean(off <= 3.0 * error + _LOOSE) < _AGREE
        or max(abs(part - middle) for part in parts) > _LOOSE + 0.5 * abs(middle - 1.0) + chance
    ):
        return 1.0
    return middle


def _at_fixes(epochs: Records, plane: Plane) -> _Drive:
    rows = np.flatnonzero(epochs.has_fix)
    heading = np.cumsum(epochs.turn) - epochs.turn
    c, s = np.cos(heading), np.sin(heading)
    x = np.cumsum(c * epochs.forward - s * epochs.left)[rows]
    y = np.cumsum(s * epochs.forward + c * epochs.left)[rows]
    fix = epochs.fix[rows]
    unknown = (epochs.odometry_valid == 0) | (epochs.odometry_valid == BELOW)
    scale = np.asarray(plane.scale(fix[:, 0], fix[:, 1]))
    return _Drive(
        epochs.time[rows], np.column_stack([x, y]), np.cumsum(np.abs(epochs.arc))[rows],
        np.cumsum(unknown)[rows], fix[:, :2] / scale[:, None],
        np.sqrt(fix[:, 2] * fix[:, 3]),
    )  # fmt: skip


def _cuts(
    drive: _Drive, shortest: float, times: tuple[float, float], straight: float
) -> NDArray[np.int64]:
    """First and last fixes of chords, one after the other, (k, 2)."""
    n = len(drive.time)
    soonest = np.maximum(
        np.searchsorted(drive.way, drive.way + shortest),
        np.searchsorted(drive.time, drive.time + times[0]),
    ).tolist()
    cuts = [0]
    while cuts[-1] < n and soonest[cuts[-1]] < n:
        cuts.append(soonest[cuts[-1]])
    first, last = np.array(cuts[:-1], np.int64), np.array(cuts[1:], np.int64)
    chord = np.hypot(*(drive.reckoned[last] - drive.reckoned[first]).T)
    seconds = drive.time[last] - drive.time[first]
    good = (chord >= straight * (drive.way[last] - drive.way[first])) & (seconds <= times[1])
    good &= drive.gaps[last] == drive.gaps[first]
    found: NDArray[np.int64] = np.column_stack([first, last])[good]
    return found


def _chords(drive: _Drive) -> tuple[Array, Array]:
    """Chords of the fixes over those of the odometry, and their errors."""
    first, last = _cuts(drive, _SHORTEST, (_LEAST_TIME, _MOST_TIME), _STRAIGHT).T
    chord = np.hypot(*(drive.reckoned[last] - drive.reckoned[first]).T)
    seen = np.hypot(*(drive.seen[last] - drive.seen[first]).T)
    error = np.hypot(drive.sigma[first], drive.sigma[last]) + _ERROR
    return seen / chord, error / chord


def _corners(drive: _Drive) -> tuple[Array, Array]:
    """Turns between chords of the fixes over those of the odometry, and their errors."""
    first, last = _cuts(drive, _SIDE, (0.0, _SIDE_TIME), 0.0).T
    told, seen = (_directions(at[last] - at[first]) for at in (drive.reckoned, drive.seen))
    side = np.hypot(*(drive.reckoned[last] - drive.reckoned[first]).T)
    error = 0.5 * (np.hypot(drive.sigma[first], drive.sigma[last]) + _ERROR) / side
    turned = wrap(np.diff(told))
    corner = (first[1:] == last[:-1]) & (np.abs(turned) > _TURN[0]) & (np.abs(turned) < _TURN[1])
    ratio = wrap(np.diff(seen))[corner] / turned[corner]
    return ratio, (np.hypot(error[1:], error[:-1]) / np.abs(turned + (turned == 0.0)))[corner]


def _directions(steps: Array) -> Array:
    return np.arctan2(steps[:, 1], steps[:, 0])
