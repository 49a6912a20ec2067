"""Rows of two vehicles as one drive: places that alternate between two tracks.

A vehicle turns back once in a while; a wrong place makes a turn there, one back and perhaps one
more.  Between rows of two vehicles the way turns back row after row, while every other row leads
onward.  That holds however near the two are in time, and however far apart their rows.
"""

import numpy as np
from numpy.typing import NDArray

from ..observations import Array, Fixes
from .checks import Bools, Ints
from .units_by_places import distances, metres_between

REFUSED = 0.25  # share of steps that alternate, from which on rows are not read as one drive
NOTED = 0.03  # and from which on it is said; of one vehicle none was seen with any
_FAR = 30.0  # m, steps beyond it may be between two tracks
_STANDS = 15.0  # m, within which a track may turn, as errors of fixes turn it
_BACK = -0.5  # cosine of the angle between steps, below which the second turns back
_LONG = 5  # rows on end: independent errors, however large, hardly make so many
_LONGER = 11  # where rows between them are left out: single wrong places turn back every time
_NEAR = 0.5  # of the way there, within which the way back ends where it began


def alternating(lat_deg: Array, lon_deg: Array, first: "Ints | tuple[int, ...]" = (0,)) -> Bools:
    """Whether each step is one of many between two tracks, (n - 1,).

    Args:
        lat_deg: (n,) places in the order of time, one at a time.
        lon_deg: Likewise.
        first: Where each drive begins; steps from one to the next are none.
    """
    n = len(lat_deg)
    if n < _LONG:
        return np.zeros(max(n - 1, 0), np.bool_)
    drive = np.searchsorted(first, np.arange(n), side="right")
    steps = metres_between(lat_deg[:-1], lon_deg[:-1], lat_deg[1:], lon_deg[1:])
    moved = np.hypot(*steps)
    rows = _on_end(*steps, moved, drive, _LONG)
    least = np.minimum(moved[:-1], moved[1:])
    lone = np.zeros(n, np.bool_)  # of the vehicle with fewer rows, or wrong
    lone[1:-1] = (least > _FAR) & (distances(lat_deg, lon_deg, 2) < _NEAR * least)
    few = np.flatnonzero(lone | np.append(lone[1:], False))
    if len(few) >= _LONGER:
        lat, lon = lat_deg[few], lon_deg[few]
        steps = metres_between(lat[:-1], lon[:-1], lat[1:], lon[1:])
        few = few[_on_end(*steps, np.hypot(*steps), drive[few], _LONGER)]
        rows[few[lone[few]]] = True
    return np.asarray((rows[:-1] | rows[1:]) & (drive[:-1] == drive[1:]))


def _on_end(
    east: Array, north: Array, moved: Array, drive: NDArray[np.int64], least: int
) -> Bools:  # fmt: skip
    """Rows, of `least` on end, at which the way turns back and every other row leads on, (n,).

    Args:
        east: (n - 1,) m from each row to the next.
        north: Likewise.
        moved: Likewise, the whole way.
        drive: (n,) of the rows, n ≥ `least`.
        least: 5 at least.
    """
    n = len(drive)
    found = np.zeros(n, np.bool_)
    with np.errstate(over="ignore", invalid="ignore"):  # places may be anything
        along = east[:-1] * east[1:] + north[:-1] * north[1:]
        turned = (along < _BACK * moved[:-1] * moved[1:]) & (drive[:-2] == drive[2:])
        turned &= np.minimum(moved[:-1], moved[1:]) > _FAR
        if np.count_nonzero(turned) < least:  # as of most drives
            return found
        east, north = east[:-1] + east[1:], north[:-1] + north[1:]  # over two rows
        moved = np.hypot(east, north)
        onward = east[:-2] * east[2:] + north[:-2] * north[2:] >= 0.0
        onward |= np.minimum(moved[:-2], moved[2:]) < _STANDS
        onward &= (moved[:-2] > 0.0) & (moved[2:] > 0.0)  # the mast of a cell is no vehicle
        onward |= drive[:-4] != drive[4:]
    found[1:-1] = turned
    found[2:-2] &= onward
    ends = np.flatnonzero(np.diff(found, prepend=False, append=False))
    begin, end = ends[::2], ends[1::2]
    long = end - begin >= least
    change = np.zeros(n + 1, np.int64)
    change[begin[long]] = 1
    change[end[long]] -= 1
    return np.asarray(np.cumsum(change[:-1]) > 0)


def mixed_notes(fixes: Fixes | None) -> list[str]:
    """What is said of the fixes of a drive whose rows seem to be of two vehicles."""
    if fixes is None:
        return []
    new = np.diff(fixes.time, prepend=-np.inf) > 0.0
    found = alternating(fixes.lat_deg[new], fixes.lon_deg[new])
    if not len(found) or np.mean(found) < NOTED:
        return []
    return [f"rows seem to be of two vehicles: {said_of(found)}"]


def said_of(found: Bools) -> str:
    """How many steps of a drive alternate, and what to do."""
    return (
        f"{np.count_nonzero(found)} of {len(found)} steps from place to place go back and forth "
        "between two tracks; rows of one vehicle, by one clock, were expected; name the column "
        "that identifies the vehicle (--id COLUMN, id=)"
    )
