"""Odometry: rear wheel counters, speed and yaw rate, or a distance, of a real car's kind.

A wheel's radius depends on wear, pressure, load and speed; a driven wheel slips a little.  The
filter is told the numbers of a new car.
"""

import numpy as np

from .drivers import Truth
from .faults import Event, during, has

TRACK = 1.52  # m, between the rear wheels, as the filter is told
PER_TICK = 0.0217  # m, as the filter is told
GAP = "bus_gap"

Columns = dict[str, np.ndarray]  # each (n,), NaN: absent; with "time"


def count_wheels(truth: Truth, events: list[Event], random: np.random.Generator) -> Columns:
    """Counters of both rear wheels at 10 Hz."""
    time, metres = truth.time, np.diff(truth.travel, prepend=truth.travel[0])
    turn = np.diff(truth.heading, prepend=truth.heading[0])
    speed = truth.speed
    pull, side = np.gradient(speed, time), speed * np.gradient(truth.heading, time)
    track = TRACK * (1.0 + 0.004 * random.normal())
    wear, uneven = 0.007 * random.normal(), 2.5e-4 * random.normal()
    slips = float(random.uniform(0.0, 2e-3))  # for each m/s² that the wheels pull
    columns: Columns = {"time": time.copy()}
    factor = _factors(time, events, random.spawn(1)[0])  # faults leave the rest as it is
    for name, sign in (("left", -1.0), ("right", 1.0)):
        rolled = metres + sign * 0.5 * track * turn
        radius = 1.0 + wear + sign * (uneven + 1.5e-4 * side) + 2e-6 * speed**2
        rolled = rolled / radius * (1.0 + slips * pull.clip(0.0, 4.0))
        rolled += np.sqrt(np.abs(metres)) * random.normal(0.0, 2.5e-3, len(time))
        rolled = np.where(np.abs(metres) < 1e-4, 0.0, rolled)
        count = np.floor(np.cumsum(rolled * factor[name]) / PER_TICK + random.uniform(0, 1000))
        columns[name] = _held(time, count, events)
    if has(events, "swapped"):
        columns["left"], columns["right"] = columns["right"], columns["left"]
    if has(events, "dead"):
        columns["left"] = np.zeros(len(time))
    return _as_logged(columns, events)


def _factors(time: np.ndarray, events: list[Event], random: np.random.Generator) -> Columns:
    """What each wheel counts over what it rolls."""
    factor = {"left": np.ones(len(time)), "right": np.ones(len(time))}
    for e in events:
        inside = (time >= e.begin) & (time <= e.end)
        which = str(random.choice(["left", "right"]))
        if e.name == "slip":
            extra = 1.0 + random.uniform(0.1, 0.6)
            for name in factor if random.random() < 0.5 else (which,):
                factor[name][inside] *= extra
        elif e.name == "tyre":
            size = random.choice([-1.0, 1.0]) * random.uniform(0.005, 0.05)
            factor["left"][inside] *= 1.0 + size
        elif e.name == "stand":
            for name in factor:
                factor[name][inside] = 0.0
        elif e.name == "stuck":
            factor[which][inside] = 0.0
        elif e.name == "dropped":
            factor[which][inside] *= 1.0 - random.uniform(0.02, 0.1)
    return factor


def _held(time: np.ndarray, count: np.ndarray, events: list[Event]) -> np.ndarray:
    """Counts of which old ones are repeated."""
    inside = during(time, events, "repeats")
    last = np.maximum.accumulate(np.where(inside, 0, np.arange(len(time))))
    return count[last]


def measure_yaw(truth: Truth, events: list[Event], random: np.random.Generator) -> Columns:
    """Speed and yaw rate at 10 Hz."""
    n, step = len(truth), float(np.median(np.diff(truth.time)))
    scale, gain = 1.0 + 0.007 * random.normal(), 1.0 + 0.003 * random.normal()
    speed = truth.speed * scale
    speed = np.where(np.abs(speed) < 0.02, 0.0, speed + random.normal(0.0, 0.03, n))
    bias, walk = 2e-4 * random.normal(), 1e-5
    [faulty] = random.spawn(1)
    if has(events, "gyro_bias"):
        bias = float(faulty.choice([-1.0, 1.0]) * faulty.uniform(1e-3, 6e-3))
        walk = 1e-4
    drift = bias + walk * np.sqrt(step) * np.cumsum(random.normal(size=n))
    yaw = gain * np.gradient(truth.heading, truth.time) + drift + random.normal(0.0, 1e-3, n)
    if has(events, "yaw_sign"):
        yaw = -yaw
    if has(events, "yaw_degrees"):
        yaw = np.degrees(yaw)
    columns = {"time": truth.time.copy(), "speed": np.round(speed, 2), "yaw": np.round(yaw, 5)}
    return _as_logged(columns, events)


def measure_distance(truth: Truth, events: list[Event], random: np.random.Generator) -> Columns:
    """An odometer at 10 Hz, in steps of 10 cm."""
    scale = 1.0 + 0.007 * random.normal()
    metres = scale * np.abs(np.diff(truth.travel, prepend=truth.travel[0]))
    rolled = metres + np.sqrt(metres) * random.normal(0.0, 2.5e-3, len(truth))
    columns = {"time": truth.time.copy(), "odometer": np.floor(10.0 * np.cumsum(rolled)) / 10.0}
    return _as_logged(columns, events)


def _as_logged(columns: Columns, events: list[Event]) -> Columns:
    """Columns as they stand in a table: filled wrongly, or with gaps."""
    for name in [name for name in columns if name != "time"]:
        if has(events, "zeros") or (name == "yaw" and has(events, "no_turn")):
            columns[name] = np.zeros(len(columns[name]))
        elif name != "yaw" and has(events, "backwards"):
            columns[name] = -columns[name]
        elif name != "yaw" and has(events, "odometry_kmh"):
            columns[name] = 3.6 * columns[name]
    if "left" in columns and has(events, "no_turn"):
        columns["left"] = columns["right"].copy()
    keep = ~during(columns["time"], events, GAP)
    columns["time"] = columns["time"] + 1.0 * has(events, "odometry_late")
    columns["time"] += 18.0 * has(events, "odometry_18")  # as leap seconds
    return {name: column[keep] for name, column in columns.items()}
