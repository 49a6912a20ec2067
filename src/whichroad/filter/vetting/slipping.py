"""Wheels that slide or spin for some seconds: the receiver's speed is another one.

Where brakes lock wheels smoothly, no reading is what no car can do.  Beside a receiver that
measures its speed by Doppler, the way is not known then until the two agree again.  The variance
along the heading grows by the square of what they differ by.

A receiver's speed that lags differs in every braking, by the acceleration times the lag, which is
learnt.  One that has never agreed, or does not for long, is in another unit: that is none of this.
"""

import math

import numpy as np

from ..._compile import Record, kernel
from .delay_filter import DELAY
from .latency import PUNCTUAL

SLIP = np.dtype(
    [
        ("agreed", "f8"),  # s of driving for which the two have agreed
        ("by", "f8"),  # m/s by which they differ; 0: they agree
        ("time", "f8"),  # s, of the last comparison,
        ("since", "f8"),  # and of the last one in which they agreed
        ("until", "f8"),  # s, until which the way is counted,
        ("way", "f8"),  # m by which it may be wrong,
        ("variance", "f8"),  # and what this epoch adds to the square of that, m²
        ("then", "f8", (2,)),  # s, and m/s by the odometer, a second ago
        ("pull", "f8"),  # m/s², of late
        ("lag", "f8", (2,)),  # moments: differences times m/s², and squares of these
        ("seconds", "f8"),  # for which the way was not believed
    ],
    align=True,
)

_DOPPLER = 0.3  # m/s, sigma of a speed from which on it may come out of a filter
_SLACK, _SIGMAS = 1.0, 3.0  # m/s, and sigmas, by which the two may differ
_LAG, _WEIGHT = 0.5, 2.0  # s by which it lags as far as is known; m²/s⁴, weight of that
_MOST_LAG, _SAFETY = 5.0, 1.5  # s; times the lag that is learnt
_SECOND, _RECENT, _PULL_LASTS = 0.95, 2.5, 3.0  # s
_MOST_PULL = 3.0  # m/s², more than most drives have
_DRIVES = 2.0  # m/s
_TRIED, _MOST_TRIED, _LONGEST = 3.0, 10.0, 10.0  # s that must have agreed; and of a slip
_JUMP = 6.0  # m/s², of a receiver's speed that is wrong itself


@kernel
def weigh_slip(vetting: Record, epoch: Record, believed: bool) -> None:
    """Hold the odometer's speed against the receiver's, at a fix.

    Args:
        vetting: In place.
        epoch: With a fix.
        believed: Whether odometer and receiver's speed are, but for this.
    """
    slip = vetting.slip
    windows = vetting.windows
    if vetting.slow.coarse == 1:
        slip.by = slip.way = slip.seconds = 0.0
        return
    since = epoch.time - slip.time
    slack = _SIGMAS * epoch.speed_sigma + _SLACK
    change = abs(epoch.speed - windows.speed)
    known = epoch.speed_sigma < _DOPPLER and vetting.silent <= 0.0 and believed
    if not known or change > _JUMP * (epoch.time - windows.speed_time) + slack:
        if since > _RECENT:
            slip.by = slip.way = 0.0
        return
    slip.time = epoch.time
    speed = abs(vetting.speed_sample.rate)
    off = speed - epoch.speed
    learnt = speed * vetting.wheel_size.scale.rate - epoch.speed  # by a scale that may be wrong
    if abs(learnt) < abs(off):
        off = learnt
    _learn_lag(slip, epoch.time, speed, off)
    lag = abs(_WEIGHT * _LAG + slip.lag[0]) / (_WEIGHT + slip.lag[1])
    if vetting.latency.late != PUNCTUAL:
        lag = max(lag, abs(vetting.latency.estimate.state[DELAY]))
    if abs(off) <= slack + _SAFETY * lag * slip.pull:
        slip.by = slip.way = 0.0
        slip.since = slip.until = epoch.time
        if speed > _DRIVES:
            slip.agreed = min(slip.agreed + min(since, _RECENT), _MOST_TRIED)
    elif slip.agreed >= _TRIED and epoch.time - slip.since <= _LONGEST:
        slip.by = abs(off)
    else:
        slip.agreed = slip.by = slip.way = 0.0


@kernel
def _learn_lag(slip: Record, time: float, speed: float, off: float) -> None:
    """Moments of the lag L, from the odometer's acceleration a: the two differ by L a."""
    since = time - slip.then[0]
    if since < _SECOND:
        return
    if since < _RECENT:
        pull = (speed - slip.then[1]) / since
        slip.pull = max(slip.pull * math.exp(-since / _PULL_LASTS), min(abs(pull), _MOST_PULL))
        if abs(pull) < _MOST_PULL:
            most = _MOST_LAG * abs(pull)
            slip.lag[0] += pull * min(max(off, -most), most)
            slip.lag[1] += pull * pull
    slip.then[0], slip.then[1] = time, speed


@kernel
def count_slip(vetting: Record, time: float) -> None:
    """What the way until an epoch may be wrong by: as much as the speed, since they agreed last."""
    slip = vetting.slip
    slip.variance = 0.0
    if slip.by <= 0.0 or time <= slip.until:
        return
    before = slip.way * slip.way
    slip.way += slip.by * (time - slip.until)
    slip.seconds += time - slip.until
    slip.until = time
    slip.variance = slip.way * slip.way - before
    vetting.slow.unreckoned += slip.variance
