"""Speed profile: speeds and stops along the path, from limits, curvature and driver."""

from typing import NamedTuple

import numpy as np

from ..graph.network import Roads
from ..observations import Array
from .lateral_profile import VehiclePath, gauss_markov
from .simulation_settings import SimulationSettings

_SLOWEST = 1.0  # m/s while moving
_BEFORE_JUNCTION = 4.0  # m, distance of stops from junctions
_BETWEEN_STOPS = 80.0  # m, least distance between stops
_RHYTHM = 300.0  # m, correlation length of the driver's speed factor


class SpeedProfile(NamedTuple):
    """Motion along the path: uniform acceleration between grid points, then waiting.

    Shape (n,) each, at the n grid points of the driven part of the path.
    """

    travelled: Array  # true m along the path
    speed: Array  # m/s
    arrive: Array  # s since the drive's start
    depart: Array  # s; later than `arrive` where the car waits


class Motion(NamedTuple):
    """Samples of the motion, shape (n,) each."""

    travelled: Array  # true m along the path
    speed: Array  # m/s


def _limits(
    roads: Roads, path: VehiclePath, settings: SimulationSettings, random: np.random.Generator
) -> Array:
    """Highest speed at each grid point, m/s, from the road and the bend."""
    on = np.clip(np.searchsorted(path.entry, path.along, side="right") - 1, 0, len(path.edges) - 1)
    coarse = np.linspace(0.0, path.along[-1], max(2, int(path.along[-1] / 25.0)))
    rhythm = gauss_markov(coarse, settings.speed_profile_sigma, _RHYTHM, random)[:, 0]
    profile = (
        1.0
        + random.normal(0.0, settings.speed_profile_sigma)
        + np.interp(path.along, coarse, rhythm)
    )
    limit = roads.edges.speed[path.edges].astype(float)[on] * np.clip(profile, 0.5, 1.5)
    bend = np.abs(np.gradient(path.heading) / np.maximum(np.gradient(path.travelled), 1e-3))
    bent = np.sqrt(settings.lateral_acceleration / np.maximum(bend, 1e-6))
    most: Array = np.maximum(np.minimum(limit, bent), _SLOWEST)
    return most


def _stops(
    roads: Roads, path: VehiclePath, settings: SimulationSettings, random: np.random.Generator
) -> Array:
    """Where along the route the car stops, in driving order, true m."""
    left = roads.edges[path.edges[:-1]]
    forks = left.end_turn - left.first_turn > 1
    places = path.entry[1:-1][forks] - _BEFORE_JUNCTION
    places = places[random.random(len(places)) < settings.stop_probability]
    kept, last = [], 0.0
    for place in places.tolist():
        if place > last + _BETWEEN_STOPS:
            kept.append(place)
            last = place
    return np.array(kept)


def draw_speed_profile(
    roads: Roads,
    path: VehiclePath,
    start: int,
    stop: int,
    settings: SimulationSettings,
    random: np.random.Generator,
) -> SpeedProfile:
    """Decide speeds and stops between two grid points, standing at both.

    Args:
        roads: The network.
        path: The path.
        start: First grid point driven.
        stop: Last grid point driven, > start.
        settings: Accelerations, stops.
        random: Source of chance.

    Returns:
        The motion along the driven part.
    """
    limit = _limits(roads, path, settings, random)[start : stop + 1]
    s = path.travelled[start : stop + 1]
    wait = np.zeros(len(s))
    stops = np.searchsorted(path.along, _stops(roads, path, settings, random)) - start
    # no stop next to the ends, where the car stands already
    for k in stops[(stops > 1) & (stops < len(s) - 2)]:
        wait[k] = 1.0 + random.exponential(settings.stop_time)
    square = limit**2
    square[(wait > 0)] = 0.0
    square[[0, -1]] = 0.0
    # v² grows at most by 2 a per metre ahead, and must have shrunk by 2 b before each limit
    up, down = 2.0 * settings.acceleration * s, 2.0 * settings.braking * s
    square = np.minimum.accumulate(square - up) + up
    square = np.minimum.accumulate((square + down)[::-1])[::-1] - down
    speed = np.sqrt(np.maximum(square, 0.0))
    speed[(wait > 0)] = 0.0
    speed[[0, -1]] = 0.0
    wait[0] = settings.first_wait
    needs = 2.0 * np.diff(s) / (speed[1:] + speed[:-1])
    depart = np.cumsum(wait) + np.concatenate([[0.0], np.cumsum(needs)])
    return SpeedProfile(travelled=s, speed=speed, arrive=depart - wait, depart=depart)


def motion_at(profile: SpeedProfile, time: Array) -> Motion:
    """Distance and speed at `time` (n,), s since the start and not past the end."""
    k = np.clip(np.searchsorted(profile.depart, time, side="right") - 1, 0, len(profile.depart) - 2)
    last = profile.arrive[k + 1] - profile.depart[k]
    local = np.clip(time - profile.depart[k], 0.0, last)
    gain = (profile.speed[k + 1] - profile.speed[k]) / last
    speed = profile.speed[k] + gain * local
    travelled = profile.travelled[k] + profile.speed[k] * local + 0.5 * gain * local**2
    return Motion(travelled, np.where(time >= profile.depart[0], speed, 0.0))
