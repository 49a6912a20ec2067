"""Odometry that counts backwards for long: a vehicle faces where it drives.

A sign that is wrong (of a counter, of a speed, or of the gear by which one is signed) looks like a
vehicle that drives backwards on the opposite edges, and every fix agrees with that.  But nobody
drives so for long, or fast, and farther than forwards.  A vehicle that can, as some shuttles do,
is taken to face the other way from then on.
"""

from ..._compile import Record, kernel
from .motion_sources import TURN

_FAST, _MOST = 4.0, 20.0  # m/s backwards, beyond which, and up to which
_COUNTS = 5.0  # a metre counts as so many
_FAR = 150.0  # m backwards, less those forwards since, from which on it faces the other way,
_SIGNED = 1000.0  # and as many as it drove forwards, up to this, before


@kernel
def face_forward(vetting: Record, reading: Record, dt: float) -> bool:
    """Turn odometry about that counts backwards.

    Args:
        vetting: In place.
        reading: What the sensors measured, in place.
        dt: Since the epoch before, s.

    Returns:
        Whether the vehicle is found to face the other way with this epoch, which has a fix.
    """
    if vetting.reversed == 1:
        _turn_about(reading)
    if reading.odometry_valid == 1 and dt > 0.0:  # a fix may be an epoch of its own
        back = min(-reading.arc, _MOST * dt)  # a counter that jumps back counts little
        vetting.backed = max(vetting.backed + back * (_COUNTS if back > _FAST * dt else 1.0), 0.0)
        vetting.forth = min(vetting.forth + max(-back, 0.0), _SIGNED)
    if vetting.backed < max(_FAR, vetting.forth) or reading.has_fix == 0:
        return False
    _turn_about(reading)
    vetting.reversed = 1 - vetting.reversed
    vetting.turnabouts += 1
    vetting.backed = vetting.forth = 0.0
    vetting.windows.count = 0  # what it has driven until now was the other way
    vetting.score[TURN] = vetting.drift = 0.0
    vetting.refused[TURN] = vetting.turned = vetting.tried = 0
    vetting.reported[TURN] = vetting.seen[TURN] = 0.0
    return True


@kernel
def _turn_about(reading: Record) -> None:
    """The same motion of a vehicle that faces the other way; its turn is the same."""
    reading.arc = -reading.arc
    reading.forward = -reading.forward
    reading.left = -reading.left
