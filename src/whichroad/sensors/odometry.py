"""Wheels, odometers and yaw rates: cumulative distance and turn of M.

Everything is kept cumulative, so that the quantisation of wheel counts telescopes
instead of piling up as white noise per step.
"""

import math
from typing import NamedTuple

import numpy as np

from ..filter.motion import arc_chord
from ..observations import (
    Array,
    Distance,
    Observation,
    Odometer,
    OdometryLog,
    SpeedYaw,
    SpeedYawRate,
    WheelCounts,
    WheelSpeed,
    WheelSpeeds,
    WheelTicks,
    WithGyro,
    YawRates,
)
from ..settings import Vehicle
from .turns import turns_at
from .validation import FASTEST, Skipped

_JITTER = 0.02  # s, by which readings come too close together
_JUMP = "odometry jumped (bridged)"


class Motion(NamedTuple):
    """Cumulative odometry of M, the middle of the rear axle, shape (n,) each."""

    time: Array  # s
    distance: Array  # m, falling in reverse
    turn: Array | None  # rad, counter-clockwise; None where nothing measures it
    gyro: bool = False  # whether a gyro alone measures it: its drift runs in time


def _integral(time: Array, rate: Array) -> Array:
    """Cumulative trapezoidal integral, 0 at the first row."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(steps)])


def motion_of(log: OdometryLog, vehicle: Vehicle) -> Motion:
    """Cumulative distance and turn from any odometry (paper, §2.1).

        δs = (δright + δleft) / 2,   δθ = (δright − δleft) / track width

    Args:
        log: Rear-wheel counts or speeds, an odometer, or speed and yaw rate.
        vehicle: Metres per count and track width.

    Returns:
        Cumulative motion at the log's own times.
    """
    match log:
        case WheelCounts():
            left = (log.left - log.left[0]) * vehicle.metres_per_tick_left
            right = (log.right - log.right[0]) * vehicle.metres_per_tick_right
        case WheelSpeeds():
            left = _integral(log.time, log.left)
            right = _integral(log.time, log.right)
        case Odometer():
            return Motion(log.time, log.distance - log.distance[0], None)
        case SpeedYawRate():
            distance, turn = (_integral(log.time, v) for v in (log.speed, log.yaw_rate))
            return Motion(log.time, distance, turn, gyro=True)
        case WithGyro():
            return _with_gyro(motion_of(log.distance, vehicle), log.gyro)
    return Motion(log.time, 0.5 * (left + right), (right - left) / vehicle.track_width)


def _with_gyro(motion: Motion, gyro: YawRates) -> Motion:
    """An odometer's distance, and the turn by the gyro at its readings, where both are known.

    Distance is not interpolated to a quicker gyro: the speed would jump at every reading.
    """
    turned, near = turns_at(motion.time, gyro)
    return Motion(motion.time[near], motion.distance[near], turned[near], gyro=True)


def step_between(before: Observation, reading: Observation, car: Vehicle) -> tuple[float, float]:
    """The same of two readings of one sensor that follow one another.

    Args:
        before: The earlier one.
        reading: The later one, of the same kind.
        car: Metres per count and track width.

    Returns:
        Distance (m, negative in reverse) and turn (rad, counter-clockwise; 0 of an
        odometer, which measures none).
    """
    dt = reading.time - before.time
    match reading, before:
        case WheelTicks(), WheelTicks():
            left = (reading.left - before.left) * car.metres_per_tick_left
            right = (reading.right - before.right) * car.metres_per_tick_right
        case WheelSpeed(), WheelSpeed():
            left = 0.5 * (reading.left + before.left) * dt
            right = 0.5 * (reading.right + before.right) * dt
        case Distance(), Distance():
            left = right = reading.distance - before.distance
        case SpeedYaw(), SpeedYaw():
            half = 0.25 * (reading.yaw_rate + before.yaw_rate) * dt * car.track_width
            middle = 0.5 * (reading.speed + before.speed) * dt
            left, right = middle - half, middle + half
        case _:
            return 0.0, 0.0
    return 0.5 * (left + right), (right - left) / car.track_width


def bridged_step(
    before: Observation,
    reading: Observation,
    car: Vehicle,
    rate: tuple[float, float],
    skipped: Skipped,
) -> tuple[float, float]:
    """`step_between`; a step that no car can make is as the motion before it, and counted.

    Args:
        before: The earlier reading.
        reading: The later one, of the same kind.
        car: Metres per count and track width.
        rate: What moves it, m/s and rad/s.
        skipped: Counts the jumps.
    """
    dt = reading.time - before.time
    arc, turn = step_between(before, reading, car)
    if abs(arc) + 0.5 * abs(turn) * car.track_width <= FASTEST * (dt + _JITTER):
        return arc, turn
    skipped[_JUMP] = skipped.get(_JUMP, 0) + 1
    return rate[0] * dt, rate[1] * dt


def dead_reckoned(
    pose: tuple[float, float, float], arc: float, turn: float, scale: float = 1.0
) -> tuple[float, float, float]:
    """Equation (1) of the paper, by the filter's own increment: uncorrected odometry.

    Args:
        pose: x, y (plane m) and heading (rad).
        arc: Distance driven, m, negative in reverse.
        turn: Turn, rad.
        scale: Plane metres per true metre there.

    Returns:
        The pose afterwards.
    """
    x, y, heading = pose
    forward, left = arc_chord(arc, turn)
    c, s = math.cos(heading), math.sin(heading)
    return (
        x + scale * (c * forward - s * left),
        y + scale * (s * forward + c * left),
        heading + turn,
    )
