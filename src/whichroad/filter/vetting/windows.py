"""What the sensors say of the last seconds, one beside the other, without a map.

Once a second an *anchor* is kept: the fix, and what odometer, gyro and the receiver's own speed
have summed up until then.  Between two anchors each source of motion tells a distance and a turn.
No hypothesis enters, so that a wrong belief cannot vouch for a wrong sensor.
"""

import math
from typing import NamedTuple

import numpy as np

from ..._compile import Record, kernel
from ...graph.geometry import wrap
from .._simd import copy_record

WHEELS, DISTANCE, CLOCK = 0, 1, 2  # what moves the vehicle: wheels with turn, distance, time

BY_WHEELS, BY_GYRO, AT_REST, GYRO_ALONE, UNTURNED, HEARD_AGAIN = range(6)
# what measures an epoch's turn: AT_REST a gyro whose rest has been used, GYRO_ALONE one while the
# distance is not measured, HEARD_AGAIN such a one as wheels tell the distance, UNTURNED nothing

ANCHORS = 32
_EVERY = 0.95  # s between anchors, at least
PAUSE = 6.0  # s without a fix, after which the windows begin anew
_BRAKES = 8.0  # m/s², with what is usual, beyond which positions have jumped, and not the car
_USUAL = 4.0  # times the usual jitter
_TIME_CONSTANT = 15.0  # s
_MOST_JITTER = 30.0  # m
_TURNS = 3.0  # m of jitter that are the car's own, in bends and by braking
_CORRELATED = 0.8  # of the reported sigmas: errors of fixes a few seconds apart are alike
_LEAST = 1.0  # m
COARSE = 30.0  # m, from which on a way by fixes tells nothing
_OF_JITTER, _OF_WHILE, _FLOOR = 0.7, 0.15, 0.5  # of the jitter, m/s, m: errors as seen
_SHORTEST, _LONGEST = 1.5, 15.0  # s between two anchors that are compared

ANCHOR = np.dtype(
    [
        ("time", "f8"),  # s
        ("x", "f8"),  # fix, plane m
        ("y", "f8"),
        ("sigma", "f8"),  # of the fix, m
        ("arc", "f8"),  # odometer, summed up, m
        ("turn", "f8"),  # and its turn, rad
        ("ox", "f8"),  # dead-reckoned place, m, in a frame of its own
        ("oy", "f8"),
        ("path", "f8"),  # integral of the receiver's speed, m
        ("course", "f8"),  # rad,
        ("towards", "f8", (2,)),  # and its cosine and sine
        ("odometry", "u1"),  # 1: odometry was measured all the time since the anchor before
        ("speeds", "u1"),  # 1: so were the receiver's speeds
        ("courses", "u1"),  # 1: it has a course
    ],
    align=True,
)

WINDOWS = np.dtype(
    [
        ("anchors", ANCHOR, (ANCHORS,)),  # the last ones, row (number % ANCHORS)
        ("count", "i8"),  # of anchors since the windows began
        ("now", ANCHOR),  # the sums until now
        ("speed", "f8"),  # the receiver's last one, m/s
        ("speed_time", "f8"),  # s
        ("vx", "f8"),  # m/s between the last two anchors, in the plane
        ("vy", "f8"),
        ("moves", "u1"),  # 1: these are known
        ("left", "f8", (5,)),  # where they last jumped from: plane, s, and the velocity there, m/s
        ("jumped_at", "f8"),  # s, when positions last jumped
        ("jitter", "f8"),  # m by which fixes usually leave the line of those before,
        ("watched", "f8"),  # s for which that was seen
    ],
    align=True,
)


class Seen(NamedTuple):
    """Motion between two anchors by each source."""

    seconds: float
    fixes: float  # m, distance of the fixes
    sigma: float  # m
    heading: float  # rad, from the first fix to the last one
    odometer: float  # m, chord of the dead-reckoned way
    arc: float  # m, its way
    turn: float  # rad, by the odometry
    receiver: float  # m, by its speeds
    odometry: bool  # whether it was measured throughout
    speeds: bool


@kernel
def is_alone(epoch: Record) -> bool:
    """Whether a gyro turned the vehicle while wheels were silent."""
    return bool(epoch.gyro == GYRO_ALONE or epoch.gyro == HEARD_AGAIN)


