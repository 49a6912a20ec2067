"""Cut the rows of a vehicle into its trips: at gaps, at stops, and at jumps that no car makes.

The cuts depend on the rows of the vehicle alone, in the order of time, place for place; so they
are the same whatever engine brought the rows together.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingError
from ..geodesy.angles import wrap_degrees
from ..observations import Array
from .arrow_columns import numbers, times
from .checks import Ints, is_place
from .clock_change import clock_changes, put_rows_apart
from .dates import DAY, UNSAID, Writing
from .names import Column, find
from .units_by_places import distances, reachable

if TYPE_CHECKING:
    import pyarrow as pa

STANDING = "fixes while standing between trips"
_STAY = 60.0  # m from the first fix of a stop, within which all of its fixes lie
_NEAR = 3.0  # median distances to a stop's middle, within which a fix belongs to it
_LEAST = 5.0  # m, the same at least
_LONG = 12 * 3600.0  # s, a pause that a trip hardly has
_STEPS = 512  # fixes that are looked at in one go
_UNITS = {"": 1.0, "s": 1.0, "sec": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0}


class Part(NamedTuple):
    """A trip of a vehicle: rows of its table in the order of time."""

    low: int
    high: int
    standing: int  # rows behind it, of a stop, that belong to no trip


def seconds_of(
    text: str | float | None,
    name: str = "split",
    use: str = "after which a pause or a stop ends a trip",
) -> float | None:
    """`5min`, `300s`, `1.5h` or a number of seconds; None stays None.

    Args:
        text: The time.
        name: Of the argument, for errors.
        use: What the time is for, for errors.

    Raises:
        SettingError: It is no time, or none that is more than nothing.
    """
    if text is None:
        return None
    match = re.fullmatch(r"\s*([0-9.]+)\s*([a-z]*)\s*", str(text).lower())
    try:
        seconds = float(match[1]) * _UNITS[match[2]] if match else 0.0
    except (KeyError, ValueError):
        seconds = 0.0
    if not 0.0 < seconds < 1e9:
        raise SettingError(
            f"{name} is {text!r}; a time such as 5min, 300s or 1h was expected, {use}"
        )
    return seconds


def with_pauses(
    notes: Sequence[Sequence[str]], time: Array, first: Sequence[int]
) -> list[list[str]]:
    """The notes on trips, and what is to be said of a pause as between two trips of one name.

    Args:
        notes: On each of d trips.
        time: (n,) s, of the epochs of all.
        first: (d + 1,) where each begins, and n.
    """
    said = [list(own) for own in notes]
    step = np.diff(time)
    begins = np.array(first[1:-1], np.int64)
    step[begins[(begins > 0) & (begins < len(time))] - 1] = 0.0  # from trip to trip
    whose = np.searchsorted(first, np.flatnonzero(step > _LONG), "right") - 1
    for trip in np.unique(whose).tolist():
        longest = float(step[first[trip] : first[trip + 1] - 1].max())
        days = f"{longest / DAY:,.0f} days" if longest > 2.0 * DAY else f"{longest / 3600.0:.0f} h"
        said[trip].append(
            f"pause of {days}: rows of several trips may bear this name; --split (split=) cuts them"
        )
    return said


def split_trips(
    table: "pa.Table", pause: float, own: Mapping[str, str | int] | None = None,
    written: Writing = UNSAID,
) -> "tuple[pa.Table, list[Part]]":  # fmt: skip
    """The rows of one vehicle in the order of time, and the trips among them.

    A trip ends before a pause of more than `pause` without a fix, when the vehicle begins to
    stand for as long, and where the next fixes are farther than a car gets.

    Args:
        table: All rows of a vehicle, with times; rows without a readable time come last.
        pause: s.
        own: Own names of columns, as `names.find` takes them.
        written: How times are written, where they do not show it.

    Returns:
        The table in order, and its trips; at least one where there are rows.
    """
    table, time = in_time_order(table, own, written)
    found = find(table.column_names, own)
    lat, lon = (degrees_of(table, found.get(name)) for name in ("lat", "lon"))
    rows = np.flatnonzero(np.isfinite(time) & is_place(lat, lon))
    if not len(rows):
        return table, [Part(0, table.num_rows, 0)]
    return table, _parts(time, rows, lat[rows], lon[rows], pause)


def in_time_order(
    table: "pa.Table", own: Mapping[str, str | int] | None = None, written: Writing = UNSAID
) -> "tuple[pa.Table, Array]":
    """The rows of a vehicle in the order of time, and their times, s.

    Rows without a readable time come last, their time is infinite. `own` names columns, as
    `names.find` takes them; `written` tells how times are, where they do not show it.
    """
    found = find(table.column_names, own)
    unknown = np.full(table.num_rows, np.inf)
    if "time" not in found:
        return table, unknown
    meaning = found["time"]
    try:
        column = table.column(meaning.place)
        dates = found.get("date")
        day = None if dates is None else (dates.name, table.column(dates.place))
        read = times(column, meaning, "table", Counter(), written=written, date=day)
        time = read.seconds
        change = clock_changes(time, written.zone) if read.zoneless else None
        if change is not None:
            put_rows_apart(time, np.arange(len(time)), change)
    except Exception:  # the reader of the trip will say what its times are
        return table, unknown
    time = np.where(np.isfinite(time), time, np.inf)
    lat, lon = (degrees_of(table, found.get(name)) for name in ("lat", "lon"))
    order = np.lexsort((lon, lat, time))
    if (np.diff(order) != 1).any():
        table, time = table.take(order), time[order]
    return table, time


def degrees_of(table: "pa.Table", column: Column | None) -> Array:
    """A column as degrees, (n,); NaN where there is none, or no number."""
    if column is None:
        return np.full(table.num_rows, np.nan)
    return numbers(table.column(column.place), column.name, Counter()) * column.factor


def _parts(time: Array, rows: Ints, lat: Array, lon: Array, pause: float) -> list[Part]:
    """Trips of a table whose `rows` have places."""
    at = time[rows]
    driven = np.ones(len(rows), np.bool_)  # whether a fix belongs to a trip, or to a stop
    begins = np.zeros(len(rows), np.bool_)
    begins[0] = True
    begins[1:] = (np.diff(at) > pause) | _jumps(at, lat, lon)
    departs = np.zeros(len(rows), np.bool_)
    for first, last in _stops(at, lat, lon, begins, pause):
        driven[first + 1 : last] = False
        begins[last] = departs[last] = True
    bounds = [*np.flatnonzero(begins).tolist(), len(rows)]
    parts: list[Part] = []
    low = before = 0  # rows before the first trip
    for begin, end in pairwise(bounds):
        high = len(time) if end == len(rows) else int(rows[end])
        last = begin + int(np.flatnonzero(driven[begin:end])[-1])
        step = slice(max(begin - 1, 0), begin + 1)
        near = begin > 0 and distances(lat[step], lon[step])[0] <= _STAY
        idle = near or departs[begin] or last < end - 1
        if last == begin and idle:  # stood all the time
            if parts:
                parts[-1] = parts[-1]._replace(standing=parts[-1].standing + high - low)
            else:
                before += high - low
        else:
            stop = int(rows[last]) + 1 if last < end - 1 else high
            parts.append(Part(low, stop, high - stop + before))
            before = 0
        low = high
    return parts or [Part(0, len(time), 0)]


def _jumps(time: Array, lat: Array, lon: Array) -> NDArray[np.bool_]:
    """Between which fixes the vehicle went farther than a car gets, and did not come back."""
    n = len(time)
    if n < 2:
        return np.zeros(0, np.bool_)
    far = distances(lat, lon) > reachable(np.diff(time))
    if n < 3 or not far.any():
        return far
    back = distances(lat, lon, 2) <= reachable(time[2:] - time[:-2])
    outlier = far[:-1] & far[1:] & back  # there and back again: one fix is wrong
    lone = np.zeros(n - 1, np.bool_)
    lone[:-1] |= outlier
    lone[1:] |= outlier
    return far & ~lone


def _stops(
    time: Array, lat: Array, lon: Array, begins: NDArray[np.bool_], pause: float
) -> list[tuple[int, int]]:
    """First and last fix of each stop of at least `pause`, within the runs between cuts."""
    found = []
    bounds = [*np.flatnonzero(begins).tolist(), len(time)]
    perhaps = _may_stand(time, lat, lon, bounds, pause)
    for begin, end in pairwise(bounds):
        own = perhaps[np.searchsorted(perhaps, begin) : np.searchsorted(perhaps, end)]
        after = begin
        for k in own.tolist():
            if k < after:
                continue
            last = _stays_until(lat, lon, k, end)
            if time[last] - time[k] < pause:
                continue
            first, final = _core(lat, lon, k, last)
            if time[final] - time[first] >= pause:
                found.append((first, final))
            after = last + 1
    return found


def _may_stand(time: Array, lat: Array, lon: Array, bounds: list[int], pause: float) -> Ints:
    """Fixes that are near where the vehicle is half a pause and a pause later, in the same run."""
    later = np.searchsorted(time, time + pause)
    end = np.repeat(bounds[1:], np.diff(bounds))
    rows = np.flatnonzero(later < end)
    near = np.ones(len(rows), np.bool_)
    for at in (later[rows], (rows + later[rows]) // 2):
        pairs = np.column_stack([rows, at]).ravel()
        near &= distances(lat[pairs], lon[pairs])[0::2] <= _STAY
    return rows[near]


def _stays_until(lat: Array, lon: Array, k: int, end: int) -> int:
    """The last fix of those from k on that all lie near fix k."""
    last = k
    while last + 1 < end:
        block = slice(last + 1, min(last + 1 + _STEPS, end))
        far = _from(lat[block], lon[block], float(lat[k]), float(lon[k])) > _STAY
        if far.any():
            return last + int(np.argmax(far))
        last = block.stop - 1
    return last


def _core(lat: Array, lon: Array, first: int, last: int) -> tuple[int, int]:
    """First and last fix that lie as near to the middle of a stop as its fixes do."""
    a, b = lat[first : last + 1], wrap_degrees(lon[first : last + 1] - lon[first])
    away = _from(a, b, float(np.median(a)), float(np.median(b)))
    near = np.flatnonzero(away <= max(_LEAST, _NEAR * float(np.median(away))))
    return first + int(near[0]), first + int(near[-1])


def _from(lat: Array, lon: Array, lat0: float, lon0: float) -> Array:
    """Metres from a place to others."""
    n = len(lat)
    both = np.empty(2 * n), np.empty(2 * n)
    for whole, values, one in zip(both, (lat, lon), (lat0, lon0), strict=True):
        whole[0::2], whole[1::2] = values, one
    return distances(*both)[0::2]
