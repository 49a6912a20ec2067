"""Speeds and courses that are told in coarse steps: whole m/s, eight directions.

The error of a step lasts for as long as a vehicle drives evenly.  Some devices cut speeds to the
step below.  Each drive is judged by its own rows.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geodesy.angles import degrees, wrap_degrees
from ..observations import COARSE_COURSE, CUT_SPEED, MOVING, Array, Fixes
from ..wording import counted
from .checks import Ints
from .interpolated_places import FEWEST, metres

COARSE = COARSE_COURSE | CUT_SPEED
_SPEED, _COURSE = 0.29, 4.4  # m/s and degrees, below which a step is fine
_CIRCLE = 360.0  # degrees
_SAME = 1e-9  # by which numbers are the same
_UNUSED = 20.0  # degrees, from which on courses are not used
_SPEEDS = 8  # different speeds of a drive, so that it is no chance
_COURSES = (4, 8)  # different courses: half of the directions that there are, within these
_EXACT = 0.12  # of a step: speeds may have been rounded again, in another unit
_AGAIN = (0.011, 0.501)  # degrees, by which courses differ that were rounded again; to whole ones
_WINDOW = 5.0  # s, over which ways are compared with places; the longest time between rows
_MOVED = 20.0  # m in that time, beyond the errors of fixes
_STRAIGHT = 12.0  # degrees from chord to chord, up to which ways are as long as these
_WINDOWS = 6  # of times of their own, at least
_GROSS = 3.0  # steps, to which a difference is limited
_CUT = 0.25  # of a step, by which the speeds of most windows are too small
_SURE = 2.5  # standard errors of their mean


class Coarse(NamedTuple):
    """What coarse steps change, (n,) each."""

    more: Array  # m/s, cut off on average
    speed_sigma: Array  # m/s, of the step
    course_sigma: Array  # degrees; infinite: it is not used
    flags: NDArray[np.uint16]  # CUT_SPEED and COARSE_COURSE of `Fixes.flags`


def coarse_steps(
    time: Array, lat: Array, lon: Array, speed: Array | None, course: Array | None, first: Ints
) -> Coarse | None:
    """What the steps of speeds and courses do to them.

    Args:
        time: (n,) s, drive after drive.
        lat: (n,) degrees.
        lon: (n,) degrees.
        speed: (n,) m/s, NaN where absent; None: there is none, and no course that is used.
        course: (n,) degrees, likewise.
        first: (d,) where each drive begins.

    Returns:
        None: nothing, as steps are fine.
    """
    if speed is None:
        return None
    n = len(time)
    coarse: Coarse | None = None
    for own in _may_be_coarse(np.diff(speed), _SPEED, first, n):
        if not (step := _speed_step(speed[own])):
            continue
        coarse = coarse or _nothing(n)
        coarse.speed_sigma[own] = step / 12**0.5
        if _is_cut(time[own], lat[own], lon[own], speed[own], step):
            moves = speed[own] > 0.0  # most of the others stand
            coarse.more[own][moves] = 0.5 * step
            coarse.speed_sigma[own][~moves] *= 2.0
            coarse.flags[own][moves] |= CUT_SPEED
    if course is None:
        return coarse
    known = np.where(speed > MOVING, course, np.nan)
    for own in _may_be_coarse(wrap_degrees(np.diff(known)), _COURSE, first, n):
        if not (step := _course_step(known[own])):
            continue
        coarse = coarse or _nothing(n)
        coarse.course_sigma[own] = step / 12**0.5 if step < _UNUSED else np.inf
        if step >= _UNUSED:
            coarse.flags[own][np.isfinite(known[own])] |= COARSE_COURSE
    return coarse


def _nothing(n: int) -> Coarse:
    """No change of n rows."""
    more, speed, course = np.zeros((3, n))
    return Coarse(more, speed, course, np.zeros(n, np.uint16))


def _may_be_coarse(change: Array, step: float, first: Ints, n: int) -> Iterator[slice]:
    """The rows of drives in which no change from row to row, (n - 1,), is below a step but 0."""
    change = np.abs(change)
    fine = np.zeros(n, np.bool_)
    fine[1:] = (change > _SAME) & (change < step)
    fine[first] = False
    size = np.diff(first, append=n)
    for drive in np.flatnonzero((size >= FEWEST) & ~np.logical_or.reduceat(fine, first)):
        yield slice(first[drive], first[drive] + size[drive])


def _speed_step(speed: Array) -> float:
    """The step of which the speeds of a drive, m/s, are multiples; 0: it is fine, or unknown."""
    values = np.unique(speed[np.isfinite(speed)])
    if len(values) < _SPEEDS:
        return 0.0
    apart = np.diff(values)
    step = float(np.median(apart[apart < 1.5 * apart.min()]))
    if step < _SPEED:
        return 0.0
    k = np.round(values[0] / step) + np.append(0.0, np.cumsum(np.round(apart / step)))
    step = float(values @ k / (k @ k))
    return step if np.abs(values - k * step).max() < _EXACT * step else 0.0


def _course_step(course: Array) -> float:
    """The part of 360 degrees of which the courses of a drive are multiples; 0: as for speeds."""
    values = np.unique(np.mod(course[np.isfinite(course)], _CIRCLE))
    if len(values) < _COURSES[0]:
        return 0.0
    apart = np.diff(values, append=values[0] + _CIRCLE)
    directions = round(_CIRCLE / float(apart[apart < 1.5 * apart.min()].mean()))
    step = _CIRCLE / directions
    if step < _COURSE or len(values) < min(max(directions // 2, _COURSES[0]), _COURSES[1]):
        return 0.0
    off = _AGAIN[int((values == np.round(values)).all())]
    return step if np.abs(values - step * np.round(values / step)).max() < off else 0.0


def _is_cut(time: Array, lat: Array, lon: Array, speed: Array, step: float) -> bool:
    """Whether the speeds of a drive are about half a step below those between places."""
    at = np.flatnonzero(np.isfinite(speed))
    t, v = time[at], speed[at]
    k = max(round(_WINDOW / float(np.median(np.diff(t)))), 1)
    if len(at) < 2 * k + _WINDOWS:
        return False
    way = np.append(0.0, np.cumsum(0.5 * np.diff(t) * (v[1:] + v[:-1])))
    lasted, way = t[k:] - t[:-k], way[k:] - way[:-k]
    east, north = metres(lat, lon, at[:-k], at[k:])
    chord, course = np.hypot(east, north), degrees(np.arctan2(east, north))
    good = (lasted < 1.5 * _WINDOW) & (chord > _MOVED)
    good[k:] &= np.abs(wrap_degrees(course[k:] - course[:-k])) < _STRAIGHT
    good[:k] = False
    pace, over = (way / lasted)[good], ((way - chord) / lasted)[good]
    over = over.clip(-_GROSS * step, _GROSS * step)
    windows, mean = len(over) / k, over.mean() if len(over) else 0.0  # of times of their own
    if windows < _WINDOWS or mean > -_SURE * over.std() / windows**0.5:
        return False
    slow = over[pace <= np.median(pace)]  # a wrong scale shows in the others
    return bool(max(np.median(slow), np.median(over)) < -_CUT * step)


def coarse_notes(fixes: Fixes | None, first: int = 0, end: int | None = None) -> list[str]:
    """What is to be said of the fixes of one drive, from `first` on, whose steps are coarse."""
    if fixes is None or not (fixes.flags[first:end] & COARSE).any():
        return []
    notes, flags = [], fixes.flags[first:end]
    if (cut := (flags & CUT_SPEED) > 0).any():
        step = np.diff(np.unique(fixes.speed[first:end][cut])).min()
        notes.append(
            f"speeds are in steps of {step:.2g} m/s and lie half a step below those between the "
            f"places, so they were cut, not rounded: {step / 2:.2g} m/s were added to {_of(cut)}; "
            "give all decimals"
        )
    if (unused := (flags & COARSE_COURSE) > 0).any():
        step = _course_step(fixes.bearing_deg[first:end][unused])
        notes.append(
            f"courses are in steps of {step:.3g} degrees, and those of {_of(unused)} are not used; "
            "give whole degrees at least"
        )
    return notes


def _of(rows: NDArray[np.bool_]) -> str:
    """How many of all rows are meant."""
    return f"{np.count_nonzero(rows):,} of {counted(len(rows), 'row')}"
