"""Short drives by the ten thousand: one compiled call simulates one, straight into epochs.

The same world as `simulate_drive` (map error in Fourier modes, lanes, corners, wheels,
receiver; the tests compare the two), along lines that were prepared before and without
files, records or degrees.  All kernels stand in this file and call nothing outside it but
NumPy's random numbers, so the compile cache, which knows this file's age, is never stale.
"""

# ruff: noqa: NPY002 - compiled code has no other random numbers, and each drive seeds them

import math
from typing import NamedTuple

import numpy as np

from ..core._jit import Bytes, Ints32, Matrix, Vector, kernel
from ..core.drive import Epochs, new_epochs
from .settings import SimulationSettings

LONGEST = 6000  # grid points of a line, about metres
_MODES = 24  # of each field of the map's error
_COARSE = 5  # grid points between places where the fields are evaluated
_BLEND = 10  # m, half width of four averages: a change of lane has sigma 12 m, as in `course`
_BLEND_SPEED = 14.0  # m/s, and more on roads that are faster than that


class Numbers(NamedTuple):
    """`SimulationSettings` as the kernels take them; the settings say units and meaning."""

    map_sigma: float
    map_shortest: float
    map_longest: float
    relative_sigma: float
    relative_shortest: float
    relative_longest: float
    street_sigma: float
    lane_sigma: float
    lane_length: float
    lane_change_rate: float
    lane_width: float
    pace_sigma: float
    acceleration: float
    braking: float
    lateral_acceleration: float
    stop_probability: float
    stop_time: float
    first_wait: float
    odometry_rate: float
    metres_per_tick: float
    track_width: float
    scale_sigma: float
    differential_sigma: float
    track_sigma: float
    wheel_walk: float
    antenna_forward: float
    antenna_left: float
    gnss_rate: float
    gnss_bias_low: float
    gnss_bias_high: float
    gnss_time: float
    gnss_white: float
    gnss_axis_ratio: float
    gnss_reported: float
    gnss_reported_spread: float
    gnss_speed_sigma: float
    multipath_rate: float
    multipath_sigma: float
    multipath_time: float

    @classmethod
    def of(cls, settings: SimulationSettings) -> "Numbers":
        """Take them from settings."""
        return cls(*(float(getattr(settings, name)) for name in cls._fields))


class Line(NamedTuple):
    """A route prepared for driving: points each metre or so, shape (n,) each.

    Positions are of the centre line in the map's frame, corners rounded already.
    """

    along: Vector  # m along the centre line
    x: Vector  # m, plane
    y: Vector
    lane: Vector  # usual offset right of the centre line, m
    limit: Vector  # usual speed, m/s
    road: Ints32  # number of the road, see `scenes`
    street: Ints32  # 0, 1, ... along the route: each has an offset of its own
    stop: Bytes  # 1: here one may have to stop
    masked: Bytes  # 1: no GNSS
    hidden: Bytes  # 1: the road is missing from the map


class Truth(NamedTuple):
    """What is true at each epoch, shape (n,) each."""

    x: Vector  # m, plane, world frame
    y: Vector
    heading: Vector  # rad, not wrapped
    speed: Vector  # m/s
    travelled: Vector  # m since the drive's start
    place: Ints32  # point of the line
    map_x: Vector  # m, the same place in the map's frame
    map_y: Vector


class Swarm(NamedTuple):
    """Room for one drive, used again and again."""

    epochs: Epochs
    truth: Truth
    grid: Matrix  # (15, LONGEST) see the rows below
    modes: Matrix  # (12, _MODES)
    drawn: Vector  # (8,) what this drive's car and receiver are, see the names below


X, Y, MAP_X, MAP_Y, HEADING, TRAVELLED, SPEED, ARRIVE, DEPART, OFFSET, NX, NY, BEND, A, B = range(
    15
)  # rows of `grid`
SCALE, DIFFERENTIAL, TRACK, BIAS_X, BIAS_Y, RATIO, ANGLE, BIAS = range(8)  # of `drawn`


def _new_truth(n: int) -> Truth:
    x, y, heading, speed, travelled, map_x, map_y = np.zeros((7, n))
    return Truth(x, y, heading, speed, travelled, np.zeros(n, np.int32), map_x, map_y)


