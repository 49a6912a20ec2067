"""Places that a receiver has dead-reckoned: none beside odometry that measures turns.

Such a receiver goes on without satellites by sensors of its own, and tells a small error while its
places drift.  Wheels with a gyro say the same, and the filter knows how they drift.  An odometer
alone measures no turns: beside it such places are of use.  So they are where the odometry says
another way than they do, as where it reads 0: nothing else shows that then.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from ..observations import RECKONED_PLACE, Array, Drive, Fixes, Odometer
from ..settings import Vehicle
from .checks import Bools, Skipped, keep
from .odometry_fit import way_of
from .units_by_places import distances

LEFT_OUT = "place dead-reckoned by the receiver, beside odometry that measures turns"
KEPT = "places that the receiver has dead-reckoned are used: the odometry says another way"
HEARD = 5.0  # s for which odometry that was heard stands beside a place
_STEP = 4.0  # s between places whose chords are the way
_PIECE = 60.0  # s over which ways are compared
_OTHER, _LEAST = 0.2, 30.0  # of the longer way, m: beyond both it is another

_LASTING = 10.0  # s that odometry reads no motion while places move by `_LEAST`, on line

Beside = Callable[[float], bool]  # whether such odometry was heard about a time, s since 1970
Stood = Callable[[float], float]  # s for which it has read no motion up to a time


def nothing_beside(_: float) -> bool:
    """There is no odometry."""
    return False


def never_stood(_: float) -> float:
    """It moves."""
    return 0.0


def without_reckoned(drive: Drive, vehicle: Vehicle) -> Drive:
    """The drive without such places; those before its first other fix say where it begins.

    Args:
        drive: A drive, in one piece.
        vehicle: For the scale of counters.
    """
    log, found = drive.odometry, drive.fixes
    if log is None or isinstance(log, Odometer) or found is None or not len(log.time):
        return drive
    reckoned = found.flags & RECKONED_PLACE > 0
    others = found.time[~reckoned]
    if len(others) in (0, len(found)):
        return drive
    last = np.searchsorted(log.time, found.time, side="right") - 1
    heard = (last >= 0) & (found.time - log.time[last] <= HEARD) & (found.time > others[0])
    time, way = way_of(log, vehicle)
    driven = np.append(0.0, np.cumsum(np.abs(np.diff(way))))
    notes = drive.notes
    ends = np.flatnonzero(np.diff(np.concatenate([[0], reckoned & heard, [0]])))
    for begin, end in ends.reshape(-1, 2).tolist():
        if not _same_way(found, slice(begin, end), time, driven):
            heard[begin:end] = False
            notes = tuple(dict.fromkeys((*notes, KEPT)))
    skipped: Skipped = Counter(drive.skipped)
    left = without(found, heard, skipped)
    return replace(drive, fixes=left, skipped=dict(skipped), notes=notes)


def _same_way(found: Fixes, run: slice, time: Array, driven: Array) -> bool:
    """Whether odometry says about the way of these places in each minute of theirs."""
    at = found.time[run]
    _, some = np.unique(at // _STEP, return_index=True)
    if len(some) < 2:
        return True
    at = at[some]
    way = np.append(0.0, np.cumsum(distances(found.lat_deg[run][some], found.lon_deg[run][some])))
    until = np.minimum(np.searchsorted(at, at + _PIECE), len(at) - 1)
    mine = way[until] - way
    its = np.interp(at[until], time, driven) - np.interp(at, time, driven)
    return not bool((np.abs(mine - its) > np.maximum(_OTHER * np.maximum(mine, its), _LEAST)).any())


def without(found: Fixes, beside: Bools, skipped: Skipped) -> Fixes:
    """Fixes without those that the receiver dead-reckoned beside odometry.

    Args:
        found: The fixes.
        beside: (n,) whether odometry stands beside each.
        skipped: Where to count.
    """
    good = keep((found.flags & RECKONED_PLACE == 0) | ~beside, LEFT_OUT, skipped)
    if good.all():
        return found
    return Fixes(**{one.name: getattr(found, one.name)[good] for one in fields(Fixes)})


class OnLine:
    """The same on line: left out while odometry is heard, unless it stands and they move.

    Args:
        beside: Whether odometry that measures turns was heard about a time.
        stood: For how long it has read no motion.
    """

    def __init__(self, beside: Beside, stood: Stood) -> None:
        self._beside, self._stood = beside, stood
        self._first: tuple[float, float, float] | None = None  # since it stands: s, degrees

    def without(self, found: Fixes, skipped: Skipped) -> Fixes:
        """The fixes without those places.

        Args:
            found: The next fixes, in the order of time.
            skipped: Where to count.
        """
        beside = found.flags & RECKONED_PLACE > 0
        for k in np.flatnonzero(beside).tolist():
            time, lat, lon = (float(x[k]) for x in (found.time, found.lat_deg, found.lon_deg))
            beside[k] = self._beside(time) and not self._moves(time, lat, lon)
        return without(found, beside, skipped)

    def _moves(self, time: float, lat_deg: float, lon_deg: float) -> bool:
        """Whether places have moved on while the odometry stood."""
        first, stood = self._first, self._stood(time)
        if first is None or not 0.0 <= time - first[0] <= stood:
            self._first = (time, lat_deg, lon_deg)
            return False
        _, lat, lon = first
        far = float(distances(np.array([lat, lat_deg]), np.array([lon, lon_deg]))[0])
        return time - first[0] >= _LASTING and far > _LEAST
