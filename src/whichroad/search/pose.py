"""A start from a given pose."""

import numpy as np

from ..core.belief import Belief, Route, normalise
from ..core.epoch import CLOCK, WHEELS
from ..core.reduction import reduce
from ..core.start import cold_start
from ..core.switching import new_work
from ..geodesy.angles import heading_of, radians
from ..records import StartPose
from ..roadmap import RoadMap
from ..settings import Settings, Vehicle
from .follow import set_clock


def start_at(
    belief: Belief, roads: RoadMap, route: Route, start: StartPose, time: float, mode: int,
    settings: Settings, vehicle: Vehicle,
) -> None:  # fmt: skip
    """Begin from a given pose of M, before any fix.

    Args:
        belief: The filter's, empty.
        roads: The map.
        route: The tree of edges entered.
        start: The pose.
        time: s.
        mode: What moves the vehicle.
        settings: The model's numbers.
        vehicle: The car.
    """
    x, y = roads.plane.from_geodetic(np.array([start.lat_deg]), np.array([start.lon_deg]))
    turn = roads.plane.convergence(x, y)
    heading = heading_of(start.bearing_deg, float(turn[0]))
    fix = np.array([x[0], y[0], start.sigma_m, start.sigma_m, 0.0])
    par = settings.parameters()
    scale = 1.0 + roads.arrays.curvature * float(x[0] ** 2 + y[0] ** 2)
    work = new_work()
    clock_mode = mode == CLOCK
    cold_start(
        belief, roads.arrays, route, work, 1.0, fix, 1.0, 0.01, scale, np.zeros(2), heading,
        radians(start.sigma_bearing_deg), 6.0 if clock_mode else 1.0,
        8.0 if clock_mode else par.scale_sigma, par.drift_sigma if mode == WHEELS else 0.0,
        1.0 if vehicle.driving_side == "right" else -1.0, par.lane_sigma, par.map_sigma,
        par.search_radius, par.off_road_start, par.wrong_way,
    )  # fmt: skip
    n = int(belief.size[0])
    for state in (8, 9):  # the pose owes nothing to the GNSS error of later fixes
        belief.cov[:n, state, :] = 0.0
        belief.cov[:n, :, state] = 0.0
        belief.cov[:n, state, state] = 1.0
    normalise(belief)
    reduce(belief, route, scale, par.prune, par.merge, int(par.components))
    set_clock(belief.clock, time, settings)