def new_swarm(epochs: int = 6000) -> Swarm:
    """Make room for drives of up to so many epochs."""
    return Swarm(
        new_epochs(epochs),
        _new_truth(epochs),
        np.zeros((15, LONGEST)),
        np.zeros((12, _MODES)),
        np.zeros(8),
    )


@kernel
def _draw_field(modes: Matrix, row: int, sigma: float, shortest: float, longest: float) -> None:
    """Six rows: wave vector, cosine and sine amplitudes; as `warp.draw_field`."""
    size = sigma / math.sqrt(_MODES)
    for m in range(_MODES):
        wave = 2 * math.pi / math.exp(np.random.uniform(math.log(shortest), math.log(longest)))
        direction = np.random.uniform(-math.pi, math.pi)
        modes[row, m] = wave * math.cos(direction)
        modes[row + 1, m] = wave * math.sin(direction)
        for part in range(2, 6):
            modes[row + part, m] = np.random.normal(0.0, size)


@kernel
def _warp(modes: Matrix, x: float, y: float) -> tuple[float, float]:
    """World minus map at a point: both fields."""
    dx = 0.0
    dy = 0.0
    for row in (0, 6):
        for m in range(_MODES):
            phase = modes[row, m] * x + modes[row + 1, m] * y
            c = math.cos(phase)
            s = math.sin(phase)
            dx += modes[row + 2, m] * c + modes[row + 4, m] * s
            dy += modes[row + 3, m] * c + modes[row + 5, m] * s
    return dx, dy


@kernel
def _average(values: Vector, work: Vector, n: int, half: int) -> None:
    """Running mean over 2 half + 1 points, twice; what lies beyond the ends is as the ends."""
    for _ in range(2):
        total = (half + 1) * values[0]
        for k in range(1, half + 1):
            total += values[min(k, n - 1)]
        for k in range(n):
            work[k] = total / (2 * half + 1)
            total += values[min(k + half + 1, n - 1)] - values[max(k - half, 0)]
        for k in range(n):
            values[k] = work[k]


@kernel
def _wander(out: Vector, n: int, every: int, sigma: float, length: float) -> None:
    """Add a Gauss-Markov process drawn each `every` points, a smooth curve between."""
    keep = math.exp(-every / length)
    fresh = sigma * math.sqrt(1.0 - keep * keep)
    p = np.random.normal(0.0, sigma)
    q = keep * p + fresh * np.random.normal()
    r = keep * q + fresh * np.random.normal()
    before = p
    k = 0
    while k < n:
        for i in range(min(every, n - k)):
            f = i / every
            out[k + i] += (
                q * f
                + p * (1.0 - f)
                + f * (1.0 - f) * 0.5 * ((1.0 - f) * (2 * p - before - q) + f * (2 * q - p - r))
            )
        before, p, q = p, q, r
        r = keep * q + fresh * np.random.normal()
        k += every


@kernel
def _curve(row: Vector, n: int) -> None:
    """Fill in between each _COARSE-th point by Catmull-Rom; the last is in place too."""
    last = n - 1
    k = 0
    while k < last:
        k1 = min(k + _COARSE, last)
        p0 = row[k - _COARSE] if k >= _COARSE else row[k]
        p1 = row[k]
        p2 = row[k1]
        p3 = row[min(k1 + _COARSE, last)]
        for i in range(1, k1 - k):
            f = i / (k1 - k)
            row[k + i] = p1 + 0.5 * f * (
                p2 - p0 + f * (2 * p0 - 5 * p1 + 4 * p2 - p3 + f * (3 * p1 - p0 - 3 * p2 + p3))
            )
        k = k1


@kernel
def _directions(line: Line, grid: Matrix, n: int) -> None:
    """Normal to the right, and bend (left positive), of the centre line."""
    nx = grid[NX]
    ny = grid[NY]
    bend = grid[BEND]
    for k in range(n):
        a = max(k - 1, 0)
        b = min(k + 1, n - 1)
        dx = line.x[b] - line.x[a]
        dy = line.y[b] - line.y[a]
        step = math.sqrt(dx * dx + dy * dy)
        nx[k] = dy / step
        ny[k] = -dx / step
    for k in range(n):
        a = max(k - 1, 0)
        b = min(k + 1, n - 1)
        cross = nx[a] * ny[b] - ny[a] * nx[b]
        bend[k] = math.asin(min(1.0, max(-1.0, cross))) / (line.along[b] - line.along[a])


