"""Whether a drive's odometry fits its fixes: what it covers, its clock, its scale.

What does not fit is named with what to do.  Nothing is changed.
"""

import math
from dataclasses import replace

import numpy as np

from ..observations import (
    Array,
    Drive,
    Fixes,
    Odometer,
    OdometryLog,
    SpeedYawRate,
    WheelCounts,
    WheelSpeeds,
    WithGyro,
)
from ..settings import Vehicle
from .coarse_steps import coarse_notes
from .drive_columns import unused
from .mixed_rows import mixed_notes
from .resampled import resampling_notes
from .rounded_places import rounding_notes
from .units_by_places import (
    SPEED_UNITS,
    Track,
    Windows,
    distance_ratio,
    distances,
    is_telling,
    speed_ratios,
    windows_of,
)  # fmt: skip

_SECOND = "a second yaw rate not used: that beside the speed is"
_COVERED = 0.9  # share of the fixes' time, below which odometry is said to cover a part
_FEWEST = 10  # fixes
_SCALE = (0.8, 1.25)  # odometry over places, beyond which it is said
_ABOUT = 0.06  # of the ratio that a unit explains
_SPARSE_SCALE = (0.5, 3.0)  # the same of a receiver's speed where fixes are far apart
_MOST_LATE = 5.0  # s, the largest offset that is looked for
_COARSE, _FINE = 0.5, 0.1  # s between offsets that are tried
_STEP = 0.5  # s, at which speeds are compared
_MOST_STEPS = 1500  # of a drive
_HALF = 1.5  # s, half of the time over which a speed is taken
_DENSE = 2.5  # s between fixes, beyond which their speeds show no offset
_GROSS = 3.0  # m/s, beyond which a difference is an error of its own
_SHORTEST = 50.0  # s of both
_LONGEST = 7200.0  # s of both that are compared
_LATE = 0.75  # s, from which an offset is said
_BETTER = 0.6  # of the squared difference at no offset, that the best must stay below
_VARIES = 1.0  # m/s, standard deviation of a speed that shows an offset
_MOST = 7200  # fixes that are looked at


