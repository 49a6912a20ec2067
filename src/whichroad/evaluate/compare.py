"""An answer beside its truth, epoch by epoch."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import DriveError
from ..geodesy.angles import radians, unwrap_degrees, wrap_degrees
from ..observations import Array
from ..wording import moment
from .input_tables import Bools, Table, roads_of

SLACK_M = 10.0
"""An edge is right if it is, was or will be the true one within so much travel."""

NEES_CAP = 1e4
"""One epoch far off must not hide all others."""

_MOVED = 1e-8  # rad between two places of the truth, some centimetres, that define a course
_LATE_S = 0.5  # s, how far outside the truth's span epochs are compared
_GAP_S, _GAP = 60.0, 10.0  # s, and usual steps, to a row of the truth: farther is a gap of it
_WGS84 = (6378137.0, 6.69437999014e-3)  # m, half the equator's diameter; squared eccentricity


class Comparison(NamedTuple):
    """An answer beside its truth, one row per compared epoch; concatenate them to pool drives.

    A column is NaN where the answer or the truth lacks what it is made of.
    """

    along: Array  # m, estimate less truth, in the true direction of travel
    cross: Array  # m, to the right of it
    heading: Array  # rad
    nees: Array  # squared position error weighed by the inverse covariance, 2 degrees of freedom
    nees_pose: Array  # with the heading, 3 degrees of freedom
    map_error: Array  # m, of the pose in the map's frame; infinite where not given
    right: Bools  # the edge is right within `SLACK_M`, or there is none and none was true
    strict: Bools  # the edge is the true one at that very moment
    along_error: Array  # m along the edge where strictly right, else 0
    p_road: Array  # of the edge; 0 where none is given
    p_off: Array
    on_road: Bools  # in truth
    stopped: Bools  # in truth
    since: Array  # s since the truth began
    outage: Bools
    edge_known: Bools  # whether answer and truth name their edges

    def rows(self, keep: Bools) -> "Comparison":
        """Some of the rows."""
        return Comparison._make(column[keep] for column in self)


def compare(points: Any, truth: Any, *, mask: Sequence[tuple[float, float]] = ()) -> Comparison:
    """Set an answer beside its truth, epoch by epoch; arguments as in `evaluate`.

    Epochs without a position, or outside the truth's span, are left out.

    Raises:
        DriveError: No epoch is left, or they are of several drives.
        ReadError: A column is missing or not of its kind.
    """
    p, t = Table(points, "points"), Table(truth, "truth")
    true_time = t.times()
    p = p.rows(_comparable(p, true_time))
    time = p.times()
    nearest = _nearest(true_time, time)
    bearing = np.interp(time, true_time, np.unwrap(_bearing(t)))
    east, north = _error(p, t, time, true_time, "lat", "lon")
    unknown = np.full(len(time), np.nan)
    turned = (radians(p.numbers("bearing_deg")) if "bearing_deg" in p.names else unknown) - bearing
    heading = -np.arctan2(np.sin(turned), np.cos(turned))
    nees = _nees(east, north, *cov) if (cov := _covariance(p)) is not None else unknown
    map_error = np.full(len(time), np.inf)
    if {"map_lat", "map_lon"} <= p.names & t.names:
        map_error = np.hypot(*_error(p, t, time, true_time, "map_lat", "map_lon"))
    on_road = t.flags("on_road", True)
    named = roads_of(p, t)
    edge, true_edge = named or (np.full(len(time), -1), np.full(len(true_time), -1))
    true_edge = np.where(on_road, true_edge, -1)
    speed = t.numbers("speed_mps", 1.0)[nearest]
    placed = named is not None and {"abscissa_m"} <= p.names & t.names
    along = unknown
    if placed:
        place = t.numbers("abscissa_m", 0.0)[nearest] + speed * (time - true_time[nearest])
        along = p.numbers("abscissa_m", 0.0) - place
    strict = edge == true_edge[nearest]
    outage = t.flags("outage", False)[nearest]
    for begin, end in mask:
        outage = outage | ((time >= begin) & (time <= end))
    return Comparison(
        along=east * np.sin(bearing) + north * np.cos(bearing),
        cross=east * np.cos(bearing) - north * np.sin(bearing),
        heading=heading,
        nees=nees,
        # the table has no covariance of place and heading; the mean is 3 without it, too
        nees_pose=np.minimum(
            nees + (heading / radians(p.known("sigma_bearing_deg"))) ** 2, NEES_CAP
        ),
        map_error=map_error,
        right=within_slack(edge, nearest, true_edge, _travelled(t)),
        strict=strict,
        along_error=np.where(strict & (edge >= 0), along, 0.0) if placed else unknown,
        p_road=p.numbers("p_road", 0.0) if "p_road" in p.names else unknown,
        p_off=p.numbers("p_off_road", 0.0) if "p_off_road" in p.names else unknown,
        on_road=on_road[nearest],
        stopped=speed == 0.0,
        since=time - true_time[0],
        outage=outage,
        edge_known=np.full(len(time), named is not None),
    )


def _covariance(p: Table) -> tuple[Array, Array, Array] | None:
    """East-east, east-north and north-north, m², also of a round sigma; None: not given."""
    if {"cov_ee_m2", "cov_nn_m2"} <= p.names:
        return p.numbers("cov_ee_m2"), p.numbers("cov_en_m2", 0.0), p.numbers("cov_nn_m2")
    if "sigma_m" not in p.names:
        return None
    variance = p.numbers("sigma_m") ** 2
    return variance, np.zeros(len(variance)), variance


def _bearing(t: Table) -> Array:
    """The truth's bearing, rad; where it has none its course, at a standstill the last one."""
    if "bearing_deg" in t.names:
        return radians(t.numbers("bearing_deg"))
    lat, lon = radians(t.numbers("lat")), radians(t.numbers("lon"))
    north, east = np.diff(lat), np.diff(lon) * np.cos(lat[1:])
    moved = np.flatnonzero(np.hypot(north, east) > _MOVED)
    if not len(moved):
        return np.zeros(len(lat))
    k = np.clip(np.searchsorted(moved, np.arange(len(lat)), side="right") - 1, 0, None)
    course: Array = np.arctan2(east, north)[moved[k]]
    return course


