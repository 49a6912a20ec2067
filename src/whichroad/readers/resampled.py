"""What is said of rows that were made up from others, not measured."""

import numpy as np

from ..observations import INTERPOLATED, Fixes
from ..wording import counted

RESAMPLED = INTERPOLATED
_NOTES = {
    INTERPOLATED: "places of {} of {} lie on the lines between others, so they were interpolated; "
    "they are not used: give the fixes as they were measured",
}


def resampling_notes(fixes: Fixes | None, first: int = 0, end: int | None = None) -> list[str]:
    """What is to be said of the fixes of one drive, from `first` on, that were resampled."""
    if fixes is None:
        return []
    flags = fixes.flags[first:end]
    return [
        text.format(f"{count:,}", counted(len(flags), "row"))
        for flag, text in _NOTES.items()
        if (count := np.count_nonzero(flags & flag))
    ]
