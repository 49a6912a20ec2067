"""Which way the vehicle faces, where odometry counts backwards.

A sign that is wrong (of a counter, of a speed, or of the gear by which one is signed) looks like a
vehicle that drives backwards on the opposite edges, and every fix agrees with that.  But nobody
drives so for long, or fast, before having driven forwards.  So metres that count backwards speak
for a wrong sign, and those forwards against it, five times as much at 4 m/s or more:

    P(it faces the other way) = 1 / (1 + exp((150 - backwards) / 15))

At 1/2 the odometry is turned about, and 150 m forwards settle it.  A sign by which the vehicle has
driven 150 m forwards is right: what counts backwards from then on is driven backwards, however
long, as shuttles and forklifts do.  It is in doubt again where it changes and the fixes drive on as
before.  A sign that a gear tells is never turned about.
"""

import math

from ..._compile import Record, kernel
from .motion_sources import TURN

_FAST, _MOST = 4.0, 20.0  # m/s, beyond which, and up to which
_COUNTS = 5.0  # a metre counts as so many
_FAR = 150.0  # m backwards: it faces the other way; m forwards: its sign is right
_NAT, _TURNED = 15.0, 30.0  # m that are a nat; m fewer than that once it was turned about
_LEG, _SIGMAS = 10.0, 4.0  # m, and sigmas of a fix, of a way by fixes
_FASTEST = 90.0  # m/s
_ONE_WAY = 0.8  # share of the odometry that goes one way
_ABOUT = 0.2  # cosine, below which a vehicle faces another way than before its sign changed


@kernel
def p_other_way(vetting: Record) -> float:
    """P(the vehicle faces the other way than it is taken to)."""
    if vetting.forth >= _FAR or vetting.backed <= 0.0:
        return 0.0
    return 1.0 / (1.0 + math.exp((_FAR - vetting.backed) / _NAT))


@kernel
def face_forward(vetting: Record, reading: Record, dt: float, turns: bool) -> bool:
    """Turn odometry about that counts backwards.

    Args:
        vetting: In place.
        reading: What the sensors measured, in place.
        dt: Since the epoch before, s.
        turns: Whether there is a sensor of turns.

    Returns:
        Whether the vehicle is found to face the other way with this epoch, which has a fix.
    """
    if vetting.reversed == 1:
        _turn_about(reading)
    turn = reading.turn if turns and vetting.refused[TURN] == 0 else 0.0
    if _track(vetting.facing, reading, dt, turn) and reading.geared == 0:
        vetting.forth = 0.0
    if reading.odometry_valid == 1 and dt > 0.0:  # a fix may be an epoch of its own
        _count(vetting, float(reading.arc), dt)
    if vetting.backed < _FAR or reading.has_fix == 0 or reading.geared == 1:
        return False
    _turn_about(reading)
    vetting.reversed = 1 - vetting.reversed
    vetting.backed, vetting.forth = _FAR - _TURNED, 0.0
    vetting.facing.sign = 0.0
    vetting.windows.count = 0  # what it has driven until now was the other way
    vetting.score[TURN] = vetting.drift = 0.0
    vetting.refused[TURN] = vetting.turned = vetting.tried = 0
    vetting.reported[TURN] = vetting.seen[TURN] = 0.0
    return True


@kernel
def _track(track: Record, reading: Record, dt: float, turn: float) -> bool:
    """Hold the way of the fixes against the sign of the odometry; whether it has gone about.

    A way by fixes, the other way where odometry counts backwards, is where the vehicle faces.  Over
    a change of the sign that is the same, turned by what was measured.

    Args:
        track: In place.
        reading: What the sensors measured.
        dt: Since the epoch before, s.
        turn: Of it, rad, as far as it is believed.
    """
    if abs(reading.arc) > _FASTEST * dt and dt > 0.0:  # nothing is known of the motion
        track.sign, track.metres = 0.0, math.inf
    track.arc += reading.arc
    track.metres += abs(reading.arc)
    track.turn += turn
    track.last += turn
    if reading.has_fix == 0:
        return False
    dx, dy = reading.fix[0] - track.x, reading.fix[1] - track.y
    far = math.hypot(dx, dy)
    mixed = abs(track.arc) < _ONE_WAY * track.metres
    if not mixed and max(far, track.metres) < max(_LEG, _SIGMAS * reading.fix[2]):
        return False
    about = False
    if not mixed and _ONE_WAY * track.metres < far < track.metres / _ONE_WAY:
        sign = math.copysign(1.0, track.arc)
        faces = math.atan2(sign * dy, sign * dx)
        turned = math.cos(faces - track.faces - track.turn + 0.5 * track.last)
        about = sign * track.sign < 0.0 and turned < _ABOUT
        track.sign, track.faces = sign, faces + 0.5 * track.last
        track.turn = 0.0
    track.x, track.y = reading.fix[0], reading.fix[1]
    track.arc = track.metres = track.last = 0.0
    return about


@kernel
def _count(vetting: Record, arc: float, dt: float) -> None:
    """Sum up what is driven forwards and backwards; a counter that jumps back counts little."""
    speed = arc / dt
    way = min(abs(arc), _MOST * dt) * (_COUNTS if abs(speed) > _FAST else 1.0)
    if arc > 0.0:
        vetting.forth = min(vetting.forth + way, _FAR)
        vetting.backed = max(vetting.backed - way, 0.0)
        if vetting.forth == _FAR and vetting.reversed == 1:
            vetting.turnabouts = 1
    elif vetting.forth < _FAR:
        vetting.backed = min(vetting.backed + way, _FAR)


@kernel
def _turn_about(reading: Record) -> None:
    """The same motion of a vehicle that faces the other way; its turn is the same."""
    reading.arc = -reading.arc
    reading.forward = -reading.forward
    reading.left = -reading.left