@kernel
def _offsets(line: Line, grid: Matrix, n: int, par: Numbers) -> None:
    """Where the car drives beside the centre line: lane, street, visits, the driver's stray."""
    offset = grid[OFFSET]
    bend = grid[BEND]
    own = 0.0
    for k in range(n):
        if k == 0 or line.street[k] != line.street[k - 1]:
            own = np.random.normal(0.0, par.street_sigma)
        offset[k] = line.lane[k] + own
    for _ in range(np.random.poisson(par.lane_change_rate * n)):
        begin = np.random.uniform(0.0, line.along[n - 1])
        end = begin + np.random.uniform(100.0, 400.0)
        for k in range(n):
            if begin < line.along[k] < end and line.limit[k] > 12.0 and abs(bend[k]) < 0.01:
                offset[k] -= par.lane_width
    fast = 0.0
    for k in range(n):
        fast += line.limit[k] / n
    half = round(_BLEND * max(1.0, fast / _BLEND_SPEED))
    _average(offset, grid[A], n, half)
    _average(offset, grid[A], n, half)
    _wander(offset, n, 10, par.lane_sigma, par.lane_length)
    for k in range(n):  # no car follows a bend far inside
        offset[k] = max(offset[k], -0.3 / max(bend[k], 1e-3))
        offset[k] = min(offset[k], 0.3 / max(-bend[k], 1e-3))
    _average(offset, grid[A], n, 4)


@kernel
def _lay(line: Line, swarm: Swarm, n: int, par: Numbers) -> None:
    """The path of M in both frames, its length and heading."""
    grid = swarm.grid
    _directions(line, grid, n)
    _offsets(line, grid, n, par)
    mx = grid[MAP_X]
    my = grid[MAP_Y]
    for k in range(n):
        mx[k] = line.x[k] + grid[OFFSET, k] * grid[NX, k]
        my[k] = line.y[k] + grid[OFFSET, k] * grid[NY, k]
    _draw_field(swarm.modes, 0, par.map_sigma, par.map_shortest, par.map_longest)
    _draw_field(swarm.modes, 6, par.relative_sigma, par.relative_shortest, par.relative_longest)
    k = 0
    while k < n:
        grid[A, k], grid[B, k] = _warp(swarm.modes, mx[k], my[k])
        k = n if k == n - 1 else min(k + _COARSE, n - 1)
    _curve(grid[A], n)
    _curve(grid[B], n)
    x = grid[X]
    y = grid[Y]
    for k in range(n):
        x[k] = mx[k] + grid[A, k]
        y[k] = my[k] + grid[B, k]
    travelled = grid[TRAVELLED]
    heading = grid[HEADING]
    travelled[0] = 0.0
    for k in range(n):
        if k > 0:
            travelled[k] = travelled[k - 1] + math.hypot(x[k] - x[k - 1], y[k] - y[k - 1])
        a = max(k - 1, 0)
        b = min(k + 1, n - 1)
        h = math.atan2(y[b] - y[a], x[b] - x[a])
        if k > 0:
            turn = h - heading[k - 1]
            h -= 2 * math.pi * round(turn / (2 * math.pi))
        heading[k] = h


