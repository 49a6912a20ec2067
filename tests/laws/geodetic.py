"""The same drives through the public names: tables of streets in degrees, readings in time."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import geopandas
import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from scenes import Truth
from whichroad import RoadMap, Settings, Vehicle, match
from whichroad.filter.state import CLOCK, WHEELS
from whichroad.geodesy.plane import Plane
from whichroad.observations import Drive, Fixes, Odometer, WheelCounts

Array = NDArray[np.float64]

PLACE = Plane(49.4, 8.7)
CAR = Vehicle(track_width=1.5, metres_per_tick_left=0.01, metres_per_tick_right=0.01)


def degrees(points: ArrayLike, place: Plane = PLACE) -> Array:
    """Longitude and latitude (n, 2) of points (n, 2) in metres about a place."""
    x, y = np.asarray(points, float).T
    lat, lon = place.to_geodetic(x, y)
    return np.column_stack([lon, lat])


def road_map(lines: Sequence[ArrayLike], **columns: Sequence[Any]) -> RoadMap:
    """The map of streets whose vertices are (longitude, latitude), numbered from 0."""
    table = {"id": list(range(len(lines))), **columns}
    shapes = [shapely.LineString(line) for line in lines]
    return RoadMap.from_edges(geopandas.GeoDataFrame(table, geometry=shapes, crs="EPSG:4326"))


def fixes(
    truth: Truth, fix: Array, at: ArrayLike, *, course: float = 6.0, place: Plane = PLACE
) -> Fixes:
    """Fixes (n, 5) of the plane as a receiver reports those `at`, the first with its course.

    Args:
        truth: The drive.
        fix: x, y, sigma_major, sigma_minor, heading of the major axis.
        at: Epochs.
        course: Sigma of the first one's course, degrees.
        place: The plane.
    """
    rows = np.asarray(at)
    x, y, major, minor, axis = fix[rows].T
    turn = place.convergence(x, y)
    c, s = np.cos(axis - turn), np.sin(axis - turn)
    lat, lon = place.to_geodetic(x, y)
    n = len(rows)
    course_sigma = np.full(n, np.inf)
    course_sigma[0] = course
    return Fixes(
        truth.time[rows], lat, lon, major**2 * c**2 + minor**2 * s**2,
        (major**2 - minor**2) * c * s, major**2 * s**2 + minor**2 * c**2,
        np.gradient(truth.s, truth.time)[rows], np.full(n, 0.3),
        np.degrees(0.5 * np.pi - truth.heading[rows] + turn) % 360.0, course_sigma,
        np.zeros(n, np.uint8),
    )  # fmt: skip


def drive(truth: Truth, said: Fixes, mode: int) -> Drive:
    """The drive of a car that has wheels, an odometer or GNSS alone."""
    half = 0.5 * CAR.track_width * (truth.heading - truth.heading[0])
    odometry = None
    if mode == WHEELS:
        odometry = WheelCounts(truth.time, 100.0 * (truth.s - half), 100.0 * (truth.s + half))
    elif mode != CLOCK:
        odometry = Odometer(truth.time, truth.s)
    return Drive("d", said, odometry)


class Answer(NamedTuple):
    """Columns of the points, (n,) each."""

    lat: Array
    lon: Array
    bearing: Array  # degrees
    cov_ee: Array
    cov_en: Array
    cov_nn: Array
    p_road: Array
    p_off_road: Array
    alternatives: list[dict[int, float]]  # probability of each edge

    def p_of(self, roads: RoadMap, street: int) -> Array:
        """Probability of both directions of a street of `road_map`, (n,)."""
        mine = {e for e, name in enumerate(roads.column("source_id")) if int(name) == street}
        return np.array([sum(p for e, p in row.items() if e in mine) for row in self.alternatives])


def answer(
    drive: Drive, roads: RoadMap, *, side: str = "right", settings: Settings | None = None
) -> Answer:
    """What `match` says."""
    car = Vehicle(
        track_width=CAR.track_width, metres_per_tick_left=0.01, metres_per_tick_right=0.01,
        driving_side=side,
    )  # fmt: skip
    points = match(drive, roads, vehicle=car, settings=settings).to_arrow()
    names = ("lat", "lon", "bearing_deg", "cov_ee_m2", "cov_en_m2", "cov_nn_m2", "p_road",
             "p_off_road")  # fmt: skip
    rows = points["alternatives"].to_pylist()
    return Answer(
        *(points[name].to_numpy() for name in names),
        [{a["edge_id"]: a["p"] for a in row} for row in rows],
    )
