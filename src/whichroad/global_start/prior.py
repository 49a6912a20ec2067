"""Prior of a start on the map: a Gaussian mixture over the roads."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import DriveError
from ..filter.hypotheses.population import locate_all, turn_sums
from ..geodesy.angles import heading_of, radians
from ..graph.network import AGAINST_ONE_WAY, NO_ACCESS
from ..observations import Array, StartPose
from ..ragged import row_and_place
from ..roadmap import RoadMap
from ..settings import Settings

KNOWN_BEARING = 45.0  # degrees; a bearing with a larger sigma is ignored
DROP = 1e-3  # share of the average weight below which a hypothesis is dropped

_LONGEST = 40.0  # m, longest stretch of road of one prior component
_BEND = 0.3  # rad, largest turn within a component
_SHORTEST = 12.0  # m
_SIGMA_RATIO = 0.4  # along-track sigma of a component over its length: a flat density at the joints
_MOST = 250_000  # components, about 1.5 GB


class Components(NamedTuple):
    """Prior components: where a vehicle may be, (n,) each."""

    edge: NDArray[np.int32]
    s: Array  # along-track position of the mean, m
    sigma: Array  # along-track sigma, m
    log_weight: Array  # weights sum to one
    x: Array  # m, plane
    y: Array


def prior_components(roads: RoadMap, settings: Settings, start: StartPose | None) -> Components:
    """Cut the roads, those near the start if there is one, and weigh them.

    Args:
        roads: The map.
        settings: For the weight of driving against one-ways.
        start: Where the vehicle may be; a bearing with a large sigma is ignored.

    Returns:
        Components; their weight: length, less on service roads, next to nothing against
        one-ways, times the Gaussian of the start.

    Raises:
        DriveError: No road is near, or the roads are more than can be searched.
    """
    network = roads.arrays
    edges = network.edges
    longest = _LONGEST if start is None else min(_LONGEST, max(2.0 * start.sigma_m, _SHORTEST))
    turns = np.zeros(len(edges))
    turn_sums(network, turns)
    wanted = np.maximum(edges.length / longest, turns / _BEND)
    count = np.ceil(np.clip(wanted, 1.0, np.maximum(edges.length / _SHORTEST, 1.0))).astype(int)
    weight = np.where(edges.rule & AGAINST_ONE_WAY, settings.wrong_way, 1.0)
    weight *= np.where(edges.rule & NO_ACCESS, 0.1, 1.0) * np.where(edges.service, 0.5, 1.0)
    weight *= edges.length / count
    count[weight <= 0.0] = 0
    if start is not None:
        count[~_near_start(roads, start)] = 0
    if count.sum() > _MOST:
        raise DriveError(
            f"start: the roads give {count.sum():,} places to search; at most {_MOST:,} were "
            "expected; give start=StartPose(..., sigma_m=...) (--start map:LAT,LON,METRES), or a "
            "smaller map"
        )
    of, nth = row_and_place(count)
    edge = of.astype(np.int32)
    length = (edges.length / np.maximum(count, 1))[edge]
    s, sigma, log_weight = length * (nth + 0.5), _SIGMA_RATIO * length, np.log(weight[edge])
    x, y, heading = np.zeros((3, len(edge)))
    locate_all(network, edge, s, sigma, x, y, heading)
    if start is not None:
        log_weight += _log_prior(roads, start, x, y, heading)
    if len(edge) == 0 or log_weight.max() < -1e4:
        raise DriveError("no road of the map is near the start; is it the right map?")
    log_weight -= log_weight.max()
    log_weight -= math.log(np.exp(log_weight).sum())
    keep = log_weight > math.log(DROP / len(edge))
    return Components(edge[keep], s[keep], sigma[keep], log_weight[keep], x[keep], y[keep])


def _in_plane(roads: RoadMap, start: StartPose) -> tuple[float, float, float]:
    """The start in the plane: x, y, heading."""
    x, y = roads.plane.from_geodetic(start.lat_deg, start.lon_deg)
    heading = heading_of(start.bearing_deg, roads.plane.convergence(x, y))
    return x, y, heading


def _near_start(roads: RoadMap, start: StartPose) -> NDArray[np.bool_]:
    """Edges with a vertex, or a stretch between two, that may be near the start."""
    vertices = roads.arrays.vertices
    x, y, _ = _in_plane(roads, start)
    away = np.hypot(vertices.x - x, vertices.y - y)
    reach = np.maximum(np.diff(vertices.s, append=0.0), np.diff(vertices.s, prepend=0.0))
    first = roads.arrays.edges.first_vertex
    least = np.minimum.reduceat(away - np.maximum(reach, 0.0), first)
    return np.asarray(least < 4.5 * start.sigma_m + 30.0)


def _log_prior(roads: RoadMap, start: StartPose, x: Array, y: Array, heading: Array) -> Array:
    """Gaussian of the start at positions and headings, up to a constant."""
    x0, y0, heading0 = _in_plane(roads, start)
    log_prior: Array = -0.5 * ((x - x0) ** 2 + (y - y0) ** 2) / start.sigma_m**2
    if start.sigma_bearing_deg <= KNOWN_BEARING:
        turned = np.arctan2(np.sin(heading - heading0), np.cos(heading - heading0))
        log_prior -= 0.5 * turned**2 / (radians(start.sigma_bearing_deg) ** 2 + 0.015)
    return log_prior
