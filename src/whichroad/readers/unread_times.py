"""What is said of rows whose time cannot be understood, or is in another format than most."""

import numpy as np

from .arrow_columns import Times, strings, unparsable
from .checks import LAST, NO_TIME, UNPARSABLE_TIME, Bools, Skipped
from .drive_columns import Columns
from .names import Seen

_NOTED = 0.05  # share of a table's rows


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


def _example(seen: Seen, rows: Bools | None = None) -> str:
    """The beginning of the first cell that is filled, of these rows."""
    column = seen.table.column(seen.found["time"].place)
    cells = strings(column if rows is None else column.filter(rows))
    return next((cell for cell in cells if cell), "")[:40]
