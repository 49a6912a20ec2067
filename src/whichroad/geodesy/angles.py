"""The only conversions of degrees: to radians, between bearing and heading, into one turn.

A bearing is in degrees clockwise from true north.  A heading is in radians
counter-clockwise from the plane's x axis.  The two differ by a quarter of a turn, the
sense, and the convergence: the heading of true north less that of the plane's y axis.
Every function takes and gives scalars or arrays.
"""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Angle = TypeVar("Angle", float, Array)

DEGREE = math.pi / 180.0  # rad
_RADIAN = 180.0 / math.pi  # degrees


def radians(angle_deg: Angle) -> Angle:
    """Radians of degrees."""
    return angle_deg * DEGREE


def degrees(angle: Angle) -> Angle:
    """Degrees of radians."""
    return angle * _RADIAN


def wrap(angle: Angle) -> Angle:
    """The angle in (-π, π], rad."""
    return -((math.pi - angle) % (2.0 * math.pi) - math.pi)


def wrap_degrees(angle_deg: Angle) -> Angle:
    """The angle in [-180, 180), as of a longitude or of a difference, degrees."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def wrap_bearing(bearing_deg: Angle) -> Angle:
    """The bearing in [0, 360), degrees."""
    return _modulo(bearing_deg, 360.0)


def wrap_axis(bearing_deg: Angle) -> Angle:
    """The bearing of an axis, which has no sense, in [0, 180), degrees."""
    return _modulo(bearing_deg, 180.0)


def _modulo(angle: Angle, turn: float) -> Angle:
    """The angle in [0, turn); of arrays in a fifth of the time of `%`."""
    if isinstance(angle, np.ndarray):
        wrapped = angle - turn * np.floor(angle / turn)
    else:
        wrapped = angle % turn
    return wrapped * (wrapped < turn)  # -1e-20 % 360 is 360


def unwrap_degrees(angles_deg: Array) -> Array:
    """Successive angles (n,) without jumps of a whole turn, degrees."""
    return np.unwrap(angles_deg, period=360.0)


def heading_of(bearing_deg: Angle, convergence: Angle | float) -> Angle:
    """Heading (rad, not wrapped) of a bearing.

    Args:
        bearing_deg: Degrees clockwise from true north.
        convergence: `Plane.convergence` at the place, rad; 0: the heading is from east.
    """
    return 0.5 * math.pi - radians(bearing_deg) + convergence


def bearing_of(heading: Angle, convergence: Angle | float) -> Angle:
    """Bearing (degrees clockwise from true north, [0, 360)) of a heading.

    Args:
        heading: Rad.
        convergence: `Plane.convergence` at the place, rad; 0: the heading is from east.
    """
    return wrap_bearing(degrees(0.5 * math.pi + convergence - heading))


def axis_bearing_of(heading: Angle, convergence: Angle | float) -> Angle:
    """Bearing (degrees clockwise from true north, [0, 180)) of an axis of this heading.

    Args:
        heading: Rad.
        convergence: `Plane.convergence` at the place, rad; 0: the heading is from east.
    """
    return wrap_axis(90.0 - degrees(heading - convergence))


def course_of(east: Array, north: Array) -> Array:
    """Bearings (degrees clockwise from north, [0, 360)) of vectors (n,)."""
    return wrap_bearing(degrees(np.arctan2(east, north)))
