"""Readings that no car makes: beyond brakes, tyres and steering."""

from .._compile import Record, kernel
from .sources import ARC, blame, is_possible
from .windows import WHEELS

_INTERVAL = 0.2  # s of odometry that are looked at as one
_BRAKES = 12.0  # m/s², more than any car's acceleration
_SPEED_SLACK = 1.0  # m/s, of counts
_FIRM = 5.0  # m/s², firm braking; with what is usual, more than most drives have
_COUNTS = 0.3  # m/s
_UNUSUAL = 4.0  # times the usual change
_NEW = 0.02  # share of the last look in it
_LATERAL = 12.0  # m/s², more than tyres hold
_LATERAL_SLACK = 0.15  # 1/s times the speed, of counts
_CURVATURE = 0.4  # 1/m, more than a car's steering
_RATE_SLACK = 0.6  # rad/s, of counts
_TURN_ACCELERATION = 4.0  # rad/s²
_FASTEST = 90.0  # m/s
_PAUSE_OF_SPEEDS = 6.0  # s, after which a speed may have become any other
_ODD = 3  # speeds in a row that do not follow; they are right then


@kernel
def check_odometry(vetting: Record, epoch: Record, dt: float, sensors: int) -> None:
    """Hold odometry against what cars can do, some tenths of a second at a time.

    Args:
        vetting: In place.
        epoch: What the sensors measured.
        dt: Since the epoch before, s.
        sensors: WHEELS or DISTANCE.
    """
    vetting.windows.now.time = epoch.time
    vetting.time += dt
    vetting.arc += epoch.arc
    vetting.turn += epoch.turn
    if vetting.time < _INTERVAL:
        return
    speed = vetting.arc / vetting.time
    rate = vetting.turn / vetting.time
    possible = True
    if vetting.looked:
        possible = abs(speed - vetting.speed) <= _BRAKES * vetting.time + _SPEED_SLACK
    if sensors == WHEELS:
        size = abs(speed)
        possible = possible and abs(speed * rate) <= _LATERAL + _LATERAL_SLACK * size
        possible = possible and abs(rate) <= _CURVATURE * size + _RATE_SLACK
        if vetting.looked:
            limit = _TURN_ACCELERATION * vetting.time + _RATE_SLACK
            possible = possible and abs(rate - vetting.rate) <= limit
    if vetting.looked:
        change = abs(speed - vetting.speed)
        if change > _FIRM * vetting.time + _COUNTS + _UNUSUAL * vetting.change:
            vetting.suspect_at = epoch.time
        vetting.change += _NEW * (min(change, _BRAKES * vetting.time) - vetting.change)
    if possible:
        vetting.rolled += abs(vetting.arc)
        if vetting.refused[ARC] == 0 and is_possible(vetting):
            vetting.sound = speed
    else:
        vetting.suspect_at = epoch.time
        blame(vetting, epoch.time)
    vetting.speed = speed
    vetting.rate = rate
    vetting.looked = 1
    vetting.time = 0.0
    vetting.arc = 0.0
    vetting.turn = 0.0


@kernel
def is_odd(vetting: Record, epoch: Record) -> bool:
    """Whether the receiver's speed is not what its last one, or any car, may have become."""
    windows = vetting.windows
    if epoch.speed_sigma >= 5.0:
        vetting.odd = 0
        return False
    since = epoch.time - windows.speed_time
    odd = epoch.speed > _FASTEST
    if since < _PAUSE_OF_SPEEDS and vetting.odd < _ODD:
        slack = 3.0 * epoch.speed_sigma + _SPEED_SLACK
        odd = odd or abs(epoch.speed - windows.speed) > _BRAKES * since + slack
    vetting.odd = vetting.odd + 1 if odd else 0
    return bool(odd)
