"""Whether a vehicle stands, by fixes alone: they keep their place.

Without odometry and without a reported speed a standing vehicle looks as one that is very slow.
It would creep on along the road, and turn round.  The fixes tell its speed by two low-pass
filters in a row, of which the second lags more:

    v = |near − far| / T          of a vehicle at constant speed

Their white noise leaves an error of σ √Δt / (2 T^1.5) in it.  Errors that drift look like motion.
Then the vehicle is not said to stand, and all is as it was.

One fix shows that it has left, unless no car drives so far since the one before: such a fix is
wrong, or the vehicle was carried.  The vehicle is taken to stand on, and the fix is counted as one
that fits nothing (`gnss.update`), of which enough in a row are a new start.
"""

import math

from ..._compile import Record, Vector, kernel
from ..motion import Noise

_TIME = 4.0  # s, T
_AGE = 12.0  # s of fixes, before which nothing is said
_SLOW = 0.5  # m/s; what may be faster by two sigmas does not stand
_LEAVES = 3.5  # sigmas of white noise, and m, from which on one fix shows that it has left
_ASIDE = 1.0
_SETS_OUT = 1.5  # m/s², a
_HARDEST = 4.0  # m/s², a at most
_FASTEST = 60.0  # m/s, of far fixes that move on
_SOONEST = 1e-3  # s, that a fix counts at least
_WANDERED = 2.0  # reported sigmas from where it came to stand, beyond which it has crept on
_WHITE = 0.25  # white variance over the reported one, at least


@kernel
def is_still(state: Record, epoch: Record, dt: float, longest: float) -> bool:
    """Whether the fixes say that the vehicle stands.

    Args:
        state: In place; called once for each epoch without odometry.
        epoch: With a fix, or without.
        dt: Its duration, s.
        longest: Longest interval of fixes that say something, s.
    """
    still = state.still
    if not epoch.has_fix:
        return bool(still.stands == 1 and epoch.time - still.time <= longest)
    fix = epoch.fix
    since = epoch.time - still.time
    still.time = epoch.time
    if still.age < 0.0 or since > longest:
        _begin(still, fix[0], fix[1])
        return False
    white = math.sqrt(max(state.white_factor, _WHITE) * fix[2] * fix[3])
    left = math.hypot(fix[0] - still.near[0], fix[1] - still.near[1]) / state.scale
    gain = 1.0 - math.exp(-since / _TIME)
    if _is_beyond(state, fix, left > _reach(white, since), since, _LEAVES * white + _ASIDE):
        return bool(still.stands == 1)
    lag = math.hypot(still.near[0] - still.far[0], still.near[1] - still.far[1]) / state.scale
    for a in range(2):
        still.near[a] += gain * (fix[a] - still.near[a])
        still.far[a] += gain * (still.near[a] - still.far[a])
    still.age += since
    speed = lag / _TIME
    error = white * math.sqrt(max(since, 0.0)) / (2.0 * _TIME**1.5)
    if still.stands == 0:
        if still.age > _AGE and speed + 2.0 * error < _SLOW and left < _LEAVES * white + _ASIDE:
            still.stands = 1
            still.at[0] = still.near[0]
            still.at[1] = still.near[1]
        else:
            return False
    crept = math.hypot(still.near[0] - still.at[0], still.near[1] - still.at[1]) / state.scale
    if left > _LEAVES * white + _ASIDE or crept > _WANDERED * fix[2]:
        still.stands = 0
        still.left = max(left, crept)
        state.standing = 0.0
        if crept > _WANDERED * fix[2]:
            _begin(still, fix[0], fix[1])
        return False
    state.moving += dt  # the receiver's error goes on
    return True


@kernel
def _reach(white: float, since: float) -> float:
    """How far off a fix may be of a vehicle that has left, m.

    Args:
        white: Sigma of its white noise, m.
        since: The fix before, s; until then it has left by less than a fix shows.
    """
    unseen = math.sqrt(2.0 * (_LEAVES * white + _ASIDE) / _HARDEST)
    return 0.5 * _HARDEST * (since + unseen) ** 2 + _LEAVES * white


@kernel
def _is_beyond(state: Record, fix: Vector, far: bool, since: float, shows: float) -> bool:
    """Count fixes in a row of a vehicle that stands, where it cannot have driven to.

    Args:
        state: In place.
        fix: Of this epoch.
        far: Whether it is beyond reach.
        since: The fix before, s.
        shows: m from which on a fix shows that the vehicle has left.

    Returns:
        Whether it is such a fix.  Where they move on as a car does, the receiver held its place
        while the vehicle left.  After too many in a row all begins anew.
    """
    still = state.still
    if far and still.stands == 1 and not _moves_on(state, fix, since, shows):
        if still.apart <= 0.0:
            still.beyond[0] = fix[0]
            still.beyond[1] = fix[1]
        still.apart += max(since, _SOONEST)
        if still.apart > _AGE:
            _begin(still, fix[0], fix[1])
        return True
    if still.apart > 0.0:
        still.apart = state.misfits = 0.0
    return False


@kernel
def _moves_on(state: Record, fix: Vector, since: float, shows: float) -> bool:
    """Whether a far fix is farther on than the first one, by no more than a car drives."""
    still = state.still
    if still.apart <= 0.0:
        return False
    first = still.beyond
    way = math.hypot(fix[0] - first[0], fix[1] - first[1])
    farther = math.hypot(fix[0] - still.near[0], fix[1] - still.near[1]) - math.hypot(
        first[0] - still.near[0], first[1] - still.near[1]
    )
    fastest = _FASTEST * (still.apart + since)
    return bool(farther > shows * state.scale and way < fastest * state.scale)


@kernel
def driven_off(still: Record, since: Record, noise: Noise) -> Noise:
    """Process noise with that of an epoch in which it is found out that the vehicle has left.

    It left some seconds ago, and drives by now: metres d after it set out its speed is √(2 a d).
    Smoothed, it is not moved on before.

    Args:
        still: In place.
        since: `filter.lookback.history.MOTION` since the last step, in place.
        noise: Without it.
    """
    left = float(still.left)
    if left <= 0.0:
        return noise
    still.left = 0.0
    since.switched = 1
    speed = math.sqrt(2.0 * _SETS_OUT * left)
    return Noise(
        noise.along + left * left, noise.across, noise.heading, noise.rate + speed * speed,
        noise.drift, noise.cross + left * speed,
    )  # fmt: skip


@kernel
def _begin(still: Record, x: float, y: float) -> None:
    """Begin anew at a fix."""
    still.near[0] = still.far[0] = x
    still.near[1] = still.far[1] = y
    still.age = still.apart = 0.0
    still.stands = 0
