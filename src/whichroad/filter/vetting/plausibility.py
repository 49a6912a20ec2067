"""Readings that no car makes: beyond brakes, tyres and steering."""

from ..._compile import Record, kernel
from .motion_sources import ARC, blame, is_possible
from .windows import WHEELS

_SPEED_INTERVAL = 0.095  # s of odometry, at least, of which the speed is taken,
_TURN_INTERVAL = 0.38  # and the turn rate
_BRAKES = 12.0  # m/s², more than any car's acceleration
_FIRM = 5.0  # m/s², more than most drives have
_SPEED_SLACK = 1.0  # m/s
_COUNTS = 0.3  # m/s
_UNUSUAL = 4.0  # times the usual jitter of the odometer's own speed or turn rate
_MOST_SPEED, _MOST_TURN = 10.0, 1.0  # m/s, rad/s of that at most
_NEW = 0.02  # share of a sample in what is usual
_LATERAL = 12.0  # m/s², more than tyres hold
_LATERAL_SLACK = 0.15  # 1/s times the speed, of counts
_CURVATURE = 0.4  # 1/m, more than a car's steering
_ON_THE_SPOT = 2.0  # rad/s, as vehicles turn that can turn on the spot
_TURN_ACCELERATION = 4.0  # rad/s²
_PIVOTS, _MOST_PIVOT = 0.5, 4.0  # m/s from which on its middle moves; rad at once about a wheel
_RATE_SLACK = 0.6  # rad/s
_NO_TURN = 1e-6  # rad in an epoch
_ROLLS = 2.0  # m/s, below which a vehicle may turn as it likes
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
    sample = vetting.speed_sample
    sample.time += dt
    sample.amount += epoch.arc
    believed = vetting.refused[ARC] == 0 and is_possible(vetting)
    possible = True
    if sample.time >= _SPEED_INTERVAL and epoch.odometry_valid == 1:
        arc = sample.amount
        change, limit = _take(sample, _MOST_SPEED)
        possible = abs(sample.rate) <= _FASTEST
        possible = possible and change <= _BRAKES * sample.lasted + _SPEED_SLACK + limit
        if believed and change > _FIRM * sample.lasted + _COUNTS + limit:
            vetting.suspect_at = epoch.time
        if possible:
            vetting.rolled += abs(arc)
            if vetting.refused[ARC] == 0 and is_possible(vetting):
                vetting.sound = sample.rate
    if sensors == WHEELS:
        if vetting.unturned >= 0.0:
            turns = abs(epoch.turn) > _NO_TURN
            vetting.unturned = -1.0 if turns else vetting.unturned + abs(epoch.arc)
        possible = _check_turn(vetting, epoch, dt) and possible
    if not possible:
        if believed:  # else it has moved nothing
            vetting.suspect_at = epoch.time
        blame(vetting, epoch.time)


@kernel
def _check_turn(vetting: Record, epoch: Record, dt: float) -> bool:
    """Whether a car can turn so, at its speed, and not for long about a wheel that stands."""
    sample = vetting.turn_sample
    sample.time += dt
    sample.amount += epoch.turn
    if sample.time < _TURN_INTERVAL or epoch.odometry_valid != 1:
        return True
    change, limit = _take(sample, _MOST_TURN)
    size = abs(vetting.speed_sample.rate)
    rate = abs(sample.rate)
    pivots = size > _PIVOTS and rate > _CURVATURE * size + limit
    alike = pivots and vetting.pivoted * sample.rate >= 0.0
    vetting.pivoted = vetting.pivoted + sample.rate * sample.lasted if alike else 0.0
    possible = abs(vetting.pivoted) <= _MOST_PIVOT
    possible = possible and size * rate <= _LATERAL + (_LATERAL_SLACK + limit) * size
    possible = possible and rate <= _CURVATURE * size + _ON_THE_SPOT + limit
    if size > _ROLLS:
        possible = possible and change <= _TURN_ACCELERATION * sample.lasted + _RATE_SLACK + limit
    return bool(possible)


@kernel
def _take(sample: Record, most: float) -> tuple[float, float]:
    """Take what was summed up as a rate.

    Returns:
        By how much the rate changed, and what of that its usual jitter may be, `most` at most.
    """
    rate = sample.amount / sample.time
    change = rate - sample.rate if sample.count > 0 else 0.0
    limit = min(_UNUSUAL * sample.jitter, most)
    if sample.count > 1:
        jitter = abs(change - sample.change)
        sample.jitter += _NEW * (min(jitter, limit + 0.5) - sample.jitter)
    sample.change = change
    sample.rate = rate
    sample.lasted = sample.time
    sample.count = min(sample.count + 1, 2)
    sample.time = 0.0
    sample.amount = 0.0
    return abs(change), limit


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
