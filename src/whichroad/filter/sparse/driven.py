"""How far an odometer says that a vehicle has driven between two sparse fixes.

Trackers tell a place every half minute, and the mileage beside it.  That tells routes apart that
fixes and their times do not.  By the speed alone (`filter.speed_process`) a vehicle drives
d ~ N(m, V).  The odometer reads D ~ N(d, r²).  Knowing both,

    d ~ N(m + g (D − m), (1 − g) V),    g = V / (V + r²)

What an odometer reads may be wrong all the same: it is set back, or wheels spin.
"""

import math
from typing import NamedTuple

from ..._compile import Record, kernel
from ..speed_process import SpeedProcess

_FARTHEST = 1e6  # m, of one leg; beyond it the odometer was set anew
_LEAST_VARIANCE = 1.0  # m², of a distance
_CONTRADICTS = 16.0  # squared sigmas from the way to a fix, from which on that alone is believed
_MOSTLY = 0.5  # of the gain, from which on the odometer and not the speed tells the distance


class Driven(NamedTuple):
    """What is known of the distance to a sparse fix, before its place is seen."""

    metres: float  # D; 0 where no odometer tells it
    variance: float  # r², m²
    gain: float  # g; 0: no odometer tells it
    wrong: float  # P(what it reads says nothing)
    seconds: float  # at the usual speed, by the speed alone
    free: SpeedProcess  # of the speed alone


@kernel
def driven_by(
    free: SpeedProcess, dt: float, metres: float, variance: float, wrong: float
) -> Driven:  # fmt: skip
    """What an odometer adds to the speed; a variance of 0: there is none."""
    seconds = dt - free.distance_by_speed
    if variance <= 0.0:
        return Driven(0.0, 0.0, 0.0, wrong, seconds, free)
    prior = max(free.variance, _LEAST_VARIANCE)
    return Driven(metres, variance, prior / (prior + variance), wrong, seconds, free)


@kernel
def driven_to(driver: Record, reading: Record, free: SpeedProcess, dt: float) -> Driven:
    """What the odometer reads at an epoch and at the one before says.

    Args:
        driver: DRIVER; it has read the odometer at the epoch before.
        reading: EPOCH.
        free: Of the speed alone.
        dt: Since the epoch before, s.
    """
    metres = reading.odometer[0] - driver.odometer
    if reading.odometer[0] == 0.0 or driver.odometer == 0.0 or not 0.0 <= metres <= _FARTHEST:
        return driven_by(free, dt, 0.0, 0.0, 0.0)
    variance = reading.odometer[1] + driver.scale_variance * metres * metres
    variance = max(variance, _LEAST_VARIANCE)
    return driven_by(free, dt, driver.scale * metres, variance, driver.wrong)


@kernel
def conditioned(driven: Driven) -> SpeedProcess:
    """The process of the speed, the odometer being known."""
    free, left = driven.free, 1.0 - driven.gain
    return SpeedProcess(
        free.keep, left * free.distance_by_speed, left * free.variance, left * free.cross,
        free.sigma,
    )  # fmt: skip


@kernel
def by_speed(driven: Driven, usual: float, rate: float) -> float:
    """The distance by the speed alone, m."""
    return usual * driven.seconds + rate * driven.free.distance_by_speed


@kernel
def distance_of(driven: Driven, usual: float, rate: float) -> float:
    """The distance that is expected, m: at a speed, and a usual one that it tends to, m/s."""
    free = by_speed(driven, usual, rate)
    return free + driven.gain * (driven.metres - free)


@kernel
def faster_by(driven: Driven, usual: float, rate: float) -> float:
    """By how much the odometer shows that the vehicle is faster at the end, m/s."""
    prior = max(driven.free.variance, _LEAST_VARIANCE)
    off = driven.metres - by_speed(driven, usual, rate)
    return driven.gain * driven.free.cross * off / prior


@kernel
def stood_by_odometer(share: float, driven: Driven, usual: float, rate: float) -> float:
    """P(stood) of a vehicle, less where its odometer went on; `share` is that without it."""
    variance = driven.free.variance + driven.variance
    off = driven.metres - by_speed(driven, usual, rate)
    wide = max(variance, off * off)
    moved = math.exp(-0.5 * off * off / wide) / math.sqrt(wide)
    stood = math.exp(-0.5 * driven.metres**2 / driven.variance) / math.sqrt(driven.variance)
    stood = min(stood + driven.wrong * moved, moved)
    return share * stood / (share * stood + (1.0 - share) * moved)


@kernel
def straight_cost(driven: Driven, straight: float, sigma: float) -> float:
    """Cost of a straight line that is longer than what the odometer read, nats."""
    if driven.gain == 0.0:
        return 0.0
    beyond = max(straight - driven.metres - sigma, 0.0)
    wide = 2.0 * (driven.variance + sigma * sigma)
    return -math.log(driven.wrong + (1.0 - driven.wrong) * math.exp(-beyond * beyond / wide))


@kernel
def believed(read: float, alone: float, wrong: float) -> float:
    """Cost of a distance, nats: by what the odometer reads, or the speed alone if that is wrong."""
    more = read - alone
    if more > 0.0:
        return alone - math.log(wrong + (1.0 - wrong) * math.exp(-more))
    return read - math.log(1.0 - wrong + wrong * math.exp(more))


@kernel
def is_measured(driven: Driven) -> bool:
    """Whether the odometer tells the distance, and the speed hardly does."""
    return bool(driven.gain > _MOSTLY)


@kernel
def trusted(driven: Driven, went: float, variance: float) -> Driven:
    """The same, without the odometer where it contradicts a way of some metres (variance, m²)."""
    off = went - driven.metres
    if driven.gain == 0.0 or off * off <= _CONTRADICTS * (driven.variance + variance):
        return driven
    return Driven(0.0, 0.0, 0.0, driven.wrong, driven.seconds, driven.free)
