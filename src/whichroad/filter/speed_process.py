"""A speed that nobody measures, over some seconds: an Ornstein-Uhlenbeck process."""

import math
from typing import NamedTuple

from .._compile import kernel

_BETWEEN_FIXES = 22.0  # s, correlation time of the speed about what is usual on roads


class SpeedProcess(NamedTuple):
    """Moments of the speed and of the distance after some seconds, the old speed being known."""

    keep: float  # share of the old speed's deviation that is kept
    distance_by_speed: float  # derivative of the distance by the old speed, s
    variance: float  # of the distance, m²
    cross: float  # its covariance with the new speed, m²/s
    sigma: float  # of the speed, m/s


@kernel
def speed_process(dt: float, sigma: float, time: float = _BETWEEN_FIXES) -> SpeedProcess:
    """Moments after dt seconds.

        variance = σ² τ² (2 dt/τ − 3 + 4 exp(−dt/τ) − exp(−2 dt/τ))

    Args:
        dt: s.
        sigma: σ of the speed, m/s.
        time: τ, its correlation time, s.
    """
    keep = math.exp(-dt / time)
    v = sigma * sigma
    variance = v * time**2 * (2.0 * dt / time - 3.0 + 4.0 * keep - keep * keep)
    cross = v * time * (1.0 - keep) ** 2
    return SpeedProcess(keep, time * (1.0 - keep), max(variance, 0.0), cross, sigma)
