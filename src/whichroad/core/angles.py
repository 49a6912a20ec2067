"""Angles."""

import math

from ._jit import kernel


@kernel
def wrap(angle: float) -> float:
    """Bring an angle into (-π, π]."""
    if -math.pi < angle <= math.pi:
        return angle
    wrapped = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    if wrapped <= -math.pi:  # the quotient was rounded up, or the angle is -π itself
        return min(wrapped + 2.0 * math.pi, math.pi)
    return min(wrapped, math.pi)
