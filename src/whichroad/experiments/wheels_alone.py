"""Dead reckoning through an outage: equation (1), without map and GNSS."""

import numpy as np

from ..observations import Array
from ..sensors.odometry import motion_of
from ..simulate import SimulatedDrive


def wheels_alone(drive: SimulatedDrive) -> Array:
    """Integrate the wheels from the true pose where GNSS is lost to where it is back.

    Returns:
        (k, 2) m, plane.
    """
    truth, (begin, end) = drive.truth, drive.outages[0]
    assert drive.drive.odometry is not None
    motion = motion_of(drive.drive.odometry, drive.vehicle)
    assert motion.turn is not None
    inside = (motion.time >= begin) & (motion.time <= end)
    first = int(np.searchsorted(truth.time, motion.time[inside][0] - 1e-3))
    turn = motion.turn[inside] - motion.turn[inside][0]
    heading = truth.heading[first] + 0.5 * (turn[1:] + turn[:-1])
    step = np.diff(motion.distance[inside])
    return np.column_stack(
        [
            truth.x[first] + np.cumsum(step * np.cos(heading)),
            truth.y[first] + np.cumsum(step * np.sin(heading)),
        ]
    )


def wheels_alone_error(drive: SimulatedDrive) -> float:
    """How far wheels alone are from the truth where GNSS is back, m."""
    last = int(np.searchsorted(drive.truth.time, drive.outages[0][1], side="right")) - 1
    x, y = wheels_alone(drive)[-1]
    return float(np.hypot(x - drive.truth.x[last], y - drive.truth.y[last]))
