"""Units of speed in m/s, and the size of the Earth where metres suffice."""

from typing import TypeVar

from .angles import DEGREE, Array

Speed = TypeVar("Speed", float, Array)

KNOT = 1852.0 / 3600.0  # m/s
KMH = 1.0 / 3.6  # m/s
MPH = 0.44704  # m/s
EARTH_RADIUS = 6_371_008.8  # m, mean
METRES_PER_DEGREE = EARTH_RADIUS * DEGREE  # of latitude, on the sphere


def mps_of_kmh(speed_kmh: Speed) -> Speed:
    """A speed in m/s of one in km/h."""
    return speed_kmh / 3.6


def kmh_of_mps(speed: Speed) -> Speed:
    """A speed in km/h of one in m/s."""
    return speed * 3.6
