"""Times for tracks that have none: their points are matched by order and distance."""

from collections.abc import Sequence

import numpy as np

from ..observations import Array
from .checks import Ints
from .units_by_places import distances

SPEED = 10.0  # m/s, at which the invented times go along the points
_SHORTEST = 0.1  # s between points of one place
NOTE = (
    "no times in the file: they were invented, at 10 m/s from 1970-01-01T00:00:00Z; points "
    "were matched by order and distance, and times, speeds and durations mean nothing"
)


def invented_times(
    lat_deg: Array, lon_deg: Array, tracks: Sequence[Ints], notes: list[str]
) -> Array:
    """Times at which points are passed at a constant speed, s since 1970.

    Args:
        lat_deg: (n,) latitudes of all points, NaN: no place.
        lon_deg: Their longitudes.
        tracks: The rows of each track, in order.
        notes: Where it is said.

    Returns:
        (n,) times, increasing within each track; NaN where there is no place.
    """
    notes.append(NOTE)
    time = np.full(len(lat_deg), np.nan)
    for rows in tracks:
        placed = rows[np.isfinite(lat_deg[rows]) & np.isfinite(lon_deg[rows])]
        steps = distances(lat_deg[placed], lon_deg[placed]) / SPEED
        time[placed] = np.concatenate([[0.0], np.cumsum(np.maximum(steps, _SHORTEST))])[
            : len(placed)
        ]
    return time
