"""Speeds and courses of a recording that lag behind its places by seconds.

Receivers smooth them, and tables are joined by times that differ.  A speed that is some seconds old
puts the vehicle on the wrong side of a junction.  Both are compared with the chord between the
places a second before and behind; each has its own delay.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..geodesy.angles import radians
from ..geodesy.units import METRES_PER_DEGREE
from ..observations import Array
from .checks import Ints, Skipped
from .interpolated_places import metres

_FEWEST = 60  # rows of a drive that is judged
_CLOSE = 2.5  # s between rows, up to which speeds of places show a delay
_FIRST, _LONGEST = 2, 12  # s, delays that are looked for
_LOOK = 3  # s, the delay that is tried first
_BETTER = 0.8  # of the squared difference without a delay, that the best has at most
_GROSS = 3.0  # m/s, beyond which a difference is an error of its own
_VARIES = 1.5  # m/s, standard deviation of a speed that shows a delay
_CHORD = 8.0  # m, the shortest chord that has a course
_SAMPLE = 2000  # rows that tell the usual time between rows
_GAIN = 0.05  # m²/s², by which the squared difference has to fall for a drive to be looked at
_SHOWN = 20  # rows with such a chord, at least


class Columns(NamedTuple):
    """What a receiver reports of its motion, (n,) each; None: nothing."""

    speed: Array | None  # m/s
    sigma_speed: Array | None
    course: Array | None  # degrees


class Late(NamedTuple):
    """By how much speeds and courses of a drive lag, s; 0: they do not."""

    speed: int
    course: int


def delays(time: Array, lat: Array, lon: Array, speed: Array, course: Array | None) -> Late:
    """The delays of one drive, from 2 s on, where they are clear.

    Args:
        time: (n,) s, in order.
        lat: (n,) degrees.
        lon: (n,) degrees.
        speed: (n,) m/s, NaN where absent.
        course: (n,) degrees, likewise; None: there is none.
    """
    if len(time) < _FEWEST or np.isnan(speed).any():
        return Late(0, 0)
    step = float(np.median(np.diff(time)))
    if step > _CLOSE or np.std(speed) < _VARIES:
        return Late(0, 0)
    side = max(round(1.0 / step), 1)
    at = np.arange(side, len(time) - side - round(_LONGEST / step))
    if len(at) < _FEWEST // 2:
        return Late(0, 0)
    before, behind = at - side, at + side
    east, north = metres(lat, lon, before, behind)
    chord = np.hypot(east, north)
    pace = chord / (time[behind] - time[before])

    def of_speed(late: int) -> float:
        off = speed[at + round(late / step)] - pace
        return float(np.minimum(off * off, _GROSS**2).mean())

    found = _delay(of_speed)
    if course is None or not found:
        return Late(found, 0)
    shown = (chord > _CHORD) & np.isfinite(course[at])
    if np.count_nonzero(shown) < _SHOWN:
        return Late(found, 0)
    rows, way = at[shown], np.arctan2(east[shown], north[shown])

    def of_course(late: int) -> float:
        return float(np.nanmean(1.0 - np.cos(radians(course[rows + round(late / step)]) - way)))

    return Late(found, _delay(of_course))


def _may_lag(time: Array, place: tuple[Array, Array], speed: Array, bounds: Ints) -> Ints:
    """Drives whose speeds fit the places of some seconds before better, found for all at once."""
    none = np.zeros(0, np.int64)
    if len(time) < _FEWEST:
        return none
    steps = np.diff(time[:_SAMPLE])
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if not 0.0 < step <= _CLOSE:
        return none
    side, late = max(round(1.0 / step), 1), round(_LOOK / step)
    n = len(time) - 2 * side - late
    if n < 1:
        return none
    spent = time[2 * side : 2 * side + n] - time[:n]
    lat, lon = place
    north = (lat[2 * side : 2 * side + n] - lat[:n]) * METRES_PER_DEGREE
    east = (lon[2 * side : 2 * side + n] - lon[:n]) * METRES_PER_DEGREE
    east *= np.cos(radians(lat[:n]))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        pace = np.hypot(east, north) / spent
        gain = np.minimum((speed[side : side + n] - pace) ** 2, _GROSS**2)
        gain -= np.minimum((speed[side + late : side + late + n] - pace) ** 2, _GROSS**2)
    whole = (time[2 * side + late :] - time[:n]) < 1.5 * (2 * side + late) * step
    gain = np.concatenate([np.where(whole & np.isfinite(gain), gain, 0.0), np.zeros(len(time) - n)])
    gained = np.add.reduceat(gain, bounds[:-1]) / np.diff(bounds)
    return np.flatnonzero((gained > _GAIN) & (np.diff(bounds) >= _FEWEST))


def _delay(difference: Callable[[int], float]) -> int:
    """The delay at which a mean squared difference is least by far, s; else 0."""
    without = difference(0)
    if difference(_LOOK) >= without:
        return 0
    values = [difference(late) for late in range(_FIRST, _LONGEST + 1)]
    least = int(np.argmin(values))
    return _FIRST + least if values[least] < _BETTER * without else 0


def in_time(
    time: Array, place: tuple[Array, Array], columns: Columns, first: Ints, skipped: Skipped
) -> Columns:
    """Speeds and courses, each at the place it belongs to.

    Args:
        time: (n,) s, drive after drive.
        place: Latitudes and longitudes, (n,) degrees.
        columns: `speed` (m/s), `sigma_speed` and `course` (degrees), (n,) each or None.
        first: (d,) where each drive begins.
        skipped: Rows whose speed was moved are counted.

    Returns:
        The same where nothing is late.
    """
    if columns.speed is None:
        return columns
    moved = columns
    bounds = np.append(first, len(time))
    for drive in _may_lag(time, place, columns.speed, bounds).tolist():
        low, high = int(bounds[drive]), int(bounds[drive + 1])
        own = slice(low, high)
        course = None if columns.course is None else columns.course[own]
        late = delays(time[own], place[0][own], place[1][own], columns.speed[own], course)
        if not late.speed:
            continue
        if moved is columns:
            moved = Columns(*(None if c is None else c.copy() for c in columns))
        step = float(np.median(np.diff(time[own])))
        for values, seconds in zip(moved, (late.speed, late.speed, late.course), strict=True):
            if values is not None and seconds:
                k = round(seconds / step)
                values[low : high - k] = values[low + k : high].copy()
                values[high - k : high] = np.nan
        skipped[f"speed {late.speed} s behind its place (moved there)"] += high - low
    return moved
