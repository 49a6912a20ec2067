"""Recorded drives whose places somebody has put on the roads before: their errors do not show."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .._compile import Records
from ..graph.network import Roads
from ..observations import Array
from .finding import Finding

_LOOKED_AT, _FEWEST = 24, 15  # fixes of a drive, evenly over it; that are left, 10 m apart
_APART = 10.0  # m
_FINE = 1.0  # m, of a sigma that is told: a finer receiver may have driven there
_ON, _SHARE = 0.12, 0.4  # m from the line of the answered road, and share of the fixes there:
_NEAR, _MOST = 0.7, 0.8  # others are on other lines; the same in coordinates of 5 decimals
_SIGMA = 10.0  # m, with which levels of such places held


def snapped_findings(
    epochs: Records, rows: Records, first: Sequence[int], roads: Roads
) -> dict[int, Finding]:
    """What is to be said of recorded drives most of whose fixes lie on centre lines of roads.

    Args:
        epochs: (n,) EPOCH, drive after drive.
        rows: (n,) ESTIMATE.
        first: (d + 1,) the epoch at which each begins, and n.
        roads: The map.

    Returns:
        By the number of the drive.
    """
    at, drive = _looked_at(epochs, np.asarray(first))
    looked_at = np.bincount(drive, minlength=len(first))
    edge = rows.view(np.ndarray)["edge"][at]
    at, drive, edge = at[edge >= 0], drive[edge >= 0], edge[edge >= 0]
    if len(at) < _FEWEST:
        return {}
    fix = epochs.view(np.ndarray)["fix"][at]
    away = _away(fix[:, 0], fix[:, 1], edge, roads)
    coarse = fix[:, 2] > _FINE
    left = np.bincount(drive, minlength=len(first))
    judged = (left >= _FEWEST) & (2 * left >= looked_at)
    on, near = (
        np.bincount(drive[coarse & (away < limit)], minlength=len(first)) / np.maximum(left, 1)
        for limit in (_ON, _NEAR)
    )
    found = np.flatnonzero(judged & ((on > _SHARE) | (near > _MOST)))
    return {one: _snapped(float(max(on[one], near[one]))) for one in found.tolist()}


def _looked_at(
    epochs: Records, first: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Some epochs with a fix, evenly over each drive and at places apart, and their drives."""
    table = epochs.view(np.ndarray)
    at = np.flatnonzero((table["has_fix"] > 0) & (table["filled"] == 0))
    at = at[at < first[-1]]
    drive = np.searchsorted(first, at, side="right") - 1
    count = np.bincount(drive, minlength=len(first))
    row = np.arange(len(at)) - (np.cumsum(count) - count)[drive]
    part = row * np.minimum(count, _LOOKED_AT)[drive] // count[drive]
    some = np.flatnonzero((np.diff(part, prepend=-1) != 0) | (row == 0))
    at, drive = at[some], drive[some]
    x, y = table["fix"][at, 0], table["fix"][at, 1]
    apart = np.hypot(np.diff(x, prepend=np.inf), np.diff(y, prepend=np.inf)) > _APART
    return at[apart], drive[apart]


def _away(x: Array, y: Array, edge: NDArray[np.int32], roads: Roads) -> Array:
    """How far places, (k,) in the plane, are from the lines of edges, m."""
    vertices, edges = roads.vertices.view(np.ndarray), roads.edges.view(np.ndarray)
    begin = edges["first_vertex"][edge].astype(np.int64)
    count = edges["last_vertex"][edge] - begin
    of = np.repeat(np.arange(len(edge)), count)
    starts = np.cumsum(count) - count
    a = np.arange(len(of)) - starts[of] + begin[of]
    ax, ay = vertices["x"][a], vertices["y"][a]
    dx, dy = vertices["x"][a + 1] - ax, vertices["y"][a + 1] - ay
    px, py = x[of] - ax, y[of] - ay
    share = ((px * dx + py * dy) / np.maximum(dx * dx + dy * dy, 1e-12)).clip(0.0, 1.0)
    return np.asarray(np.minimum.reduceat(np.hypot(px - share * dx, py - share * dy), starts))


def _snapped(share: float) -> Finding:
    return Finding(
        "snapped places", "information", share, 0.0, _SHARE,
        "most places lie on the centre lines of this map, where somebody has put them: their true "
        "errors do not show, and the probabilities are those of that choice; give the places as "
        f"they were measured, or else errors of {_SIGMA:.0f} m (sigma_m)",
    )  # fmt: skip
