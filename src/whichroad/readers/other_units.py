"""Speeds of a receiver in another unit than their column says, found by the places beside them.

A table joins vehicles of several vendors, of whom one writes mph under `speed_kmh`.  So each drive
is judged by its own rows: the way by its speeds against that between places ten seconds apart.
"""

import math

import numpy as np

from ..geodesy.units import KMH, KNOT, MPH
from ..observations import OTHER_UNIT, Array, Fixes
from .checks import Bools, Ints
from .units_by_places import Track, distances, speed_ratios, windows_of

_FEWEST = 8  # windows that tell
_LOW, _HIGH = 0.7, 1.4  # ways by speeds over those between places, beyond which a unit is wrong
_MOST = 0.75  # of the windows, that are beyond
_NEAR = 0.8, 1.3  # the same of a whole drive, within which it is not looked at
_NARROW = 1.35  # times as much, at most, is the upper quartile as the lower: a unit is a constant
_CLOSE = 15.0  # s between fixes, beyond which a speed at both says little of that between
_SIGMAS = 8.0  # of a place, that a chord has at least
_FITS = 1.12  # times, within which a ratio is that of two units
_SI = {"km/h": KMH, "m/s": 1.0, "mph": MPH, "knots": KNOT}


def other_units(
    time: Array, place: tuple[Array, Array], sigma: Array, speed: Array | None, first: Ints
) -> Bools | None:
    """Which speeds are of drives whose speeds are in another unit.

    Args:
        time: (n,) s, drive after drive.
        place: Latitudes and longitudes, (n,) degrees.
        sigma: (n,) m, of the places.
        speed: (n,) m/s as far as is known, NaN where absent; None: there is none.
        first: (d,) where each drive begins.

    Returns:
        (n,); None: there is none.
    """
    if speed is None or len(time) < _FEWEST:
        return None
    size = np.diff(first, append=len(time))
    step, chord = np.diff(time), distances(*place)
    with np.errstate(over="ignore", invalid="ignore"):
        way = 0.5 * step * np.abs(speed[1:] + speed[:-1])
        told = np.isfinite(way) & (step <= _CLOSE)
        told[first[1:] - 1] = False
        by_speed = np.add.reduceat(np.append(np.where(told, way, 0.0), 0.0), first)
        by_place = np.add.reduceat(np.append(np.where(told, chord, 0.0), 0.0), first)
        near = (by_speed > _NEAR[0] * by_place) & (by_speed < _NEAR[1] * by_place)
    found: Bools | None = None
    for drive in np.flatnonzero(~near & (size >= _FEWEST)).tolist():
        own = slice(first[drive], first[drive] + size[drive])
        least = _SIGMAS * float(np.median(sigma[own]))
        ratios = _ratios(time[own], place[0][own], place[1][own], speed[own], least)
        if _are_beyond(ratios):
            found = np.zeros(len(time), np.bool_) if found is None else found
            found[own] = True
    return found


def _ratios(time: Array, lat: Array, lon: Array, speed: Array, least: float) -> Array:
    """Ways by the speeds of a drive over chords that are long enough."""
    windows = windows_of(Track(time, lat, lon))
    good = (windows.end - windows.begin <= _CLOSE) & (windows.moved > least)
    return speed_ratios(type(windows)(*(column[good] for column in windows)), time, speed)


def _are_beyond(ratios: Array) -> bool:
    """Whether most ratios are alike, and on one side of those of speeds in their unit."""
    if len(ratios) < _FEWEST:
        return False
    low, high = np.quantile(ratios, (1.0 - _MOST, _MOST))
    return bool((high < _LOW or low > _HIGH) and high < _NARROW * low)


def unit_notes(fixes: Fixes | None, first: int = 0, end: int | None = None) -> list[str]:
    """What is said of the speeds of one drive, from row `first` on, that are not used so."""
    if fixes is None or not (fixes.flags[first:end] & OTHER_UNIT).any():
        return []
    part = slice(first, end)
    speed = np.where((fixes.flags[part] & OTHER_UNIT) > 0, fixes.speed[part], np.nan)
    ratios = _ratios(fixes.time[part], fixes.lat_deg[part], fixes.lon_deg[part], speed, 0.0)
    ratio = float(np.median(ratios)) if len(ratios) else math.nan
    return [
        f"speeds of the fixes are {ratio:.2g} times those between their places{_fitting(ratio)}; "
        "they are not used: give them in the unit that their column names"
    ]


def _fitting(ratio: float) -> str:
    """The unit that a ratio is of, and the one that it was taken for, the more usual of two."""
    for named, factor in _SI.items() if ratio > 0.0 else ():
        away = {a: abs(math.log(ratio * si / factor)) for a, si in _SI.items() if a != named}
        unit = min(away, key=lambda one: away[one])
        if away[unit] < math.log(_FITS):
            return f", as {unit} named {named} are"
    return ""
