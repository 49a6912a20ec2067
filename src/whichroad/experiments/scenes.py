"""The paper's situations: its claims, and the drives through them.

Everything random in a drive comes from its seed: the map's error, the car, the receiver,
the driver.  They are those of the simulator's preset `GOOD`, errors correlated in time and
place, without stops and changes of lane, which would be other situations.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from ..simulate import GOOD, URBAN, Pull, SimulatedDrive, simulate_drive
from ..simulate.map_error_field import draw_map_error
from .scene_maps import CANYON_ROUTE, GAP, along, known

if TYPE_CHECKING:
    from ..observations import Fixes
    from ..roadmap import RoadMap

STEADY = replace(GOOD, lane_change_rate=0.0, stop_probability=0.0)
FROM_NODE = 0.8  # of its length, the first edge is driven

DARK = 1e4  # m, later than any end


@dataclass(frozen=True, slots=True)
class Scene:
    """One experiment."""

    name: str
    figure: str  # of the paper
    title: str
    claim: str  # the paper's claim, in our words
    drive: Callable[["RoadMap", int], SimulatedDrive]
    zero: str  # what lies at 0 m
    decision_m: float  # where that is, m driven
    centre: tuple[float, float]  # and on the map as drawn, m
    near_m: tuple[float, float]  # what the map shows, m driven from there
    far_m: tuple[float, float]  # range of the curves over the distance
    counted_m: tuple[float, float]  # where a wrong road may begin to count

    @property
    def roads(self) -> "RoadMap":
        """The scene's map."""
        return known(self.name)


def _fork(roads: "RoadMap", seed: int) -> SimulatedDrive:
    routes = (["1", "2a", "2"], ["1", "3"], ["1", "2a", "4"])
    route = along(roads, routes[seed % 3])
    return simulate_drive(roads, seed=seed, route=route, scenario=STEADY)


def _junction(roads: "RoadMap", seed: int) -> SimulatedDrive:
    route = along(roads, ["1", "23"[seed % 2]])
    dark = [(600.0 * FROM_NODE - 10.0, DARK)]
    return simulate_drive(roads, seed=seed, route=route, scenario=STEADY, outages_m=dark)


_MASK = (1080.0, 2580.0)  # m driven: the paper's 1.5 km
_OUTAGE_ROUTE = ["ab", "bc", "cd", "de", "ef", "fg", "gh", "hi", "ij", "jk"]


def _outage(roads: "RoadMap", seed: int) -> SimulatedDrive:
    route = along(roads, _OUTAGE_ROUTE)
    return simulate_drive(roads, seed=seed, route=route, scenario=STEADY, outages_m=[_MASK])


_BACK = 800.0  # m driven, where GNSS comes back
_SPLIT = 500.0 * FROM_NODE
_PULL = (GAP + 1.0, 15.0, 6.0)  # m to the other road, s over which it wears off, m reported


def _parallel(roads: "RoadMap", seed: int) -> SimulatedDrive:
    """The map's own error is part of the pull, so that fixes lie beyond the map's other road."""
    error_field = draw_map_error(STEADY, np.random.default_rng([seed, 9]))
    map_error = float(error_field.at(np.array([900.0]), np.array([0.0]))[0, 1])
    size, wears_off, reported = _PULL
    left = seed % 2 == 0
    pull = Pull(_BACK, (size if left else -size) + map_error, wears_off, reported)
    route = along(roads, ["approach", "left road" if left else "right road"])
    dark = [(_SPLIT - 150.0, _BACK)]
    return simulate_drive(
        roads,
        seed=seed,
        route=route,
        scenario=STEADY,
        outages_m=dark,
        pulls=[pull],
        error_field=error_field,
    )


CANYON_M = (600.0, 1800.0)
"""The stretch between high houses, m driven."""

