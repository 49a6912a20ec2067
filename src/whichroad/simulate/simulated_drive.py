"""One simulated drive: a route, the true motion along it, and what the sensors measure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingError
from ..geodesy.angles import radians
from ..graph.network import Roads
from ..observations import Array, Drive, Fixes
from ..settings import Vehicle
from .lateral_profile import VehiclePath, draw_path
from .map_error_field import MapErrorField, draw_map_error
from .route_choice import Edges, random_route
from .sensor_models import (
    GnssErrors,
    Jump,
    Pull,
    States,
    Wheels,
    antenna,
    draw_wheels,
    fixes_from,
    gnss_errors,
    jumped,
    pulled,
    wheel_counts,
)
from .simulation_settings import PRESETS, SimulationSettings
from .speed_profile import SpeedProfile, draw_speed_profile, motion_at

if TYPE_CHECKING:
    from ..roadmap import RoadMap

START = 1780300800.0
"""Every simulated drive begins at 2026-06-01T08:00:00Z, s since 1970."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Where M truly was, at the odometry's rate, shape (n,) each."""

    time: Array  # s since 1970 UTC
    x: Array  # m, the map's plane, world frame
    y: Array
    heading: Array  # rad in (-pi, pi], counter-clockwise from the plane's east
    speed: Array  # m/s
    stopped: NDArray[np.bool_]
    travelled: Array  # true m since the drive's start
    edge: NDArray[np.int64]  # directed edge of the map
    along: Array  # true m from the edge's start
    map_x: Array  # m, the same place in the map's frame
    map_y: Array

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, slots=True)
class SimulatedDrive:
    """A drive, and everything that a real one would not reveal."""

    drive: Drive  # what was recorded
    vehicle: Vehicle  # what its user believes of the car
    truth: Truth
    route: Edges  # (r,) edges in driving order
    outages: tuple[tuple[float, float], ...]  # (from, to) without fixes, s since 1970
    fix_truth: States  # true motion at the times of all fixes, also those of outages
    fix_error: Array  # (m, 2) east and north error of those, m
    false_fix: NDArray[np.bool_]  # (m,) in a multipath episode
    seen_fix: NDArray[np.bool_]  # (m,) not in an outage: those in `drive`
    wheels: Wheels
    error_field: MapErrorField
    settings: SimulationSettings
    seed: int


def settings_of(scenario: str | SimulationSettings) -> SimulationSettings:
    """Find a preset by its name, or take settings as they are.

    Raises:
        SettingError: No such preset.
    """
    if isinstance(scenario, SimulationSettings):
        return scenario
    if scenario not in PRESETS:
        raise SettingError(
            f"scenario {scenario!r} is not known; one of {', '.join(PRESETS)} was expected"
        )
    return PRESETS[scenario]


def _states(path: VehiclePath, profile: SpeedProfile, time: Array) -> States:
    """True motion at times (n,), s since the drive's start.

    Between grid points the path is a cubic with the grid's headings, so that positions,
    headings and speeds fit one another.
    """
    motion = motion_at(profile, time)
    s = path.travelled
    k = np.clip(np.searchsorted(s, motion.travelled, side="right") - 1, 0, len(s) - 2)
    step = s[k + 1] - s[k]
    f = (motion.travelled - s[k]) / step
    a, b = f * (1 - f) ** 2 * step, -(f**2) * (1 - f) * step
    blend = f**2 * (3 - 2 * f)
    scale = np.hypot(path.x[k + 1] - path.x[k], path.y[k + 1] - path.y[k]) / step
    turn = path.heading[k + 1] - path.heading[k]

    def along(values: Array, slope: Array) -> Array:
        curve: Array = (
            values[k] * (1 - blend)
            + values[k + 1] * blend
            + scale * (a * slope[k] + b * slope[k + 1])
        )
        return curve

    return States(
        time=time,
        x=along(path.x, np.cos(path.heading)),
        y=along(path.y, np.sin(path.heading)),
        heading=path.heading[k] + f * turn,
        bend=turn / step,
        travelled=motion.travelled,
        speed=motion.speed,
    )


