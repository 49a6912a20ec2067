"""What the sensors said, as the kernels take it."""

from typing import NamedTuple

import numpy as np

from ._jit import Bytes, Matrix, Vector

WHEELS, DISTANCE, CLOCK = 0, 1, 2  # what moves the vehicle: wheels with turn, distance, time


class Epochs(NamedTuple):
    """What the sensors said, one row an epoch, in time order.

    Odometry is pre-integrated since the epoch before, in M's frame at that epoch.
    """

    time: Vector  # (n,) s
    arc: Vector  # (n,) odometer metres
    turn: Vector  # (n,) rad
    forward: Vector  # (n,) m
    left: Vector  # (n,) m
    moved: Bytes  # (n,) 1: the odometer spoke
    has_fix: Bytes  # (n,)
    fix: Matrix  # (n, 5) x, y (plane), sigma_major, sigma_minor (m), heading of major (rad)
    speed: Vector  # (n,) m/s
    speed_sigma: Vector  # (n,) inf: not reported
    course: Vector  # (n,) heading over ground, rad
    course_sigma: Vector  # (n,) inf: not reported


def new_epochs(n: int) -> Epochs:
    """Empty epochs."""
    arc, turn, forward, left, speed, speed_sigma, course, course_sigma = np.zeros((8, n))
    moved, has_fix = np.zeros((2, n), np.uint8)
    return Epochs(
        np.zeros(n), arc, turn, forward, left, moved, has_fix, np.zeros((n, 5)), speed,
        speed_sigma, course, course_sigma,
    )  # fmt: skip
