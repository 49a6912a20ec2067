"""Kernels of the map's plane: WGS84 ellipsoid, Gauss conformal sphere, stereographic plane.

The "double stereographic" projection (EPSG guidance note 7-2, method 9809, with scale 1
at the origin).  Angles are radians here; degrees stay in `angles`.
"""

import math
from typing import NamedTuple

from .._compile import Vector, entry, kernel

SEMI_MAJOR = 6378137.0  # m, WGS84
FLATTENING = 1.0 / 298.257223563
E2 = FLATTENING * (2.0 - FLATTENING)
E = math.sqrt(E2)


class Sphere(NamedTuple):
    """The Gauss conformal sphere that touches the ellipsoid at the origin."""

    power: float  # n: spherical over ellipsoidal longitude
    shift: float  # isometric latitude on the sphere less n times that on the ellipsoid
    radius: float  # m, geometric mean of the radii of curvature
    sin0: float  # of the origin's latitude on the sphere
    cos0: float
    lon0: float  # rad


@kernel
def isometric(lat: float) -> float:
    """Isometric latitude of the ellipsoid: asinh(tan φ) - e atanh(e sin φ)."""
    return math.asinh(math.tan(lat)) - E * math.atanh(E * math.sin(lat))


@kernel
def wrap_longitude(angle: float) -> float:
    """The angle in [-π, π)."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@entry
def to_plane(sphere: Sphere, lat: float, lon: float) -> tuple[float, float]:
    """Plane coordinates of a geodetic position.

    Args:
        sphere: The plane's sphere.
        lat: Geodetic latitude, rad.
        lon: Longitude, rad.

    Returns:
        x, y: m, x to the east and y to the north at the origin.
    """
    q = sphere.power * isometric(lat) + sphere.shift
    sine = math.tanh(q)
    cosine = 1.0 / math.cosh(q)
    angle = sphere.power * wrap_longitude(lon - sphere.lon0)
    ahead = cosine * math.cos(angle)
    factor = 2.0 * sphere.radius / (1.0 + sine * sphere.sin0 + ahead * sphere.cos0)
    return (
        factor * cosine * math.sin(angle),
        factor * (sine * sphere.cos0 - ahead * sphere.sin0),
    )


@kernel
def _on_sphere(sphere: Sphere, x: float, y: float) -> tuple[float, float, float]:
    """The point of the sphere: along the Earth's axis, east and ahead of it.

    Ahead is where the origin's meridian lies: sin χ, sin Λ cos χ, cos Λ cos χ.
    """
    u = x / (2.0 * sphere.radius)
    v = y / (2.0 * sphere.radius)
    t = u * u + v * v
    east = 2.0 * u / (1.0 + t)
    north = 2.0 * v / (1.0 + t)
    up = (1.0 - t) / (1.0 + t)
    sine = up * sphere.sin0 + north * sphere.cos0
    return sine, east, up * sphere.cos0 - north * sphere.sin0


@entry
def to_geodetic(sphere: Sphere, x: float, y: float) -> tuple[float, float]:
    """Geodetic position of a point of the plane: the inverse of `to_plane`.

    Args:
        sphere: The plane's sphere.
        x: m.
        y: m.

    Returns:
        Latitude in [-π/2, π/2] and longitude in [-π, π), rad.
    """
    sine, east, ahead = _on_sphere(sphere, x, y)
    q = (math.asinh(sine / math.hypot(east, ahead)) - sphere.shift) / sphere.power
    s = math.tanh(q)
    for _ in range(7):  # each round gains a factor of e² cos²φ
        s = math.tanh(q + E * math.atanh(E * s))
    lat = math.atan(math.sinh(q + E * math.atanh(E * s)))
    return lat, wrap_longitude(sphere.lon0 + math.atan2(east, ahead) / sphere.power)


@entry
def convergence(sphere: Sphere, x: float, y: float) -> float:
    """Heading of true north less that of the plane's y axis, counter-clockwise.

    tan γ = sin Λ (sin χ + sin χ₀) / (cos χ cos χ₀ + (1 + sin χ sin χ₀) cos Λ)

    Args:
        sphere: The plane's sphere.
        x: m.
        y: m.

    Returns:
        Grid convergence, rad.
    """
    sine, east, ahead = _on_sphere(sphere, x, y)
    return math.atan2(
        east * (sine + sphere.sin0),
        (east * east + ahead * ahead) * sphere.cos0 + (1.0 + sine * sphere.sin0) * ahead,
    )


@entry
def place_on_earth(sphere: Sphere, x: float, y: float) -> tuple[float, float, float]:
    """`to_geodetic` and `convergence` of a point, in one call."""
    lat, lon = to_geodetic(sphere, x, y)
    return lat, lon, convergence(sphere, x, y)


@entry
def to_plane_all(sphere: Sphere, lat: Vector, lon: Vector, x: Vector, y: Vector) -> None:
    """`to_plane` of (n,) positions in radians into x and y."""
    for i in range(len(lat)):
        x[i], y[i] = to_plane(sphere, lat[i], lon[i])


@entry
def convergence_all(sphere: Sphere, x: Vector, y: Vector, out: Vector) -> None:
    """`convergence` of (n,) points into out, radians."""
    for i in range(len(x)):
        out[i] = convergence(sphere, x[i], y[i])
