"""Times that were cut to whole seconds or minutes: their rows are spread by the order of the file.

Rows that share a time are of several moments only where all of this holds: every time is whole,
times follow each other by that unit, each has about as many rows, and the rows of one time lead
on evenly to the place of the next.  Rows of two receivers do not lead on.
"""

from collections.abc import Sequence

import numpy as np

from ..observations import Array
from .checks import LAST, Bools, Ints, as_time_passes, is_place
from .drive_columns import MOTION, Columns
from .names import SENSED
from .table_drives import Trip
from .units_by_places import metres_between

_UNITS = {"minutes": 60.0, "seconds": 1.0}  # s
_SHARE = 0.2  # of a drive's rows that share a time at other places, from which on it matters
_EVEN = 0.8  # share of times that have about as many rows as the middle one
_ABOUT = 0.25  # of that number, by which others may differ, or by one row
_FEWEST = 5  # times whose rows are seen to lead on
_ON = 0.3  # share of times that lead on evenly: 0.6 or more of one receiver, 0.05 of two
_MOVED = 5.0  # m from one time to the next, beyond the noise of fixes


def spread(columns: Columns, trips: Sequence[Trip]) -> dict[str, str]:
    """Give rows of one time moments of their own, where times were cut to a whole unit.

    Args:
        columns: Of all drives; `time` is changed in place.
        trips: The rows of each drive, in the order of the file.

    Returns:
        What is to be said of drives, by their names.
    """
    if not {"lat", "lon"} <= columns.keys():
        return {}
    told = {}
    for name, rows in trips:
        known = rows[np.abs(columns["time"][rows]) < LAST]
        if (np.diff(columns["time"][known]) > 0.0).all():
            continue
        known = as_time_passes(columns["time"], known)
        known = known[np.argsort(columns["time"][known], kind="stable")]
        said = _spread(columns, known)
        if said:
            told[name] = said
    return told


def _spread(columns: Columns, rows: Ints) -> str | None:
    """As `spread`, of one drive with rows by time; None: there is nothing to be said."""
    time, lat, lon = (columns[name][rows] for name in ("time", "lat", "lon"))
    placed = is_place(lat, lon)
    again = np.diff(time[placed]) == 0.0
    shared = int(np.count_nonzero(again & ~_same(lat[placed], lon[placed])))
    if shared < _SHARE * len(time):
        return None
    first = np.flatnonzero(np.diff(time, prepend=-np.inf) > 0.0)
    unit = _unit_of(time, first)
    sensed = [q for q in columns if q in MOTION or q.startswith(SENSED)]
    others = any(np.isfinite(columns[q][rows][~placed]).any() for q in sensed)
    if unit is None or others or not _lead_on(time, lat, lon, first, _UNITS[unit]):
        return (
            f"{shared:,} of {len(time):,} rows have the time of a row before them at another place "
            "and were dropped; where times were rounded, give them with their fractions; where "
            "rows are of several receivers, give each as a drive (--id, id=)"
        )
    # a row that repeats the one before it keeps that one's time, and is counted as repeated
    repeated = np.concatenate([[False], (np.diff(time) == 0.0) & _same(lat, lon)])
    own = np.maximum.accumulate(np.where(repeated, 0, np.arange(len(time))))
    moments = _moments(time, first, _UNITS[unit])[own]
    columns["time"][rows] = moments
    changed = int(np.count_nonzero(moments != time))
    return (
        f"times were in whole {unit}; {changed:,} rows were spread evenly to the next one, in the "
        "order of the file"
    )


def _same(lat: Array, lon: Array) -> Bools:
    """Whether each place is that of the row before it, (n - 1,)."""
    return np.asarray((np.diff(lat) == 0.0) & (np.diff(lon) == 0.0))


def _unit_of(time: Array, first: Ints) -> str | None:
    """The unit that times were cut to, each with about as many rows; None: there is none."""
    unit = next((name for name, size in _UNITS.items() if (time % size == 0.0).all()), None)
    if unit is None or len(first) <= _FEWEST:
        return None
    next_ = np.diff(time[first]) == _UNITS[unit]
    whole = next_[:-1] & next_[1:]  # others may be cut short: the first, the last, beside gaps
    if 2 * np.count_nonzero(next_) < len(next_) or not whole.any():
        return None
    sizes = np.diff(first)[1:][whole]
    middle = float(np.median(sizes))
    alike = np.abs(sizes - middle) <= max(1.0, _ABOUT * middle)
    return unit if middle > 1.0 and alike.mean() >= _EVEN else None


def _lead_on(time: Array, lat: Array, lon: Array, first: Ints, unit: float) -> bool:
    """Whether rows amid those of one time are as far on the way to the next as their number."""
    low, high = first[:-1], first[1:]
    next_ = (time[high] - time[low]) == unit
    low, high = low[next_], high[next_]
    amid = low + (high - low) // 2
    placed = np.logical_and.reduce([is_place(lat[k], lon[k]) for k in (low, amid, high)])
    low, amid, high = (rows[placed & (amid > low)] for rows in (low, amid, high))
    east, north = metres_between(lat[low], lon[low], lat[high], lon[high])
    to_east, to_north = metres_between(lat[low], lon[low], lat[amid], lon[amid])
    way = east**2 + north**2
    far = way > _MOVED**2
    if np.count_nonzero(far) < _FEWEST:
        return False
    gone = (east * to_east + north * to_north)[far] / way[far]
    share = ((amid - low) / (high - low))[far]
    even = (0.5 * share < gone) & (gone < 1.5 * share)
    return bool(0.5 < np.median(gone / share) < 1.5 and even.mean() >= _ON)


def _moments(time: Array, first: Ints, unit: float) -> Array:
    """Times of rows that are spread over the unit that begins with their time.

    Where rows are missing beside a gap, they are so on the side of the gap.
    """
    sizes = np.diff(first, append=len(time))
    steps = np.diff(time[first], prepend=-np.inf, append=np.inf) > unit
    after, before = steps[:-1], steps[1:]  # whether a gap is on that side
    usual = np.where(after != before, np.maximum(sizes, np.median(sizes)), sizes)
    late = np.where(after & ~before, unit * (1.0 - sizes / usual), 0.0)
    number = np.arange(len(time)) - np.repeat(first, sizes)
    return np.asarray(time + np.repeat(late, sizes) + unit * number / np.repeat(usual, sizes))
