"""Drives whose truth is exact: straight pieces and circular arcs, wheels without an error."""

import math
from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from whichroad._compile import Records
from whichroad.filter.state import new_epochs

Array = NDArray[np.float64]


class Truth(NamedTuple):
    """Where M was, (n,) each."""

    time: Array  # s
    x: Array  # m, plane
    y: Array
    heading: Array  # rad, not wrapped
    s: Array  # m driven


def _pieces(corners: Array, radius: float) -> list[tuple[float, float]]:
    """Length and curvature of what lies between the first and the last corner."""
    legs = np.diff(corners, axis=0)
    length = np.hypot(*legs.T)
    heading = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    pieces, cut = [], 0.0
    for i, turn in enumerate(np.diff(heading)):
        tangent = radius * math.tan(abs(turn) / 2.0)
        pieces.append((length[i] - cut - tangent, 0.0))
        pieces.append((radius * abs(turn), math.copysign(1.0 / radius, turn)))
        cut = tangent
    return [*pieces, (length[-1] - cut, 0.0)]


def drive_along(
    corners: ArrayLike, *, radius: float = 9.0, speed: float = 10.0, interval: float = 0.1,
    margin: float = 5.0,
) -> Truth:  # fmt: skip
    """Follow a line at constant speed, its corners rounded.

    Args:
        corners: (n, 2) m.
        radius: Of the circles that round the corners, m.
        speed: m/s.
        interval: Between epochs, s.
        margin: Left out at both ends, m.
    """
    corners = np.asarray(corners, float)
    pieces = np.array(_pieces(corners, radius))
    ends = np.concatenate([[0.0], np.cumsum(pieces[:, 0])])
    s = np.arange(margin, ends[-1] - margin, speed * interval)
    at = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(pieces) - 1)
    x0, y0 = corners[0]
    h0 = math.atan2(*(corners[1] - corners[0])[::-1])
    starts = [(x0, y0, h0)]
    for size, bend in pieces:
        starts.append(_advance(*starts[-1], size, bend))
    of, bends = at.tolist(), pieces[at, 1].tolist()
    sizes = (s - ends[at]).tolist()
    pose = np.array([_advance(*starts[a], v, b) for a, v, b in zip(of, sizes, bends, strict=True)])
    return Truth(np.arange(len(s)) * interval, *pose.T, s - s[0])


def brake(
    truth: Truth, at: int, standing: int, *, goes_on: bool = False
) -> tuple[Truth, NDArray[np.int64]]:
    """Brake by 5 m/s² until an epoch of a drive at 10 m/s, ten a second, and stand there.

    Args:
        truth: The drive.
        at: Where it stops; 10 or more.
        standing: Epochs for which it stands.
        goes_on: Whether it then starts by as much and drives on.

    Returns:
        The drive with the stop, and for each of its epochs the nearest one of the drive before.
    """
    braking = np.arange(20) - 0.025 * np.arange(20) ** 2
    parts = [np.arange(at - 10), at - 10 + braking, np.full(standing, at)]
    if goes_on:
        parts += [(at + 10 - braking)[::-1], np.arange(at + 11, len(truth.time))]
    rows = np.concatenate(parts)
    every_row = np.arange(len(truth.time))
    columns = [np.interp(rows, every_row, column) for column in truth[1:]]
    return Truth(np.arange(len(rows)) * 0.1, *columns), np.rint(rows).astype(int)


def _advance(x: float, y: float, h: float, size: float, bend: float) -> tuple[float, float, float]:
    half = 0.5 * size * bend
    chord = size * (math.sin(half) / half if half else 1.0)
    return x + chord * math.cos(h + half), y + chord * math.sin(h + half), h + 2.0 * half


def wandering(noise: Array, keep: float) -> Array:
    """An error of unit variance that keeps so much of itself from row to row, of white noise."""
    fresh = math.sqrt(1.0 - keep * keep) * noise
    fresh[0] = noise[0]
    columns = [accumulate(column, lambda a, b: keep * a + b) for column in fresh.T.tolist()]
    return np.column_stack([list(column) for column in columns])


def gnss(truth: Truth, *, sigma: float = 3.0, seed: int = 0, constant: float = 60.0) -> Array:
    """Fixes (n, 5) at every epoch: a slowly wandering error and a little white noise."""
    rng = np.random.default_rng(seed)
    n = len(truth.time)
    keep = math.exp(-(truth.time[1] - truth.time[0]) / constant)
    bias = wandering(rng.normal(0.0, 1.0, (n, 2)), keep)
    error = sigma * (bias + 0.5 * rng.normal(0.0, 1.0, (n, 2)))
    return np.column_stack(
        [truth.x + error[:, 0], truth.y + error[:, 1], np.full((n, 2), sigma), np.zeros(n)]
    )


def epochs_of(
    truth: Truth, fix: Array, at: Sequence[int] | NDArray[np.int64], *, course: float = math.inf
) -> Records:
    """Perfect wheels at every epoch, fixes at some.

    Args:
        truth: The drive.
        fix: (n, 5) fixes, of which those `at` are used.
        at: Epochs with a fix.
        course: Sigma of the true heading that the first fix reports, rad.
    """
    n = len(truth.time)
    dx, dy = np.diff(truth.x, prepend=truth.x[0]), np.diff(truth.y, prepend=truth.y[0])
    before = np.concatenate([truth.heading[:1], truth.heading[:-1]])
    epochs = new_epochs(n)
    epochs.time = truth.time
    epochs.arc = np.diff(truth.s, prepend=truth.s[0])
    epochs.turn = np.diff(truth.heading, prepend=truth.heading[0])
    epochs.forward = np.cos(before) * dx + np.sin(before) * dy
    epochs.left = -np.sin(before) * dx + np.cos(before) * dy
    epochs.odometry_valid = 1
    epochs.has_fix[at] = 1
    epochs.fix[at] = fix[at]
    epochs.speed_sigma = epochs.course_sigma = np.inf
    epochs.course = truth.heading
    epochs.course_sigma[at[0]] = course
    return epochs
