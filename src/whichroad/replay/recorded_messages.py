"""The messages that the live service would have sent for a recorded drive, epoch by epoch.

They are made from a result.  With `hypotheses` the alternatives have poses.  Without,
they come from the table of points and name edges only.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ..diagnosis.sensor_states import SensorTrack
from ..geodesy.angles import axis_bearing_of, bearing_of, radians
from ..geodesy.units import METRES_PER_DEGREE
from ..live.message_types import VERSION, EstimateMessage, PlayMessage
from ..live.messages import iso, level_messages
from ..observations import Array
from ..ragged import row_and_place
from ..roadmap.level_shares import LevelShare, LevelShares
from ..sensors.gnss import ellipse
from ..tables.schema import seconds_of
from ..tables.status import STATUS, far_off
from .driven_path import Route
from .places_about import PlacesAbout
from .signals import Signals

if TYPE_CHECKING:
    from ..live.message_types import HeardMessage
    from ..places import Places
    from ..roadmap import RoadMap
    from ..tables.result import Result

Window = tuple[float, float]

NONE = -2  # edge of an alternative that is not there
OFF = -1  # off the roads

_NUMBERS = (
    "lat", "lon", "bearing_deg", "speed_mps", "sigma_bearing_deg", "ellipse_major_m",
    "ellipse_minor_m", "ellipse_bearing_deg", "abscissa_m", "lateral_m", "matched_lat",
    "matched_lon", "map_lat", "map_lon", "p_road", "p_way", "p_off_road", "protection_level_m",
    "gnss_scale", "map_scale",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Choices:
    """The alternatives of n epochs, (n, k) each; poses are NaN where they were not kept."""

    edge: NDArray[np.int64]  # NONE, OFF or an edge
    p: Array
    lat: Array
    lon: Array
    bearing_deg: Array
    major: Array  # 1 sigma, m
    minor: Array
    axis_deg: Array  # bearing of the major axis


class RecordedMessages:
    """The messages of one drive.

    Args:
        result: The answer.
        roads: The map it was matched to; without it streets have no names.
        signals: The sensors' recordings, if known.
        masked: Windows (s since 1970) in which GNSS was withheld.
        places: Of a result that was read from a file; one that `match` gave has its own.
    """

    def __init__(
        self, result: "Result", roads: "RoadMap | None" = None, signals: Signals | None = None,
        masked: Sequence[Window] = (), places: "Places | None" = None,
    ) -> None:  # fmt: skip
        points = result.to_arrow()
        self.drive_id = str(points["drive_id"][0].as_py()) if points.num_rows else ""
        self.time: Array = seconds_of(points["time"])
        self.columns = {
            name: points[name].to_numpy().astype(np.float64)
            for name in _NUMBERS
            if name in points.column_names
        }
        way = self.columns.get("p_way")  # null in what an earlier version wrote
        self.has_way = way is not None and not np.isnan(way).all()
        if not self.has_way:
            self.columns["p_way"] = self.columns["p_road"]
        edge = points["edge_id"].fill_null(NONE).to_numpy().astype(np.int64)
        self.edge = edge
        words = points["status"].to_numpy().astype(str)
        self.status = _RANKS[np.searchsorted(_SORTED, words)]
        self.reason: list[str] = points["reason"].to_pylist()
        self.masked = list(masked)
        self.signals = signals or Signals()
        self._roads = roads
        self.route = None if roads is None else _route(result.path_arrow(), self.drive_id, roads)
        self._streets: dict[tuple[int, int | None], dict[str, Any]] = {}
        self._source = points["source_id"] if "source_id" in points.column_names else None
        poses = result.hypotheses
        self.choices = (
            _from_poses(poses, roads)
            if poses is not None and roads is not None
            else _from_table(points, self.columns, edge)
        )
        self.reckoning = self.signals.reckoning(self, self.used_fixes())
        self.sensor_track = result.sensor_track or SensorTrack([], [])
        self.places = PlacesAbout.of_points(points, places) if places is not None else None
        if result.surroundings:
            self.places = PlacesAbout.of_drive(result.surroundings[0])
        self._levels = None if roads is None else LevelShares(roads)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def length(self) -> float:
        """Duration, s."""
        return float(self.time[-1] - self.time[0]) if len(self) else 0.0

    def at(self, seconds: float) -> int:
        """The epoch at some seconds after the beginning."""
        k = int(np.searchsorted(self.time, self.time[0] + seconds + 1e-6, side="right")) - 1
        return min(max(k, 0), len(self) - 1)

    def is_masked(self, time: Any) -> Any:
        """Whether GNSS is withheld at a time, or at times (s since 1970)."""
        hidden = np.zeros(np.shape(time), bool)
        for low, high in self.masked:
            hidden |= (time >= low) & (time <= high)
        return hidden

    def used_fixes(self) -> Array:
        """Times of the fixes that the filter was given."""
        times = self.signals.fix_times
        return times[~self.is_masked(times)] if len(times) else times

    def between(self, at: NDArray[np.int64]) -> dict[int, list[list[float]]]:
        """[lat, lon] of the route's vertices between some epochs that are far apart in time.

        Args:
            at: (n,) the epochs, rising.

        Returns:
            By index in `at`: the path to it from the epoch before.
        """
        if self.route is None or self._roads is None:
            return {}
        along = self.columns["abscissa_m"]
        return self.route.between(self.time[at], self.edge[at], along[at], self._roads)

    def track(self) -> tuple[Array, Array]:
        """Latitudes and longitudes of the track, along the roads between distant epochs."""
        known = np.flatnonzero(np.isfinite(self.columns["lat"]))
        lat, lon = self.columns["lat"][known], self.columns["lon"][known]
        lines = self.between(known)
        if not lines:
            return lat, lon
        place = np.repeat(list(lines), [len(line) for line in lines.values()])
        more = np.array([point for line in lines.values() for point in line])
        return np.insert(lat, place, more[:, 0]), np.insert(lon, place, more[:, 1])

    @property
    def driven(self) -> float:
        """Distance driven, m: along the path if points are far apart, else point to point."""
        known = np.flatnonzero(np.isfinite(self.columns["lat"]))
        if self.route is not None and self.between(known):
            return self.route.length
        lat, lon = self.columns["lat"][known], self.columns["lon"][known]
        return float(np.sum(_metres(np.diff(lat), np.diff(lon), lat[:1].sum())))

    def street(self, edge: int, s: float | None = None) -> dict[str, Any]:
        """Columns of an edge's street, at a place or of its longest piece; nothing without a map.

        Args:
            edge: Its number.
            s: m from its start.
        """
        if self._roads is None or not 0 <= edge < len(self._roads):
            return {}
        piece = None if s is None else int(self._roads.piece(np.array([edge]), np.array([s]))[0])
        if (edge, piece) not in self._streets:
            self._streets[edge, piece] = self._roads.attributes(edge, s)
        return self._streets[edge, piece]

    def message(self, k: int, seq: int, play: PlayMessage) -> EstimateMessage:
        """The live service's message at epoch k.

        Args:
            k: The epoch.
            seq: Number of the message.
            play: Where the replay stands.
        """
        time, answered = float(self.time[k]), bool(np.isfinite(self._get("lat", k) or np.nan))
        message = {
            "version": VERSION, "type": "estimate", "vehicle": None, "seq": seq, "time": iso(time),
            "epoch_s": round(time, 6), "answered": answered,
            "pose": self._pose(k) if answered else None,
            "map_lat": self._get("map_lat", k), "map_lon": self._get("map_lon", k),
            "ellipse": self._ellipse(k), "sigma_bearing_deg": self._get("sigma_bearing_deg", k),
            "protection_m": self._get("protection_level_m", k),
            "protection_level_m": self._get("protection_level_m", k),
            "level_along_m": self._get("level_along_m", k),
            "level_across_m": self._get("level_across_m", k), "protection_risk": 1e-3,
            "radius95_m": None, "gnss_scale": self._get("gnss_scale", k) or 0.0,
            "map_scale": self._get("map_scale", k) or 1.0,
            "p_road": self._get("p_road", k) or 0.0,
            "p_way": self._get("p_way", k) or 0.0,
            "p_off_road": self._get("p_off_road", k) or 0.0,
            "road": self._road(k), "status": STATUS[self.status[k]],
            "reason": self.reason[k] or "", "dead_reckoning": False,
            "stale": False, "age_s": 0.0,
            "lagged": None, "decided_until": None,
            "hypotheses": self.hypotheses(k),
            "fix": self._fix(k),
            "reckoning": self.reckoning.at(k), "sensors": self.signals.sensors(time),
            "heard": self.heard(k),
            "levels": level_messages(self.levels(k)),
            "ahead": None if self.places is None else self.places.ahead(k),
            "nearby": None if self.places is None else self.places.nearby(k),
            "gnss_masked": bool(self.is_masked(time)), "play": play,
            "latency_ms": {"p50": None, "p99": None},
        }  # fmt: skip
        return cast(EstimateMessage, message)

    def hypotheses(self, k: int) -> list[dict[str, Any]]:
        """The alternatives of epoch k, most probable first."""
        c = self.choices
        found = []
        for j in range(c.edge.shape[1]):
            edge = int(c.edge[k, j])
            if edge == NONE or c.p[k, j] <= 0.0:
                continue
            known = bool(np.isfinite(c.lat[k, j]))
            shape = {
                "major_m": round(float(c.major[k, j]), 3),
                "minor_m": round(float(c.minor[k, j]), 3),
                "bearing_deg": round(float(c.axis_deg[k, j]), 2),
            }
            found.append(
                {
                    "p": round(float(c.p[k, j]), 6),
                    "edge_id": edge if edge >= 0 else None,
                    "name": self.street(edge).get("name"),
                    "lat": round(float(c.lat[k, j]), 8) if known else None,
                    "lon": round(float(c.lon[k, j]), 8) if known else None,
                    "bearing_deg": round(float(c.bearing_deg[k, j]), 3) if known else None,
                    "ellipse": shape if known else None,
                }
            )
        return found

    def heard(self, k: int) -> "list[HeardMessage]":
        """The sensors as they were heard until epoch k, and what the filter held of them."""
        time = float(self.time[k])
        return self.signals.heard_at(time, self.sensor_track.at(time))

    def levels(self, k: int) -> list[LevelShare]:
        """Levels of the road at epoch k; of edges but the best the level at their middle counts."""
        if self._levels is None or not np.isfinite(self.columns["lat"][k]):
            return []
        edge, p = self.choices.edge[k], self.choices.p[k]
        here = (edge != NONE) & (p > 0.0)
        edges, best, s = edge[here].tolist(), int(self.edge[k]), self.columns["abscissa_m"][k]
        along = [s if one == best else self._middle(one) for one in edges]
        return self._levels.of(edges, along, p[here].tolist())

    def _middle(self, edge: int) -> float:
        if self._roads is None or edge < 0:
            return 0.0
        return 0.5 * float(self._roads.arrays.edges.length[edge])

    def _get(self, name: str, k: int) -> float | None:
        column = self.columns.get(name)
        value = float(column[k]) if column is not None else np.nan
        return round(value, 8) if np.isfinite(value) else None

    def _pose(self, k: int) -> dict[str, float | None]:
        return {name: self._get(name, k) for name in ("lat", "lon", "bearing_deg", "speed_mps")}

    def _fix(self, k: int) -> dict[str, Any] | None:
        """The last fix, and whether it is consistent with the estimate."""
        time = float(self.time[k])
        fix = self.signals.fix(time)
        if fix is None:
            return None
        masked = bool(self.is_masked(fix["epoch_s"]))
        lat, lon, major = (self.columns[n][k] for n in ("lat", "lon", "ellipse_major_m"))
        away = float(_metres(fix["lat"] - lat, fix["lon"] - lon, lat))
        own = (fix["ellipse"] or {"major_m": 0.0})["major_m"]
        near = not far_off(away, float(np.hypot(own, major)))
        return {
            **fix, "believed": None if masked else near, "masked": masked,
            "satellites": None, "hdop": None, "altitude_m": None, "geoid_m": None,
        }  # fmt: skip

    def _ellipse(self, k: int) -> dict[str, float | None] | None:
        names = ("major_m", "minor_m", "bearing_deg")
        shape = {name: self._get(f"ellipse_{name}", k) for name in names}
        return None if None in shape.values() else shape

    def _road(self, k: int) -> dict[str, Any]:
        edge = int(self.edge[k])
        street = self.street(edge, self._get("abscissa_m", k)) if edge >= 0 else {}
        return {
            "edge_id": edge if edge >= 0 else None,
            "source_id": self._source[k].as_py() if self._source is not None else None,
            "forward": None, "name": street.get("name"), "highway": street.get("highway"),
            "speed_limit_kmh": street.get("speed_limit_kmh"),
            "abscissa_m": self._get("abscissa_m", k), "lateral_m": self._get("lateral_m", k),
            "matched_lat": self._get("matched_lat", k),
            "matched_lon": self._get("matched_lon", k),
        }  # fmt: skip


def _route(path: Any, drive_id: str, roads: "RoadMap") -> Route | None:
    """The route, where the answer has one on this map."""
    route = Route.of(path, drive_id)
    return None if route is None or route.edge.max() >= len(roads) else route


def _metres(lat: Any, lon: Any, at: float) -> Any:
    """Length of small differences of positions in degrees."""
    return np.hypot(lat, lon * np.cos(radians(at))) * METRES_PER_DEGREE


_SORTED = np.array(sorted(STATUS))
_RANKS = np.array([STATUS.index(word) for word in sorted(STATUS)])


def _from_poses(poses: dict[str, NDArray[Any]], roads: "RoadMap") -> Choices:
    """Alternatives with their own poses, from the plane to degrees."""
    plane, x, y = roads.plane, poses["x"], poses["y"]
    lat, lon = plane.to_geodetic(x, y)
    turn = plane.convergence(x, y)
    bearing = bearing_of(poses["heading"], turn)
    major, minor, heading = ellipse(poses["cov_xx"], poses["cov_xy"], poses["cov_yy"])
    axis = axis_bearing_of(heading, turn)
    edge = poses["edge"].astype(np.int64)
    return Choices(edge, poses["p"], lat, lon, bearing, major, minor, axis)


def _from_table(points: Any, columns: dict[str, Array], best: NDArray[np.int64]) -> Choices:
    """Alternatives without poses: the best has the answer's, the others none.

    Args:
        points: (n,) rows, with or without `alternatives`.
        columns: Their numbers.
        best: (n,) the most probable edge, NONE off the roads.
    """
    n = len(best)
    edge, p = _alternatives(points, n)
    if not edge.shape[1]:  # a table without them: the best alone
        edge = np.where(best >= 0, best, NONE)[:, None]
        p = np.where(best >= 0, np.nan_to_num(columns["p_road"]), 0.0)[:, None]
    off = np.nan_to_num(columns.get("p_off_road", np.zeros(n)))
    edge = np.column_stack([edge, np.where(off > 0.0, OFF, NONE)])
    p = np.column_stack([p, off])
    order = np.argsort(-p, axis=1, kind="stable")
    edge, p = np.take_along_axis(edge, order, 1), np.take_along_axis(p, order, 1)
    here = (edge == best[:, None]) & (edge >= 0) | ((edge == OFF) & (best[:, None] == NONE))

    def own(name: str) -> Array:
        column = columns.get(name, np.full(n, np.nan))
        return np.where(here, column[:, None], np.nan)

    return Choices(
        edge, p, own("lat"), own("lon"), own("bearing_deg"), own("ellipse_major_m"),
        own("ellipse_minor_m"), own("ellipse_bearing_deg"),
    )  # fmt: skip


def _alternatives(points: Any, n: int) -> tuple[NDArray[np.int64], Array]:
    """The lists of the column `alternatives` as (n, k) edges and P."""
    if "alternatives" not in points.column_names:
        return np.empty((n, 0), np.int64), np.empty((n, 0))
    lists = points["alternatives"].combine_chunks()
    flat = lists.flatten()
    count = lists.value_lengths().fill_null(0).to_numpy()
    row, place = row_and_place(count)
    most = int(count.max(initial=0))
    edge, p = np.full((n, most), NONE, np.int64), np.zeros((n, most))
    edge[row, place] = flat.field("edge_id").to_numpy(zero_copy_only=False)
    p[row, place] = flat.field("p").to_numpy(zero_copy_only=False)
    return edge, p
