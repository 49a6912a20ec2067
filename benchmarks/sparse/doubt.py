"""Where the hand-made truth of a real track contradicts its own fixes.

A receiver good to a few metres at 1 Hz runs steadily beside some stretches of a true route,
where the map lacked the road that was driven, or its connection.  Who matches such a stretch
well is counted wrong.
"""

from typing import Any

import numpy as np

FAR = 15.0  # m between a fix at 1 Hz and the true route, from which on the route is in doubt


def undoubted(
    metrics: Any, fixes: np.ndarray, true: list[Any], found: list[Any]
) -> dict[str, float]:
    """What is wrong where the truth agrees with the fixes.

    Args:
        metrics: The harness's module.
        fixes: (n, 2) positions at 1 Hz, plane, m.
        true: Lines of the true route.
        found: Lines of the route found.

    Returns:
        `wrong`, metres missed and extra, and `d0`, metres driven, both without those whose
        nearest fix is far from the true route.
    """
    from scipy.spatial import cKDTree

    driven, said = metrics.densify(true), metrics.densify(found)
    far = cKDTree(driven[:, :2]).query(fixes)[0] > FAR
    tree = cKDTree(fixes)
    sure = ~far[tree.query(driven[:, :2])[1]]
    d0 = float(driven[sure, 3].sum())
    if not len(said):
        return {"wrong": d0, "d0": d0}
    missed = sure & uncovered(metrics, driven, said)
    extra = ~far[tree.query(said[:, :2])[1]] & uncovered(metrics, said, driven)
    return {"wrong": float(driven[missed, 3].sum() + said[extra, 3].sum()), "d0": d0}


def uncovered(metrics: Any, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Which samples of a b does not cover, as the harness counts it."""
    from scipy.spatial import cKDTree

    tree = cKDTree(metrics._embed(b))
    gap, _ = tree.query(metrics._embed(a), distance_upper_bound=metrics.NEAR * np.sqrt(2))
    return ~np.isfinite(gap)