@kernel
def _pace(line: Line, grid: Matrix, n: int, par: Numbers) -> None:
    """Speed and times at each point: roads, bends, stops, what a car can do."""
    s = grid[TRAVELLED]
    speed = grid[SPEED]
    wait = grid[A]
    pace = grid[B]
    usual = 1.0 + np.random.normal(0.0, par.pace_sigma)
    for k in range(n):
        pace[k] = usual
        wait[k] = 0.0
    _wander(pace, n, 25, par.pace_sigma, 300.0)
    last_stop = 0.0
    for k in range(n):
        bend = abs(grid[HEADING, min(k + 1, n - 1)] - grid[HEADING, max(k - 1, 0)]) / (
            s[min(k + 1, n - 1)] - s[max(k - 1, 0)]
        )
        most = math.sqrt(par.lateral_acceleration / max(bend, 1e-6))
        speed[k] = max(min(line.limit[k] * min(max(pace[k], 0.5), 1.5), most), 1.0)
        if line.stop[k] and np.random.random() < par.stop_probability and s[k] > last_stop + 80.0:
            wait[k] = 1.0 + np.random.exponential(par.stop_time)
            speed[k] = 0.0
            last_stop = s[k]
    speed[0] = 0.0
    speed[n - 1] = 0.0
    wait[0] = par.first_wait
    for k in range(1, n):
        most = speed[k - 1] ** 2 + 2 * par.acceleration * (s[k] - s[k - 1])
        speed[k] = min(speed[k], math.sqrt(most))
    for k in range(n - 2, -1, -1):
        most = speed[k + 1] ** 2 + 2 * par.braking * (s[k + 1] - s[k])
        speed[k] = min(speed[k], math.sqrt(most))
    time = 0.0
    for k in range(n):
        if k > 0:
            time += 2.0 * (s[k] - s[k - 1]) / (speed[k] + speed[k - 1])
        grid[ARRIVE, k] = time
        time += wait[k]
        grid[DEPART, k] = time


@kernel
def _follow(swarm: Swarm, n: int, rate: float) -> int:
    """True motion at `rate` Hz; returns how many epochs."""
    grid = swarm.grid
    truth = swarm.truth
    count = min(int(grid[ARRIVE, n - 1] * rate) + 1, len(truth.x))
    k = 0
    for e in range(count):
        t = e / rate
        while k < n - 2 and grid[DEPART, k + 1] <= t:
            k += 1
        last = grid[ARRIVE, k + 1] - grid[DEPART, k]
        local = min(max(t - grid[DEPART, k], 0.0), last)
        gain = (grid[SPEED, k + 1] - grid[SPEED, k]) / last
        step = grid[TRAVELLED, k + 1] - grid[TRAVELLED, k]
        went = grid[SPEED, k] * local + 0.5 * gain * local * local
        f = min(max(went / step, 0.0), 1.0)
        a = f * (1 - f) ** 2 * step
        b = -f * f * (1 - f) * step
        blend = f * f * (3 - 2 * f)
        h0 = grid[HEADING, k]
        h1 = grid[HEADING, k + 1]
        truth.x[e] = (
            grid[X, k] * (1 - blend) + grid[X, k + 1] * blend + a * math.cos(h0) + b * math.cos(h1)
        )
        truth.y[e] = (
            grid[Y, k] * (1 - blend) + grid[Y, k + 1] * blend + a * math.sin(h0) + b * math.sin(h1)
        )
        truth.heading[e] = h0 + f * (h1 - h0)
        truth.speed[e] = grid[SPEED, k] + gain * local if t >= grid[DEPART, k] else 0.0
        truth.travelled[e] = grid[TRAVELLED, k] + f * step
        truth.place[e] = k
        truth.map_x[e] = grid[MAP_X, k] + f * (grid[MAP_X, k + 1] - grid[MAP_X, k])
        truth.map_y[e] = grid[MAP_Y, k] + f * (grid[MAP_Y, k + 1] - grid[MAP_Y, k])
    return count


@kernel
def _count_wheels(swarm: Swarm, count: int, par: Numbers) -> None:
    """Whole ticks of both rear wheels, and what the nominal car makes of them."""
    truth = swarm.truth
    epochs = swarm.epochs
    drawn = swarm.drawn
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
        epochs.arc[e] = arc
        epochs.turn[e] = turn
        epochs.forward[e] = chord * math.cos(0.5 * turn)
        epochs.left[e] = chord * math.sin(0.5 * turn)
        epochs.moved[e] = 1


