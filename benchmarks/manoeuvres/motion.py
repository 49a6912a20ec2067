"""A vehicle along polylines: its path in its lane, its speed, where it is at each moment.

Speed is held by a cruising speed, by the lateral acceleration in bends, and by what brakes and
engine do.  All begins and ends at rest, so that one leg of a drive can follow another.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

STEP = 0.05  # s, between moments
LANE = 1.75  # m right of the middle of a street
LATERAL, ALONG = 2.5, 1.5  # m/s², at most
_GRID = 0.5  # m, between points of a path
_CHANGE = 15.0  # m, sigma of a change between lanes
_WANDER = 0.3  # m, sigma across the lane
_LASTING = 40.0  # m, sigma of the kernel that makes it slow
_FADE = 30.0  # m, from an end of a leg, where it begins
_REST = 1.0  # s, at both ends of a leg
_JERK = 0.15  # s, sigma of the smoothing of speeds


class Stretch(NamedTuple):
    """A piece of a path."""

    code: int  # directed street, in which the vehicle looks
    line: np.ndarray  # (k, 2) m
    right: float = LANE  # m, by which it drives right of the line


class Path(NamedTuple):
    """Points of a path, `_GRID` apart before corners were rounded."""

    xy: np.ndarray  # (n, 2) m
    code: np.ndarray  # (n,)


@dataclass(frozen=True, slots=True)
class Motion:
    """The middle of the rear axle, (n,) every `STEP`."""

    time: np.ndarray  # s
    x: np.ndarray  # m
    y: np.ndarray
    heading: np.ndarray  # rad, unwrapped, of the vehicle's nose
    rolled: np.ndarray  # m, backwards counts down
    code: np.ndarray  # directed street

    def __len__(self) -> int:
        return len(self.time)

    @property
    def travel(self) -> np.ndarray:
        """m, both ways counted up, (n,)."""
        return np.cumsum(np.abs(np.diff(self.rolled, prepend=self.rolled[0])))

    @property
    def speed(self) -> np.ndarray:
        """m/s, without a sign, (n,)."""
        return np.gradient(self.travel, self.time)


def smoothed(values: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian means of (n,) values, `sigma` samples wide; both ends stay where they are."""
    reach = min(int(4 * sigma), len(values) - 1)
    if reach < 1:
        return values
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    padded = np.pad(values, reach, mode="reflect", reflect_type="odd")
    return np.convolve(padded, kernel / kernel.sum(), "valid")


def path(
    stretches: Sequence[Stretch], random: np.random.Generator, rounding: float = 4.0,
    finish: float = 4.0, wander: float = _WANDER,
) -> Path:  # fmt: skip
    """The path of a vehicle that follows stretches.

    Args:
        stretches: Each begins where the one before ended.
        random: Of this leg.
        rounding: m, sigma of the smoothing of corners of the lines.
        finish: m, that of the vehicle's own path.
        wander: m, sigma across the lane; none at both ends.
    """
    pieces = [_resampled(one.line)[min(k, 1) :] for k, one in enumerate(stretches)]
    counts = [len(piece) for piece in pieces]
    xy = _both(np.concatenate(pieces), rounding)
    right = smoothed(np.repeat([one.right for one in stretches], counts), _CHANGE / _GRID)
    ahead = np.gradient(xy, axis=0)
    ahead /= np.hypot(*ahead.T)[:, None]
    right += _wandering(len(xy), wander, random)
    xy = xy + right[:, None] * np.column_stack([ahead[:, 1], -ahead[:, 0]])
    return Path(_both(xy, finish), np.repeat([one.code for one in stretches], counts))


def _resampled(line: np.ndarray) -> np.ndarray:
    line = np.asarray(line, float)
    marks = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.linspace(0.0, marks[-1], max(round(marks[-1] / _GRID), 1) + 1)
    return np.column_stack([np.interp(at, marks, column) for column in line.T])


def _both(xy: np.ndarray, metres: float) -> np.ndarray:
    return np.column_stack([smoothed(column, metres / _GRID) for column in xy.T])