def _truth(roads: Roads, path: VehiclePath, states: States) -> Truth:
    """Edges and the map's frame for the true motion."""
    along = np.interp(states.travelled, path.travelled, path.along)
    k = np.searchsorted(path.entry, along, side="right") - 1
    k = np.clip(k, 0, len(path.edges) - 1)
    edge = path.edges[k]
    return Truth(
        time=START + states.time,
        x=states.x,
        y=states.y,
        heading=np.arctan2(np.sin(states.heading), np.cos(states.heading)),
        speed=states.speed,
        stopped=states.speed == 0.0,
        travelled=states.travelled - states.travelled[0],
        edge=edge,
        along=np.minimum(along - path.entry[k], roads.edges.length[edge]),
        map_x=np.interp(states.travelled, path.travelled, path.map_x),
        map_y=np.interp(states.travelled, path.travelled, path.map_y),
    )


def _outages(
    profile: SpeedProfile, settings: SimulationSettings, windows: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Times without fixes, s since the start, for windows of distance driven."""
    windows = list(windows)
    driven = profile.travelled - profile.travelled[0]
    if settings.outage_length > 0:
        period = max(settings.outage_every, settings.outage_length + 1.0)
        begins = np.arange(settings.outage_first, driven[-1], period)
        windows += [(float(b), float(b) + settings.outage_length) for b in begins]
    return [
        (float(np.interp(a, driven, profile.depart)), float(np.interp(b, driven, profile.depart)))
        for a, b in windows
    ]


def _fixes(
    roads: "RoadMap",
    states: States,
    settings: SimulationSettings,
    random: np.random.Generator,
    pulls: Sequence[Pull | Jump],
) -> tuple[Fixes, GnssErrors]:
    """Every fix of the drive as if there were no outage, and its errors."""
    plane = roads.plane
    moving = np.concatenate(
        [[0.0], np.cumsum(np.diff(states.time) * (np.diff(states.travelled) > 0.01))]
    )
    errors = gnss_errors(states.time, states.travelled, settings, random, moving)
    ahead_x, ahead_y, speed, heading = antenna(states, settings)
    convergence = plane.convergence(states.x, states.y)
    for pull in pulls:
        if isinstance(pull, Jump):
            errors = jumped(states, errors, pull)
        else:
            errors = pulled(states, convergence, errors, pull)
    c, s = np.cos(convergence), np.sin(convergence)
    scale = plane.scale(states.x, states.y)
    position = plane.to_geodetic(
        states.x + scale * (ahead_x + c * errors.east - s * errors.north),
        states.y + scale * (ahead_y + s * errors.east + c * errors.north),
    )
    bearing = radians(plane.bearing(heading, states.x, states.y))
    fixes = fixes_from(START + states.time, position, (speed, bearing), errors, settings, random)
    return fixes, errors


def _choose(fixes: Fixes, rows: NDArray[np.bool_]) -> Fixes:
    """The fixes of some rows."""
    return replace(fixes, **{name: getattr(fixes, name)[rows] for name in fixes.__slots__})


def _nominal(settings: SimulationSettings) -> Vehicle:
    """The car as its user believes it to be."""
    return Vehicle(
        track_width=settings.track_width,
        metres_per_tick_left=settings.metres_per_tick,
        metres_per_tick_right=settings.metres_per_tick,
        antenna_forward=settings.antenna_forward,
        antenna_left=settings.antenna_left,
        driving_side=settings.driving_side,
    )


def _part(
    path: VehiclePath, length_m: float, given: bool, random: np.random.Generator
) -> tuple[int, int]:
    """First and last grid point of the course that are driven: from mid-edge to mid-edge."""
    first, last = path.entry[1], path.along[-1] - path.entry[-2]
    begin = (0.2 if given else random.uniform(0.1, 0.6)) * first
    end = path.along[-1] - 0.2 * last
    if not given:
        end = min(end, begin + length_m)
    start = int(np.searchsorted(path.along, begin))
    return start, max(start + 2, int(np.searchsorted(path.along, end)) - 1)


def simulate_drive(
    roads: "RoadMap",
    *,
    seed: int,
    length_m: float = 12_000.0,
    scenario: str | SimulationSettings = "good",
    route: Sequence[int] | None = None,
    outages_m: Sequence[tuple[float, float]] = (),
    outages_s: Sequence[tuple[float, float]] = (),
    pulls: Sequence[Pull | Jump] = (),
    allowed: NDArray[np.bool_] | None = None,
    error_field: MapErrorField | None = None,
    drive_id: str | None = None,
) -> SimulatedDrive:
    """Simulate a drive whose truth is known.

    Args:
        roads: The map that the driver, but not the world, agrees with.
        seed: Everything random comes from this: same seed, same drive.
        length_m: How far to drive, true m.
        scenario: "good", "urban", "outage", or settings of one's own.
        route: Edges to drive along instead of a random route; driven from 20 % of the
            first to 80 % of the last, whatever `length_m` is.
        outages_m: Windows without fixes, (from, to) in m driven, besides the scenario's.
        outages_s: The same in s since the drive's start.
        pulls: False positions, besides the scenario's errors.
        allowed: What `drivable` found, to save finding it for each of many drives.
        error_field: World minus map, to share one between drives; None: drawn.
        drive_id: Name of the drive; None: from the seed.

    Returns:
        The recorded drive, the vehicle as its user believes it to be, and the truth.

    Raises:
        MapError: No legal drive of 50 m exists on this map.
        SettingError: No such scenario, or a route that is not connected.
    """
    settings, arrays = settings_of(scenario), roads.arrays
    streams = (np.random.default_rng([seed, k]) for k in range(6))
    for_route, for_map_error, for_lateral, for_speed, for_wheels, for_fixes = streams
    if route is None:
        edges = random_route(arrays, 1.1 * length_m + 100.0, for_route, allowed)
    else:
        edges = _checked(arrays, route)
    error_field = error_field or draw_map_error(settings, for_map_error)
    path = draw_path(arrays, edges, error_field, settings, for_lateral)
    start, stop = _part(path, length_m, route is not None, for_route)
    profile = draw_speed_profile(arrays, path, start, stop, settings, for_speed)
    ticks = partial(_grid_times, profile.arrive[-1])
    states = _states(path, profile, ticks(settings.odometry_rate))
    fix_states = _states(path, profile, ticks(settings.gnss_rate))
    wheels = draw_wheels(settings, for_wheels)
    fixes, errors = _fixes(roads, fix_states, settings, for_fixes, pulls)
    outages = [*_outages(profile, settings, outages_m), *outages_s]
    seen = np.ones(len(fixes), dtype=bool)
    for begin, end in outages:
        seen &= (fix_states.time < begin) | (fix_states.time > end)
    return SimulatedDrive(
        drive=Drive(
            drive_id=drive_id or f"simulated-{seed}",
            fixes=_choose(fixes, seen),
            odometry=wheel_counts(states, START, wheels, settings, for_wheels),
        ),
        vehicle=_nominal(settings),
        truth=_truth(arrays, path, states),
        route=edges,
        outages=tuple((START + a, START + b) for a, b in outages),
        fix_truth=fix_states,
        fix_error=np.column_stack([errors.east, errors.north]),
        false_fix=errors.false,
        seen_fix=seen,
        wheels=wheels,
        error_field=error_field,
        settings=settings,
        seed=seed,
    )


def _grid_times(end: float, rate: float) -> Array:
    """Reading times at `rate` Hz from 0 to `end`, s."""
    return np.arange(int(end * rate) + 1) / rate


def _checked(roads: Roads, route: Sequence[int]) -> Edges:
    """A given route as an array, if its edges follow one another."""
    edges = np.asarray(route, dtype=np.int64)
    broken = np.flatnonzero(roads.edges.to_node[edges[:-1]] != roads.edges.from_node[edges[1:]])
    if len(edges) == 0 or len(broken):
        at = (
            f"edge {edges[broken[0]]} is not followed by {edges[broken[0] + 1]}"
            if len(broken)
            else "it is empty"
        )
        raise SettingError(f"route of {len(edges)} edges: {at}; connected edges were expected")
    return edges
