"""The hour that local clocks show twice in autumn: which of the two a row is of.

Reading takes the first.  The order of rows tells more: where their times jump back by that hour,
the second begins.  Where they go on without a pause at one of its ends, all are of that side.
"""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta, timezone, tzinfo

import numpy as np

from ..observations import Array
from .checks import Bools, Ints, as_time_passes
from .dates import LATEST
from .drive_columns import Columns
from .table_drives import Trip

_PAUSE = 600.0  # s, longest between rows that go on without one
_QUARTER = 900.0  # s; clocks change at whole ones
_WAIT = 86_400.0  # s behind a time, beyond any hour that comes twice
_SEASON = 60 * 86_400.0  # s, within which clocks do not change twice


def put_apart(columns: Columns, trips: Sequence[Trip], zone: tzinfo | None) -> dict[str, str]:
    """Move rows of the second hour to it.

    Args:
        columns: Of all drives; `time`, taken as of the first hour, is changed in place.
        trips: The rows of each drive, in the order of the file.
        zone: Of the times; None: UTC.

    Returns:
        What is to be said of drives, by their names.
    """
    time = columns["time"]
    back = clock_back(time, zone)
    if back is None:
        return {}
    told = {name: put_rows_apart(time, rows, back) for name, rows in trips}
    return {name: said for name, said in told.items() if said}


def put_rows_apart(time: Array, rows: Ints, back: Array) -> str | None:
    """As `put_apart`, of one drive.

    Args:
        time: (n,) s, changed in place.
        rows: Of the drive, in the order of the file.
        back: (n,) as of `clock_back`.
    """
    known = as_time_passes(time, rows[np.isfinite(time[rows])])
    second, said = _second_hour(time[known], back[known])
    time[known[second]] += back[known[second]]
    return said


def clock_back(time: Array, zone: tzinfo | None) -> Array | None:
    """By how much the clocks go back after times that they show once more.

    Args:
        time: (n,) s since 1970 UTC, the first where a local time comes twice; NaN: none.
        zone: Of the clocks; None: UTC.

    Returns:
        (n,) s, 0 for times that come once; None: all do.
    """
    known = np.flatnonzero((time >= 0.0) & (time < LATEST - _WAIT))
    if zone is None or isinstance(zone, timezone) or not len(known):
        return None
    low, high = float(time[known].min()), float(time[known].max())
    if high - low < _SEASON and _offset(low, zone) == _offset(high + _WAIT, zone):
        return None
    quarters, which = np.unique(np.floor(time[known] / _QUARTER), return_inverse=True)
    shown = [datetime.fromtimestamp(_QUARTER * quarter, zone) for quarter in quarters.tolist()]
    sizes = np.array([_shown_again(moment) for moment in shown])
    result = np.zeros(len(time))
    result[known] = sizes[which]
    return result if sizes.any() else None


def _offset(seconds: float, zone: tzinfo) -> timedelta | None:
    return datetime.fromtimestamp(seconds, UTC).astimezone(zone).utcoffset()


def _shown_again(moment: datetime) -> float:
    """By how much the clock goes back to show a time again, s; 0: it does not."""
    first, second = moment.utcoffset(), moment.replace(fold=1).utcoffset()
    if moment.fold or first is None or second is None:
        return 0.0
    return max((first - second).total_seconds(), 0.0)


def _second_hour(time: Array, back: Array) -> tuple[Bools, str | None]:
    """Which rows are of the second of two equal hours, and what is to be said.

    Args:
        time: (n,) s since 1970 UTC as of the first hour, in the order of the file.
        back: (n,) as of `clock_back`.
    """
    twice, size = back > 0.0, float(back.max(initial=0.0))
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
