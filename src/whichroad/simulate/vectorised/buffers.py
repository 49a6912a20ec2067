"""Data of the vectorised simulator: settings, lines, truth and epochs of one drive."""

from typing import NamedTuple

import numpy as np

from ..._compile import Bytes, Ints32, Matrix, Records, Vector
from ...filter.state import new_epochs
from ..simulation_settings import SimulationSettings

LONGEST = 6000  # points of a line, about metres
MODES = 24  # of each field of the map's error


class Numbers(NamedTuple):
    """`SimulationSettings` as the kernels take them; the settings document units and meaning."""

    map_sigma: float
    map_shortest: float
    map_longest: float
    relative_sigma: float
    relative_shortest: float
    relative_longest: float
    street_sigma: float
    lane_sigma: float
    lane_length: float
    lane_change_rate: float
    lane_width: float
    speed_profile_sigma: float
    acceleration: float
    braking: float
    lateral_acceleration: float
    stop_probability: float
    stop_time: float
    first_wait: float
    odometry_rate: float
    metres_per_tick: float
    track_width: float
    scale_sigma: float
    differential_sigma: float
    track_sigma: float
    wheel_walk: float
    antenna_forward: float
    antenna_left: float
    gnss_rate: float
    gnss_bias_low: float
    gnss_bias_high: float
    gnss_time: float
    gnss_white: float
    gnss_axis_ratio: float
    gnss_reported: float
    gnss_reported_spread: float
    gnss_speed_sigma: float
    multipath_rate: float
    multipath_sigma: float
    multipath_time: float

    @classmethod
    def of(cls, settings: SimulationSettings) -> "Numbers":
        """Take them from settings."""
        return cls(*(float(getattr(settings, name)) for name in cls._fields))


class Line(NamedTuple):
    """A route prepared for driving: points each metre or so, shape (n,) each.

    Positions are of the centre line in the map's frame, corners rounded already.
    """

    along: Vector  # m along the centre line
    x: Vector  # m, plane
    y: Vector
    lane: Vector  # usual offset right of the centre line, m
    limit: Vector  # usual speed, m/s
    road: Ints32  # number of the road, see `scenes`
    street: Ints32  # 0, 1, ... along the route: each has an offset of its own
    stop: Bytes  # 1: here one may have to stop
    masked: Bytes  # 1: no GNSS
    hidden: Bytes  # 1: the road is missing from the map


class Truth(NamedTuple):
    """What is true at each epoch, shape (n,) each."""

    x: Vector  # m, plane, world frame
    y: Vector
    heading: Vector  # rad, not wrapped
    speed: Vector  # m/s
    travelled: Vector  # m since the drive's start
    place: Ints32  # point of the line
    map_x: Vector  # m, the same place in the map's frame
    map_y: Vector


class DriveBuffers(NamedTuple):
    """Buffers for one drive, used for one drive after another."""

    epochs: Records  # (n,)
    truth: Truth
    grid: Matrix  # (15, LONGEST) see the rows below
    modes: Matrix  # (12, MODES)
    drawn: Vector  # (8,) what this drive's car and receiver are, see the names below


X, Y, MAP_X, MAP_Y, HEADING, TRAVELLED, SPEED, ARRIVE, DEPART, OFFSET, NX, NY, BEND, A, B = range(
    15
)  # rows of `grid`
SCALE, DIFFERENTIAL, TRACK, BIAS_X, BIAS_Y, RATIO, ANGLE, BIAS = range(8)  # of `drawn`


def _new_truth(n: int) -> Truth:
    x, y, heading, speed, travelled, map_x, map_y = np.zeros((7, n))
    return Truth(x, y, heading, speed, travelled, np.zeros(n, np.int32), map_x, map_y)


def new_buffers(epochs: int = 6000) -> DriveBuffers:
    """Allocate buffers for drives of up to so many epochs."""
    return DriveBuffers(
        new_epochs(epochs),
        _new_truth(epochs),
        np.zeros((15, LONGEST)),
        np.zeros((12, MODES)),
        np.zeros(8),
    )
