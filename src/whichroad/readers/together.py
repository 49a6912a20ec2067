"""The fixes of many trips at once, for trips about which there is nothing to say.

What `table.drive_from_table` does trip by trip, it does in calls that cost the same for
one row and for thousands.
"""

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from ..records import Array, Fixes
from ..settings import Settings
from .arrow_columns import LARGEST, numbers, times
from .checks import LAST, Bools, Ints, Skipped
from .drive_columns import Columns, reported
from .names import Column, find
from .reported_fixes import completed, is_place

if TYPE_CHECKING:
    import pyarrow as pa

_ODOMETRY = frozenset(
    ["wheel_rl", "wheel_rr", "wheel_rl_ticks", "wheel_rr_ticks", "odometer", "yaw_rate"]
)


def fixes_together(
    table: "pa.Table", first: Ints, settings: Settings
) -> tuple[Fixes, Bools] | None:
    """Read the fixes of those of some trips that are plain.

    Args:
        table: (n,) rows, trip after trip.
        first: (d,) where each begins.
        settings: Gives the sigma of fixes that report none.

    Returns:
        Fixes, trip after trip, and (d,) of which trips: what is read of those alone is the same,
        nothing skipped and nothing noted; None where that cannot be said of any.
    """
    found = find(table.column_names)
    found.pop("drive_id", None)
    if not _is_plain(table, found):
        return None
    time = _in_one_unit(table, found["time"])
    if time is None:
        return None
    skipped: Skipped = Counter()
    columns: Columns = {"time": time}
    for quantity, column in found.items():
        if quantity not in ("time", "geometry"):
            values = numbers(table.column(column.place), column.name, skipped)
            columns[quantity] = values * column.factor
    good = (np.abs(time) < LAST) & is_place(columns["lat"], columns["lon"])
    later = np.diff(time, prepend=-np.inf) > 0.0
    later[first] = True
    plain = np.logical_and.reduceat(good & later, first)
    if not plain.all():
        rows = np.repeat(plain, np.diff(first, append=len(time)))
        columns = {quantity: values[rows] for quantity, values in columns.items()}
    fixes = completed(reported(columns), settings, skipped)
    return None if skipped else (fixes, plain)


def _is_plain(table: "pa.Table", found: dict[str, Column]) -> bool:
    """Whether there are positions and no odometry, all of them numbers."""
    import pyarrow as pa

    has = found.keys()
    if not {"time", "lat", "lon"} <= has or not table.num_rows or _ODOMETRY & has:
        return False
    if "bearing" in has and "speed" not in has:  # which is worth a note
        return False
    return all(
        pa.types.is_floating(kind)
        or pa.types.is_integer(kind)
        or (quantity == "time" and pa.types.is_timestamp(kind))
        for quantity, column in found.items()
        if quantity != "geometry"
        for kind in (table.schema.field(column.place).type,)
    )


def _in_one_unit(table: "pa.Table", meaning: Column) -> Array | None:
    """Seconds since 1970; None where the sizes of bare numbers tell of several units."""
    import pyarrow as pa

    column = table.column(meaning.place)
    if meaning.factor or pa.types.is_timestamp(column.type):
        return times(column, meaning, "table", Counter())
    values = numbers(column, meaning.name, Counter())
    sizes = np.abs(values[np.isfinite(values)])
    if not len(sizes):
        return values
    bounds = [largest for largest, _ in LARGEST]
    least, most = np.searchsorted(bounds, [sizes.min(), sizes.max()], side="right").tolist()
    return values * LARGEST[least][1] if least == most else None
