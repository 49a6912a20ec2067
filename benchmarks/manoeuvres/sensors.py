"""Sensors of a motion: a receiver, wheel counters, an odometer, speed and yaw rate.

A receiver's error is slow and white; its sigma is told rightly.  Readings are what the filter
takes on line, each with the moment at which it comes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from whichroad import Distance, GeoFix, SpeedYaw, Vehicle, WheelTicks

from ..worlds.drives import START
from ..worlds.maps import Plane
from .motion import Motion

TRACK, PER_TICK = 1.5, 0.0404  # m, as the filter is told
CAR = Vehicle(track_width=TRACK, metres_per_tick_left=PER_TICK, metres_per_tick_right=PER_TICK)
SLOW_TIME = 60.0  # s, in which a receiver forgets its slow error
_PERIOD = 0.1  # s, of odometry
_SCALE, _UNEVEN = 0.007, 4e-4  # of both wheels, of one against the other
_SLIP = 0.003  # m for the root of a metre
_DOPPLER, _REPORTED = 0.1, 0.15  # m/s
_COURSE, _LEAST = 0.005, 1.5  # rad; m/s, below which there is no course
_BIAS, _WALK, _WHITE = 0.002, 1e-5, 0.003  # rad/s of a yaw rate; rad/s for the root of a second
_SPEED_NOISE = 0.03  # m/s
_LEAST_COUNT = 0.1  # m, of an odometer


class Heard(NamedTuple):
    """A reading, and when it comes, s since 1970; its own time may lie."""

    when: float
    reading: GeoFix | WheelTicks | SpeedYaw | Distance


@dataclass(frozen=True, slots=True)
class Receiver:
    """A receiver's errors, m of each axis, and its period."""

    slow: float = 2.0
    white: float = 1.0
    period: float = 1.0  # s

    @property
    def sigma(self) -> float:
        """What it reports, m."""
        return math.hypot(self.slow, self.white)


def of_sigma(sigma: float, period: float = 1.0) -> Receiver:
    """A receiver of that sigma, most of it slow."""
    return Receiver(0.8 * sigma, 0.6 * sigma, period)


def times(motion: Motion, period: float, random: np.random.Generator) -> np.ndarray:
    """Moments from a chance one in the first period on, (n,) s."""
    return np.arange(motion.time[0] + random.uniform(0.0, period), motion.time[-1], period)


def fixes(
    motion: Motion, receiver: Receiver, doppler: bool, plane: Plane, random: np.random.Generator
) -> list[Heard]:
    """What a receiver reports; speed and course where it has Doppler."""
    time = times(motion, receiver.period, random)
    kept = math.exp(-receiver.period / SLOW_TIME)
    fresh = random.normal(size=(len(time), 2)) * math.sqrt(1.0 - kept * kept)
    fresh[0] /= math.sqrt(1.0 - kept * kept)
    error = receiver.slow * lfilter([1.0], [1.0, -kept], fresh, axis=0)
    error += receiver.white * random.normal(size=error.shape)
    true = np.column_stack([np.interp(time, motion.time, c) for c in (motion.x, motion.y)])
    lon, lat = plane.degrees(true + error).T
    plain = [
        GeoFix(t, float(a), float(b), receiver.sigma**2, 0.0, receiver.sigma**2)
        for t, a, b in zip((START + time).tolist(), lat, lon, strict=True)
    ]
    if doppler:
        plain = _with_doppler(plain, motion, time, random)
    return [Heard(one.time, one) for one in plain]


