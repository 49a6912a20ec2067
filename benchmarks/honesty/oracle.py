"""The exact test between two roads from positions alone, all noise known in distribution.

It projects every fix on both roads.  The lateral offsets of one drive are then jointly
normal, with a dense covariance that the simulator's settings give exactly: receiver
(Gauss-Markov, stopped with the car, and white), map (both fields), lane and driver.  The
test is told this drive's receiver; it does not know of changes of lane and of multipath.
"""

import math
from functools import cache

import numpy as np
from scipy.special import j0

from whichroad.simulate import SimulationSettings
from whichroad.simulate.scenes import Scene
from whichroad.simulate.vectorised import ANGLE, BIAS, RATIO, Line

from .score import DECLARED

_FARTHEST = 2000  # m, of the tables of covariance


@cache
def _field(sigma: float, shortest: float, longest: float) -> np.ndarray:
    """Covariance of a field of `map_error_field` at 0, 1, 2 ... m, m².

    Waves in all directions, wavelengths log-uniform: the mean of J0(2 pi r / wavelength).
    """
    r = np.arange(_FARTHEST + 1.0)[:, None]
    wave = np.exp(np.linspace(math.log(shortest), math.log(longest), 200))
    table: np.ndarray = sigma**2 * j0(2.0 * np.pi * r / wave).mean(axis=1)
    return table


def lateral(line: Line, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance (m, right positive) from a line to points (n,), and the place there."""
    at = np.argmin((x[:, None] - line.x) ** 2 + (y[:, None] - line.y) ** 2, axis=1)
    low, high = np.maximum(at - 1, 0), np.minimum(at + 1, len(line.x) - 1)
    tx, ty = line.x[high] - line.x[low], line.y[high] - line.y[low]
    size = np.hypot(tx, ty)
    across = ((x - line.x[at]) * ty - (y - line.y[at]) * tx) / size
    return across - line.lane[at], at


def covariance(
    line: Line, at: np.ndarray, moving: np.ndarray, drawn: np.ndarray, how: SimulationSettings
) -> np.ndarray:
    """Of the lateral offsets at places `at` (n,) of the driven line, `moving` s on the way."""
    tx, ty = np.gradient(line.x)[at], np.gradient(line.y)[at]
    size = np.hypot(tx, ty)
    nx, ny = ty / size, -tx / size
    turned = np.outer(nx, nx) + np.outer(ny, ny)
    apart = np.hypot(line.x[at][:, None] - line.x[at], line.y[at][:, None] - line.y[at])
    apart = np.minimum(np.rint(apart).astype(int), _FARTHEST)
    absolute = _field(how.map_sigma, how.map_shortest, how.map_longest)
    relative = _field(how.relative_sigma, how.relative_shortest, how.relative_longest)
    cov = (absolute + relative)[apart] * turned
    along = line.along[at]
    stray = np.exp(-np.abs(along[:, None] - along) / how.lane_length)
    cov += how.lane_sigma**2 * stray
    cov += how.street_sigma**2 * (line.street[at][:, None] == line.street[at])
    c, s = math.cos(drawn[ANGLE]), math.sin(drawn[ANGLE])
    ratio = drawn[RATIO]
    major2 = 2.0 * ratio**2 / (1.0 + ratio**2)
    minor2 = 2.0 / (1.0 + ratio**2)
    p, q = c * nx + s * ny, c * ny - s * nx
    shape = major2 * np.outer(p, p) + minor2 * np.outer(q, q)
    slow = drawn[BIAS] ** 2 * np.exp(-np.abs(moving[:, None] - moving) / how.gnss_time)
    return cov + shape * (slow + how.gnss_white**2 * np.eye(len(at)))


def log_ratio(
    scene: Scene, driven: int, x: np.ndarray, y: np.ndarray, moving: np.ndarray,
    drawn: np.ndarray, how: SimulationSettings,
) -> np.ndarray:  # fmt: skip
    """Log-likelihood of the driven road less that of the other after each fix, (n,).

    Args:
        scene: With two routes.
        driven: Which of them is driven.
        x: (n,) m, fixes less the antenna's lever arm.
        y: (n,)
        moving: (n,) s, the clock of the receiver's slow error.
        drawn: What this drive's receiver is.
        how: The noise.
    """
    mine, at = lateral(scene.routes[driven].line, x, y)
    other, _ = lateral(scene.routes[1 - driven].line, x, y)
    cov = covariance(scene.routes[driven].line, at, moving, drawn, how)
    root = np.linalg.cholesky(cov)
    white = np.linalg.solve(root, np.column_stack([mine, other]))
    ratio: np.ndarray = np.cumsum(0.5 * (white[:, 1] ** 2 - white[:, 0] ** 2))
    return ratio


def declares(ratio: np.ndarray, after: np.ndarray) -> tuple[bool, bool, int]:
    """Whether the test declares a road among fixes `after` (n,), a wrong one, and at which."""
    enough = math.log(DECLARED / (1.0 - DECLARED))
    sure = np.flatnonzero(after & (np.abs(ratio) >= enough))
    if len(sure) == 0:
        return False, False, -1
    return True, bool(ratio[sure[0]] < 0.0), int(sure[0])
