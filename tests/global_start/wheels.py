"""A drive as wheels alone tell it."""

import numpy as np

from whichroad.epochs import Timeline
from whichroad.filter.motion import arc_chord
from whichroad.filter.state import WHEELS, new_epochs
from whichroad.geodesy.plane import Plane

PLANE = Plane(49.4, 8.7)


def wheels_of(truth: object) -> Timeline:
    """Perfect wheels as epochs."""
    epochs = new_epochs(len(truth.time))
    arc, turn = np.diff(truth.s, prepend=truth.s[0]), np.diff(truth.heading, prepend=0.0)
    turn[0] = 0.0
    epochs.time[:], epochs.arc[:], epochs.turn[:] = truth.time, arc, turn
    pairs = [arc_chord(a, t) for a, t in zip(arc, turn, strict=True)]
    epochs.forward[:], epochs.left[:] = np.array(pairs).T
    epochs.odometry_valid = 1
    return Timeline(epochs, WHEELS, 0)
