"""Speeds and courses of a recording that lag behind its places by seconds, or these behind them.

Receivers smooth them, and tables are joined by times that differ.  A speed that is some seconds old
puts the vehicle on the wrong side of a junction.  Both are compared with the chord between the
places a second before and behind; each has its own delay.  No speed is early: where it seems so,
the places are late, as by a low pass, and `late_places` moves them.
"""

from collections.abc import Callable
from copy import deepcopy
from typing import NamedTuple

import numpy as np

from ..geodesy.angles import radians
from ..geodesy.units import METRES_PER_DEGREE
from ..observations import Array
from .checks import Ints, Skipped
from .interpolated_places import metres
from .late_places import Places, move_to

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
    """By how much speeds and courses of a drive lag behind its places, s; 0: they do not."""

    speed: int  # below 0: the places lag behind the speeds
    course: int  # in that case: behind the places once these are moved


_NO_DELAY = Late(0, 0)


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
        return _NO_DELAY
    if float(np.median(np.diff(time))) > _CLOSE or np.std(speed) < _VARIES:
        return _NO_DELAY
    told = _delays(time, lat, lon, speed, course)
    back = None if course is None else course[::-1] + 180.0
    # driven backwards, the places lead where they lag
    other = _delays(-time[::-1], lat[::-1], lon[::-1], speed[::-1], back)
    if other.left >= told.left:
        return Late(told.speed, told.course)
    return Late(-other.speed, 0 if other.alike else other.speed)


class _Delays(NamedTuple):
    """Delays of speeds and courses behind places, s; 0: none."""

    speed: int
    course: int
    alike: bool  # courses fit with the delay of the speeds better than without
    left: float  # share of the squared difference of speeds without a delay that is left


def _delays(time: Array, lat: Array, lon: Array, speed: Array, course: Array | None) -> _Delays:
    """The delays of one drive whose speeds vary."""
    none = _Delays(0, 0, True, 1.0)
    step = float(np.median(np.diff(time)))
    side = max(round(1.0 / step), 1)
    at = np.arange(side, len(time) - side - round(_LONGEST / step))
    if len(at) < _FEWEST // 2:
        return none
    before, behind = at - side, at + side
    east, north = metres(lat, lon, before, behind)
    chord = np.hypot(east, north)
    pace = chord / (time[behind] - time[before])

    def of_speed(late: int) -> float:
        off = speed[at + round(late / step)] - pace
        return float(np.minimum(off * off, _GROSS**2).mean())

    found = _delay(of_speed)
    if not found:
        return none
    left = of_speed(found) / of_speed(0)
    if course is None:
        return _Delays(found, 0, True, left)
    shown = (chord > _CHORD) & np.isfinite(course[at])
    if np.count_nonzero(shown) < _SHOWN:
        return _Delays(found, 0, True, left)
    rows, way = at[shown], np.arctan2(east[shown], north[shown])

    def of_course(late: int) -> float:
        return float(np.nanmean(1.0 - np.cos(radians(course[rows + round(late / step)]) - way)))

    return _Delays(found, _delay(of_course), of_course(found) <= of_course(0), left)


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
    time: Array, places: Places, columns: Columns, first: Ints, skipped: Skipped
) -> tuple[Places, Columns]:
    """Speeds and courses, each at the place it belongs to, and places at the times of speeds.

    Args:
        time: (n,) s, drive after drive.
        places: (n,) each.
        columns: `speed` (m/s), `sigma_speed` and `course` (degrees), (n,) each or None.
        first: (d,) where each drive begins.
        skipped: Rows whose speed or place was moved are counted.

    Returns:
        The same where nothing is late.
    """
    if columns.speed is None:
        return places, columns
    place, moved, new = places[:2], columns, None
    bounds = np.append(first, len(time))
    suspects = set(_may_lag(time, place, columns.speed, bounds).tolist())
    back = (place[0][::-1], place[1][::-1])
    early = _may_lag(-time[::-1], back, columns.speed[::-1], len(time) - bounds[::-1])
    suspects |= set((len(first) - 1 - early).tolist())
    for drive in sorted(suspects):
        low, high = int(bounds[drive]), int(bounds[drive + 1])
        own = slice(low, high)
        course = None if columns.course is None else columns.course[own]
        late = delays(time[own], place[0][own], place[1][own], columns.speed[own], course)
        if not late.speed:
            continue
        if moved is columns:
            moved = Columns(*(None if c is None else c.copy() for c in columns))
        step = float(np.median(np.diff(time[own])))
        rows = round(abs(late.speed) / step)
        of_speed, of_course = rows if late.speed > 0 else 0, round(late.course / step)
        for values, k in zip(moved, (of_speed, of_speed, of_course), strict=True):
            if values is not None and k:
                values[low : high - k] = values[low + k : high].copy()
                values[high - k : high] = np.nan
        seconds = f"{rows * step:.0f} s behind its"
        if late.speed > 0:
            skipped[f"speed {seconds} place (moved there)"] += high - low
        else:
            new = new or deepcopy(places)
            move_to(time[own] + rows * step, new, own, time[own])
            skipped[f"place {seconds} speed (moved there)"] += high - low
    return new or places, moved
