"""Fixes that repeat the place of an earlier one, to the digit, while the vehicle moves.

Receivers, phones and loggers fill gaps with their last fix.  A measured place never comes
again to the centimetre, but for a vehicle that stands.
"""

import math

import numpy as np

from ..._compile import Record, kernel

REPEATS = np.dtype(
    [
        ("place", "f8", (2,)),  # the last one that was measured, plane
        ("begun", "f8"),  # when, s,
        ("last", "f8"),  # and when it was last repeated
        ("driven", "f8"),  # m since, by the odometer or by reported speeds
        ("sample", "f8", (3,)),  # a place about a second before, plane, and when, s
        ("speeds", "f8", (2,)),  # m/s, by reports or from place to place: the last two
        ("apart", "f8"),  # s over which the last one is a mean; 0: it was reported
        ("longest", "f8"),  # s for which a place was repeated that the vehicle had left
        ("restless", "f8"),  # s of standing, in which places were others; none was held since
        ("held", "f8"),  # s for which a place has been withheld that may be that of a stop
        ("seconds", "f8"),  # for which fixes were withheld
    ],
    align=True,
)

_SAME = 1e-3  # m, up to which two places are one
_LEAST = 3.0  # m driven, or the fix's sigma if that is more, from which on a place is repeated,
_LEAST_DRIVEN = 5.5  # by an odometer, which may count in steps of 5 m,
_LEAST_ALONE = 10.0  # and where nothing but places tells it, of receivers that never did
_REPORTED = 1.0  # m/s, sigma from which on a speed says nothing
_STANDS = 0.5  # m/s, of a receiver that says that the vehicle stands
_BRAKES, _GAINS = 5.0, 4.0  # m/s², beyond which vehicles seldom brake, or gain speed
_SLOWS = 3.0  # m/s², as most brake
_SECOND = 0.95  # s between the places that tell a speed
_AGAIN = 2.0  # times as long as before may a place be repeated
_STOPS, _EASES = 3.25, 1.5  # m/s at its last place up to which a vehicle may stop, m/s² before
_DRIVES_OFF = 2.5  # m/s², of a vehicle whose receiver still holds the place of its stop
_HOLDS = 20.0  # m, at most that receivers do so
_FORGETS = 0.5  # what is left of that after a place that was held at a stop
_RESTS = 0.5  # m/s from place to place, of a vehicle that stands
_RESTLESS, _MOST = 10.0, 60.0  # s of that, from which on a receiver holds no place; and at most
_PAUSE = 5.0  # s between places that tell nothing


@kernel
def is_repeated(seen: Record, epoch: Record, dt: float, measured: bool) -> bool:
    """Whether a fix only repeats a place that the vehicle has left.

    Where there is an odometer, it tells.  Else it has left it if reported speeds say so, or if no
    braking could have kept it there.  Where the receiver has repeated places before, the vehicle
    drives on.  A receiver whose places have never been the same while the vehicle stood measures
    none that is.

    Args:
        seen: In place, REPEATS.
        epoch: What the sensors measured.
        dt: Since the epoch before, s.
        measured: Whether the odometry is believed: it was measured, or is between two readings.
    """
    reported = epoch.has_fix == 1 and epoch.speed_sigma < _REPORTED
    if measured:
        seen.driven += epoch.arc
    elif reported:
        seen.driven += max(epoch.speed - 3.0 * epoch.speed_sigma, 0.0) * dt
    if not epoch.has_fix:
        return False
    if math.hypot(epoch.fix[0] - seen.place[0], epoch.fix[1] - seen.place[1]) > _SAME:
        _take(seen, epoch, reported)
        return False
    seen.last = epoch.time
    if not measured and seen.restless >= _RESTLESS:
        seen.held += dt
        return True
    if measured:
        far, least = abs(seen.driven), _LEAST_DRIVEN
    else:
        far = _least_way(seen, epoch.time)
        if not (reported and epoch.speed < _STANDS):
            far = max(far, abs(seen.driven))
        least = _LEAST if reported or seen.longest > 0.0 else _LEAST_ALONE
    if far <= max(least, epoch.fix[2]):
        return False
    seen.seconds += dt
    return True


@kernel(inline=True)
def _take(seen: Record, epoch: Record, reported: bool) -> None:
    """Remember a place, and how fast the vehicle is there."""
    x, y = epoch.fix[0], epoch.fix[1]
    far = math.hypot(x - seen.place[0], y - seen.place[1])
    since = epoch.time - seen.last
    if seen.last > seen.begun:
        if far > _LEAST + epoch.fix[2] + _let_go(seen, epoch.time):
            seen.longest = max(seen.longest, seen.last - seen.begun)
            seen.seconds += seen.held
        else:  # the place of a stop, held
            seen.restless = 0.0
            seen.longest *= _FORGETS
    elif far < _RESTS * since and since < _PAUSE:
        seen.restless = min(seen.restless + since, _MOST)
    since = epoch.time - seen.sample[2]
    if reported or since >= _SECOND:
        speed = math.hypot(x - seen.sample[0], y - seen.sample[1]) / since if since > 0.0 else 0.0
        if reported:  # a report of 0 where a gap begins is none
            braked = max(seen.speeds[0] - _BRAKES * since, speed - 0.5 * _BRAKES * since)
            speed = max(epoch.speed, braked)
        seen.apart = 0.0 if reported else since
        seen.speeds[1] = speed if reported else seen.speeds[0]
        seen.speeds[0] = speed
        seen.sample[0], seen.sample[1], seen.sample[2] = x, y, epoch.time
    seen.place[0], seen.place[1] = x, y
    seen.begun = seen.last = epoch.time
    seen.driven = seen.held = 0.0


@kernel(inline=True)
def _let_go(seen: Record, time: float) -> float:
    """Metres by which a vehicle may be away when its receiver no longer holds a place.

    Receivers that hold the place of a stop let it go some seconds after the vehicle drives off.
    """
    since, stood = time - seen.last, time - seen.begun
    far = 0.5 * _GAINS * since * since
    if _may_stop(seen):
        far = max(far, min(0.5 * _DRIVES_OFF * stood * stood, _HOLDS))
    return float(far)


@kernel(inline=True)
def _may_stop(seen: Record) -> bool:
    """Whether the vehicle was slow enough at its last place to stop there."""
    slow = _STOPS + 0.5 * _EASES * min(seen.apart, _PAUSE)
    return bool(min(seen.speeds[0], seen.speeds[1]) <= slow)


@kernel(inline=True)
def _least_way(seen: Record, time: float) -> float:
    """Metres since the last place that was measured of a vehicle that brakes as hard as it can."""
    speed = min(seen.speeds[0], seen.speeds[1])  # one wrong place tells no speed
    since = time - seen.begun
    if since <= _AGAIN * seen.longest:
        return float(speed * since)
    speed = max(speed - 0.5 * _SLOWS * min(seen.apart, _PAUSE), 0.0)
    brakes = min(since, speed / _BRAKES)
    return float((speed - 0.5 * _BRAKES * brakes) * brakes)