@kernel
def _receive(line: Line, swarm: Swarm, count: int, every: int, dt: float, par: Numbers) -> None:
    """A fix each `every` epochs of `dt` s, but where GNSS is masked; errors go on there."""
    truth = swarm.truth
    epochs = swarm.epochs
    drawn = swarm.drawn
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
                fresh = bias * math.sqrt(1.0 - keep * keep)
                u = keep * u + fresh * np.random.normal()
                v = keep * v + fresh * np.random.normal()
            left -= every * dt
            if np.random.random() < par.multipath_rate * metres:
                left = np.random.exponential(par.multipath_time)
                false_x = np.random.normal(0.0, par.multipath_sigma)
                false_y = np.random.normal(0.0, par.multipath_sigma)
        p = major * (u + par.gnss_white * np.random.normal())
        q = minor * (v + par.gnss_white * np.random.normal())
        ex = c * p - s * q + (false_x if left > 0 else 0.0)
        ey = s * p + c * q + (false_y if left > 0 else 0.0)
        says = par.gnss_reported * math.exp(par.gnss_reported_spread * np.random.normal())
        noise_x = par.gnss_speed_sigma * np.random.normal()
        noise_y = par.gnss_speed_sigma * np.random.normal()
        if line.masked[truth.place[e]]:
            continue
        a = max(e - 1, 0)
        b = min(e + 1, count - 1)
        rate = (truth.heading[b] - truth.heading[a]) / ((b - a) * dt)
        hc = math.cos(truth.heading[e])
        hs = math.sin(truth.heading[e])
        fix = epochs.fix[e]
        fix[0] = truth.x[e] + par.antenna_forward * hc - par.antenna_left * hs + ex
        fix[1] = truth.y[e] + par.antenna_forward * hs + par.antenna_left * hc + ey
        fix[2] = says * major
        fix[3] = says * minor
        fix[4] = angle
        ahead = truth.speed[e] - rate * par.antenna_left
        side = rate * par.antenna_forward
        vx = ahead * hc - side * hs + noise_x
        vy = ahead * hs + side * hc + noise_y
        epochs.has_fix[e] = 1
        epochs.speed[e] = math.hypot(vx, vy)
        epochs.speed_sigma[e] = max(par.gnss_speed_sigma, 1e-3)
        if epochs.speed[e] > 1.0:
            epochs.course[e] = math.atan2(vy, vx)
            epochs.course_sigma[e] = max(par.gnss_speed_sigma, 1e-3) / epochs.speed[e]


@kernel
def _thin(swarm: Swarm, count: int, every: int) -> int:
    """Keep the epochs with fixes alone, for drives without odometry; returns how many."""
    truth = swarm.truth
    epochs = swarm.epochs
    n = 0
    for e in range(0, count, every):
        epochs.time[n] = epochs.time[e]
        epochs.has_fix[n] = epochs.has_fix[e]
        for i in range(5):
            epochs.fix[n, i] = epochs.fix[e, i]
        epochs.speed[n] = epochs.speed[e]
        epochs.speed_sigma[n] = epochs.speed_sigma[e]
        epochs.course[n] = epochs.course[e]
        epochs.course_sigma[n] = epochs.course_sigma[e]
        epochs.arc[n] = epochs.turn[n] = epochs.forward[n] = epochs.left[n] = 0.0
        epochs.moved[n] = 0
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


@kernel
def simulate_short(line: Line, swarm: Swarm, par: Numbers, odometry: bool, seed: int) -> int:
    """Simulate one drive along a line.

    Args:
        line: The route, n points, at most LONGEST.
        swarm: Filled from row 0 on: epochs and truth.
        par: What is wrong with map, car and receiver.
        odometry: Wheels at `odometry_rate`; else fixes alone.
        seed: Everything random comes from it.

    Returns:
        The number of epochs.
    """
    np.random.seed(seed)
    n = len(line.x)
    _lay(line, swarm, n, par)
    _pace(line, swarm.grid, n, par)
    count = _follow(swarm, n, par.odometry_rate)
    epochs = swarm.epochs
    dt = 1.0 / par.odometry_rate
    for e in range(count):
        epochs.time[e] = e * dt
        epochs.has_fix[e] = 0
        epochs.speed_sigma[e] = math.inf
        epochs.course_sigma[e] = math.inf
    _count_wheels(swarm, count, par)
    every = round(par.odometry_rate / par.gnss_rate)
    _receive(line, swarm, count, every, dt, par)
    return count if odometry else _thin(swarm, count, every)