@kernel
def advance(windows: Record, epoch: Record, dt: float, valid: bool) -> None:
    """Sum up an epoch's odometry.

    Args:
        windows: In place.
        epoch: What the sensors measured.
        dt: Since the epoch before, s.
        valid: Whether the odometry is measured.
    """
    now = windows.now
    if dt <= 0.0:
        return
    c = math.cos(now.turn)
    s = math.sin(now.turn)
    now.arc += epoch.arc
    now.ox += c * epoch.forward - s * epoch.left
    now.oy += s * epoch.forward + c * epoch.left
    now.turn += epoch.turn
    if not valid:
        now.odometry = 0


@kernel
def add_fix(windows: Record, epoch: Record, scale: float, speed: bool) -> bool:
    """Sum up the receiver's speed, and keep an anchor where one is due.

    Positions that jump as no car moves begin the windows anew.

    Args:
        windows: In place.
        epoch: With a fix.
        scale: Plane metres per true metre.
        speed: Whether its speed may be summed up.

    Returns:
        Whether an anchor was kept.
    """
    now = windows.now
    _sum_speed(windows, epoch, speed and epoch.speed_sigma < 5.0)
    last = windows.anchors[(windows.count - 1) % ANCHORS]
    since = epoch.time - last.time
    if windows.count > 0:
        if since < _EVERY:
            return False
        vx = (epoch.fix[0] - last.x) / (scale * since)
        vy = (epoch.fix[1] - last.y) / (scale * since)
        if _returns(windows, epoch, scale) or _jumps(windows, vx, vy, since):
            windows.jumped_at = epoch.time
            windows.count = 0
        elif since > PAUSE:
            windows.count = 0
    now.time = epoch.time
    now.x = epoch.fix[0]
    now.y = epoch.fix[1]
    now.sigma = math.sqrt(epoch.fix[2] * epoch.fix[3]) + max(windows.jitter - _TURNS, 0.0)
    now.course = epoch.course
    now.courses = epoch.course_sigma < 0.5
    if now.courses == 1:
        now.towards[0] = math.cos(epoch.course)
        now.towards[1] = math.sin(epoch.course)
    copy_record(windows.anchors[windows.count % ANCHORS], now)
    windows.count += 1
    now.odometry = 1
    now.speeds = 1
    return True


@kernel
def _sum_speed(windows: Record, epoch: Record, reported: bool) -> None:
    """Integrate the receiver's speed, where it is reported."""
    since = epoch.time - windows.speed_time
    if reported and since < PAUSE:
        windows.now.path += 0.5 * (epoch.speed + windows.speed) * since
    else:
        windows.now.speeds = 0
    if reported:
        windows.speed = epoch.speed
        windows.speed_time = epoch.time


@kernel
def _returns(windows: Record, epoch: Record, scale: float) -> bool:
    """Whether a fix goes on where positions jumped from: the one between was off by itself."""
    left = windows.left
    since = epoch.time - left[2]
    if windows.moves == 1 or since > 2.0 * PAUSE:
        return False
    vx = (epoch.fix[0] - left[0]) / (scale * since)
    vy = (epoch.fix[1] - left[1]) / (scale * since)
    change = math.hypot(vx - left[3], vy - left[4]) * since
    if change > _BRAKES * since + _USUAL * windows.jitter:
        return False
    windows.moves = 1
    windows.vx = vx
    windows.vy = vy
    return True


@kernel
def _jumps(windows: Record, vx: float, vy: float, since: float) -> bool:
    """Whether positions change their velocity as no car does; where they were is kept then."""
    change = math.hypot(vx - windows.vx, vy - windows.vy) * since
    jumped = windows.moves == 1 and change > _BRAKES * since + _USUAL * windows.jitter
    if windows.moves == 1:
        kept = math.exp(-since / _TIME_CONSTANT)
        windows.jitter = kept * windows.jitter + (1.0 - kept) * min(change, _MOST_JITTER)
        windows.watched = min(windows.watched + since, _TIME_CONSTANT)
    if jumped:
        last = windows.anchors[(windows.count - 1) % ANCHORS]
        windows.left[0] = last.x
        windows.left[1] = last.y
        windows.left[2] = last.time
        windows.left[3] = windows.vx
        windows.left[4] = windows.vy
    windows.moves = 0 if jumped else 1
    windows.vx = vx
    windows.vy = vy
    return bool(jumped)


