"""What the further sensors of `benchmarks.evidence` say of simulated drives, sound and faulty."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from whichroad.geodesy.angles import bearing_of
from whichroad.observations import SensorReading
from whichroad.roadmap import RoadMap
from whichroad.sensors import (
    Compass,
    DualAntenna,
    LaneCamera,
    Ranging,
    SecondReceiver,
    Sensor,
)
from whichroad.simulate import SimulatedDrive

Told = tuple[Sensor, list[SensorReading]]
EVERY_M, FAR_M = 200.0, 60.0  # between points that ranges are to; the farthest
FAULT_S = 60.0  # after the drive's start, at which a fault begins
_JUNCTION_M = 12.0  # from a node, up to which a camera sees no line
_RATE = 10  # epochs of odometry from reading to reading
SIGMAS = {"compass": 5.0, "receiver": 2.5, "antennas": 0.5, "camera": 0.3, "range": 1.0}


def lasting(steps: np.ndarray, sigma: float, length: float, rng: np.random.Generator) -> np.ndarray:
    """A Gauss-Markov error (n,) of a sigma, that lasts for a length of what `steps` counts."""
    error = np.empty(len(steps))
    error[0] = sigma * rng.standard_normal()
    for k in range(1, len(steps)):
        kept = math.exp(-(steps[k] - steps[k - 1]) / length)
        error[k] = kept * error[k - 1] + sigma * math.sqrt(1 - kept**2) * rng.standard_normal()
    return error


def _readings(time: np.ndarray, **columns: np.ndarray) -> list[SensorReading]:
    rows = zip(*(c.tolist() for c in columns.values()), strict=True)
    return [
        SensorReading(t, dict(zip(columns, row, strict=True)))
        for t, row in zip(time.tolist(), rows, strict=True)
    ]


def _bearings(roads: RoadMap, drive: SimulatedDrive, k: np.ndarray) -> np.ndarray:
    t = drive.truth
    return np.asarray(bearing_of(t.heading[k], roads.plane.convergence(t.x[k], t.y[k])))


def compass(roads: RoadMap, drive: SimulatedDrive, rng: np.random.Generator) -> Told:
    """Once a second, with 5 degrees that last for 300 m."""
    t, sensor = drive.truth, Compass()
    k = np.arange(0, len(t), _RATE)
    error = lasting(t.travelled[k], SIGMAS["compass"], sensor.lasts_m, rng)
    return sensor, _readings(t.time[k], compass_deg=_bearings(roads, drive, k) + error)


def still_compass(
    roads: RoadMap, drive: SimulatedDrive, off_deg: float, sensor: Compass
) -> Told:  # fmt: skip
    """Once a second, off by the same angle throughout, as one that is mounted so."""
    k = np.arange(0, len(drive.truth), _RATE)
    told = (_bearings(roads, drive, k) + off_deg) % 360.0
    return sensor, _readings(drive.truth.time[k], compass_deg=told)


def antennas(roads: RoadMap, drive: SimulatedDrive, rng: np.random.Generator) -> Told:
    """Once a second, with 0.5 degrees that last for 5 s."""
    t, sensor = drive.truth, DualAntenna()
    k = np.arange(0, len(t), _RATE)
    error = lasting(t.time[k], SIGMAS["antennas"], sensor.lasts_s, rng)
    return sensor, _readings(t.time[k], antennas_deg=_bearings(roads, drive, k) + error)


def receiver(roads: RoadMap, drive: SimulatedDrive, rng: np.random.Generator) -> Told:
    """Once a second, with 2.5 m along each axis that last for 80 s; also in the outage."""
    t, sensor = drive.truth, SecondReceiver(sigma_m=SIGMAS["receiver"])
    k = np.arange(0, len(t), _RATE)
    scale = roads.plane.scale(t.x[k], t.y[k])
    x, y = (
        at[k] + scale * lasting(t.time[k], SIGMAS["receiver"], sensor.lasts_s, rng)
        for at in (t.x, t.y)
    )
    lat, lon = roads.plane.to_geodetic(x, y)
    return sensor, _readings(t.time[k], second_lat=lat, second_lon=lon)


def camera(roads: RoadMap, drive: SimulatedDrive, rng: np.random.Generator) -> Told:
    """Once a second off junctions: 0.3 m that last for 50 m, from the line of the map."""
    t, sensor = drive.truth, LaneCamera()
    k = np.arange(0, len(t), _RATE)
    k = k[t.edge[k] >= 0]
    length = roads.arrays.edges["length"][t.edge[k]]
    k = k[np.minimum(t.along[k], length - t.along[k]) > _JUNCTION_M]
    offset = np.empty(len(k))
    for n, i in enumerate(k.tolist()):
        x, y, heading = roads.at(int(t.edge[i]), float(t.along[i]))
        right = (t.map_x[i] - x) * math.sin(heading) - (t.map_y[i] - y) * math.cos(heading)
        offset[n] = right / float(roads.plane.scale(x, y))
    offset += lasting(t.travelled[k], SIGMAS["camera"], sensor.lasts_m, rng)
    return sensor, _readings(t.time[k], lane_offset_m=offset)


def ranges(
    roads: RoadMap, drive: SimulatedDrive, rng: np.random.Generator, *, on_map: bool = False
) -> Told:
    """One range of 1 m every 200 m, to a point 20 to 60 m ahead beside the road."""
    t, points, told = drive.truth, {}, []
    at = (t.map_x, t.map_y) if on_map else (t.x, t.y)
    places = np.arange(EVERY_M, t.travelled[-1], EVERY_M)
    for n, k in enumerate(np.searchsorted(t.travelled, places)):
        angle, metres = t.heading[k] + rng.uniform(-0.6, 0.6), rng.uniform(20.0, FAR_M)
        away = metres * float(roads.plane.scale(t.x[k], t.y[k]))
        lat, lon = roads.plane.to_geodetic(
            float(at[0][k] + away * math.cos(angle)), float(at[1][k] + away * math.sin(angle))
        )
        points[n] = (float(lat), float(lon))
        seen = metres + SIGMAS["range"] * rng.standard_normal()
        told.append(SensorReading(float(t.time[k]), {"range_to": float(n), "range_m": float(seen)}))
    return Ranging(points, on_map=on_map), told


SENSORS: dict[str, Callable[..., Told]] = {
    "compass": compass, "antennas": antennas, "receiver": receiver, "camera": camera,
    "ranges": ranges,
}  # fmt: skip
_VALUES = {"compass": ("compass_deg",), "antennas": ("antennas_deg",), "camera": ("lane_offset_m",),
           "receiver": ("second_lat", "second_lon"), "ranges": ("range_m",)}  # fmt: skip
FAULTS = ("sign", "unit", "delay", "stuck", "biased")
_LATE = 5  # readings
_UNITS = {
    "compass": math.pi / 180.0,
    "antennas": math.pi / 180.0,
    "camera": 3.28,
    "ranges": 3.28,
    "receiver": 1.0005,
}  # radians for degrees, feet for metres, another datum
_BIAS = {"compass": 40.0, "antennas": 10.0, "camera": 3.0, "receiver": 3e-4, "ranges": 20.0}


def faulty(name: str, told: Told, fault: str) -> Told:
    """The same sensor, with something wrong from a minute after the start on."""
    sensor, sound = told
    begin, last = sound[0].time + FAULT_S, sound[0].values
    out = []
    for k, one in enumerate(sound):
        values: dict[str, Any] = dict(one.values)
        if one.time < begin:
            last = one.values
            out.append(one)
            continue
        for column in _VALUES[name]:
            v, first = values[column], float(sound[0].values[column])
            if fault == "sign":  # of a position: away from where it began
                values[column] = 2.0 * first - v if name == "receiver" else -v
            elif fault == "unit":
                values[column] = v * _UNITS[name]
            elif fault == "delay" and k >= _LATE:
                values[column] = sound[k - _LATE].values[column]
            elif fault == "stuck":
                values[column] = last[column]
            elif fault == "biased":
                values[column] = v + _BIAS[name]
        out.append(replace(one, values=values))
    return sensor, out
