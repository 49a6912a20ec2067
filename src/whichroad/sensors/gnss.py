"""GNSS fixes as the filter takes them: plane coordinates and the axes of the ellipse."""

import math

import numpy as np

from ..frames import Plane
from ..records import Array, Fixes


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
    course = math.pi / 2 - np.radians(fixes.bearing_deg) + turn
    return rows, course, np.radians(fixes.sigma_bearing_deg)
