"""Trajectory of a simulated car: map error, lane, curvature, speed, stops."""
# ruff: noqa: NPY002 - compiled code has no other random numbers, and each drive seeds them

import math

import numpy as np

from ..._compile import Matrix, Vector, by_numba, kernel
from .buffers import (
    ARRIVE,
    BEND,
    DEPART,
    HEADING,
    MAP_X,
    MAP_Y,
    MODES,
    NX,
    NY,
    OFFSET,
    SPEED,
    TRAVELLED,
    A,
    B,
    DriveBuffers,
    Line,
    Numbers,
    X,
    Y,
)

_COARSE = 5  # points between places where the fields are evaluated
_BLEND = (
    10  # m, half width of four averages: a change of lane has sigma 12 m, as in `lateral_profile`
)
_BLEND_SPEED = 14.0  # m/s, and more on roads that are faster than that


@kernel
def _draw_field(modes: Matrix, row: int, sigma: float, shortest: float, longest: float) -> None:
    """Six rows: wave vector, cosine and sine amplitudes; as `map_error_field.draw_field`."""
    size = sigma / math.sqrt(MODES)
    for m in range(MODES):
        wave = 2 * math.pi / math.exp(np.random.uniform(math.log(shortest), math.log(longest)))
        direction = np.random.uniform(-math.pi, math.pi)
        modes[row, m] = wave * math.cos(direction)
        modes[row + 1, m] = wave * math.sin(direction)
        for part in range(2, 6):
            modes[row + part, m] = np.random.normal(0.0, size)


@kernel
def _map_error(modes: Matrix, x: float, y: float) -> tuple[float, float]:
    """World minus map at a point: both fields."""
    dx = 0.0
    dy = 0.0
    for row in (0, 6):
        for m in range(MODES):
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
def _gauss_markov(out: Vector, n: int, every: int, sigma: float, length: float) -> None:
    """Add a Gauss-Markov process drawn each `every` points, a smooth curve between."""
    keep = math.exp(-every / length)
    driving_sigma = sigma * math.sqrt(1.0 - keep * keep)
    p = np.random.normal(0.0, sigma)
    q = keep * p + driving_sigma * np.random.normal()
    r = keep * q + driving_sigma * np.random.normal()
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
        r = keep * q + driving_sigma * np.random.normal()
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
    _gauss_markov(offset, n, 10, par.lane_sigma, par.lane_length)
    for k in range(n):  # no car follows a bend far inside
        offset[k] = max(offset[k], -0.3 / max(bend[k], 1e-3))
        offset[k] = min(offset[k], 0.3 / max(-bend[k], 1e-3))
    _average(offset, grid[A], n, 4)


@kernel
def _vehicle_path(line: Line, buffers: DriveBuffers, n: int, par: Numbers) -> None:
    """The path of M in both frames, its length and heading."""
    grid = buffers.grid
    _directions(line, grid, n)
    _offsets(line, grid, n, par)
    mx = grid[MAP_X]
    my = grid[MAP_Y]
    for k in range(n):
        mx[k] = line.x[k] + grid[OFFSET, k] * grid[NX, k]
        my[k] = line.y[k] + grid[OFFSET, k] * grid[NY, k]
    _draw_field(buffers.modes, 0, par.map_sigma, par.map_shortest, par.map_longest)
    _draw_field(buffers.modes, 6, par.relative_sigma, par.relative_shortest, par.relative_longest)
    k = 0
    while k < n:
        grid[A, k], grid[B, k] = _map_error(buffers.modes, mx[k], my[k])
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
def _speed_profile(line: Line, grid: Matrix, n: int, par: Numbers) -> None:
    """Speed and times at each point: roads, bends, stops, what a car can do."""
    s = grid[TRAVELLED]
    speed = grid[SPEED]
    wait = grid[A]
    ratio = grid[B]
    usual = 1.0 + np.random.normal(0.0, par.speed_profile_sigma)
    for k in range(n):
        ratio[k] = usual
        wait[k] = 0.0
    _gauss_markov(ratio, n, 25, par.speed_profile_sigma, 300.0)
    last_stop = 0.0
    for k in range(n):
        bend = abs(grid[HEADING, min(k + 1, n - 1)] - grid[HEADING, max(k - 1, 0)]) / (
            s[min(k + 1, n - 1)] - s[max(k - 1, 0)]
        )
        most = math.sqrt(par.lateral_acceleration / max(bend, 1e-6))
        speed[k] = max(min(line.limit[k] * min(max(ratio[k], 0.5), 1.5), most), 1.0)
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
def _follow(buffers: DriveBuffers, n: int, rate: float) -> int:
    """True motion at `rate` Hz; returns how many epochs."""
    grid = buffers.grid
    truth = buffers.truth
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


@by_numba
def drive_line(line: Line, buffers: DriveBuffers, par: Numbers, seed: int) -> int:
    """Drive along a line; returns the number of epochs, whose truth is filled."""
    np.random.seed(seed)
    n = len(line.x)
    _vehicle_path(line, buffers, n, par)
    _speed_profile(line, buffers.grid, n, par)
    return _follow(buffers, n, par.odometry_rate)
