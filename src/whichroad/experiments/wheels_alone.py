"""Dead reckoning through an outage: equation (1), without map and GNSS."""

import numpy as np

from ..observations import Array
from ..sensors.odometry import dead_reckoned, motion_of
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
    pose = float(truth.x[first]), float(truth.y[first]), float(truth.heading[first])
    places = []
    for arc, turn in zip(
        np.diff(motion.distance[inside]), np.diff(motion.turn[inside]), strict=True
    ):
        pose = dead_reckoned(pose, float(arc), float(turn))
        places.append(pose[:2])
    return np.array(places)


def wheels_alone_error(drive: SimulatedDrive) -> float:
    """How far wheels alone are from the truth where GNSS is back, m."""
    last = int(np.searchsorted(drive.truth.time, drive.outages[0][1], side="right")) - 1
    x, y = wheels_alone(drive)[-1]
    return float(np.hypot(x - drive.truth.x[last], y - drive.truth.y[last]))
