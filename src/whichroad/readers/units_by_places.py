"""Units that a table does not name, found from the places that it holds beside them.

A speed in m/s, integrated between two fixes, is about their distance.  Of the usual units the
one is taken for which this holds best.  Where a drive is too short or too sparse to tell,
nothing is decided.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..geodesy.angles import radians, wrap_degrees
from ..geodesy.units import EARTH_RADIUS, KMH, KNOT, MPH
from ..observations import Array
from .checks import Bools, is_place
from .dates import DAY

SPEED_UNITS = {"m/s": 1.0, "km/h": KMH, "mph": MPH, "knots": KNOT}
DISTANCE_UNITS = {"m": 1.0, "km": 1000.0, "miles": 1609.344}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9, "days": DAY}
_WINDOW = 10.0  # s, over which distances are compared
_SPARSE_RATIOS = {"m/s": (0.7, 1.5), "km/h": (3.4, 6.5)}  # of ways over chords of sparse fixes
_LONGEST = 90.0  # s between fixes, beyond which a chord says too little of the distance driven
_SPARSE = 20.0  # s between fixes, beyond which knots and mph cannot be told apart
_MOVED = 40.0  # m within a window, well beyond the errors of fixes
_FEWEST = 5  # windows
_WINDING = 35.0  # s, from which on a pass of hairpins is some times as long as its chords
_SURE = 20  # windows, for a speed whose column names another unit
_IN_KMH = (2.3, 6.5)  # a quarter of ratios above, half below: of 84 sound drives 1.8 at most
_MOST = 2000  # windows that are looked at
_CAR = (0.5, 70.0)  # m/s, median speed of what drives
_JUMP, _JUMP_SPEED = 1000.0, 100.0  # m, m/s: beyond them a fix is of another vehicle, or wrong
TOO_FAST = 1e5  # m/s, median speed of nothing that is recorded
_ACROSS = 12.0  # m/s², lateral acceleration beyond what tyres hold
_TURNING = 3.0  # rad/s, beyond what cars reach


@dataclass(frozen=True)
class Track:
    """Places of one drive, in the order of time."""

    time: Array  # (n,) s
    lat_deg: Array
    lon_deg: Array

    @classmethod
    def of(cls, time: Array, lat_deg: Array, lon_deg: Array) -> "Track":
        """The rows that have a place and a time."""
        known = np.flatnonzero((np.abs(time) < 1e300) & is_place(lat_deg, lon_deg))
        known = known[np.argsort(time[known], kind="stable")]
        return cls(time[known], lat_deg[known], lon_deg[known])

    def apart(self) -> "Track":
        """The rows with a time of their own."""
        later = self.time[1:] > self.time[:-1]
        if later.all():
            return self
        new = np.append(True, later)
        return Track(self.time[new], self.lat_deg[new], self.lon_deg[new])

    @cached_property
    def moved(self) -> Array:
        """Metres from each place to the next, (n - 1,)."""
        return distances(self.lat_deg, self.lon_deg)


class Windows(NamedTuple):
    """Stretches between fixes during which a drive moved."""

    begin: Array  # (n,) s
    end: Array
    moved: Array  # m, chord

    @property
    def sparse(self) -> bool:
        """Whether chords are so long that they are shorter than the way driven."""
        return len(self.end) > 0 and float(np.median(self.end - self.begin)) > _SPARSE

    def short(self) -> "Windows":
        """Those in which a road does not wind so much that a unit could be taken for another."""
        few = self.end - self.begin < _WINDING
        return Windows(self.begin[few], self.end[few], self.moved[few])


def distances(lat_deg: Array, lon_deg: Array, step: int = 1) -> Array:
    """Metres from each place to the one `step` later, (n - step,)."""
    return np.hypot(
        *metres_between(lat_deg[:-step], lon_deg[:-step], lat_deg[step:], lon_deg[step:])
    )


def metres_between(
    lat_deg: Array, lon_deg: Array, to_lat_deg: Array, to_lon_deg: Array
) -> tuple[Array, Array]:
    """Metres east and north from places to others, (n,) each."""
    with np.errstate(over="ignore", invalid="ignore"):  # places may be anything
        lat, to_lat = radians(lat_deg), radians(to_lat_deg)
        turned = radians(wrap_degrees(to_lon_deg - lon_deg))
        east = turned * np.cos(0.5 * (to_lat + lat))
        return EARTH_RADIUS * east, EARTH_RADIUS * (to_lat - lat)


def windows_of(track: Track) -> Windows:
    """Stretches of about ten seconds, or of one interval where fixes are farther apart."""
    if len(track.time) < 2:
        return Windows(np.empty(0), np.empty(0), np.empty(0))
    slot = np.floor((track.time - track.time[0]) / _WINDOW)
    at = np.flatnonzero(np.diff(slot, prepend=-1.0) > 0)[: _MOST + 1]
    time = track.time[at]
    moved = distances(track.lat_deg[at], track.lon_deg[at])
    good = (moved > _MOVED) & (np.diff(time) < _LONGEST)
    return Windows(time[:-1][good], time[1:][good], moved[good])


def speed_ratios(windows: Windows, time: Array, speed: Array) -> Array:
    """Distance by a speed over distance by places, in each window that the speed covers.

    Args:
        windows: Of the drive.
        time: (n,) s, when the speed was read.
        speed: In any unit, NaN where it is absent.
    """
    known = np.flatnonzero(np.isfinite(speed) & np.isfinite(time))
    known = known[np.argsort(time[known], kind="stable")]
    if len(known) < 2:
        return np.empty(0)
    t, v = time[known], np.abs(speed[known])
    with np.errstate(over="ignore", invalid="ignore"):
        way = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (v[1:] + v[:-1]))])
        inside = (windows.begin >= t[0] - 1.0) & (windows.end <= t[-1] + 1.0)
        begin, end = windows.begin[inside], windows.end[inside]
        ratios = (np.interp(end, t, way) - np.interp(begin, t, way)) / windows.moved[inside]
    return np.asarray(ratios[np.isfinite(ratios)])


def speed_unit(ratios: Array, sparse: bool) -> str | None:
    """The unit of a speed that fits the places; None: none fits, or too little is known.

    Args:
        ratios: Of `speed_ratios`.
        sparse: Whether fixes are far apart.
    """
    if len(ratios) < _FEWEST:
        return None
    ratio = float(np.median(ratios))
    if sparse:  # ways are longer than chords, so that knots and mph cannot be told apart
        return next((u for u, (low, high) in _SPARSE_RATIOS.items() if low < ratio < high), None)
    return _nearest(ratio, SPEED_UNITS, 1.25)


def is_in_kmh(ratios: Array) -> bool:
    """Whether a speed that is said to be in m/s can only be one in km/h.

    Ways are longer than chords, and a speed at two fixes may be none of that between them.  But of
    a quarter of the windows at least, a speed in m/s says about the chord.

    Args:
        ratios: Of `speed_ratios`, over windows of `Windows.short`.
    """
    if len(ratios) < _SURE:
        return False
    quarter, half = np.quantile(ratios, (0.25, 0.5))
    low, high = _IN_KMH
    return bool(quarter > low and half < high)


def is_telling(ratios: Array) -> bool:
    """Whether there are so many ratios that their median means something."""
    return len(ratios) >= _FEWEST


def distance_ratio(windows: Windows, time: Array, distance: Array) -> float:
    """Distance of an odometer over distance by places, in all; NaN: too little is known."""
    known = np.flatnonzero(np.isfinite(distance) & np.isfinite(time))
    known = known[np.argsort(time[known], kind="stable")]
    if len(known) < 2 or len(windows.end) < _FEWEST:
        return math.nan
    t, d = time[known], distance[known]
    inside = (windows.begin >= t[0]) & (windows.end <= t[-1])
    if np.count_nonzero(inside) < _FEWEST:
        return math.nan
    driven = np.interp(windows.end[inside], t, d) - np.interp(windows.begin[inside], t, d)
    return float(np.sum(np.abs(driven)) / np.sum(windows.moved[inside]))


def distance_unit(windows: Windows, time: Array, distance: Array) -> str | None:
    """The unit of an odometer that fits the places; None: too little is known, or none fits."""
    ratio = distance_ratio(windows, time, distance)
    return _nearest(ratio, DISTANCE_UNITS, 1.3) if ratio > 0 and math.isfinite(ratio) else None


def _nearest(ratio: float, units: dict[str, float], far: float) -> str | None:
    """The unit whose numbers are `ratio` times those in SI; None: none is nearer than `far`."""
    if not ratio > 0.0:
        return None
    away = {unit: abs(math.log(ratio * factor)) for unit, factor in units.items()}
    best = min(away, key=lambda unit: away[unit])
    return best if away[best] < math.log(far) else None


def time_unit(tracks: Iterable[Track]) -> str | None:
    """The unit of times that count from a start; None: none makes a drive of the places.

    Args:
        tracks: Their times in the unit that is to be found.
    """
    speed = median_speed(tracks)
    if not math.isfinite(speed):
        return "s"
    fitting = [u for u, f in TIME_UNITS.items() if _CAR[0] <= speed / f <= _CAR[1]]
    return fitting[0] if fitting else "s" if 0.0 < speed < TOO_FAST else None


def median_speed(tracks: Iterable[Track]) -> float:
    """Median speed between successive fixes that differ; NaN where there are none."""
    speeds = []
    for track in tracks:
        if len(track.time) > 1:
            moved = track.moved
            with np.errstate(over="ignore"):
                speeds.append((moved / np.diff(track.time))[moved > 1.0])
    joined = np.concatenate(speeds) if speeds else np.empty(0)
    return float(np.sort(joined)[len(joined) // 2]) if len(joined) else math.nan


def is_impossible(tracks: Sequence[Track]) -> bool:
    """Whether nothing that is recorded moves so fast, so that times or places are wrong."""
    return sum(len(track.time) for track in tracks) > 2 and median_speed(tracks) > TOO_FAST


def jumps(track: Track) -> Bools:
    """Whether each place is where no vehicle gets from the one before, (n - 1,)."""
    return np.asarray(track.moved > reachable(np.diff(track.time)))


def reachable(seconds: Array) -> Array:
    """Metres within which a vehicle is after so many seconds, errors of fixes included."""
    return _JUMP + _JUMP_SPEED * seconds


def are_days(values: Array) -> bool:
    """Whether numbers look like days of a spreadsheet: 1982 to 2064, less than minutes apart."""
    known = np.sort(values[np.isfinite(values)])
    if not len(known) or known[0] < 30_000.0 or known[-1] > 60_000.0:
        return False
    steps = np.diff(known)
    steps = steps[steps > 0.0]
    return len(steps) > 0 and float(np.median(steps)) < 2e-3


def is_in_degrees(yaw_rate: Array, speed: Array | None) -> bool:
    """Whether a yaw rate is impossible in rad/s: beyond what cars and their tyres reach."""
    known = np.isfinite(yaw_rate)
    if np.count_nonzero(known) < _FEWEST:
        return False
    rate = np.abs(yaw_rate[known])
    if np.quantile(rate, 0.98) > _TURNING:
        return True
    if speed is None:
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        across = rate * np.abs(speed[known])
    across = across[np.isfinite(across)]
    return len(across) >= _FEWEST and float(np.quantile(across, 0.98)) > _ACROSS
