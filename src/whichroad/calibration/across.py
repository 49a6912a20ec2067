"""How far from the middle of its lane a road is drawn, by the fixes across it."""

import math
from collections.abc import Sequence

import numpy as np

from .._compile import Records
from ..diagnosis.statistics import ConsistencyStatistics
from ..filter.summary.estimate import Output
from ..observations import Array
from ..roadmap import RoadMap
from ..settings import Vehicle

_WARM = 60.0  # s after the first epoch, before which nothing counts
_SURE = 0.95  # P of the edge
_MOVING = 2.0  # m/s
_ABOUT = 2.0  # s before and after in which the road must run straight
_STRAIGHT = 0.15  # rad turned in that time

Sums = Array  # fixes, sum of the offset, of its square, of the variance reported


def across_sums(epochs: Records, output: Output, roads: RoadMap, vehicle: Vehicle) -> Sums:
    """Offsets of fixes from the middle of the usual lane, where the road is sure and straight.

    Args:
        epochs: (n,) of a drive.
        output: Its estimates.
        roads: The map.
        vehicle: For its antenna and the side on which it is driven.

    Returns:
        (4,) `Sums`.
    """
    rows = output.rows
    turned = np.cumsum(epochs.turn)
    time = np.asarray(epochs.time)
    late = np.interp(time + _ABOUT, time, turned) - np.interp(time - _ABOUT, time, turned)
    used = (epochs.has_fix > 0) & (rows.p_edge > _SURE) & (np.abs(late) < _STRAIGHT)
    used &= (np.abs(rows.speed) > _MOVING) & (time > time[0] + _WARM)
    row, fix = rows[used], epochs.fix[used]
    cosine, sine = np.cos(row.heading), np.sin(row.heading)
    ahead, left = vehicle.antenna_forward, vehicle.antenna_left
    east = fix[:, 0] - row.match_x - ahead * cosine + left * sine
    north = fix[:, 1] - row.match_y - ahead * sine - left * cosine
    side = 1.0 if vehicle.driving_side == "right" else -1.0
    offset = east * sine - north * cosine - side * roads.arrays.edges["lane"][row.edge]
    reported = 0.5 * (fix[:, 2] ** 2 + fix[:, 3] ** 2)
    return np.array([len(row), offset.sum(), offset @ offset, reported.sum()])


def across_of(sums: Sequence[Sums], statistics: ConsistencyStatistics) -> float:
    """Sigma of all errors across the road but the receiver's, m; nan where it is not seen.

    Args:
        sums: Of drives.
        statistics: Of the same drives; they have the receiver's own errors.
    """
    n, offset, square, reported = np.sum(sums, axis=0)
    if n < 100.0 or statistics.hidden:
        return math.nan
    errors = statistics.errors()
    rest = square / n - (offset / n) ** 2 - (errors.size + errors.white) * reported / n
    return math.sqrt(rest) if rest > 0.0 else math.nan