def with_fit_notes(drive: Drive, vehicle: Vehicle) -> Drive:
    """The drive with notes on its fixes and odometry: what is rounded, what does not fit.

    Args:
        drive: A drive, in one piece.
        vehicle: For the scale of counters.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # distances may be anything
        notes = _notes(drive, vehicle)
    if drive.gyro is not None:
        notes += unused({"yaw_rate"}, drive.odometry) or [_SECOND]
    notes += [
        *mixed_notes(drive.fixes), *rounding_notes(drive.fixes), *resampling_notes(drive.fixes),
        *coarse_notes(drive.fixes),
    ]  # fmt: skip
    return replace(drive, notes=(*drive.notes, *notes)) if notes else drive


def with_speed_notes(drive: Drive) -> Drive:
    """The drive with a note on a receiver's speed that does not fit the places.

    Args:
        drive: A drive, in one piece.
    """
    fixes = drive.fixes
    if fixes is None or len(fixes) < _FEWEST:
        return drive
    windows = windows_of(Track.of(fixes.time, fixes.lat_deg, fixes.lon_deg).apart())
    speed = np.where(np.isfinite(fixes.sigma_speed), fixes.speed, np.nan)
    ratios = speed_ratios(windows, fixes.time, speed)
    if not is_telling(ratios):
        return drive
    ratio = float(np.median(ratios))
    low, high = _SPARSE_SCALE if windows.sparse else _SCALE
    if low <= ratio <= high:
        return drive
    note = (
        f"speeds of the fixes are {ratio:.2g} times those between their places; is the unit right?"
    )
    return replace(drive, notes=(*drive.notes, note))


def _notes(drive: Drive, vehicle: Vehicle) -> list[str]:
    fixes, odometry = drive.fixes, drive.odometry
    if fixes is None or odometry is None or len(fixes) < _FEWEST or len(odometry.time) < 2:
        return []
    time, way = way_of(odometry, vehicle)
    notes = [_coverage(fixes, time)]
    low, high = np.searchsorted(fixes.time, (time[0], time[-1]))
    part = slice(low, min(high, low + _MOST))
    track = Track(fixes.time[part], fixes.lat_deg[part], fixes.lon_deg[part])
    if len(track.time) >= _FEWEST:
        speed = fixes.speed[part], fixes.sigma_speed[part]
        notes += [_clock(track, speed, time, way), _scale(windows_of(track), time, way, odometry)]
    return [note for note in notes if note]


def way_of(odometry: OdometryLog, vehicle: Vehicle) -> tuple[Array, Array]:
    """Times and distance driven so far, m."""
    if isinstance(odometry, WithGyro):
        odometry = odometry.distance
    if isinstance(odometry, Odometer):
        return odometry.time, odometry.distance
    if isinstance(odometry, WheelCounts):
        left = odometry.left * vehicle.metres_per_tick_left
        return odometry.time, 0.5 * (left + odometry.right * vehicle.metres_per_tick_right)
    if isinstance(odometry, SpeedYawRate):
        speed = odometry.speed
    else:
        speed = 0.5 * (odometry.left + odometry.right)
    steps = 0.5 * np.diff(odometry.time) * (speed[1:] + speed[:-1])
    return odometry.time, np.concatenate([[0.0], np.cumsum(steps)])


def _coverage(fixes: Fixes, time: Array) -> str:
    """What is said of odometry that is known for a part of the drive only."""
    whole = float(fixes.time[-1] - fixes.time[0])
    common = min(float(time[-1]), float(fixes.time[-1])) - max(float(time[0]), float(fixes.time[0]))
    if whole <= 0.0 or common >= _COVERED * whole:
        return ""
    return f"odometry covers {100 * max(common, 0.0) / whole:.0f} % of the time of the fixes"


def _clock(track: Track, doppler: tuple[Array, Array], time: Array, way: Array) -> str:
    """What is said of odometry that is early or late, by the speeds of both."""
    if track.time[-1] - track.time[0] < _SHORTEST:
        return ""
    if float(np.median(np.diff(track.time))) > _DENSE:
        return ""
    known = np.isfinite(doppler[1])
    if np.mean(known) > 0.9:
        at, speed = track.time[known], doppler[0][known]
        driven = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(at) * (speed[1:] + speed[:-1]))])
    else:
        at, driven = track.time, None
    reach = _MOST_LATE + _HALF
    begin, end = at[0] + reach, min(at[-1] - reach, at[0] + _LONGEST)
    grid = np.arange(begin, end, max(_STEP, (end - begin) / _MOST_STEPS))
    gaps = np.concatenate([[0], np.cumsum(np.diff(at) > _DENSE)])  # before each fix
    first, last = (np.searchsorted(at, grid + h) for h in (-_HALF, _HALF))
    grid = grid[gaps[np.minimum(last, len(at) - 1)] == gaps[np.maximum(first - 1, 0)]]
    if len(grid) < 2 * _FEWEST:
        return ""
    if driven is None:  # chords of some seconds: shorter ones are mostly errors of the fixes
        lat = np.column_stack([np.interp(grid + h, at, track.lat_deg) for h in (-_HALF, _HALF)])
        lon = np.column_stack([np.interp(grid + h, at, track.lon_deg) for h in (-_HALF, _HALF)])
        way_of_fixes = distances(lat.ravel(), lon.ravel())[::2]
    else:
        way_of_fixes = np.interp(grid + _HALF, at, driven) - np.interp(grid - _HALF, at, driven)
    wanted = way_of_fixes / (2.0 * _HALF)
    if np.std(wanted) < _VARIES:
        return ""

    def difference(lag: float) -> float:
        mine = np.interp(grid + _HALF + lag, time, way) - np.interp(grid - _HALF + lag, time, way)
        apart = np.abs(mine) / (2.0 * _HALF) - wanted
        return float(np.mean(np.minimum(apart**2, _GROSS**2)))

    late = min(np.arange(-_MOST_LATE, _MOST_LATE + _FINE, _COARSE), key=difference)
    late = min(np.arange(late - _COARSE, late + _COARSE + 0.5 * _FINE, _FINE), key=difference)
    if not _LATE <= abs(late) < _MOST_LATE or difference(late) > _BETTER * difference(0.0):
        return ""
    return (
        f"odometry seems to be {abs(late):.1f} s {'late' if late > 0 else 'early'}: speeds of "
        f"both fit best so; if it is, give odometry = {-late:.1f} under [clock] in vehicle.toml"
    )


def _scale(windows: Windows, time: Array, way: Array, odometry: OdometryLog) -> str:
    """What is said of odometry that is far longer or shorter than the way of the fixes."""
    ratio = distance_ratio(windows, time, way)
    if not math.isfinite(ratio) or _SCALE[0] <= ratio <= _SCALE[1] or windows.sparse:
        return ""
    units = [unit for unit, si in SPEED_UNITS.items() if abs(ratio * si - 1.0) < _ABOUT]
    hint = "is its unit, or metres_per_tick of vehicle.toml, right?"
    if units and isinstance(odometry, WheelSpeeds | SpeedYawRate):
        hint = f"is its speed in {units[0]}?"
    return f"odometry says {ratio:.2g} times the distance of the fixes; {hint}"
