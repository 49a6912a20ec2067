"""Odometry that reads 0 below a speed: the vehicle stands, or creeps at up to that speed.

Sensors of wheels that need a changing field, as of many ABS, say nothing below 2 or 3 km/h.  Such a
0 is an epoch that is `BELOW`.  Where the receiver has measured a speed since it began, the vehicle
moves at that speed w, less what noise makes of standing:

    arc = min(√(max(w² − w₀², 0)), v) dt,    variance = _BY_RECEIVER dt

Else it is expected to stand.  A speed of σ that fades within τ, as most soon do stand, moves it by

    σ τ (1 − exp(−T/τ)),    σ = _SHARE v

after T seconds.  Its variance, and a little more for whoever creeps on later, is noise along the
heading.  A receiver's speed of exactly 0 is held by a filter of its own, and tells nothing.
"""

import math

from .._compile import Record, kernel
from .motion import Noise
from .state import CLOCK
from .vetting.motion_sources import BELOW, SPEED
from .vetting.windows import BY_WHEELS

_SHARE, _LASTS = 0.6, 60.0  # of the least speed, σ; τ, s
_LATER = 0.1  # m²/s, of whoever creeps on later
_BY_RECEIVER = 0.1  # m²/s, of a way by the receiver's speed
_DOPPLER, _NOISE = 0.5, 0.15  # m/s: most sigma of such a speed; w₀, which it makes of standing
_SMOOTHING, _RECENT = 3.0, 2.0  # s, over which it is averaged; for which it holds
_TURNS = 0.02  # rad²/m, of a turn that nothing measures


@kernel
def creep(vetting: Record, reading: Record, dt: float) -> None:
    """Say how far a vehicle has crept whose odometry reads 0, and how unsure that is.

    Args:
        vetting: In place.
        reading: What the sensors measured, in place.
        dt: Since the epoch before, s.
    """
    slow = vetting.slow
    slow.turn = slow.way = 0.0
    slow.variance = reading.unsure
    if reading.odometry_valid != BELOW:
        slow.unreckoned += slow.variance
        slow.seconds = slow.known_at = 0.0
        if reading.unsure > 0.0:
            slow.coarse = 1
        elif reading.odometry_valid == 1 and reading.arc != 0.0:
            slow.coarse = 0
        return
    begun = slow.seconds
    slow.seconds += dt
    if slow.known_at > 0.0 and reading.time - slow.known_at < _RECENT:
        speed = math.sqrt(max(slow.speed * slow.speed - _NOISE * _NOISE, 0.0))
        reading.arc = min(speed, slow.least) * dt
        c, s = math.cos(0.5 * reading.turn), math.sin(0.5 * reading.turn)
        reading.forward, reading.left = reading.arc * c, reading.arc * s
        slow.variance = _BY_RECEIVER * dt
        slow.way = reading.arc
    else:
        sigma = _SHARE * slow.least
        slow.variance = _faded(sigma, slow.seconds) - _faded(sigma, begun) + _LATER * dt
        slow.way = sigma * math.exp(-begun / _LASTS) * dt
    slow.unreckoned += slow.variance
    if reading.gyro == BY_WHEELS:
        slow.turn = _TURNS * slow.way
    if reading.has_fix:
        _hear(vetting, reading)


@kernel
def _faded(sigma: float, seconds: float) -> float:
    """Variance of the way of a speed that fades, m²."""
    way = sigma * _LASTS * (1.0 - math.exp(-seconds / _LASTS))
    return way * way


@kernel
def _hear(vetting: Record, reading: Record) -> None:
    """Take the receiver's speed, where it is believed."""
    slow = vetting.slow
    believed = vetting.refused[SPEED] == 0 and vetting.odd == 0
    if not believed or reading.speed_sigma > _DOPPLER or reading.speed <= 0.0:
        return
    keep = 0.0
    if slow.known_at > 0.0:
        keep = math.exp(-(reading.time - slow.known_at) / _SMOOTHING)
    slow.speed = keep * slow.speed + (1.0 - keep) * reading.speed
    slow.known_at = reading.time


@kernel
def unsure_of(state: Record, noise: Noise, metres: float, arc: float) -> Noise:
    """Process noise with that of a vehicle that may creep, slips, or is counted in coarse steps.

    Args:
        state: Of the filter.
        noise: Of its motion over so many metres.
        metres: m.
        arc: Of the epoch, of which they are a part, m.
    """
    slow = state.vetting.slow
    slip = state.vetting.slip
    more_drift = state.vetting.walk.more
    if slow.variance + slip.variance + more_drift == 0.0 or state.mode == CLOCK:
        return noise
    part = metres / abs(arc) if abs(arc) > metres else 1.0
    more = part * slow.variance + slip.variance
    slip.variance = 0.0  # of an epoch, whose pieces are several
    return Noise(
        noise.along + more, noise.across, noise.heading + slow.turn, noise.rate,
        noise.drift + more_drift * metres, noise.cross,
    )  # fmt: skip


@kernel
def crept(slow: Record, noise: Noise) -> Noise:
    """Process noise with that of all ways since this was asked last."""
    along = noise.along + slow.unreckoned
    slow.unreckoned = 0.0
    return Noise(along, noise.across, noise.heading, noise.rate, noise.drift, noise.cross)


@kernel
def count_motion(state: Record, metres: float, dt: float) -> None:
    """Distances and times that slow states and the map's spacing are measured by.

    For fixes a vehicle that may creep always moves, for roads as far as is likely.

    Args:
        state: In place.
        metres: Driven.
        dt: s.
    """
    slow = state.vetting.slow
    creeps = slow.seconds > 0.0 and state.mode != CLOCK
    state.since_fix += max(metres, slow.least * dt) if creeps else metres
    likely = max(metres, slow.way) if creeps else metres
    state.since_map += likely
    state.since_exit += likely
    if metres > 0.05 * dt:
        state.moving += dt
        state.standing = 0.0
    else:
        state.moving += dt if creeps else 0.0
        state.standing += dt
