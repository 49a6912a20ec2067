"""Clocks that differ, put right: late fixes, and late odometry, are moved on to now."""

import math

from ..._compile import Record, kernel
from .delay_filter import DELAY, Delayed
from .latency import (
    CHANGE,
    FIXES,
    LONGEST,
    ODOMETRY,
    PACE,
    PLACES,
    PUNCTUAL,
    SOONEST,
    Frame,
    compare,
    decide,
    delayed,
    p_late,
    place_at,
    velocity,
)

_LEAD = 0.3  # s over which the pace of late odometry is taken
_LASTS = 1000.0  # m, for which the place stays behind after the vehicle has become slower


@kernel
def heed_clocks(latency: Record, epoch: Record, scale: float, valid: bool) -> None:
    """Learn from a fix how late it is, and move it on where it is.

    Args:
        latency: In place.
        epoch: With a fix, in place.
        scale: Plane metres per true metre.
        valid: Whether the odometry may be right.
    """
    latency.found = 0
    if latency.heading[1] == math.inf or not valid:
        latency.time = -math.inf
        if not valid:
            latency.behind[0] = 0.0
        if latency.late == FIXES:
            _widen(latency, epoch)
        return
    oldest = latency.places[max(latency.kept - PLACES, 0) % PLACES][0]
    known = epoch.time - oldest > latency.estimate.state[DELAY] + CHANGE + PACE
    due = known and epoch.time - latency.time >= SOONEST
    if latency.late == PUNCTUAL and not due:
        return
    turned = latency.heading[0] - (latency.before + latency.led)
    frame = Frame(latency.rate * math.cos(turned), latency.rate * math.sin(turned))
    then = delayed(latency, frame, epoch.time)
    if due:
        compare(latency, epoch, scale, frame, then)
        decide(latency)
        _note_behind(latency, then)
    _mend_fix(latency, epoch, scale, frame, then)


@kernel
def _note_behind(latency: Record, then: Delayed) -> None:
    """Note how fast the vehicle was, if fixes are likely to be late, but are not mended."""
    behind = latency.behind
    late = latency.late == PUNCTUAL and latency.estimate.state[DELAY] > 0.0
    behind[0] = p_late(latency) if late else 0.0
    left = behind[1] * math.exp(-abs(latency.here[2] - behind[2]) / _LASTS)
    behind[1] = max(math.hypot(then.vx, then.vy), left)
    behind[2] = latency.here[2]


@kernel
def _mend_fix(latency: Record, epoch: Record, scale: float, frame: Frame, then: Delayed) -> None:
    """Move a late fix on to now; sigmas have what is not known of its delay."""
    if latency.late == PUNCTUAL:
        return
    sigma = math.sqrt(latency.estimate.cov[DELAY, DELAY])
    smoothed = 0.0
    if latency.late == FIXES:
        epoch.fix[0] += scale * then.dx
        epoch.fix[1] += scale * then.dy
        ux, uy = velocity(latency, frame, epoch.time, 0.0)
        wx, wy = velocity(latency, frame, epoch.time, 2.0 * then.delay)
        changed = max(
            math.hypot(ux - then.vx, uy - then.vy), math.hypot(then.vx - wx, then.vy - wy)
        )
        smoothed = 0.5 * then.delay * changed  # a receiver may lag in other ways
        _, _, _, turn = place_at(latency, epoch.time, then.delay)
        epoch.course += latency.here[3] - turn
        epoch.speed = max(epoch.speed + math.hypot(ux, uy) - math.hypot(then.vx, then.vy), 0.0)
    more = smoothed * smoothed + sigma * sigma * (then.vx * then.vx + then.vy * then.vy)
    for axis in range(2, 4):
        epoch.fix[axis] = math.sqrt(epoch.fix[axis] ** 2 + more)


@kernel
def _widen(latency: Record, epoch: Record) -> None:
    """A late fix is off by its way since then, in a direction that is not known."""
    _, _, arc, _ = place_at(latency, epoch.time, min(latency.estimate.state[DELAY], LONGEST))
    way = abs(latency.here[2] - arc)
    for axis in range(2, 4):
        epoch.fix[axis] = math.hypot(epoch.fix[axis], way)


@kernel
def mend_odometry(latency: Record, reading: Record) -> None:
    """Move late odometry on to now, as if the vehicle had kept its speed and its turn.

    What was too much is taken back when it is slower, no farther than its way.

    Args:
        latency: In place.
        reading: What the sensors measured, in place.
    """
    late = latency.late == ODOMETRY
    if late:
        latency.mended = 1
    if latency.mended == 0:
        return
    here = latency.here
    latency.led = latency.lead[1]
    c = math.cos(here[3])
    s = math.sin(here[3])
    latency.before = here[3]
    here[0] += c * reading.forward - s * reading.left
    here[1] += s * reading.forward + c * reading.left
    here[2] += reading.arc
    here[3] += reading.turn
    _, _, arc, turn = place_at(latency, reading.time, _LEAD)
    ahead = -latency.estimate.state[DELAY] / _LEAD if late else 0.0
    metres = max(ahead * (here[2] - arc) - latency.lead[0], -max(reading.arc, 0.0))
    turned = ahead * (here[3] - turn) - latency.lead[1]
    reading.arc += metres
    reading.forward += metres
    reading.turn += turned
    latency.lead[0] += metres
    latency.lead[1] += turned
