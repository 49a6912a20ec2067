"""Web Mercator, the projection of map tiles: the world as a square of side 1."""

import math

import numpy as np

from .angles import Array, degrees, radians


def to_square(lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
    """Positions (degrees) as fractions of the world, x right and y down."""
    phi = radians(lat_deg)
    y = 0.5 - np.log(np.tan(0.25 * math.pi + 0.5 * phi)) / (2.0 * math.pi)
    return lon_deg / 360.0 + 0.5, y


def latitude_of(y: Array) -> Array:
    """Latitudes, degrees, of fractions from the top."""
    return degrees(2.0 * np.arctan(np.exp((0.5 - y) * 2.0 * math.pi)) - 0.5 * math.pi)


def longitude_of(x: Array) -> Array:
    """Longitudes, degrees, of fractions from the left."""
    return x * 360.0 - 180.0
