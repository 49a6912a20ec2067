"""What is said of rows that are not used: made up from others, or what no vehicle does."""

import numpy as np

from ..observations import (
    HELD_COURSE,
    HELD_SPEED,
    INTERPOLATED,
    LATE_PLACE,
    OTHER_UNIT,
    SCATTERED,
    STRAY,
    ZERO_SPEED,
    Fixes,
)
from ..wording import counted
from .other_units import unit_notes
from .scattered_places import scatter_notes

RESAMPLED = (
    INTERPOLATED | HELD_SPEED | HELD_COURSE | ZERO_SPEED | OTHER_UNIT | LATE_PLACE | SCATTERED
)
_NOTES = {
    STRAY: "places of {} of {} cannot be reached from those around them, and are not used; "
    "look for a stale place at the start, latitude and longitude swapped, a lost sign, or places "
    "of a network among those of satellites",
    INTERPOLATED: "places of {} of {} lie on the lines between others, so they were interpolated; "
    "they are not used: give the fixes as they were measured",
    LATE_PLACE: "places of {} of {} are not known: places lag behind the speeds of their rows by "
    "seconds and were moved to them; give each place at the time at which it was measured",
    HELD_SPEED: "speeds of {} of {} repeat the row before while the vehicle drives, and are not "
    "used; give each speed where it was measured, and leave the rows between empty",
    HELD_COURSE: "courses of {} of {} repeat the row before while the vehicle drives, and are not "
    "used; give each course where it was measured, and leave the rows between empty",
    ZERO_SPEED: "speeds of 0 in {} of {} are not used: the vehicle drove at many of them; leave "
    "speeds empty that are not known",
}


def resampling_notes(fixes: Fixes | None, first: int = 0, end: int | None = None) -> list[str]:
    """What is to be said of the fixes of one drive, from `first` on, that were resampled."""
    if fixes is None:
        return []
    flags = fixes.flags[first:end]
    said = [
        text.format(f"{count:,}", counted(len(flags), "row"))
        for flag, text in _NOTES.items()
        if (count := np.count_nonzero(flags & flag))
    ]
    return said + unit_notes(fixes, first, end) + scatter_notes(fixes, first, end)
