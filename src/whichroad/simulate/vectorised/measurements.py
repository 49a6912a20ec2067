"""Measurements of the simulated wheels and receiver."""
# ruff: noqa: NPY002 - compiled code has no other random numbers, and each drive seeds them

import math

import numpy as np

from ..._compile import by_numba, kernel
from ...filter._simd import copy_record
from .buffers import ANGLE, BIAS, DIFFERENTIAL, RATIO, SCALE, TRACK, DriveBuffers, Line, Numbers


@kernel
def _count_wheels(buffers: DriveBuffers, count: int, par: Numbers) -> None:
    """Whole ticks of both rear wheels, and what the nominal car makes of them."""
    truth = buffers.truth
    epochs = buffers.epochs
    drawn = buffers.drawn
    drawn[SCALE] = 1.0 + par.scale_sigma * np.random.normal()
    drawn[DIFFERENTIAL] = par.differential_sigma * np.random.normal()
    drawn[TRACK] = par.track_width * (1.0 + par.track_sigma * np.random.normal())
    tick = par.metres_per_tick
    left_tick = tick * drawn[SCALE] * (1.0 + 0.5 * drawn[DIFFERENTIAL])
    right_tick = tick * drawn[SCALE] * (1.0 - 0.5 * drawn[DIFFERENTIAL])
    left_phase = np.random.random()
    right_phase = np.random.random()
    left_walk = 0.0
    right_walk = 0.0
    left = 0.0
    right = 0.0
    for e in range(count):
        if e > 0:
            size = par.wheel_walk * math.sqrt(truth.travelled[e] - truth.travelled[e - 1])
            left_walk += size * np.random.normal()
            right_walk += size * np.random.normal()
        half = 0.5 * drawn[TRACK] * (truth.heading[e] - truth.heading[0])
        now_left = math.floor((truth.travelled[e] - half + left_walk) / left_tick + left_phase)
        now_right = math.floor((truth.travelled[e] + half + right_walk) / right_tick + right_phase)
        d_left = (now_left - left) * tick if e > 0 else 0.0
        d_right = (now_right - right) * tick if e > 0 else 0.0
        left = now_left
        right = now_right
        arc = 0.5 * (d_left + d_right)
        turn = (d_right - d_left) / par.track_width
        chord = arc if turn == 0.0 else arc * math.sin(0.5 * turn) / (0.5 * turn)
        epoch = epochs[e]
        epoch.arc = arc
        epoch.turn = turn
        epoch.forward = chord * math.cos(0.5 * turn)
        epoch.left = chord * math.sin(0.5 * turn)
        epoch.odometry_valid = 1


@kernel
def _receive(
    line: Line, buffers: DriveBuffers, count: int, every: int, dt: float, par: Numbers
) -> None:
    """A fix each `every` epochs of `dt` s, but where GNSS is masked; errors go on there."""
    truth = buffers.truth
    epochs = buffers.epochs
    drawn = buffers.drawn
    ratio = math.sqrt(par.gnss_axis_ratio)
    size = math.sqrt(0.5 * (ratio**2 + ratio**-2))
    major = ratio / size
    minor = 1.0 / (ratio * size)
    angle = np.random.uniform(-math.pi, math.pi)
    c = math.cos(angle)
    s = math.sin(angle)
    bias = np.random.uniform(par.gnss_bias_low, par.gnss_bias_high)
    u = bias * np.random.normal()
    v = bias * np.random.normal()
    drawn[RATIO] = major / minor
    drawn[ANGLE] = angle
    drawn[BIAS] = bias
    left = 0.0  # s of a multipath episode that are still to come
    false_x = 0.0
    false_y = 0.0
    for e in range(0, count, every):
        if e > 0:
            metres = truth.travelled[e] - truth.travelled[e - every]
            if metres > 0.01:
                keep = math.exp(-every * dt / par.gnss_time)
                driving_sigma = bias * math.sqrt(1.0 - keep * keep)
                u = keep * u + driving_sigma * np.random.normal()
                v = keep * v + driving_sigma * np.random.normal()
            left -= every * dt
            if np.random.random() < par.multipath_rate * metres:
                left = np.random.exponential(par.multipath_time)
                false_x = np.random.normal(0.0, par.multipath_sigma)
                false_y = np.random.normal(0.0, par.multipath_sigma)
        p = major * (u + par.gnss_white * np.random.normal())
        q = minor * (v + par.gnss_white * np.random.normal())
        ex = c * p - s * q + (false_x if left > 0 else 0.0)
        ey = s * p + c * q + (false_y if left > 0 else 0.0)
        reported = par.gnss_reported * math.exp(par.gnss_reported_spread * np.random.normal())
        noise_x = par.gnss_speed_sigma * np.random.normal()
        noise_y = par.gnss_speed_sigma * np.random.normal()
        if line.masked[truth.place[e]]:
            continue
        a = max(e - 1, 0)
        b = min(e + 1, count - 1)
        rate = (truth.heading[b] - truth.heading[a]) / ((b - a) * dt)
        hc = math.cos(truth.heading[e])
        hs = math.sin(truth.heading[e])
        epoch = epochs[e]
        fix = epoch.fix
        fix[0] = truth.x[e] + par.antenna_forward * hc - par.antenna_left * hs + ex
        fix[1] = truth.y[e] + par.antenna_forward * hs + par.antenna_left * hc + ey
        fix[2] = reported * major
        fix[3] = reported * minor
        fix[4] = angle
        ahead = truth.speed[e] - rate * par.antenna_left
        side = rate * par.antenna_forward
        vx = ahead * hc - side * hs + noise_x
        vy = ahead * hs + side * hc + noise_y
        epoch.has_fix = 1
        epoch.speed = math.hypot(vx, vy)
        epoch.speed_sigma = max(par.gnss_speed_sigma, 1e-3)
        if epoch.speed > 1.0:
            epoch.course = math.atan2(vy, vx)
            epoch.course_sigma = max(par.gnss_speed_sigma, 1e-3) / epoch.speed


@kernel
def _thin(buffers: DriveBuffers, count: int, every: int) -> int:
    """Keep the epochs with fixes alone, for drives without odometry; returns how many."""
    truth = buffers.truth
    epochs = buffers.epochs
    n = 0
    for e in range(0, count, every):
        epoch = epochs[n]
        copy_record(epoch, epochs[e])
        epoch.arc = epoch.turn = epoch.forward = epoch.left = 0.0
        epoch.odometry_valid = 0
        truth.x[n] = truth.x[e]
        truth.y[n] = truth.y[e]
        truth.heading[n] = truth.heading[e]
        truth.speed[n] = truth.speed[e]
        truth.travelled[n] = truth.travelled[e]
        truth.place[n] = truth.place[e]
        truth.map_x[n] = truth.map_x[e]
        truth.map_y[n] = truth.map_y[e]
        n += 1
    return n


@by_numba
def sense(line: Line, buffers: DriveBuffers, par: Numbers, count: int, odometry: bool) -> int:
    """Fill the epochs of a drive of `count` epochs; without odometry only those with fixes.

    Goes on with the random numbers that `drive_line` began.
    """
    epochs = buffers.epochs
    dt = 1.0 / par.odometry_rate
    for e in range(count):
        epoch = epochs[e]
        epoch.time = e * dt
        epoch.has_fix = 0
        epoch.speed_sigma = math.inf
        epoch.course_sigma = math.inf
    _count_wheels(buffers, count, par)
    every = round(par.odometry_rate / par.gnss_rate)
    _receive(line, buffers, count, every, dt, par)
    return count if odometry else _thin(buffers, count, every)
