"""What every hypothesis expects of a GNSS fix, and what the fix makes of it."""

import math

from ._jit import Matrix, Vector, kernel, part
from .belief import GX, GY, OFF_ROAD, Belief, H, X, Y
from .gaussian import update_pair
from .rows import add_times, set_times, ten
from .switching import copy_hypothesis


@kernel
def fix_row(
    mean: Vector, row: Vector, fix: Vector, root: Vector, ex: float, ey: float, scale: float,
    lever: Vector,
) -> float:  # fmt: skip
    """Fill the row of one axis (ex, ey) of the fix's ellipse; returns the innovation, m.

    z = p + R(θ) a + S γ + white, along the unit vector e of the axis; `root` is S.
    """
    ax = 0.0
    ay = 0.0
    if lever[0] != 0.0 or lever[1] != 0.0:
        c = math.cos(mean[H])
        s = math.sin(mean[H])
        ax = c * lever[0] - s * lever[1]
        ay = s * lever[0] + c * lever[1]
    row[X] = ex
    row[Y] = ey
    row[H] = -ex * ay + ey * ax
    row[GX] = ex * root[0] + ey * root[1]
    row[GY] = ex * root[1] + ey * root[2]
    dx = (fix[0] - mean[X]) / scale - ax - root[0] * mean[GX] - root[1] * mean[GY]
    dy = (fix[1] - mean[Y]) / scale - ay - root[1] * mean[GX] - root[2] * mean[GY]
    return float(ex * dx + ey * dy)


@kernel
def _seen(cov: Matrix, row: Vector, g: Vector) -> float:
    """Set g = P hᵀ for the row h of a fix; returns h g."""
    set_times(g, row[X], cov[X])
    add_times(g, row[Y], cov[Y])
    add_times(g, row[GX], cov[GX])
    add_times(g, row[GY], cov[GY])
    if row[H] != 0.0:
        add_times(g, row[H], cov[H])
    return _along(row, g)


@kernel
def _along(row: Vector, g: Vector) -> float:
    """Return h g for the row h of a fix."""
    place = row[X] * g[X] + row[Y] * g[Y] + row[H] * g[H]
    return float(place + row[GX] * g[GX] + row[GY] * g[GY])


@part
def foresee(
    belief: Belief, fix: Vector, root: Vector, c: float, s: float, scale: float, lever: Vector,
    row: Vector,
) -> None:  # fmt: skip
    """What every hypothesis expects of a fix along the axes of its ellipse, into scratch.

    Its rows: the two innovations; the variance of the first, the covariance of both, and the
    variance of the second, without the white noise.
    """
    g = ten()
    second = ten()
    for i in range(belief.size[0]):
        cov = belief.cov[i]
        belief.scratch[0, i] = fix_row(belief.mean[i], row, fix, root, c, s, scale, lever)
        belief.scratch[1, i] = fix_row(belief.mean[i], second, fix, root, -s, c, scale, lever)
        belief.scratch[2, i] = _seen(cov, row, g)
        belief.scratch[3, i] = _along(second, g)
        belief.scratch[4, i] = _seen(cov, second, g)


@part
def drop_refuted(belief: Belief, least: float) -> None:
    """Drop the hypotheses on roads that are not worth an update, with their scratch."""
    top = -math.inf
    for i in range(belief.size[0]):
        top = max(top, belief.log_weight[i])
    low = top + math.log(least)
    kept = 0
    for i in range(belief.size[0]):
        if belief.log_weight[i] < low and belief.edge[i] != OFF_ROAD:
            continue
        if kept != i:
            copy_hypothesis(belief, i, kept)
            for a in range(5):
                belief.scratch[a, kept] = belief.scratch[a, i]
        kept += 1
    belief.size[0] = kept


@part
def take_in(
    belief: Belief, i: int, fix: Vector, root: Vector, c: float, s: float, scale: float,
    lever: Vector, row: Vector,
) -> None:  # fmt: skip
    """Condition hypothesis i on both axes of a fix, the second one given the first."""
    mean = belief.mean[i]
    cov = belief.cov[i]
    s0 = belief.scratch[2, i]
    s1 = belief.scratch[4, i]
    g = ten()
    second = ten()
    fix_row(mean, row, fix, root, c, s, scale, lever)
    _seen(cov, row, g)
    fix_row(mean, row, fix, root, -s, c, scale, lever)
    _seen(cov, row, second)
    add_times(second, -belief.scratch[3, i] / s0, g)
    update_pair(
        mean, cov, g, second, belief.scratch[0, i] / s0, belief.scratch[1, i] / s1, s0, s1,
        scale,
    )  # fmt: skip
