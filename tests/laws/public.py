"""Drives by public functions only, so that the laws do not depend on inner modules.

Positions are metres east and north in a stereographic plane computed by pyproj.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import geopandas
import numpy as np
import pyproj
import shapely
from numpy.typing import ArrayLike, NDArray

import whichroad
from scenes import Truth

Array = NDArray[np.float64]

START = 1.6e9  # s since 1970, time of a drive's first epoch
SIGMA_SPEED = 0.3  # m/s, of a receiver's Doppler speed
CAR = whichroad.Vehicle(track_width=1.5, metres_per_tick_left=0.01, metres_per_tick_right=0.01)
PLANE = pyproj.CRS.from_proj4("+proj=sterea +lat_0=49.4 +lon_0=8.7 +ellps=WGS84")
_TO_DEGREES = pyproj.Transformer.from_crs(PLANE, "EPSG:4326", always_xy=True)
_TO_METRES = pyproj.Transformer.from_crs("EPSG:4326", PLANE, always_xy=True)

WHEELS, DISTANCE, GNSS = "wheels", "distance", "gnss"
MODES = (WHEELS, DISTANCE, GNSS)


def degrees(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Longitude and latitude of points in the plane, degrees."""
    lon, lat = _TO_DEGREES.transform(x, y)
    return np.asarray(lon), np.asarray(lat)


def metres(lon: ArrayLike, lat: ArrayLike) -> tuple[Array, Array]:
    """Plane coordinates of geodetic positions, m."""
    x, y = _TO_METRES.transform(lon, lat)
    return np.asarray(x), np.asarray(y)


def convergence(lon: ArrayLike, lat: ArrayLike) -> Array:
    """Bearing of the plane's y axis, rad."""
    factors = pyproj.Proj(PLANE).get_factors(lon, lat)
    return np.radians(factors.meridian_convergence)


def road_map(lines: Sequence[ArrayLike], **columns: Sequence[Any]) -> whichroad.RoadMap:
    """The map of streets with vertices in the plane, numbered from 0."""
    table = {"id": list(range(len(lines))), **columns}
    shapes = [
        shapely.LineString(np.column_stack(degrees(*np.asarray(line, float).T))) for line in lines
    ]
    return whichroad.RoadMap.from_edges(
        geopandas.GeoDataFrame(table, geometry=shapes, crs="EPSG:4326")
    )


def geo_fixes(
    truth: Truth, fix: Array, at: ArrayLike, *, doppler: bool = False
) -> list[whichroad.GeoFix]:
    """Fixes at some epochs.

    Args:
        truth: The drive.
        fix: (n, 5) fixes; x, y and sigma of the major axis are used.
        at: Epochs with a fix.
        doppler: Whether the receiver reports its speed, and its course where it moves.
    """
    rows = np.asarray(at)
    lon, lat = degrees(fix[rows, 0], fix[rows, 1])
    bearing = np.degrees(0.5 * np.pi - truth.heading[rows] + convergence(lon, lat)) % 360.0
    speed = np.gradient(truth.s, truth.time)[rows]
    moves = doppler & (speed > 2.0)
    sigma = np.where(moves, np.degrees(np.arctan2(SIGMA_SPEED, speed)), np.inf)
    return [
        whichroad.GeoFix(
            START + float(truth.time[row]), float(lat[i]), float(lon[i]),
            float(fix[row, 2]) ** 2, 0.0, float(fix[row, 2]) ** 2,
            float(speed[i]), SIGMA_SPEED if doppler else np.inf,
            float(bearing[i]), float(sigma[i]),
        )
        for i, row in enumerate(rows)
    ]  # fmt: skip


def readings(truth: Truth, mode: str, spoken: NDArray[np.bool_] | None = None) -> list[Any]:
    """Odometry readings.

    Args:
        truth: The drive.
        mode: WHEELS, DISTANCE or GNSS.
        spoken: (n,) whether there is a reading; None: at every epoch.
    """
    rows = np.arange(len(truth.time)) if spoken is None else np.flatnonzero(spoken)
    time = START + truth.time
    if mode == DISTANCE:
        return [whichroad.Distance(float(time[k]), float(truth.s[k])) for k in rows]
    if mode == GNSS:
        return []
    half = 0.5 * CAR.track_width * (truth.heading - truth.heading[0])
    left, right = 100.0 * (truth.s - half), 100.0 * (truth.s + half)
    return [whichroad.WheelTicks(float(time[k]), float(left[k]), float(right[k])) for k in rows]


class Errors(NamedTuple):
    """Errors of estimates, and normalised by their covariance."""

    squared: Array  # (n,) m²
    nees: Array  # (n,) squared position error over its covariance, 2 degrees of freedom
    bearing_nees: Array  # (n,) of the bearing, 1 degree of freedom


def errors_of(result: whichroad.Result, truth: Truth, at: NDArray[np.bool_]) -> Errors:
    """Errors at the epochs `at` of the truth; the points must have rows at these times."""
    points = result.to_arrow()
    seconds = points["time"].cast("int64").to_numpy() * 1e-6 - START
    row = np.searchsorted(seconds, truth.time[at] - 1e-3)
    np.testing.assert_allclose(seconds[row], truth.time[at], atol=1e-3)
    c = {name: points[name].to_numpy()[row] for name in (
        "lat", "lon", "bearing_deg", "cov_ee_m2", "cov_en_m2", "cov_nn_m2", "sigma_bearing_deg",
    )}  # fmt: skip
    x, y = metres(c["lon"], c["lat"])
    dx, dy = x - truth.x[at], y - truth.y[at]
    turn = convergence(c["lon"], c["lat"])
    east = np.cos(turn) * dx + np.sin(turn) * dy
    north = -np.sin(turn) * dx + np.cos(turn) * dy
    ee, en, nn = c["cov_ee_m2"], c["cov_en_m2"], c["cov_nn_m2"]
    nees = (nn * east**2 - 2.0 * en * east * north + ee * north**2) / (ee * nn - en * en)
    said = 0.5 * np.pi - np.radians(c["bearing_deg"]) + turn
    off = np.angle(np.exp(1j * (said - truth.heading[at])))
    return Errors(dx**2 + dy**2, nees, (off / np.radians(c["sigma_bearing_deg"])) ** 2)
