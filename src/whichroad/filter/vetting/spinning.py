"""Wheels that turn on the spot, as in snow or on a brake tester: all else stands.

The seconds in which a moving vehicle is compared tell little of a slow one.  So a stand by the
fixes is compared from its beginning on.  Where the receiver's own speed stands as well, a way by
the odometer is wrong.  But a receiver may hold its place, and report no speed, while the vehicle
creeps: fixes must differ from the odometer, too, before it is withheld.  Until then the level
covers both places.
"""

import math

from ..._compile import Record, kernel
from .._simd import copy_record
from .agreement import count, differ, moved
from .motion_sources import ARC, SPEED
from .windows import ANCHORS, CLOCK, COARSE, sigma_between

_LONGEST = 60.0  # s, after which a stand without a doubt is compared anew
_APART = 2.5  # sigmas, and a share of the way,
_OF_WAY = 0.2  # by which fixes differ from the odometer
_BY_BOTH = 0.5  # share of the fixes' way that the receiver's speed tells as well, at least
_P = 0.5  # P(the odometer is wrong), as long as only the receiver speaks against it


@kernel
def begin_stand(spin: Record, anchor: Record) -> None:
    """Begin a stand at the first anchor after a pause, over which the receiver's way is not known.

    Args:
        spin: `motion_sources.VETTING`'s, in place.
        anchor: Of `windows`.
    """
    copy_record(spin.since, anchor)
    spin.p = 0.0


@kernel
def weigh_spin(vetting: Record, last: int, scale: float, sensors: int, since: float) -> None:
    """Count seconds in which only the odometer moves.

    Args:
        vetting: In place.
        last: The newest anchor.
        scale: Plane metres per true metre.
        sensors: What there is.
        since: s since anchors were compared last.
    """
    spin = vetting.spin
    windows = vetting.windows
    a = spin.since
    b = windows.anchors[last % ANCHORS]
    sigma = sigma_between(windows, a, b)
    fixes = math.hypot(b.x - a.x, b.y - a.y) / scale
    measured = sensors != CLOCK and b.odometry == 1 and b.speeds == 1 and b.time > a.time
    doubted = spin.p > 0.0
    spin.p = 0.0
    if not measured or vetting.refused[SPEED] == 1 or sigma > COARSE:
        copy_record(spin.since, b)
        return
    odometer = abs(b.arc - a.arc)
    receiver = b.path - a.path
    precise = 0.3 * math.sqrt(b.time - a.time) + 0.5
    agree = differ(fixes, receiver, sigma) < 0
    if (agree or doubted) and differ(odometer, receiver, precise) > 0:
        spin.p = _P
        spin.sigma = sigma
        if agree and abs(odometer - fixes) > _APART * sigma + _OF_WAY * max(odometer, fixes):
            count(vetting, ARC, since)
    doubted = doubted or spin.p > 0.0
    left = fixes >= moved(sigma) and (not doubted or receiver > _BY_BOTH * fixes)  # else it jumped
    if left or (not doubted and b.time - a.time > _LONGEST):
        copy_record(spin.since, b)
