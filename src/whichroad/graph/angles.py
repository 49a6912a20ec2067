"""Angles."""

import math

from .._compile import kernel


@kernel
def wrap(angle: float) -> float:
    """Bring an angle into (-π, π]."""
    if -math.pi < angle <= math.pi:
        return angle
    wrapped = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    if wrapped <= -math.pi:  # the quotient was rounded up, or the angle is -π itself
        return min(wrapped + 2.0 * math.pi, math.pi)
    return min(wrapped, math.pi)


@kernel
def angle_of(x: float, y: float) -> float:
    """Angle of a vector, atan2(y, x); of one nearly along x without atan2, as exactly."""
    if x <= 0.0 or abs(y) > 0.1 * x:
        return math.atan2(y, x)
    t = y / x
    q = t * t
    rest = 1.0 / 7.0 - q * (1.0 / 9.0 - q * (1.0 / 11.0 - q / 13.0))
    return t * (1.0 - q * (1.0 / 3.0 - q * (0.2 - q * rest)))
