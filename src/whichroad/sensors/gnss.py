"""GNSS fixes as the filter takes them: plane coordinates and the axes of the ellipse."""

import math

import numpy as np

from ..geodesy.angles import heading_of, radians
from ..geodesy.plane import Plane
from ..observations import Array, Fixes, GeoFix


def ellipse(cov_xx: Array, cov_xy: Array, cov_yy: Array) -> tuple[Array, Array, Array]:
    """Axes of error ellipses from their covariances.

    Args:
        cov_xx: (n,) m².
        cov_xy: (n,) m².
        cov_yy: (n,) m².

    Returns:
        Sigma of the major axis, of the minor axis (m), heading of the major axis (rad),
        (n,) each.
    """
    mean = 0.5 * (cov_xx + cov_yy)
    half = np.hypot(0.5 * (cov_xx - cov_yy), cov_xy)
    major = np.sqrt(np.maximum(mean + half, 0.0))
    minor = np.sqrt(np.maximum(mean - half, 0.0))
    return major, minor, 0.5 * np.arctan2(2.0 * cov_xy, cov_xx - cov_yy)


LEAST_SIGMA = 0.01  # m; a receiver that claims less claims too much


def fix_row(
    fix: GeoFix, plane: Plane, default_sigma: float
) -> tuple[tuple[float, float, float, float, float], float, float]:
    """One fix in the plane, as `fix_rows` makes it, without the cost of arrays.

    Args:
        fix: Geodetic; an infinite covariance stands for one that was not reported.
        plane: The map's plane.
        default_sigma: Taken then, m.

    Returns:
        (x, y, sigma_major, sigma_minor, heading of the major axis), course, its sigma.
    """
    x, y = plane.from_geodetic(float(fix.lat_deg), float(fix.lon_deg))
    turn = plane.convergence(x, y)
    if math.isfinite(fix.cov_ee) and math.isfinite(fix.cov_nn):
        mean = 0.5 * (fix.cov_ee + fix.cov_nn)
        half = math.hypot(0.5 * (fix.cov_ee - fix.cov_nn), fix.cov_en)
        major, minor = math.sqrt(max(mean + half, 0.0)), math.sqrt(max(mean - half, 0.0))
        angle = 0.5 * math.atan2(2.0 * fix.cov_en, fix.cov_ee - fix.cov_nn)
    else:
        major, minor, angle = default_sigma, default_sigma, 0.0
    row = (x, y, max(major, LEAST_SIGMA), max(minor, LEAST_SIGMA), angle + turn)
    course = heading_of(fix.bearing_deg, turn)
    return row, course, radians(fix.sigma_bearing_deg)


def fix_rows(fixes: Fixes, plane: Plane) -> tuple[Array, Array, Array]:
    """Fixes in the plane.

    Args:
        fixes: (n,) geodetic, covariance east-north.
        plane: The map's plane.

    Returns:
        (n, 5) x, y, sigma_major, sigma_minor, heading of the major axis; (n,) course as
        a heading in the plane; (n,) its sigma, rad (inf: not reported).
    """
    x, y = plane.from_geodetic(fixes.lat_deg, fixes.lon_deg)
    turn = plane.convergence(x, y)
    major, minor, angle = ellipse(fixes.cov_ee, fixes.cov_en, fixes.cov_nn)
    rows = np.column_stack(
        [x, y, np.maximum(major, LEAST_SIGMA), np.maximum(minor, LEAST_SIGMA), angle + turn]
    )
    course = heading_of(fixes.bearing_deg, turn)
    return rows, course, radians(fixes.sigma_bearing_deg)