def _with_doppler(
    plain: list[GeoFix], motion: Motion, time: np.ndarray, random: np.random.Generator
) -> list[GeoFix]:
    velocity = np.interp(time, motion.time, np.gradient(motion.rolled, motion.time))
    course = np.interp(time, motion.time, motion.heading) + np.pi * (velocity < 0.0)
    speed = np.abs(velocity + random.normal(0.0, _DOPPLER, len(time)))
    sigma = _REPORTED / np.maximum(np.abs(velocity), _LEAST) + _COURSE
    bearing = 90.0 - np.degrees(course + sigma * random.normal(size=len(time)))
    has_course = np.abs(velocity) > _LEAST
    return [
        replace(
            one, speed=float(v), sigma_speed=_REPORTED, bearing_deg=float(b % 360.0),
            sigma_bearing_deg=math.degrees(s) if known else math.inf,
        )
        for one, v, b, s, known in zip(plain, speed, bearing, sigma, has_course, strict=True)
    ]  # fmt: skip


def wheel_ticks(
    motion: Motion, random: np.random.Generator, factor: np.ndarray | float = 1.0,
    signed: bool = True,
) -> list[Heard]:  # fmt: skip
    """Counters of both rear wheels, backwards down if `signed`; `factor`: they count more, (n,)."""
    metres = np.diff(motion.rolled, prepend=motion.rolled[0])
    turn = np.diff(motion.heading, prepend=motion.heading[0])
    both, uneven = 1.0 + _SCALE * random.normal(), _UNEVEN * random.normal()
    time = times(motion, _PERIOD, random)
    counts = []
    for sign in (-1.0, 1.0):
        rolled = (metres + sign * 0.5 * TRACK * turn) * both * (1.0 + 0.5 * sign * uneven) * factor
        rolled += _SLIP * np.sqrt(np.abs(metres)) * random.normal(size=len(metres))
        rolled = rolled if signed else np.abs(rolled)
        counts.append(np.floor(np.interp(time, motion.time, np.cumsum(rolled)) / PER_TICK))
    rows = zip((START + time).tolist(), *(c.tolist() for c in counts), strict=True)
    return [Heard(t, WheelTicks(t, left, right)) for t, left, right in rows]


def distances(motion: Motion, random: np.random.Generator) -> list[Heard]:
    """An odometer in steps of 10 cm, which counts up backwards too."""
    time = times(motion, _PERIOD, random)
    way = np.interp(time, motion.time, motion.travel) * (1.0 + _SCALE * random.normal())
    steps = np.floor(way / _LEAST_COUNT) * _LEAST_COUNT
    rows = zip((START + time).tolist(), steps.tolist(), strict=True)
    return [Heard(t, Distance(t, metres)) for t, metres in rows]


def yaw_rates(motion: Motion, random: np.random.Generator, signed: bool = True) -> list[Heard]:
    """Speed, backwards negative if `signed`, and a yaw rate with a bias."""
    time = times(motion, _PERIOD, random)
    n = len(time)
    ends = time[:, None] + 0.5 * _PERIOD * np.array([-1.0, 1.0])
    metres, turn = (
        np.diff(np.interp(ends, motion.time, column))[:, 0] / _PERIOD
        for column in (motion.rolled, motion.heading)
    )
    speed = metres * (1.0 + _SCALE * random.normal())
    speed += _SPEED_NOISE * random.normal(size=n) * (np.abs(metres) > 0.1)
    speed = speed if signed else np.abs(speed)
    bias = _BIAS * random.normal() + _WALK * math.sqrt(_PERIOD) * np.cumsum(random.normal(size=n))
    turn += bias + _WHITE * random.normal(size=n)
    rows = zip((START + time).tolist(), speed.tolist(), turn.tolist(), strict=True)
    return [Heard(t, SpeedYaw(t, v, w)) for t, v, w in rows]


Odometry = Callable[[Motion, np.random.Generator], list[Heard]]

SUITES: dict[str, tuple[Odometry | None, bool]] = {
    "wheels": (wheel_ticks, False),
    "yaw": (yaw_rates, False),
    "wheels without a sign": (partial(wheel_ticks, signed=False), False),
    "yaw, speed without a sign": (partial(yaw_rates, signed=False), False),
    "odometer": (distances, False),
    "odometer and Doppler": (distances, True),
    "Doppler": (None, True),
    "fixes": (None, False),
}
"""Sets of sensors: odometry, and whether the receiver reports speed and course."""
