"""Records of what further sensors say, one for each piece of evidence, see `observe`.

A sensor beyond fixes and odometry is plain Python above the filter (`whichroad.sensors`).  It
reaches the filter as rows of one table, in the order of time, of which each epoch names its own.
"""

from typing import Annotated, NamedTuple

import numpy as np

from ..._compile import Array, Ints32, Records, Vector

HEADING, SPEED, LATERAL, POSITION, RANGE, BEARING, ATTRIBUTE, ELEVATION = range(8)

SENSORS = 16  # that a drive can have
MOST_AT_ONCE = 255  # rows of one epoch
CLASSES = 8  # of an attribute, the last one for whatever is not named
LEVEL_UNIT, LEVEL_ZERO = 0.1, 128.0  # of heights over the ground, which are classes too, m
CLIMBS = 0.97  # P that a road climbs to a bridge; else the ground sinks below it

EVIDENCE = np.dtype(
    [
        ("kind", "i4"),  # HEADING ... ELEVATION
        ("sensor", "i4"),  # 0 ... SENSORS - 1
        ("value", "f8"),  # heading or bearing, rad; speed, m/s; offset from the line or range, m
        ("variance", "f8", (2,)),  # of the value; of a position along and across its major axis
        ("bias", "f8"),  # variance of its error that stays: the state V; 0: it has none
        ("share", "f8"),  # of the reading that is new: its error lasts (sensors.lasting)
        ("axis", "f8"),  # heading of that axis, rad
        ("x", "f8"),  # the position itself, or the place that a range or bearing is to, plane
        ("y", "f8"),
        ("arm", "f8", (2,)),  # of the sensor: ahead and left of M, m
        ("on_map", "u1"),  # 1: the place shares the map's error
        ("relative", "u1"),  # 1: the bearing is from the vehicle's axis, not from the plane's
        ("column", "i4"),  # of an attribute: row of `Evidence.classes`
        ("log_likelihood", "f8", (CLASSES,)),  # of each class of it, nats; of heights their gains
    ],
    align=True,
)

SENSOR = np.dtype(
    [
        ("heard", "f8"),  # rows
        ("misfits", "f8"),  # of them, those that fitted no hypothesis
        ("score", "f8"),  # misfits lately, twice, less those that fitted
        ("withheld", "f8"),  # rows that were left out
        ("bias", "f8", (3,)),  # its error that stays, rad or m: mean, variance, variance at first
        ("by_angle", "u1"),  # 1: that is in rad
        ("refused", "u1"),  # 1: not believed now
    ],
    align=True,
)


class Evidence(NamedTuple):
    """What further sensors said in a drive, and the classes of roads that it is about.

    Shapes: n rows, E edges, P pieces of edges, A attributes.
    """

    rows: Annotated[Records, Array(EVIDENCE, 1)]  # (n,)
    first: Ints32  # (E+1,) first piece of each edge
    start: Vector  # (P,) abscissa at which each begins, m
    classes: Annotated[np.ndarray, Array(np.dtype("u1"), 2)]  # (A, P)


def new_evidence(n: int) -> Evidence:
    """Room for so many rows, about no attribute."""
    rows = np.zeros(n, EVIDENCE).view(np.recarray)
    return Evidence(rows, np.zeros(0, np.int32), np.zeros(0), np.zeros((0, 0), np.uint8))


NO_EVIDENCE = new_evidence(0)
"""Where there is no further sensor."""
