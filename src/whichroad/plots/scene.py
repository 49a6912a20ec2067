"""What is drawn, taken from an answer: plane metres about an origin, seconds from the start."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import DriveError
from ..tables.schema import seconds_of

if TYPE_CHECKING:
    import pyarrow as pa

    from ..observations import Array, Fixes
    from ..roadmap import RoadMap
    from ..tables.result import Result

HYPOTHESIS = ("edge", "p", "x", "y", "cov_xx", "cov_xy", "cov_yy")
CHI2_95 = 5.991  # 95 % of a two-dimensional Gaussian lies within this squared distance
MARGIN = 150.0  # m of map drawn about the drive
_AROUND = 8.0  # s shown before and after an unclear moment
LIVE = 0.02  # hypotheses less probable than this are not counted as a choice


class Window(NamedTuple):
    """A stretch of the drive to enlarge, in seconds from the drive's start."""

    title: str
    begin: float
    end: float


@dataclass(frozen=True, slots=True)
class Scene:
    """Arrays of n epochs; rows without a position are NaN, which matplotlib leaves out."""

    time: "Array"  # (n,) s
    xy: "Array"  # (n, 2) m
    p_way: "Array"  # (n,) that of the most probable edge in results of earlier versions
    p_off_road: "Array"  # (n,)
    bound: "Array"  # (n,) semi-major axis of the 95 % ellipse, m
    inside: "NDArray[np.bool_] | None"  # (n,) the 95 % ellipse holds the truth
    status: list[str]
    hypotheses: dict[str, NDArray[Any]]  # (n, 6) each, x and y about the origin
    roads: list["Array"]  # polylines near the drive
    names: dict[int, str]  # of the edges among the hypotheses
    fixes: "Array"  # (m, 2)
    truth: "Array | None"  # (n, 2) at the answer's times
    reckoning: "Array | None"  # (k, 2)
    masked: list[tuple[float, float]]  # s

    def within(self, window: Window) -> NDArray[np.intp]:
        """The epochs of a window that have a position."""
        inside = (self.time >= window.begin) & (self.time <= window.end)
        return np.flatnonzero(inside & np.isfinite(self.xy[:, 0]))

    def is_masked(self) -> NDArray[np.bool_]:
        """Which epochs lie in a masked stretch, shape (n,)."""
        hidden = np.zeros(len(self.time), dtype=bool)
        for begin, end in self.masked:
            hidden |= (self.time >= begin) & (self.time <= end)
        return hidden


def make_scene(
    result: "Result",
    roads: "RoadMap",
    truth: "pa.Table | None",
    fixes: "Fixes | None",
    masked: Iterable[tuple[float, float]],
    reckoning: "pa.Table | None",
    origin: "Array | None" = None,
) -> Scene:
    """Bring everything into one frame and one clock; the origin is the answer's if not given."""
    points = result.to_arrow()
    seconds = seconds_of(points["time"])
    xy = _plane(roads, points)
    origin = origin_of(result, roads) if origin is None else origin
    hypotheses = _hypotheses(result, origin)
    seen = np.empty((0, 2))
    if fixes is not None:
        seen = _to_plane(roads, fixes.lat_deg, fixes.lon_deg) - origin
    there = None if truth is None else _truth_at(seconds, roads, truth) - origin
    return Scene(
        time=seconds - seconds[0],
        xy=xy - origin,
        p_way=way_of(points),
        p_off_road=_column(points, "p_off_road"),
        bound=np.sqrt(CHI2_95) * _column(points, "ellipse_major_m"),
        inside=None if there is None else _inside(points, roads, xy, there + origin),
        status=points["status"].to_pylist(),
        hypotheses=hypotheses,
        roads=_roads_near(roads, xy, origin),
        names={e: _name(roads, e) for e in np.unique(hypotheses["edge"]).tolist() if e >= 0},
        fixes=seen,
        truth=there,
        reckoning=None if reckoning is None else _plane(roads, reckoning) - origin,
        masked=list(masked),
    )


def origin_of(result: "Result", roads: "RoadMap") -> "Array":
    """A round place south-west of the answer, plane metres, shape (2,)."""
    lowest = np.nanmin(_plane(roads, result.to_arrow()), axis=0)
    return np.asarray(np.floor(lowest / 100) * 100)


