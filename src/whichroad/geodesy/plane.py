"""Geodetic positions and the map's plane, bearings and headings there.

The plane is conformal, so an angle on the ground is the same angle in the plane, and a
covariance is turned by the convergence alone.  Its scale is that of `Plane.scale`:
plane metres per true metre.
"""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from ..errors import MapError
from . import kernels
from .angles import Array, bearing_of, degrees, heading_of, radians, wrap

_POLE_DEG = 89.999  # largest latitude of an origin; nearer to a pole north is undefined


@dataclass(frozen=True, slots=True)
class Plane:
    """A stereographic plane about an origin; x is east and y is north there.

    Every method takes scalars or arrays (n,) and gives the same.

    Args:
        lat0_deg: Geodetic latitude of the origin (WGS84), degrees.
        lon0_deg: Longitude of the origin, degrees.

    Raises:
        MapError: The origin is not on Earth, or at a pole.
    """

    lat0_deg: float
    lon0_deg: float
    sphere: kernels.Sphere = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not (abs(self.lat0_deg) <= _POLE_DEG and abs(self.lon0_deg) <= 360.0):
            raise MapError(
                f"plane's origin: lat {self.lat0_deg}, lon {self.lon0_deg}; a latitude within "
                f"±{_POLE_DEG}° and a longitude within ±360° were expected; give degrees"
            )
        sphere = _sphere_at(radians(self.lat0_deg), radians(self.lon0_deg))
        object.__setattr__(self, "sphere", sphere)

    @property
    def curvature(self) -> float:
        """1 / (4 R²), 1/m²: the scale is 1 + curvature (x² + y²)."""
        return 0.25 / self.sphere.radius**2

    @overload
    def from_geodetic(self, lat_deg: float, lon_deg: float) -> tuple[float, float]: ...
    @overload
    def from_geodetic(self, lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]: ...
    def from_geodetic(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> tuple[object, object]:
        """Plane coordinates x, y (m) of WGS84 positions in degrees."""
        if isinstance(lat_deg, float) and isinstance(lon_deg, float):
            return _calls(self.sphere).to_plane(radians(lat_deg), radians(lon_deg))
        lat = radians(np.asarray(lat_deg, dtype=np.float64))
        lon = radians(np.asarray(lon_deg, dtype=np.float64))
        x, y = np.empty_like(lat), np.empty_like(lat)
        kernels.to_plane_all(self.sphere, lat.ravel(), lon.ravel(), x.ravel(), y.ravel())
        return _as_given(x), _as_given(y)

    def lay(self, lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
        """`from_geodetic` of a map's nodes, to within some nanometres, in NumPy alone.

        A map so is built without loading a single compiled kernel.
        """
        return _plane(self.sphere, radians(lat_deg), radians(lon_deg))

    @overload
    def to_geodetic(self, x: float, y: float) -> tuple[float, float]: ...
    @overload
    def to_geodetic(self, x: Array, y: Array) -> tuple[Array, Array]: ...
    def to_geodetic(self, x: ArrayLike, y: ArrayLike) -> tuple[object, object]:
        """Latitude and longitude (degrees, WGS84, longitude in [-180, 180)) of plane points."""
        if isinstance(x, float) and isinstance(y, float):
            lat, lon = _calls(self.sphere).to_geodetic(x, y)
            return degrees(lat), degrees(lon)
        lats, lons = _geodetic(
            self.sphere, np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        )
        return _as_given(degrees(lats)), _as_given(degrees(lons))

    @overload
    def convergence(self, x: float, y: float) -> float: ...
    @overload
    def convergence(self, x: Array, y: Array) -> Array: ...
    def convergence(self, x: ArrayLike, y: ArrayLike) -> object:
        """Heading of true north less that of the plane's y axis, rad, counter-clockwise."""
        if isinstance(x, float) and isinstance(y, float):
            return _calls(self.sphere).convergence(x, y)
        east, north = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        out = np.empty(east.shape)
        kernels.convergence_all(self.sphere, east.ravel(), north.ravel(), out.ravel())
        return _as_given(out)

    @overload
    def scale(self, x: float, y: float) -> float: ...
    @overload
    def scale(self, x: Array, y: Array) -> Array: ...
    def scale(self, x: ArrayLike, y: ArrayLike) -> object:
        """Plane metres per true metre at plane points."""
        east, north = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        return _as_given(1.0 + self.curvature * (east * east + north * north))

    @overload
    def heading(self, bearing_deg: float, x: float, y: float) -> float: ...
    @overload
    def heading(self, bearing_deg: Array, x: Array, y: Array) -> Array: ...
    def heading(self, bearing_deg: ArrayLike, x: ArrayLike, y: ArrayLike) -> object:
        """Heading (rad, counter-clockwise from the plane's x axis, (-π, π]) of a bearing.

        Args:
            bearing_deg: Degrees clockwise from true north.
            x: m, where.
            y: m.
        """
        turn = np.asarray(self.convergence(x, y))  # type: ignore[call-overload]
        return _as_given(wrap(heading_of(np.asarray(bearing_deg, dtype=np.float64), turn)))

    @overload
    def bearing(self, heading: float, x: float, y: float) -> float: ...
    @overload
    def bearing(self, heading: Array, x: Array, y: Array) -> Array: ...
    def bearing(self, heading: ArrayLike, x: ArrayLike, y: ArrayLike) -> object:
        """Bearing (degrees clockwise from true north, [0, 360)) of a heading at plane points."""
        turn = np.asarray(self.convergence(x, y))  # type: ignore[call-overload]
        return _as_given(bearing_of(np.asarray(heading, dtype=np.float64), turn))

    @overload
    def pose(self, x: float, y: float, heading: float) -> tuple[float, float, float]: ...
    @overload
    def pose(self, x: Array, y: Array, heading: Array) -> tuple[Array, Array, Array]: ...
    def pose(self, x: ArrayLike, y: ArrayLike, heading: ArrayLike) -> tuple[object, object, object]:
        """Latitude, longitude (degrees) and bearing (degrees) of poses in the plane."""
        if isinstance(x, float) and isinstance(y, float) and isinstance(heading, float):
            lat_rad, lon_rad, turn = _calls(self.sphere).place_on_earth(x, y)
            return degrees(lat_rad), degrees(lon_rad), bearing_of(heading, turn)
        lat, lon = self.to_geodetic(x, y)  # type: ignore[call-overload]
        return lat, lon, self.bearing(heading, x, y)  # type: ignore[call-overload]


class _Calls(NamedTuple):
    """The kernels of one point, bound to a sphere: an unbound call takes four times as long."""

    to_plane: Callable[[float, float], tuple[float, float]]
    to_geodetic: Callable[[float, float], tuple[float, float]]
    convergence: Callable[[float, float], float]
    place_on_earth: Callable[[float, float], tuple[float, float, float]]


_bound = threading.local()  # a bound call is for one thread
_MOST_BOUND = 64  # spheres


def _calls(sphere: kernels.Sphere) -> _Calls:
    """The kernels bound to a sphere, for this thread."""
    known = cast(dict[kernels.Sphere, _Calls], _bound.__dict__)
    calls = known.get(sphere)
    if calls is None:
        if len(known) >= _MOST_BOUND:
            known.clear()
        calls = known[sphere] = _Calls(
            kernels.to_plane.bind(sphere, ..., ...),
            kernels.to_geodetic.bind(sphere, ..., ...),
            kernels.convergence.bind(sphere, ..., ...),
            kernels.place_on_earth.bind(sphere, ..., ...),
        )
    return calls


def _sphere_at(lat0: float, lon0: float) -> kernels.Sphere:
    """The sphere for an origin off the poles, rad.  Once for a map: not worth a kernel.

    n² = 1 + e² cos⁴φ₀ / (1 - e²);  R² = ρ₀ ν₀;  n sin χ₀ = sin φ₀
    """
    sine = math.sin(lat0)
    power = math.sqrt(1.0 + kernels.E2 * math.cos(lat0) ** 4 / (1.0 - kernels.E2))
    radius = kernels.SEMI_MAJOR * math.sqrt(1.0 - kernels.E2) / (1.0 - kernels.E2 * sine * sine)
    # cos²χ₀ = 1 - sin²φ₀/n², without the cancellation near a pole
    sin0 = sine / power
    cos0 = math.sqrt(math.cos(lat0) ** 2 + (power * power - 1.0)) / power
    isometric = math.asinh(math.tan(lat0)) - kernels.E * math.atanh(kernels.E * sine)
    return kernels.Sphere(
        power, math.asinh(sin0 / cos0) - power * isometric, radius, sin0, cos0, lon0
    )


def _plane(sphere: kernels.Sphere, lat: Array, lon: Array) -> tuple[Array, Array]:
    """`kernels.to_plane` of many positions, radians."""
    isometric = np.arcsinh(np.tan(lat)) - kernels.E * np.arctanh(kernels.E * np.sin(lat))
    q = sphere.power * isometric + sphere.shift
    sine, cosine = np.tanh(q), 1.0 / np.cosh(q)
    east = lon - sphere.lon0
    angle = sphere.power * (east - 2.0 * np.pi * np.floor(east / (2.0 * np.pi) + 0.5))
    ahead = cosine * np.cos(angle)
    factor = 2.0 * sphere.radius / (1.0 + sine * sphere.sin0 + ahead * sphere.cos0)
    return factor * cosine * np.sin(angle), factor * (sine * sphere.cos0 - ahead * sphere.sin0)


_N = kernels.FLATTENING / (2.0 - kernels.FLATTENING)
# geodetic less conformal latitude χ as a sum of sines of 2χ, 4χ, ...: powers of _N from the
# first, the second, ... on
_SINES = (
    (2.0, -2 / 3, -2.0, 116 / 45, 26 / 45, -2854 / 675),
    (7 / 3, -8 / 5, -227 / 45, 2704 / 315, 2323 / 945),
    (56 / 15, -136 / 35, -1262 / 105, 73814 / 2835),
    (4279 / 630, -332 / 35, -399572 / 14175),
    (4174 / 315, -144838 / 6237),
    (601676 / 22275,),
)
_SERIES = tuple(
    math.fsum(c * _N ** (k + j) for j, c in enumerate(row)) for k, row in enumerate(_SINES, 1)
)


def _geodetic(sphere: kernels.Sphere, x: Array, y: Array) -> tuple[Array, Array]:
    """`kernels.to_geodetic` of many points, radians, to within some nanometres.

    Its iteration takes ten times as long as the series (Karney 2011, equation 36; Clenshaw).
    """
    east, north = x / sphere.radius, y / sphere.radius
    with np.errstate(all="ignore"):  # a pole, and what is no point
        up = 1.0 - 0.25 * (east * east + north * north)  # all of them longer by one factor
        ahead = up * sphere.cos0 - north * sphere.sin0
        tangent = (up * sphere.sin0 + north * sphere.cos0) / np.sqrt(east * east + ahead * ahead)
        q = (np.arcsinh(tangent) - sphere.shift) / sphere.power
        sine, cosine = np.tanh(q), 1.0 / np.cosh(q)
        double = 4.0 * cosine * cosine - 2.0
        this, before = np.full_like(q, _SERIES[-1]), np.zeros_like(q)
        for c in _SERIES[-2::-1]:
            this, before = c + double * this - before, this
        lat = np.arctan2(sine, cosine) + 2.0 * sine * cosine * this
        lon = sphere.lon0 + np.arctan2(east, ahead) / sphere.power
        return lat, lon - 2.0 * math.pi * np.floor(lon / (2.0 * math.pi) + 0.5)


def _as_given(values: Array) -> object:
    """An array as it is, what was a scalar as a float."""
    return values if values.ndim else float(values)
