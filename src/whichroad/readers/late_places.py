"""Places that lag behind the speeds of their rows, as by a low pass, moved to these."""

from typing import NamedTuple

import numpy as np

from ..geodesy.angles import wrap_degrees
from ..observations import Array
from .checks import Bools

_GAP = 1.5  # usual steps, beyond which nothing is known between two rows
_AT = 0.1  # of a step, within which a time is that of a row


class Places(NamedTuple):
    """Places of fixes, (n,) each."""

    lat: Array  # degrees
    lon: Array
    cov_ee: Array  # m²
    cov_en: Array
    cov_nn: Array
    unknown: Bools  # no place is left: it was moved from here, and none came here


def move_to(wanted: Array, new: Places, own: slice, time: Array) -> None:
    """Give one drive the places of later times.

    Beyond the last row its place is held, across gaps they are on a line; both are marked as
    unknown.

    Args:
        wanted: (k,) s, whose place each row of the drive is to have.
        new: (n,) each, of all drives; in place.
        own: The k rows of the drive.
        time: (k,) s, in order.
    """
    lon = new.lon[own]
    new.lon[own] = lon[0] + wrap_degrees(lon - lon[0])  # without a step at 180 degrees
    for values in (new.lat, new.lon, new.cov_ee, new.cov_en, new.cov_nn):
        values[own] = np.interp(wanted, time, values[own])
    new.lon[own] = wrap_degrees(new.lon[own])
    step = float(np.median(np.diff(time)))
    behind = np.searchsorted(time, wanted).clip(1, len(time) - 1)
    before, after = wanted - time[behind - 1], time[behind] - wanted
    near = np.minimum(np.abs(before), np.abs(after)) < _AT * step
    new.unknown[own] = ~near & ((after < 0.0) | (before + after > _GAP * step))
