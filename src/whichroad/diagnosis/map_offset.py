"""How far the map is off and its lines are turned, as a drive has shown; or that it is another."""

import math
from typing import NamedTuple

from ..filter.state import WHEELS, Belief, X, Y, most_probable
from ..geodesy.angles import degrees
from ..geodesy.plane import Plane
from ..roadmap import RoadMap
from ..roadmap.extent import NEAR, OffMap, outside_map
from ..settings import Settings
from .finding import Finding

_FAR = 8.0  # m off as a whole, from which on a map is named
_SURE = 2.5  # and that in sigmas
_TURNED = 2.0  # times `edge_heading_sigma`, from which on lines are named
_SHORT = 0.01  # lengths of the local error, a way on which nothing of it averages out
_QUARTERS = (
    "north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west",
)  # fmt: skip


class MapError(NamedTuple):
    """What was learnt of the map's error, m."""

    east_m: float  # of the map as a whole, against the fixes
    north_m: float
    sigma_m: float  # of these
    local_m: float  # about these, 1 sigma of each axis
    heading_deg: float  # of its lines, 1 sigma, as turns of the odometry show it

    @property
    def distance(self) -> float:
        """How far the map is off as a whole, m."""
        return math.hypot(self.east_m, self.north_m)


def map_error_of(belief: Belief, settings: Settings, plane: Plane) -> MapError | None:
    """What a filter has learnt of the map's error; None: without wheels nothing is.

    What is local does not average out over a short way, so the sigma of the whole has a part of it.

    Args:
        belief: The filter's.
        settings: The filter's.
        plane: The map's.
    """
    state = belief.state[0]
    if state["mode"] != WHEELS:
        return None
    learnt = state.map
    if learnt.moments[0] <= 0.0:
        return None
    x, y = float(learnt.whole[0]), float(learnt.whole[1])
    at = belief.hyp[most_probable(belief)].mu
    turn = plane.convergence(float(at[X]), float(at[Y]))
    c, s = math.cos(turn), math.sin(turn)
    mean, local = max(float(learnt.factor - learnt.local), 0.0), float(learnt.local)
    way = float(learnt.moments[0])  # lengths for which a local error lasts
    left = 2.0 * (way - 1.0 + math.exp(-way)) / way**2 if way > _SHORT else 1.0
    sigma = settings.map_sigma
    return MapError(
        c * x + s * y, c * y - s * x, sigma * math.sqrt(mean + left * local),
        sigma * math.sqrt(local),
        float(degrees(settings.edge_heading_sigma * math.sqrt(learnt.heading_factor))),
    )  # fmt: skip


def outside_of(belief: Belief, roads: RoadMap) -> OffMap | None:
    """How far the most probable hypothesis is from the map; None: it is on it, or there is none."""
    if not belief.state[0].count:
        return None
    at = belief.hyp[most_probable(belief)].mu
    return outside_map(roads, float(at[X]), float(at[Y]))


def outside_finding(outside: OffMap) -> Finding:
    """A vehicle that is where the map has no road."""
    return Finding("map extent", "warning", outside.away, 0.0, NEAR, outside.text)


def offset_finding(error: MapError | None) -> tuple[Finding, ...]:
    """A map that is surely far off as a whole is named."""
    if error is None:
        return ()
    band = max(_FAR, _SURE * error.sigma_m)
    if error.distance <= band:
        return ()
    bearing = math.atan2(error.east_m, error.north_m)
    where = _QUARTERS[round(bearing / (math.pi / 4.0)) % 8]
    return (
        Finding(
            "map offset", "warning", error.distance, 0.0, band,
            f"the map lies {error.distance:.0f} m {where} of the fixes; this is learnt, and no "
            "setting is needed; if other drives say the same, correct the map, else the "
            "receiver's datum or its base station",
        ),
    )  # fmt: skip


def headings_finding(error: MapError | None, settings: Settings) -> tuple[Finding, ...]:
    """A map whose lines are turned against how the vehicle turns is named."""
    if error is None:
        return ()
    usual = degrees(settings.edge_heading_sigma)
    band = _TURNED * usual
    if error.heading_deg <= band:
        return ()
    return (
        Finding(
            "map headings", "warning", error.heading_deg, 0.0, band,
            f"roads turn by {error.heading_deg:.0f} degrees (1 sigma) other than the vehicle does, "
            f"for tens of metres; {usual:.0f} are usual; this is learnt, and no setting is needed; "
            "the map is distorted or drawn roughly there: compare it with imagery",
        ),
    )  # fmt: skip
