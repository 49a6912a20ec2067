"""The record of an epoch: what the sensors said at one moment, and since the one before."""

from typing import Annotated

import numpy as np

from .._compile import Array, Records
from ..graph.network import records

EPOCH = np.dtype(
    [
        ("time", "f8"),  # s
        # odometry, pre-integrated since the epoch before, in M's frame at that epoch
        ("arc", "f8"),  # odometer metres
        ("turn", "f8"),  # rad
        ("forward", "f8"),  # m
        ("left", "f8"),  # m
        # GNSS
        ("fix", "f8", (5,)),  # x, y (plane), sigma_major, sigma_minor (m), heading of major (rad)
        ("speed", "f8"),  # m/s
        ("speed_sigma", "f8"),  # inf: not reported
        ("course", "f8"),  # heading over ground, rad
        ("course_sigma", "f8"),  # inf: not reported
        ("odometry_valid", "u1"),  # 1: measured; 2: until the next reading; 0: extrapolated
        ("has_fix", "u1"),
        ("gyro", "u1"),  # what measures the turn: BY_WHEELS ... UNTURNED of `filter.windows`
        ("evidence", "u1"),  # rows of `Work.evidence`, of further sensors
        ("first_evidence", "i4"),  # the first of them
    ],
    align=True,
)

Epochs = Annotated[Records, Array(EPOCH, 1)]  # of a drive


def new_epochs(n: int) -> Epochs:
    """Empty epochs, (n,) EPOCH."""
    return records(n, EPOCH)
