"""What a search answers: the estimate of an epoch, told about one hypothesis."""

import math

import numpy as np

from ..filter.state import MX, MY, H, X, Y
from ..filter.summary.estimate import Output


def recentre(row: np.void, best: np.void, scale: float) -> None:
    """Tell the pose of one hypothesis in place of the mean: the second moments about it.

    The mean of a thousand places is a place where nobody is.

    Args:
        row: ESTIMATE of the mixture, in place.
        best: The HYPOTHESIS.
        scale: Plane metres per true metre.
    """
    mean = best["mu"]
    place = mean[[X, Y]], mean[[X, Y]] + scale * mean[[MX, MY]]
    turned = math.remainder(float(row["heading"] - mean[H]), 2.0 * math.pi)
    dx, dy = (np.array([row["x"], row["y"]]) - place[0]) / scale
    ux, uy = (np.array([row["map_x"], row["map_y"]]) - place[1]) / scale
    row["cov"] += [dx * dx, dx * dy, dx * turned, dy * dy, dy * turned, turned * turned]
    row["map_cov"] += [ux * ux, ux * uy, uy * uy]
    for level in ("protection_level", "level_along", "level_across"):
        row[level] += math.hypot(dx, dy)
    (row["x"], row["y"]), (row["map_x"], row["map_y"]) = place
    row["heading"] = mean[H]
    if row["edge"] < 0:
        row["match_x"], row["match_y"] = place[0]


def repeat(output: Output, first: int, last: int) -> None:
    """Epochs first … last − 1 are less than a step later than the one before."""
    output.rows[first:last] = output.rows[first - 1]
    if len(output.alt_pose):
        output.alt_pose[first:last] = output.alt_pose[first - 1]