def _wandering(n: int, sigma: float, random: np.random.Generator) -> np.ndarray:
    """A slow error across the lane, (n,) m, that is none at both ends."""
    width = _LASTING / _GRID
    reach = int(4 * width)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    slow = np.convolve(random.normal(size=n + 2 * reach), kernel, "valid")
    s = _GRID * np.arange(n)
    inside = np.clip(np.minimum(s, s[-1] - s) / _FADE, 0.0, 1.0)
    return sigma * slow / np.sqrt((kernel**2).sum()) * 0.5 * (1.0 - np.cos(np.pi * inside))


def drive(
    way: Path, cruise: float, stops: Sequence[tuple[float, float]] = (), backwards: bool = False,
    lateral: float = LATERAL,
) -> Motion:  # fmt: skip
    """A leg along a path, from rest to rest.

    Args:
        way: Its path; of a leg backwards the way of the rear axle, tail first.
        cruise: m/s.
        stops: m from the start and s, each.
        backwards: Whether the nose looks against the path.
        lateral: m/s², at most.
    """
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way.xy, axis=0).T))])
    heading = smoothed(np.unwrap(np.arctan2(*np.gradient(way.xy, axis=0).T[::-1])), 1.0 / _GRID)
    bend = np.abs(np.gradient(heading, s))
    speed = np.minimum(cruise, np.sqrt(lateral / np.maximum(bend, 1e-6)))
    wait = np.zeros(len(s))
    wait[0] = wait[-1] = _REST
    for metres, seconds in stops:
        wait[np.searchsorted(s, metres)] = seconds
    speed[wait > 0.0] = 0.0
    speed = _within_power(speed, s)
    took = 2.0 * np.diff(s) / (speed[1:] + speed[:-1])
    left = np.concatenate([[0.0], np.cumsum(took)]) + np.cumsum(wait)
    time = np.arange(0.0, left[-1] + STEP, STEP)
    held = np.where(wait > 0.0, 2, 1)  # a stop has two moments
    moments = np.repeat(left, held)
    moments[np.cumsum(held)[wait > 0.0] - 2] -= wait[wait > 0.0]
    at = CubicHermiteSpline(moments, np.repeat(s, held), np.repeat(speed, held))(time)
    at = smoothed(at.clip(0.0, s[-1]), _JERK / STEP)
    x, y, looks = (np.interp(at, s, column) for column in (*way.xy.T, heading))
    code = way.code[np.searchsorted(s, at).clip(0, len(s) - 1)]
    if backwards:
        return Motion(time, x, y, looks + np.pi, -at, code)
    return Motion(time, x, y, looks, at, code)


def _within_power(speed: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Speeds that engine and brakes reach, (n,) m/s."""
    square, gains = speed**2, 2.0 * ALONG * np.diff(s)
    for k in range(1, len(s)):
        square[k] = min(square[k], square[k - 1] + gains[k - 1])
    for k in range(len(s) - 2, -1, -1):
        square[k] = min(square[k], square[k + 1] + gains[k])
    return np.sqrt(square)


def standing(motion: Motion, seconds: float) -> Motion:
    """The same, and at rest at its end."""
    n = round(seconds / STEP)
    time = motion.time[-1] + STEP * np.arange(1, n + 1)
    rest = [np.full(n, column[-1]) for column in _columns(motion)]
    return Motion(
        np.concatenate([motion.time, time]),
        *(np.concatenate(both) for both in zip(_columns(motion), rest, strict=True)),
    )


def joined(first: Motion, *more: Motion) -> Motion:
    """Legs one after another; each begins where the one before stands."""
    for leg in more:
        turns = 2.0 * np.pi * round((first.heading[-1] - leg.heading[0]) / (2.0 * np.pi))
        first = Motion(
            np.concatenate([first.time, first.time[-1] + STEP + leg.time]),
            np.concatenate([first.x, leg.x]),
            np.concatenate([first.y, leg.y]),
            np.concatenate([first.heading, leg.heading + turns]),
            np.concatenate([first.rolled, first.rolled[-1] + leg.rolled]),
            np.concatenate([first.code, leg.code]),
        )
    return first


def _columns(motion: Motion) -> tuple[np.ndarray, ...]:
    return motion.x, motion.y, motion.heading, motion.rolled, motion.code
