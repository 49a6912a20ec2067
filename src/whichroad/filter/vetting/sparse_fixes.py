"""Odometry beside fixes that are too sparse for the windows: from one fix to the next one.

The odometer's way between two fixes may be longer than their distance, but not shorter.  Turns
show between the directions of two such legs.
"""

import math
from typing import NamedTuple

from ..._compile import Record, kernel
from ...graph.geometry import wrap
from .agreement import NEVER, Turned, count, weigh_turn
from .motion_sources import ARC
from .windows import ANCHORS, CLOCK, PAUSE, WHEELS, Seen

_LONGEST = 90.0  # s between two fixes
_COUNTS = 2.0  # s that a leg counts for: two of them decide
_CORRELATED, _LEAST = 0.8, 1.0  # of the reported sigmas, and m: error of a leg
_LONG = 20.0  # m and five sigmas, of a leg that tells a direction
_STANDS, _RUNS = 0.1, 2.0  # m/s by odometry that stands, and of fixes that do not
_TIMES, _SOON = 3.0, 60.0  # the odometer's way over the distance, seldom driven within so many s


class Leg(NamedTuple):
    """From one fix to the next one."""

    seconds: float  # 0: there is none
    fixes: float  # m
    sigma: float  # m, of that
    heading: float  # rad, by fixes
    chord: float  # m, by odometry
    reckoned: float  # rad, its direction by odometry
    way: float  # m, by odometry
    measured: bool  # whether odometry was, all the time


@kernel
def leg_of(windows: Record, epoch: Record, scale: float) -> Leg:
    """The leg to a fix from the last one, where the windows begin anew between them.

    Args:
        windows: Before the fix is added.
        epoch: With the fix.
        scale: Plane metres per true metre.
    """
    last = windows.anchors[(windows.count - 1) % ANCHORS]
    since = epoch.time - last.time
    if windows.count == 0 or since <= PAUSE or since > _LONGEST:
        return Leg(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False)
    now = windows.now
    dx = (epoch.fix[0] - last.x) / scale
    dy = (epoch.fix[1] - last.y) / scale
    ox, oy = now.ox - last.ox, now.oy - last.oy
    variance = epoch.fix[2] * epoch.fix[3] + last.sigma * last.sigma
    return Leg(
        since, math.hypot(dx, dy), _CORRELATED * math.sqrt(variance) + _LEAST, math.atan2(dy, dx),
        math.hypot(ox, oy), math.atan2(oy, ox), abs(now.arc - last.arc), now.odometry == 1,
    )  # fmt: skip


@kernel
def weigh_leg(vetting: Record, leg: Leg, sensors: int) -> Seen:
    """Count a leg for or against odometry; returns it as the windows would."""
    seen = Seen(
        leg.seconds, leg.fixes, leg.sigma, leg.heading, leg.way, leg.way, 0.0, 0.0, leg.measured,
        False,
    )  # fmt: skip
    if sensors == CLOCK or not leg.measured:
        vetting.leg[3] = vetting.leg_before[3] = 0.0
        return seen
    vetting.pace = leg.fixes / leg.seconds
    _weigh_way(vetting, leg)
    if sensors == WHEELS:
        _weigh_turn(vetting, leg)
    return seen


@kernel
def _weigh_way(vetting: Record, leg: Leg) -> None:
    """The odometer's way over two legs: one fix that is far away ends neither of them."""
    before = vetting.leg_before
    dx = leg.fixes * math.cos(leg.heading)
    dy = leg.fixes * math.sin(leg.heading)
    fixes = math.hypot(dx + before[0], dy + before[1])
    way = leg.way + before[2]
    seconds = leg.seconds + before[3]
    first = before[3] == 0.0
    before[0], before[1], before[2], before[3] = dx, dy, leg.way, leg.seconds
    if first:
        return
    short = way < 0.8 * fixes - 4.0 * leg.sigma
    long = seconds < _SOON and way > _TIMES * fixes + 4.0 * leg.sigma + _LONG
    runs = short and way < _STANDS * seconds and fixes > _RUNS * seconds
    if runs or (vetting.compared == 0 and (short or long)):
        count(vetting, ARC, _COUNTS)
    elif abs(way - fixes) < 2.0 * leg.sigma + 0.12 * way:
        count(vetting, ARC, -_COUNTS)
        if fixes > 5.0 * leg.sigma + _LONG:
            vetting.compared = 1


@kernel
def _weigh_turn(vetting: Record, leg: Leg) -> None:
    """The turn from the last leg to this one, by fixes and by odometry."""
    before = vetting.leg
    long = leg.fixes > 5.0 * leg.sigma + _LONG
    same = long and abs(leg.chord - leg.fixes) < 2.0 * leg.sigma + 0.12 * leg.fixes
    if long and before[3] > 0.0:
        others, reckoned = wrap(leg.heading - before[0]), wrap(leg.reckoned - before[1])
        unsure = 2.0 * leg.sigma / min(leg.fixes, before[3])
        turned = Turned(reckoned, others, 0.5 * leg.way, unsure)
        if vetting.unturned > NEVER or (same and before[2] > 0.0):
            weigh_turn(vetting, turned, _COUNTS)
    before[0], before[1] = leg.heading, leg.reckoned
    before[2] = 1.0 if same else 0.0
    before[3] = leg.fixes if long else 0.0