_HOUSES = replace(
    STEADY, gnss_bias_low=URBAN.gnss_bias_low, gnss_bias_high=URBAN.gnss_bias_high,
    gnss_time=URBAN.gnss_time, gnss_white=URBAN.gnss_white,
    gnss_reported=math.hypot(
        0.5 * (URBAN.gnss_bias_low + URBAN.gnss_bias_high), URBAN.gnss_white
    ),
)  # fmt: skip
"""Errors of a street canyon, reported as large as they are."""


def _gst(roads: "RoadMap", seed: int) -> SimulatedDrive:
    """The same drive under open sky and between houses, and the fixes of each where it is so."""
    route = along(roads, CANYON_ROUTE)
    open_sky, houses = (
        simulate_drive(roads, seed=seed, route=route, scenario=scenario)
        for scenario in (STEADY, _HOUSES)
    )
    fixes, others = open_sky.drive.fixes, houses.drive.fixes
    assert fixes is not None
    assert others is not None
    driven = np.interp(fixes.time, open_sky.truth.time, open_sky.truth.travelled)
    between = (driven >= CANYON_M[0]) & (driven < CANYON_M[1])
    mixed = {
        f.name: np.where(between, getattr(others, f.name), getattr(fixes, f.name))
        for f in fields(fixes)
    }
    return replace(open_sky, drive=replace(open_sky.drive, fixes=replace(fixes, **mixed)))


def fixed_sigma(drive: SimulatedDrive) -> SimulatedDrive:
    """The same drive, every fix with the average covariance of the drive's fixes, a circle."""
    fixes = drive.drive.fixes
    assert fixes is not None
    mean = float(np.mean(0.5 * (fixes.cov_ee + fixes.cov_nn)))
    same, none = np.full(len(fixes), mean), np.zeros(len(fixes))
    given: Fixes = replace(fixes, cov_ee=same, cov_en=none, cov_nn=same)
    return replace(drive, drive=replace(drive.drive, fixes=given))


SCENES = {
    scene.name: scene
    for scene in (
        Scene(
            "fork", "Figure 8", "A road, then a second and a third one",
            "Where a road leaves the driven one, both are candidates and get the same chance: two "
            "estimates. A step later three roads are near: three estimates. The most probable "
            "one is drawn.",
            _fork, "the first fork", 600.0 * FROM_NODE, (600.0, 0.0), (-25.0, 105.0),
            (-40.0, 140.0), (-150.0, 1e9),
        ),
        Scene(
            "outage", "Figure 9", "1.5 km without GPS",
            "In spite of a GPS mask of 1.5 km the vehicle is matched correctly, and the final "
            "position stays close to the GPS points. No error is given.",
            _outage, "where GPS is lost", _MASK[0], (1400.0, 470.0), (1445.0, 1555.0),
            (-100.0, 1700.0), (0.0, _MASK[1] - _MASK[0]),
        ),
        Scene(
            "parallel", "Figure 10", "A road beside the road",
            "When GPS comes back, the fix is nearer to the other side of the road. The method "
            "sees the ambiguity and manages all hypotheses until it is over; the true road "
            "has the highest probability.",
            _parallel, "where GPS comes back", _BACK, (900.0, 0.0), (-35.0, 130.0), (-500.0, 900.0),
            (-_BACK + _SPLIT - 50.0, 1e9),
        ),
        Scene(
            "junction", "Figure 11", "A junction without GPS",
            "GPS is lost at a junction. Two hypotheses are managed for seven steps, then the "
            "wrong one is eliminated; the right one is always the more probable.",
            _junction, "the junction", 600.0 * FROM_NODE, (600.0, 0.0), (-30.0, 120.0),
            (-40.0, 200.0), (-150.0, 1e9),
        ),
        Scene(
            "gst", "Section 2.2", "The receiver's own covariance for each fix",
            "The noise of GPS is not stationary: the receiver reports the covariance of every fix "
            "(NMEA GST), and the filter uses it. Nothing is compared.",
            _gst, "where the houses begin", CANYON_M[0], (0.0, 0.0),
            (0.0, CANYON_M[1] - CANYON_M[0]), (-400.0, 1900.0), (-150.0, 1e9),
        ),
    )
}  # fmt: skip
