"""Fixes of many trips read at once, where that gives the same as reading each alone.

Trips are regular that are sorted, valid and without odometry; the result is that of
`drive_tables.drive_from_table` trip by trip.
"""

from collections import Counter
from collections.abc import Mapping
from datetime import tzinfo
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..observations import ROUNDED, Array, Fixes
from ..settings import Settings
from .arrow_columns import numbers, times
from .bare_times import tick_of
from .checks import LAST, Bools, Ints, Skipped, is_place
from .clock_change import clock_changes
from .coarse_steps import COARSE, coarse_notes
from .dates import Writing
from .drive_columns import Columns, reported
from .fix_quality import NO_FIX
from .mixed_rows import NOTED, alternating
from .names import Column, find, normal
from .reported_fixes import completed, is_vague, says_no_hdop
from .resampled import RESAMPLED, resampling_notes
from .rounded_places import rounding_notes
from .stray_places import may_be_spikes
from .table_units import Units
from .units_by_places import TOO_FAST, distances, reachable
from .unread_times import are_unlikely

if TYPE_CHECKING:
    import pyarrow as pa

_ALONE = frozenset(
    [
        "wheel_rl",
        "wheel_rr",
        "wheel_rl_ticks",
        "wheel_rr_ticks",
        "odometer",
        "yaw_rate",
        "date",
        "north_south",
        "east_west",
    ]
)  # what only the reader of single trips understands


class RegularTrips(NamedTuple):
    """The trips of a batch that reading together gives as reading each alone."""

    fixes: Fixes  # trip after trip
    regular: Bools  # (d,) whether a trip of the batch is one
    notes: dict[int, tuple[str, ...]]  # what a reader has to say, by the trip's number


def batched_fixes(
    table: "pa.Table", first: Ints, settings: Settings,
    own: Mapping[str, str | int] | None = None, zone: tzinfo | None = None,
    units: Units | None = None,
) -> RegularTrips | None:  # fmt: skip
    """Read the fixes of the regular trips of a batch.

    Args:
        table: (n,) rows, trip after trip.
        first: (d,) where each begins.
        settings: Gives the sigma of fixes that report none.
        own: Own names of columns, as `names.find` takes them.
        zone: Of times that name none; None: UTC.
        units: Of columns that name none.

    Returns:
        The trips of which nothing is skipped.  None: no trip can be read so.
    """
    found = find(table.column_names, own)
    for name in ("drive_id", "vehicle_id", "row_id", "gear"):
        found.pop(name, None)
    if not _is_regular(table, found):
        return None
    time = _in_one_unit(table, found["time"], zone)
    if time is None or are_unlikely(time):  # the reader of each trip will say so
        return None
    skipped: Skipped = Counter()
    columns: Columns = {"time": time}
    for quantity, column in found.items():
        if quantity not in ("time", "geometry"):
            values = numbers(table.column(column.place), column.name, skipped)
            columns[quantity] = values * column.factor
    good = (np.abs(time) < LAST) & is_place(columns["lat"], columns["lon"])
    change = clock_changes(time, zone)
    if change is not None:  # the reader of each trip tells which of two hours is meant
        good &= change == 0.0
    if "hdop" in columns:
        good &= ~says_no_hdop(columns["hdop"])
    if "quality" in columns:
        good &= columns["quality"] != NO_FIX
    good &= ~is_vague(reported(columns, Counter()))
    step = np.diff(time, prepend=-np.inf)
    later = step > 0.0
    later[first] = True
    moved = np.concatenate([[0.0], distances(columns["lat"], columns["lon"])])
    # else the times of the trip may be wrong, or its rows of several vehicles
    possible = ~((moved > TOO_FAST * step) | (moved > reachable(step)))
    fast = may_be_spikes(moved, step)
    fast[first] = False
    possible[1:] &= ~(fast[1:] & fast[:-1])
    possible[first] = True
    mixed = np.append(alternating(columns["lat"], columns["lon"], first), False)
    size = np.diff(first, append=len(time))
    alone = np.add.reduceat(mixed, first, dtype=np.int64) >= NOTED * size
    regular = np.logical_and.reduceat(good & later & possible, first) & ~alone
    units = units or Units()
    units.in_si(columns)
    notes = _notes(units, columns, first)
    if not regular.all():
        rows = np.repeat(regular, size)
        columns = {quantity: values[rows] for quantity, values in columns.items()}
    begin = np.cumsum([0, *size[regular]])
    fixes = completed(reported(columns, skipped), begin[:-1], settings, skipped, units.grid)
    if skipped:
        return None
    if (fixes.flags & (ROUNDED | RESAMPLED | COARSE)).any():
        for trip, (low, high) in zip(
            np.flatnonzero(regular).tolist(), pairwise(begin), strict=True
        ):
            kinds = (rounding_notes, resampling_notes, coarse_notes)
            said = [note for notes_on in kinds for note in notes_on(fixes, low, high)]
            notes[trip] = (*notes.get(trip, ()), *said)
    return RegularTrips(fixes, regular, notes)


def _notes(units: Units, columns: Columns, first: Ints) -> dict[int, tuple[str, ...]]:
    """What is said of the units of each trip, where there is something to say."""
    if not units.notes and not units.unsure:
        return {}
    bounds = [*first.tolist(), len(columns["time"])]
    return {
        trip: units.notes_on({q: columns[q][low:high] for q in units.unsure if q in columns})
        for trip, (low, high) in enumerate(pairwise(bounds))
    }


def _is_regular(table: "pa.Table", found: dict[str, Column]) -> bool:
    """Whether the table has numeric positions and no odometry."""
    import pyarrow as pa

    has = found.keys()
    if not {"time", "lat", "lon"} <= has or not table.num_rows or _ALONE & has:
        return False
    if "bearing" in has and "speed" not in has:  # the reader of single trips adds a note
        return False
    return all(
        pa.types.is_floating(kind)
        or pa.types.is_integer(kind)
        or (quantity == "time" and pa.types.is_timestamp(kind))
        for quantity, column in found.items()
        if quantity != "geometry"
        for kind in (table.schema.field(column.place).type,)
    )


def _in_one_unit(table: "pa.Table", meaning: Column, zone: tzinfo | None) -> Array | None:
    """Seconds since 1970; None where numbers imply several units, or times are worth a note."""
    import pyarrow as pa

    column = table.column(meaning.place)
    local = pa.types.is_timestamp(column.type) and column.type.tz is None
    if local:
        unsaid = zone is None and "local" in normal(meaning.name)
        return (
            None
            if unsaid
            else times(column, meaning, "table", Counter(), written=Writing(zone)).seconds
        )
    if zone is not None:
        return None
    if meaning.factor or pa.types.is_timestamp(column.type):
        return times(column, meaning, "table", Counter()).seconds
    values = numbers(column, meaning.name, Counter())
    sizes = np.abs(values[np.isfinite(values)])
    if not len(sizes):
        return values
    least, most = tick_of(float(sizes.min())), tick_of(float(sizes.max()))
    return None if least is None or least != most else values * least