def _comparable(p: Table, true_time: Array) -> Bools:
    """Epochs with a position, within the truth's span.

    Raises:
        DriveError: There is none, or they are of several drives.
    """
    drives = p.words("drive_id")
    if len(drives) > 1:
        raise DriveError(
            f"points: epochs of {len(drives)} drives ({', '.join(sorted(drives)[:3])}, ...); one "
            "drive was expected; compare them one by one"
        )
    time = p.times()
    keep = np.isfinite(p.numbers("lat"))
    keep &= (time > true_time[0] - _LATE_S) & (time < true_time[-1] + _LATE_S)
    away = np.abs(true_time[_nearest(true_time, time)] - time)
    usual = float(np.median(np.diff(true_time))) if len(true_time) > 1 else 0.0
    keep &= away < max(_GAP_S, _GAP * usual)
    if not keep.any():
        raise DriveError(
            f"points: none of the result's epochs ({len(time):,}, from {moment(time.min())} to "
            f"{moment(time.max())}) lies within the truth's {true_time[-1] - true_time[0]:.0f} s "
            f"(from {moment(true_time[0])}) with a position; result and truth of one drive were "
            "expected; are they of one drive?"
        )
    return keep


def pool(comparisons: Sequence[Comparison]) -> Comparison:
    """The rows of many drives as one comparison."""
    columns = zip(*comparisons, strict=True)
    return Comparison._make(np.concatenate(column) for column in columns)


def _error(
    p: Table, t: Table, time: Array, true_time: Array, lat: str, lon: str
) -> tuple[Array, Array]:
    """East and north of the estimate from the truth, m."""
    true_lat = np.interp(time, true_time, t.numbers(lat))
    true_lon = np.interp(time, true_time, unwrap_degrees(t.numbers(lon)))
    radius, square = _WGS84
    sin = np.sin(radians(true_lat))
    w = 1.0 - square * sin**2
    prime, meridian = radius / np.sqrt(w), radius * (1.0 - square) / w**1.5
    apart = radians(wrap_degrees(p.numbers(lon) - true_lon))
    north = meridian * radians(p.numbers(lat) - true_lat)
    return prime * np.sqrt(1.0 - sin**2) * apart, north


def _nees(east: Array, north: Array, ee: Array, en: Array, nn: Array) -> Array:
    """Squared error weighed by the inverse covariance; the cap where it is none."""
    det = ee * nn - en**2
    fine = (det > 0.0) & (ee > 0.0)
    weighed = nn * east**2 - 2.0 * en * east * north + ee * north**2
    return np.minimum(np.where(fine, weighed / np.where(fine, det, 1.0), NEES_CAP), NEES_CAP)


def _nearest(grid: Array, time: Array) -> NDArray[np.int64]:
    """Row of the grid (sorted) nearest to each time."""
    k = np.clip(np.searchsorted(grid, time), 1, max(1, len(grid) - 1))
    k = np.minimum(k, len(grid) - 1)
    before = np.maximum(k - 1, 0)
    nearest: NDArray[np.int64] = np.where(time - grid[before] < grid[k] - time, before, k)
    return nearest


def _travelled(t: Table) -> Array:
    """Distance along the truth, m."""
    if "travelled_m" in t.names:
        return t.numbers("travelled_m")
    lat, lon = radians(t.numbers("lat")), radians(t.numbers("lon"))
    steps = 6371e3 * np.hypot(np.diff(lat), np.cos(lat[1:]) * np.diff(lon))
    return np.concatenate([[0.0], np.cumsum(steps)])


def within_slack(
    edge: NDArray[np.int64], row: NDArray[np.int64], true_edge: NDArray[np.int64], travelled: Array
) -> Bools:
    """Whether `edge` (n,) is a true edge within `SLACK_M` of travel about truth row `row` (n,)."""
    starts = np.flatnonzero(np.diff(true_edge, prepend=true_edge[0] - 1))
    runs = true_edge[starts]
    low = np.searchsorted(travelled, travelled[row] - SLACK_M)
    high = np.searchsorted(travelled, travelled[row] + SLACK_M, side="right") - 1
    first = np.searchsorted(starts, low, side="right") - 1
    last = np.searchsorted(starts, high, side="right") - 1
    right = np.zeros(len(edge), dtype=bool)
    for step in range(int((last - first).max()) + 1):
        right |= runs[np.minimum(first + step, last)] == edge
    return right
