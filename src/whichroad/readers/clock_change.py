"""Hours in which local clocks change: one that they show twice in autumn, one never in spring.

Of an hour that comes twice reading takes the first.  The order of rows tells more: where their
times jump back by that hour, the second begins.  Where they go on without a pause at one of its
ends, all are of that side.  A time that is never shown is read by clocks not yet put forward.
"""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from itertools import pairwise

import numpy as np

from ..observations import Array
from ..wording import counted
from .checks import Bools, Ints, as_time_passes
from .dates import DAY, LATEST
from .drive_columns import Columns
from .table_drives import Trip

_PAUSE = 600.0  # s, longest between rows that go on without one
_QUARTER = 900.0  # s; clocks change at whole ones
_WAIT = 86_400.0  # s before and behind a time, beyond any hour that comes twice or never
_SEASON = 60 * 86_400.0  # s, within which clocks do not change twice


def put_apart(
    columns: Columns, trips: Sequence[Trip], zone: tzinfo | None, shown: Callable[[], Array]
) -> dict[str, str]:
    """Move rows of the second hour to it, and count those of an hour that is never shown.

    Args:
        columns: Of all drives; `time`, taken as of the first hour, is changed in place.
        trips: The rows of each drive, in the order of the file.
        zone: Of the times; None: UTC.
        shown: Gives the (n,) times on the clocks, s; of rows that name their zone anything else.

    Returns:
        What is to be said of drives, by their names.
    """
    time = columns["time"]
    change = clock_changes(time, zone)
    if zone is None or change is None:
        return {}
    never = _never_shown(time, change, zone, shown) if (change < 0.0).any() else change > np.inf
    told = {
        name: put_rows_apart(time, rows, change) or _said_of(int(np.count_nonzero(never[rows])))
        for name, rows in trips
    }
    return {name: said for name, said in told.items() if said}


def put_rows_apart(time: Array, rows: Ints, change: Array) -> str | None:
    """As `put_apart`, of one drive, and of hours that come twice alone.

    Args:
        time: (n,) s, changed in place.
        rows: Of the drive, in the order of the file.
        change: (n,) as of `clock_changes`.
    """
    known = as_time_passes(time, rows[np.isfinite(time[rows])])
    second, said = _second_hour(time[known], change[known])
    time[known[second]] += change[known[second]]
    return said


def clock_changes(time: Array, zone: tzinfo | None) -> Array | None:
    """By how much the clocks change about times whose row may mean two of them.

    Args:
        time: (n,) s since 1970 UTC, the first where a local time comes twice, and by clocks not
            yet put forward where it never comes; NaN: none.
        zone: Of the clocks; None: UTC.

    Returns:
        (n,) s.  Above 0: the clocks go back by that to show the time again.  Below 0: they were
        put forward by that, and a time that they skipped is read as this one too.  None: all 0.
    """
    if zone is None or isinstance(zone, timezone):
        return None
    known = np.flatnonzero((time >= _WAIT) & (time < LATEST - _WAIT))
    if not len(known):
        return None
    low, high = float(time[known].min()), float(time[known].max())
    if high - low < _SEASON and _offset(low - _WAIT, zone) == _offset(high + _WAIT, zone):
        return None
    quarters, which = np.unique(np.floor(time[known] / _QUARTER), return_inverse=True)
    sizes = np.array([_change(_QUARTER * quarter, zone) for quarter in quarters.tolist()])
    result = np.zeros(len(time))
    result[known] = sizes[which]
    return result if sizes.any() else None


def shown_twice(low: float, high: float, zone: tzinfo) -> list[tuple[float, float]]:
    """First and last of each hour that clocks show twice between two local times, all in s."""
    found = []
    days = range(int(max(low, 0.0) // DAY) - 1, int(min(high, LATEST) // DAY) + 2)
    for before, after in pairwise(day * DAY for day in days):
        size = _offset(before, zone) - _offset(after, zone)
        if size > 0.0:
            first, last = before, after
            while last - first > 1.0:
                middle = (first + last) // 2
                if _offset(middle, zone) == _offset(before, zone):
                    first = middle
                else:
                    last = middle
            end = last + _offset(before, zone)
            found.append((end - size, end))
    return [hour for hour in found if low < hour[1] and hour[0] <= high]


def _offset(seconds: float, zone: tzinfo) -> float:
    """Of local clocks from UTC, s."""
    told = datetime.fromtimestamp(seconds, UTC).astimezone(zone).utcoffset()
    return (told or timedelta()).total_seconds()


def _change(seconds: float, zone: tzinfo) -> float:
    """As `clock_changes`, of one time."""
    now, before = _offset(seconds, zone), _offset(seconds - _WAIT, zone)
    again = datetime.fromtimestamp(seconds, zone)
    later = (again.replace(fold=1).utcoffset() or timedelta()).total_seconds()
    if not again.fold and later < now:
        return now - later
    skipped = datetime.fromtimestamp(seconds + before, UTC).replace(tzinfo=zone)
    read = (skipped.utcoffset() or timedelta()).total_seconds()
    return before - now if read == before < now else 0.0


def _never_shown(time: Array, change: Array, zone: tzinfo, shown: Callable[[], Array]) -> Bools:
    """Which rows have a local time that the clocks skip."""
    never = np.zeros(len(time), np.bool_)
    at = np.flatnonzero(change < 0.0)
    real = np.array([_offset(seconds, zone) for seconds in time[at].tolist()])
    never[at] = np.abs(shown()[at] - time[at] - real - change[at]) < 1.0
    return never


def _said_of(never: int) -> str | None:
    """What is to be said of rows with times that are never shown."""
    if not never:
        return None
    return (
        f"{counted(never, 'row')} with local times that no clock shows, as clocks go forward, read "
        "by clocks not yet put forward; check the zone, or write times with their offset, such as "
        "+02:00"
    )


def _second_hour(time: Array, change: Array) -> tuple[Bools, str | None]:
    """Which rows are of the second of two equal hours, and what is to be said.

    Args:
        time: (n,) s since 1970 UTC as of the first hour, in the order of the file.
        change: (n,) as of `clock_changes`.
    """
    twice, size = change > 0.0, float(change.max(initial=0.0))
    none = np.zeros(len(time), np.bool_)
    if not twice.any():
        return none, None
    step = np.diff(time)
    jumps = np.flatnonzero(twice[:-1] & twice[1:] & _goes_on(step + size))
    jumps = jumps[step[jumps] < 0.0]
    if len(jumps) == 1:
        second = twice & (np.arange(len(time)) > jumps[0])
        return second, (
            f"the clocks went back during the drive: {np.count_nonzero(second):,} rows behind the "
            "jump in the local times were taken as of the second of two equal hours"
        )
    begins = bool((~twice[:-1] & twice[1:] & _goes_on(step)).any())
    ends = bool((twice[:-1] & ~twice[1:] & _goes_on(step - size)).any())
    if begins != ends and not len(jumps):
        return (none, None) if begins else (twice, None)
    return none, (
        f"{np.count_nonzero(twice):,} rows have local times that come twice, as clocks go back, "
        "and their order does not tell which is meant; the first was taken; write times with their "
        "offset, such as +02:00"
    )


def _goes_on(step: Array) -> Bools:
    """Whether a row follows the one before it without a pause."""
    return np.asarray((step >= 0.0) & (step <= _PAUSE))
