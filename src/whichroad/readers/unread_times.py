"""What is said of times that cannot be understood, are mixed, or of years that are unlikely."""

import time

import numpy as np

from ..observations import Array
from .arrow_columns import Times, strings, unparsable
from .checks import LAST, NO_TIME, UNPARSABLE_TIME, Bools, Skipped
from .dates import DAY
from .digit_dates import DAYS, Taken
from .drive_columns import Columns
from .names import Seen

_NOTED = 0.05  # share of a table's rows
_OLD = 946_684_800.0  # s, 2000: hardly anybody recorded drives before
_FAR = 1e15  # s, the farthest year that is named
_NEW = 1_798_761_600.0  # s, 2027: in no future, whatever the clock of a device without one says


def with_time(seen: Seen, columns: Columns, skipped: Skipped, notes: list[str]) -> Bools:
    """Which rows of a table have a time.

    Args:
        seen: The table.
        columns: Its quantities, `time` in s.
        skipped: Counts rows without one, those that cannot be understood already.
        notes: Says where these are many.
    """
    good = np.asarray(np.abs(columns["time"]) < LAST)
    name = seen.found["time"].name if "time" in seen.found else ""
    unread = skipped[UNPARSABLE_TIME] + skipped[unparsable(name)]
    without = np.count_nonzero(~good) - unread
    if without > 0:
        skipped[NO_TIME] += int(without)
    if unread > _NOTED * len(good) and good.any():
        notes.append(
            f"{unread:,} of {len(good):,} rows left out: column {name!r} holds no time there that "
            f"can be understood, such as {_example(seen, ~good)!r}; one format was expected in "
            "all rows, such as ISO 8601 (2026-06-01T08:00:00Z)"
        )
    return good


def no_time(seen: Seen, where: str, order: str | None) -> str:
    """The message about a table without any time.

    Args:
        seen: The table.
        where: Its name.
        order: That of day and month, as the caller says.
    """
    if "time" not in seen.found:  # times were to be invented, for places
        return (
            f"{where}: no row has both a latitude and a longitude that can be understood; "
            "degrees, such as 49.4093 and 8.6937, were expected"
        )
    example = _example(seen)
    if not example:
        return f"{where}: column {seen.found['time'].name!r} is empty; times were expected"
    said = "" if order is None else f", or dates in the order {order} of dates (--dates)"
    return (
        f"{where}: column {seen.found['time'].name!r} holds no time that can be understood, such "
        f"as {example!r}; ISO 8601 (2026-06-01T08:00:00Z, or +02:00) or seconds since "
        f"1970{said} were expected; write it so"
    )


def mixed_note(read: Times, name: str) -> list[str]:
    """What is said of a column of times that mixes formats."""
    if not read.others:
        return []
    return [
        f"column {name!r} mixes formats of times: {read.others:,} of {len(read.seconds):,} rows "
        "are in another one than the others; each was read in its own"
    ]


def are_unlikely(seconds: Array) -> bool:
    """Whether the middle one of some times lies before 2000 or in the future."""
    known = seconds[np.isfinite(seconds)]
    latest = max(time.time(), _NEW) + DAY
    return bool(len(known)) and not _OLD <= float(np.median(known)) <= latest


def unlikely_notes(read: Times, seen: Seen) -> list[str]:
    """What is said of a column of times that nobody may have meant so, and of dates beside it."""
    name, day = seen.found["time"].name, seen.found.get("date")
    notes = []
    if day is not None and read.dateless:
        notes.append(
            f"column {day.name!r} not used: it holds no dates that can be understood, such as "
            f"{_example(seen, quantity='date')!r}; ISO 8601 (2026-06-01) was expected"
        )
    if day is not None and read.counted:
        notes.append(
            f"column {day.name!r} not used: column {name!r} holds numbers that are no times of "
            "day such as 74640 (07:46:40)"
        )
    if day is not None and read.taken is not None:
        notes.append(_said_of_order(read.taken, day.name))
    if read.ticks:
        notes.append(f"times in column {name!r} taken as ticks of 100 ns, of .NET or Windows")
    if not (read.dateless or read.counted) and are_unlikely(read.seconds):
        year = year_of(float(np.nanmedian(read.seconds)))
        notes.append(
            f"times in column {name!r} are of {year}; is that right? Numbers count from 1970; "
            "those of GPS count from 1980, of Apple from 2001, of NTP from 1900: give such times "
            "as ISO 8601"
        )
    return notes


def year_of(seconds: float) -> int:
    """The year of a time since 1970, s, also where no calendar of Python has it."""
    moment = np.datetime64(int(min(max(seconds, -_FAR), _FAR)), "s")
    return 1970 + int(moment.astype("datetime64[Y]").astype(np.int64))


def _said_of_order(taken: Taken, name: str) -> str:
    """What is said of dates whose digits do not show how they are to be read."""
    if taken.order == DAYS:
        how = "they were taken as days since 1970"
    else:
        how = f"the order {taken.order} was taken, in which they are the nearest to each other"
    return (
        f"column {name!r}: dates such as {taken.cell.strip()!r} do not show the order of their "
        f"digits; {how}: {taken.day}; where that is wrong give --dates (dates=), such as dmy"
    )


def _example(seen: Seen, rows: Bools | None = None, quantity: str = "time") -> str:
    """The beginning of the first cell that is filled, of these rows."""
    column = seen.table.column(seen.found[quantity].place)
    cells = strings(column if rows is None else column.filter(rows))
    return next((cell for cell in cells if cell), "")[:40]
