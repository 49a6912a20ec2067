"""The filter told which sensor fails, and when: what that leaves to be known.

Readings of the failed sensor are withheld while the fault lasts.  Wheel counters have gone on
soundly meanwhile, so that what is withheld leaves no trace in them afterwards.  A receiver that
is poor for the whole drive, a biased gyro, gaps and maps stay as they are.
"""

from dataclasses import replace

import numpy as np

from .faults import Event
from .receivers import Fixes
from .wheels import Columns

POSITIONS = ("canyon", "jump", "pulled")
SPEEDS = ("speed_spike", "speed_kmh", "speed_stuck", "speed_10")
COURSES = ("course_stuck", "course_reversed")
ODOMETRY = (
    *("slip", "tyre", "stand", "stuck", "dead", "dropped", "repeats", "swapped"),
    *("yaw_sign", "yaw_degrees", "zeros", "backwards", "no_turn", "odometry_kmh"),
)
_SLACK = 0.1  # s, around a fault: a reading there may be of its inside


def sound(events: list[Event]) -> list[Event]:
    """The events of a drive whose odometry does not fail."""
    return [e for e in events if e.name not in ODOMETRY]


def withhold(fixes: Fixes, odometry: Columns, events: list[Event]) -> tuple[Fixes, Columns]:
    """Both less the readings of what fails.

    Args:
        fixes: Of the receiver, with its faults.
        odometry: Of wheels or gyro, drawn with the `sound` events alone.
        events: All faults of the drive.

    Returns:
        Fixes without those of faulty positions, and without faulty speeds and courses; odometry
        without its rows under a fault, empty where that are all.
    """
    speed = np.where(_during(fixes.time, events, SPEEDS), np.nan, fixes.speed)
    course = np.where(_during(fixes.time, events, COURSES), np.nan, fixes.bearing_deg)
    kept = ~_during(fixes.time, events, POSITIONS)
    columns = {"time": fixes.time, "x": fixes.x, "y": fixes.y, "cov": fixes.cov}
    columns |= {"speed": speed, "bearing_deg": course}
    fixes = replace(fixes, **{name: values[kept] for name, values in columns.items()})
    if odometry:
        heard = ~_during(odometry["time"], events, ODOMETRY)
        odometry = {n: values[heard] for n, values in odometry.items()} if heard.any() else {}
    return fixes, odometry


def _during(time: np.ndarray, events: list[Event], names: tuple[str, ...]) -> np.ndarray:
    """Whether each time is within a fault of one of some names, (n,)."""
    inside = np.zeros(len(time), bool)
    for e in events:
        if e.name in names:
            inside |= (time >= e.begin - _SLACK) & (time <= e.end + _SLACK)
    return inside
