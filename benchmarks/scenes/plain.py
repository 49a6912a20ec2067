"""Plain sensors on a given path: wheels and errors of fixes with no code of the simulator."""

import numpy as np
from numpy.typing import NDArray

from whichroad.geodesy.plane import Plane
from whichroad.observations import Drive, Fixes, WheelSpeeds
from whichroad.settings import Vehicle
from whichroad.simulate.map_builder import ORIGIN

Array = NDArray[np.float64]

CAR = Vehicle()
STEP = 0.1  # s, between readings of the wheels
_PLANE = Plane(*ORIGIN)
_SIGMAS, _TIMES = (3.0, 6.0), (20.0, 120.0)  # m, s: of a receiver's slow error
_WHITE = 0.5  # m
_WHEEL = 0.003  # relative error of a wheel speed


def markov(n: int, sigma: float, keep: float, rng: np.random.Generator) -> Array:
    """A Gauss-Markov sequence, (n,)."""
    out = rng.normal(0.0, sigma, n)
    for k in range(1, n):
        out[k] = keep * out[k - 1] + np.sqrt(1.0 - keep * keep) * out[k]
    return out


def along(line: Array, speed: float) -> tuple[Array, Array, Array, Array]:
    """A path along a polyline with its corners rounded: distance, x, y (m), heading (rad)."""
    marks = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    s = np.arange(0.0, marks[-1], STEP * speed)
    reach = max(round(8.0 / (STEP * speed)), 1)  # m on both sides of a corner
    width = np.full(2 * reach + 1, 1.0 / (2 * reach + 1))
    x, y = (
        np.convolve(np.pad(np.interp(s, marks, column), reach, mode="edge"), width, mode="valid")
        for column in line.T
    )
    s, x, y = s[reach:-reach], x[reach:-reach], y[reach:-reach]
    return s, x, y, np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))


def sense(x: Array, y: Array, rng: np.random.Generator) -> Drive:
    """A drive on a path, a position every 0.1 s: wheel speeds, and a fix every second.

    The receiver's error is slow and white noise; what it reports is right.
    """
    vx, vy = np.gradient(x, STEP), np.gradient(y, STEP)
    speed, turn = np.hypot(vx, vy), np.gradient(np.unwrap(np.arctan2(vy, vx)), STEP)
    half, noise = 0.5 * CAR.track_width, 1.0 + rng.normal(0.0, _WHEEL, (2, len(x)))
    time = 1.6e9 + STEP * np.arange(len(x))
    wheels = WheelSpeeds(time, (speed - half * turn) * noise[0], (speed + half * turn) * noise[1])
    at = np.arange(int(rng.integers(10)), len(x), 10)
    n, keep, sigma = len(at), np.exp(-1.0 / rng.uniform(*_TIMES)), rng.uniform(*_SIGMAS)
    ex, ey = (markov(n, sigma, keep, rng) + rng.normal(0.0, _WHITE, n) for _ in range(2))
    lat, lon = _PLANE.to_geodetic(x[at] + ex, y[at] + ey)
    reported, zero, none = np.full(n, sigma**2 + _WHITE**2), np.zeros(n), np.full(n, np.inf)
    fixes = Fixes(
        time[at], np.asarray(lat), np.asarray(lon), reported, zero, reported, zero, none, zero,
        none, np.zeros(n, np.uint8),
    )  # fmt: skip
    return Drive("plain", fixes, wheels)
