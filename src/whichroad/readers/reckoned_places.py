"""Places that a receiver has dead-reckoned: none beside odometry that measures turns.

Such a receiver goes on without satellites by sensors of its own, and tells a small error while its
places drift.  Wheels with a gyro say the same, and the filter knows how they drift.  An odometer
alone measures no turns: beside it such places are of use.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from ..observations import RECKONED_PLACE, Drive, Fixes, Odometer
from .checks import Bools, Skipped, keep

LEFT_OUT = "place dead-reckoned by the receiver, beside odometry that measures turns"
HEARD = 5.0  # s for which odometry that was heard stands beside a place

Beside = Callable[[float], bool]  # whether such odometry was heard about a time, s since 1970


def nothing_beside(_: float) -> bool:
    """There is no odometry."""
    return False


def without_reckoned(drive: Drive) -> Drive:
    """The drive without such places; those before its first other fix say where it begins.

    Args:
        drive: A drive, in one piece.
    """
    log, found = drive.odometry, drive.fixes
    if log is None or isinstance(log, Odometer) or found is None or not len(log.time):
        return drive
    others = found.time[found.flags & RECKONED_PLACE == 0]
    if len(others) in (0, len(found)):
        return drive
    last = np.searchsorted(log.time, found.time, side="right") - 1
    heard = (last >= 0) & (found.time - log.time[last] <= HEARD) & (found.time > others[0])
    skipped: Skipped = Counter(drive.skipped)
    left = without(found, heard, skipped)
    return drive if left is found else replace(drive, fixes=left, skipped=dict(skipped))


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


def without_heard(found: Fixes, beside: Beside, skipped: Skipped) -> Fixes:
    """The same on line."""
    if not (found.flags & RECKONED_PLACE).any():
        return found
    return without(found, np.array([beside(time) for time in found.time.tolist()]), skipped)
