"""Wheels, odometers and yaw rates: cumulative distance and turn of M.

Everything is kept cumulative, so that the quantisation of wheel counts telescopes
instead of piling up as white noise per step.
"""

import math
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from ..filter.motion import arc_chord
from ..filter.vetting.windows import BY_GYRO, GYRO_ALONE, HEARD_AGAIN, UNTURNED
from ..observations import (
    Array,
    Distance,
    Fixes,
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
from .beside_wheels import beside_wheels
from .even_steps import even_log
from .gyro_turns import turns_at
from .takeover import Takeover
from .validation import BACKS, FASTEST, UNSEEN, Skipped

Rate = TypeVar("Rate", float, Array)

_JITTER = 0.02  # s, by which readings come too close together
_NONE = (0.0, 0.0)
_JUMP = "odometry jumped (bridged)"


class Motion(NamedTuple):
    """Cumulative odometry of M, the middle of the rear axle, shape (n,) each."""

    time: Array  # s
    distance: Array  # m, falling in reverse
    turn: Array | None  # rad, counter-clockwise; None where nothing measures it
    gyro: bool = False  # whether a gyro alone measures it: its drift runs in time
    by: Array | None = None  # (n,) what measures each step, as `filter.vetting.windows` counts it
    takeover: Takeover | None = None  # of a gyro beside wheels: which of them is wrong
    least_speed: float = 0.0  # m/s, below which it reads 0; 0: there is no such
    counted: bool = False  # it is counted, not a sum of speeds
    unsure: Array | None = None  # (n,) m², of each way beyond what is usual, of coarse steps
    tick: float = 0.0  # rad that ticks of the wheels that measure it resolve (`turn_of_ticks`)

    def unsure_at(self, time: Array) -> Array | float:
        """Variance of the way to each moment beyond what is usual, m², (n,), or to all of them."""
        if self.unsure is None:
            return 0.0
        summed = np.interp(time, self.time, np.cumsum(self.unsure))
        return np.diff(summed, prepend=summed[0])


def _integral(time: Array, rate: Array) -> Array:
    """Cumulative trapezoidal integral, 0 at the first row."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(steps)])


def motion_of(log: OdometryLog, vehicle: Vehicle, fixes: Fixes | None = None) -> Motion:
    """Cumulative distance and turn from any odometry (paper, §2.1).

        δs = (δright + δleft) / 2,   δθ = (δright − δleft) / track width

    Args:
        log: Rear-wheel counts or speeds, an odometer, or speed and yaw rate.
        vehicle: Metres per count and track width.
        fixes: Those that may tell whether wheels or a gyro beside them turn as the vehicle does.

    Returns:
        Cumulative motion at the log's own times.
    """
    match log:
        case WheelCounts():
            left = (log.left - log.left[0]) * vehicle.metres_per_tick_left
            right = (log.right - log.right[0]) * vehicle.metres_per_tick_right
        case WheelSpeeds():
            by_left, by_right = wheel_scales(vehicle)
            left = by_left * _integral(log.time, log.left)
            right = by_right * _integral(log.time, log.right)
        case Odometer():
            even, unsure = even_log(log)
            distance = vehicle.odometer_scale * (even.distance - even.distance[0])
            return Motion(log.time, distance, None, unsure=unsure)
        case SpeedYawRate():
            distance = vehicle.odometer_scale * _integral(log.time, log.speed)
            turn = _integral(log.time, true_rate(log.yaw_rate, vehicle))
            return Motion(log.time, distance, turn, gyro=True)
        case WithGyro():
            gyro = replace(log.gyro, rate=true_rate(log.gyro.rate, vehicle))
            motion = motion_of(log.distance, vehicle)
            if motion.turn is None or len(motion.time) < 2:
                return _with_gyro(motion, gyro)
            one = beside_wheels(*motion[:3], gyro, vehicle.track_width, fixes)  # type: ignore[arg-type]
            if not isinstance(log.distance, WheelCounts):  # speeds tell nothing of a silence
                one.by[one.by == HEARD_AGAIN] = GYRO_ALONE
            return Motion(one.time, one.distance, one.turn, by=one.by, takeover=one.takeover)
    tick = turn_of_ticks(vehicle) if isinstance(log, WheelCounts) else 0.0
    turn = (right - left) / vehicle.track_width
    return Motion(log.time, 0.5 * (left + right), turn, tick=tick)


def turn_of_ticks(vehicle: Vehicle) -> float:
    """The turn that counters of wheels resolve, rad: a tick of each wheel, independently."""
    ticks = vehicle.metres_per_tick_left, vehicle.metres_per_tick_right
    return math.hypot(*ticks) / vehicle.track_width


def true_rate(rate: Rate, vehicle: Vehicle) -> Rate:
    """A yaw rate as the gyro measured it, rad/s, less its bias and by its scale."""
    return vehicle.gyro_scale * (rate - vehicle.gyro_bias)


def wheel_scales(vehicle: Vehicle) -> tuple[float, float]:
    """Metres of the left and of the right wheel for each that its speed says."""
    ratio = vehicle.right_over_left
    left = 2.0 * vehicle.odometer_scale / (1.0 + ratio)
    return left, ratio * left


def _with_gyro(motion: Motion, gyro: YawRates) -> Motion:
    """An odometer's distance, and the turn by the gyro from reading to reading, where it is known.

    Distance is not interpolated to a quicker gyro: the speed would jump at every reading.
    """
    turned, near = turns_at(motion.time, gyro)
    steps = np.diff(turned, prepend=turned[:1])
    heard = near & np.concatenate([near[:1], near[:-1]])
    turn = np.cumsum(np.where(heard, steps, 0.0))
    by = np.where(heard, BY_GYRO, UNTURNED)
    return motion._replace(turn=turn, gyro=True, by=by)


def nearest_step(step: float, modulus: float, expected: float) -> float:
    """Of the steps that a counter of so many counts cannot tell apart the nearest to another."""
    return step + modulus * round((expected - step) / modulus)


def _unwrapped(before: float, now: float, car: Vehicle, expected: float) -> float:
    """Counts from one reading of a wheel to the next; beyond the counter's bits none wrap."""
    modulus = 2.0**car.counter_bits
    if min(before, now) < -0.5 * modulus or max(before, now) >= modulus:
        return now - before
    return nearest_step(now - before, modulus, expected)


def step_between(
    before: Observation, reading: Observation, car: Vehicle, expected: tuple[float, float] = _NONE
) -> tuple[float, float]:
    """The same of two readings of one sensor that follow one another.

    Args:
        before: The earlier one.
        reading: The later one, of the same kind.
        car: Metres per count, width of counters and of the track.
        expected: What a counter that may have wrapped more than once is likely to say, m and rad.

    Returns:
        Distance (m, negative in reverse) and turn (rad, counter-clockwise; 0 of an
        odometer, which measures none).
    """
    dt = reading.time - before.time
    match reading, before:
        case WheelTicks(), WheelTicks():
            left, right = car.metres_per_tick_left, car.metres_per_tick_right
            if car.counter_bits:
                arc, half = expected[0], 0.5 * expected[1] * car.track_width
                left *= _unwrapped(before.left, reading.left, car, (arc - half) / left)
                right *= _unwrapped(before.right, reading.right, car, (arc + half) / right)
            else:
                left *= reading.left - before.left
                right *= reading.right - before.right
        case WheelSpeed(), WheelSpeed():
            by_left, by_right = wheel_scales(car)
            left = by_left * 0.5 * (reading.left + before.left) * dt
            right = by_right * 0.5 * (reading.right + before.right) * dt
        case Distance(), Distance():
            left = right = car.odometer_scale * (reading.distance - before.distance)
        case SpeedYaw(), SpeedYaw():
            rate = true_rate(0.5 * (reading.yaw_rate + before.yaw_rate), car)
            half = 0.5 * rate * dt * car.track_width
            middle = 0.5 * car.odometer_scale * (reading.speed + before.speed) * dt
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
    gap: bool = False,
) -> tuple[float, float, int]:
    """`step_between`; a step that no car can make is as the motion before it, and counted.

    Args:
        before: The earlier reading.
        reading: The later one, of the same kind.
        car: Metres per count and track width.
        rate: What moves it, m/s and rad/s.
        skipped: Counts the jumps.
        gap: Whether it is so long after that a short counter may have wrapped more than once.

    Returns:
        Distance and turn, and whether they were measured.
    """
    dt = reading.time - before.time
    expected = (rate[0] * dt, rate[1] * dt) if gap else _NONE
    arc, turn = step_between(before, reading, car, expected)
    began_anew = dt > UNSEEN and arc < -BACKS * dt and rate[0] >= 0.0
    possible = abs(arc) + 0.5 * abs(turn) * car.track_width <= FASTEST * (dt + _JITTER)
    if possible and not began_anew:
        return arc, turn, 1
    skipped[_JUMP] = skipped.get(_JUMP, 0) + 1
    return rate[0] * dt, rate[1] * dt, 0


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