def ambiguous_windows(scene: Scene) -> list[Window]:
    """The two stretches in which the choice between roads was least clear, in order of time.

    Unclear is a second-best hypothesis of probability above `LIVE`; neighbours less
    than five seconds apart are one stretch, and of each its most unclear part is shown.
    """
    p = np.sort(np.where(scene.hypotheses["edge"] == -2, 0.0, scene.hypotheses["p"]), axis=1)
    second = p[:, -2]
    when = np.flatnonzero(second > LIVE)
    if len(when) == 0:
        middle = float(scene.time[-1]) / 2
        return [Window("Half-way", middle - _AROUND, middle + _AROUND)]
    stretches = np.split(when, np.flatnonzero(np.diff(scene.time[when]) > 5) + 1)
    stretches.sort(key=lambda run: -float(second[run].sum()))
    middles = sorted(
        float(np.average(scene.time[run], weights=second[run])) for run in stretches[:2]
    )
    return [
        Window(f"Which road, {middle:.0f} s after the start?", middle - _AROUND, middle + _AROUND)
        for middle in middles
    ]


def _hypotheses(result: "Result", origin: "Array") -> dict[str, NDArray[Any]]:
    if result.hypotheses is None:
        raise DriveError(
            "the answer was kept without its hypotheses; they were expected, to be drawn; "
            "match with hypotheses=True"
        )
    chosen = {name: result.hypotheses[name] for name in HYPOTHESIS}
    return chosen | {"x": chosen["x"] - origin[0], "y": chosen["y"] - origin[1]}


def way_of(points: "pa.Table") -> "Array":
    """P(way) of each row, (n,); P of the edge where a result of an earlier version lacks it."""
    edge = _column(points, "p_road")
    if "p_way" not in points.column_names:
        return edge
    way = _column(points, "p_way")
    return np.where(np.isnan(way), edge, way)


def _column(table: "pa.Table", name: str) -> "Array":
    values: Array = table[name].to_numpy().astype(float)
    return values


def _plane(roads: "RoadMap", table: "pa.Table") -> "Array":
    return _to_plane(roads, _column(table, "lat"), _column(table, "lon"))


def _to_plane(roads: "RoadMap", lat: "Array", lon: "Array") -> "Array":
    """Plane coordinates of positions, shape (n, 2); NaN where there is none."""
    xy = np.full((len(lat), 2), np.nan)
    present = np.isfinite(lat) & np.isfinite(lon)
    x, y = roads.plane.from_geodetic(lat[present], lon[present])
    xy[present] = np.column_stack([x, y])
    return xy


def _truth_at(seconds: "Array", roads: "RoadMap", truth: "pa.Table") -> "Array":
    """The true position at the answer's times, straight between the truth's own."""
    xy, when = _plane(roads, truth), seconds_of(truth["time"])
    there = np.column_stack([np.interp(seconds, when, xy[:, axis]) for axis in (0, 1)])
    there[(seconds < when[0]) | (seconds > when[-1])] = np.nan
    return there


def _inside(points: "pa.Table", roads: "RoadMap", xy: "Array", truth: "Array") -> NDArray[np.bool_]:
    """Whether each 95 % ellipse holds the truth."""
    apart_x, apart_y = (truth - xy).T
    turn = roads.plane.convergence(*np.nan_to_num(xy).T)  # rows without a position stay NaN
    east = np.cos(turn) * apart_x + np.sin(turn) * apart_y
    north = np.cos(turn) * apart_y - np.sin(turn) * apart_x
    ee, en, nn = (_column(points, name) for name in ("cov_ee_m2", "cov_en_m2", "cov_nn_m2"))
    with np.errstate(invalid="ignore", divide="ignore"):
        squared = (nn * east**2 - 2 * en * east * north + ee * north**2) / (ee * nn - en**2)
        held: NDArray[np.bool_] = squared <= CHI2_95
    return held


def _name(roads: "RoadMap", edge: int) -> str:
    name = roads.attributes(edge)["name"]
    return f"{name} ({edge})" if name else f"edge {edge}"


def _roads_near(roads: "RoadMap", xy: "Array", origin: "Array") -> list["Array"]:
    """The polylines of edges near the drive, each street once."""
    from ..roadmap.drawing import streets

    low, high = np.nanmin(xy, axis=0) - MARGIN, np.nanmax(xy, axis=0) + MARGIN
    near = streets(roads, tuple(low), tuple(high))
    return [roads.edge_line(edge) - origin for edge in near.tolist()]