@kernel
def sigma_between(windows: Record, a: Record, b: Record) -> float:
    """Error of the way between two anchors, m: what they report, or less if less is seen."""
    reported = _CORRELATED * math.sqrt(a.sigma * a.sigma + b.sigma * b.sigma) + _LEAST
    if reported > COARSE or windows.watched < _TIME_CONSTANT:
        return float(reported)
    seen = _OF_JITTER * windows.jitter + _OF_WHILE * (b.time - a.time) + _FLOOR
    return float(min(reported, seen))


@kernel
def needed(sigma: float) -> float:
    """Distance (m) of two fixes of an error from which on their direction tells something."""
    return 5.0 * sigma + 5.0


@kernel
def far_enough(windows: Record, last: int, scale: float, seconds: float, times: float = 1.0) -> int:
    """The newest anchor before another one from which the fixes are far away.

    Args:
        windows: With the anchors.
        last: The other one.
        scale: Plane metres per true metre.
        seconds: Or, where none is, the newest one this long before.
        times: As far as this many times what is needed.

    Returns:
        Its number, −1 where there is none.
    """
    oldest = max(windows.count - ANCHORS, 0)
    b = windows.anchors[last % ANCHORS]
    slow = -1
    for j in range(last - 1, oldest - 1, -1):
        a = windows.anchors[j % ANCHORS]
        if b.time - a.time > _LONGEST:
            break
        dx = b.x - a.x
        dy = b.y - a.y
        far = scale * times * needed(sigma_between(windows, a, b))
        if dx * dx + dy * dy >= far * far and b.time - a.time > _SHORTEST:
            return j
        if slow < 0 and b.time - a.time >= seconds:
            slow = j
    return slow


@kernel
def between(windows: Record, first: int, last: int, scale: float) -> Seen:
    """Motion between two anchors by each source."""
    a = windows.anchors[first % ANCHORS]
    b = windows.anchors[last % ANCHORS]
    odometry = True
    speeds = True
    for j in range(first + 1, last + 1):
        odometry = odometry and windows.anchors[j % ANCHORS].odometry == 1
        speeds = speeds and windows.anchors[j % ANCHORS].speeds == 1
    dx = (b.x - a.x) / scale
    dy = (b.y - a.y) / scale
    sigma = sigma_between(windows, a, b)
    chord = math.hypot(b.ox - a.ox, b.oy - a.oy)
    return Seen(
        b.time - a.time, math.hypot(dx, dy), sigma, math.atan2(dy, dx), chord,
        b.arc - a.arc, b.turn - a.turn,
        b.path - a.path, odometry, speeds,
    )  # fmt: skip


class Courses(NamedTuple):
    """Courses between two anchors."""

    mean: float  # direction, rad
    turn: float  # from the first to the last one, rad
    reported: bool  # whether all are


@kernel
def course_between(windows: Record, first: int, last: int) -> Courses:
    """Courses between two anchors."""
    c = 0.0
    s = 0.0
    turn = 0.0
    for j in range(first, last + 1):
        anchor = windows.anchors[j % ANCHORS]
        if anchor.courses == 0:
            return Courses(0.0, 0.0, False)
        c += anchor.towards[0]
        s += anchor.towards[1]
        if j > first:
            turn += wrap(anchor.course - windows.anchors[(j - 1) % ANCHORS].course)
    return Courses(math.atan2(s, c), turn, True)


@kernel
def turn_of_places(windows: Record, first: int, middle: int, last: int) -> tuple[float, float]:
    """Turn from the chord first-middle to the chord middle-last: by fixes, by dead reckoning."""
    a = windows.anchors[first % ANCHORS]
    m = windows.anchors[middle % ANCHORS]
    b = windows.anchors[last % ANCHORS]
    by_fixes = math.atan2(b.y - m.y, b.x - m.x) - math.atan2(m.y - a.y, m.x - a.x)
    reckoned = math.atan2(b.oy - m.oy, b.ox - m.ox) - math.atan2(m.oy - a.oy, m.ox - a.ox)
    return wrap(by_fixes), wrap(reckoned)
