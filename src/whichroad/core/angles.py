"""Angles."""

import math

from ._jit import kernel


@kernel
def wrap(angle: float) -> float:
    """Bring an angle into (-π, π]."""
    wrapped = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return wrapped if wrapped != -math.pi else math.pi
