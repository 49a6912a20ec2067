"""A filter of how late fixes are, beside the mixture: what they err anyway, the delay, smoothing.

Its states are the error of fixes less the way by odometry (two axes, m), the delay (s), and what
only lasts while the velocity changes, as receivers that smooth their fixes lag then (s²).
"""

from typing import NamedTuple

import numpy as np

from ..._compile import Record, Vector, kernel

_STATES = 4
DELAY, _SMOOTHING = 2, 3  # states beside the two axes
_PRIOR = (2.0, 2.0)  # s, s²: sigmas of these
_AT_FIRST, _NEW = 2.0, 1.0 / 16.0  # usual chi-square an axis; share of a new one
_GATE = 25.0  # chi-square of two axes, from which on the error of fixes has jumped
ANYWHERE, _OTHER_DELAY = 1e4, 0.3  # m² of its place then; s by which the delay may differ
ASSUMED = 0.5  # s, sigma of a delay that was found before

ESTIMATE = np.dtype(
    [
        ("state", "f8", (_STATES,)),
        ("cov", "f8", (_STATES, _STATES)),
        ("row", "f8", (2, _STATES)),  # buffers of one observation, for both axes
        ("gain", "f8", (2, _STATES)),
        ("misfit", "f8"),  # usual chi-square an axis
    ],
    align=True,
)


class Delayed(NamedTuple):
    """Motion of the vehicle about the time that a fix held, plane, true metres."""

    delay: float  # s, for which this is
    dx: float  # way since then, m
    dy: float
    vx: float  # velocity then, m/s
    vy: float
    ax: float  # its change in the seconds before, m/s²
    ay: float


@kernel
def begin(estimate: Record) -> None:
    """Begin: nothing is known."""
    estimate.misfit = _AT_FIRST
    for i in range(_STATES):
        estimate.state[i] = 0.0
        for j in range(_STATES):
            estimate.cov[i, j] = 0.0
    for i in range(2):
        estimate.cov[i, i] = ANYWHERE
        estimate.cov[DELAY + i, DELAY + i] = _PRIOR[i] ** 2


@kernel
def begin_at(estimate: Record, delay: float) -> None:
    """Begin anew at a delay, s."""
    misfit = estimate.misfit
    begin(estimate)
    estimate.misfit = misfit
    estimate.state[DELAY] = delay
    estimate.cov[DELAY, DELAY] = ASSUMED**2


@kernel
def free(estimate: Record, variance: float) -> None:
    """Let the error of fixes change."""
    estimate.cov[0, 0] += variance
    estimate.cov[1, 1] += variance


@kernel
def stretch(estimate: Record, x: float, y: float) -> None:
    """Let the error of fixes change along a way, by so much (m, one sigma)."""
    estimate.cov[0, 0] += x * x
    estimate.cov[0, 1] += x * y
    estimate.cov[1, 0] += x * y
    estimate.cov[1, 1] += y * y


@kernel
def _observe(estimate: Record, error: Vector, then: Delayed, axis: int) -> float:
    """Innovation of one axis; sets its row, and the gain times its variance."""
    row = estimate.row[axis]
    row[0] = 1.0 - axis
    row[1] = axis
    row[DELAY] = -then.vx if axis == 0 else -then.vy
    row[_SMOOTHING] = -then.ax if axis == 0 else -then.ay
    off = error[axis] + (then.dx if axis == 0 else then.dy) + row[DELAY] * then.delay
    for i in range(_STATES):
        estimate.gain[axis, i] = 0.0
        for j in range(_STATES):
            estimate.gain[axis, i] += estimate.cov[i, j] * row[j]
        off -= row[i] * estimate.state[i]
    return float(off)


@kernel
def update_delay(estimate: Record, error: Vector, then: Delayed, white: float) -> bool:
    """Kalman update by a fix; one that fits nothing says that its error has jumped: true."""
    x = _observe(estimate, error, then, 0)
    y = _observe(estimate, error, then, 1)
    gain = estimate.gain
    xx = yy = white
    xy = 0.0
    for i in range(_STATES):
        xx += gain[0, i] * estimate.row[0, i]
        xy += gain[0, i] * estimate.row[1, i]
        yy += gain[1, i] * estimate.row[1, i]
    det = xx * yy - xy * xy
    chi2 = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / det
    estimate.misfit += _NEW * (0.5 * min(chi2, _GATE) - estimate.misfit)
    if chi2 > _GATE:  # or the delay is another one
        free(estimate, ANYWHERE)
        estimate.cov[DELAY, DELAY] += _OTHER_DELAY**2
        return True
    for i in range(_STATES):
        by_x = (yy * gain[0, i] - xy * gain[1, i]) / det
        by_y = (xx * gain[1, i] - xy * gain[0, i]) / det
        estimate.state[i] += by_x * x + by_y * y
        for j in range(_STATES):
            estimate.cov[i, j] -= by_x * gain[0, j] + by_y * gain[1, j]
    return False
