"""What the service publishes: one JSON object per estimate, version 1.

The same object goes out on the WebSocket, as a server-sent event, over `/estimate` and
into the recording.  `message_types` is its schema.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from ..geodesy.angles import axis_bearing_of, degrees
from ..geodesy.plane import Plane
from ..observations import Array, GeoFix, Pose
from ..online import Estimate, Hypothesis
from ..places import AHEAD_M, NEARBY_M, Places
from ..roadmap import RoadMap
from ..roadmap.level_shares import LevelShare, LevelShares
from .message_types import (
    LIVE,
    UNKNOWN,
    VERSION,
    Ellipse,
    EstimateMessage,
    FixMessage,
    HeardMessage,
    HypothesisMessage,
    LaggedMessage,
    LatencyMessage,
    LevelMessage,
    PlayMessage,
    PoseMessage,
    ReceiverStatus,
    ReckoningMessage,
    RoadMessage,
    SensorMessage,
)
from .place_messages import LEAST_P, PlaceMessages


@dataclass(frozen=True, slots=True)
class Around:
    """What a message holds besides the estimate."""

    seq: int = 0
    vehicle: str | None = None
    receiver: ReceiverStatus | None = None
    fix: GeoFix | None = None
    fix_masked: bool = False
    dead_reckoning: bool = False
    age: float = 0.0  # s since the estimate's time, by the arrival of the newest observation
    stale: bool = False
    lagged: Estimate | None = None
    decided_until: float | None = None
    reckoning: ReckoningMessage | None = None
    sensors: Sequence[SensorMessage] = ()
    heard: Sequence[HeardMessage] = ()
    gnss_masked: bool = False
    play: PlayMessage = field(default_factory=LIVE.copy)
    latency_ms: LatencyMessage = field(default_factory=lambda: LatencyMessage(p50=None, p99=None))
    protection_risk: float = 1e-3


NO_ROAD = RoadMessage(
    edge_id=None, source_id=None, forward=None, name=None, highway=None, speed_limit_kmh=None,
    abscissa_m=None, lateral_m=None, matched_lat=None, matched_lon=None,
)  # fmt: skip


class Messages:
    """Makes messages; caches the names of a map's roads.

    Args:
        roads: The map that the estimates are of.
        places: Point objects that the estimates are asked about.
    """

    def __init__(self, roads: RoadMap, places: Places | None = None) -> None:
        self._roads, self._levels = roads, LevelShares(roads)
        self._places = None if places is None else PlaceMessages(places)
        self._streets: dict[int, dict[str, Any]] = {}  # place in `RoadMap.pieces` -> its columns

    def estimate(self, estimate: Estimate, around: Around) -> EstimateMessage:
        """The message of one estimate.

        Args:
            estimate: The localizer's.
            around: Everything else.
        """
        hypotheses, until, places = estimate.hypotheses, around.decided_until, self._places
        pose, cov, map_pose = estimate.pose, estimate.cov, estimate.map_pose
        status, reason = _status(estimate, around)
        level = math.inf if around.stale else estimate.protection_level
        return EstimateMessage(
            version=VERSION,
            type="estimate",
            vehicle=around.vehicle,
            seq=around.seq,
            time=iso(estimate.time),
            epoch_s=round(estimate.time, 6),
            answered=estimate.answered,
            pose=_pose(pose, estimate.speed) if pose else None,
            map_lat=round(map_pose.lat, 8) if map_pose else None,
            map_lon=round(map_pose.lon, 8) if map_pose else None,
            ellipse=_ellipse(self._roads.plane, pose, cov),
            sigma_bearing_deg=None
            if cov is None
            else round(degrees(math.sqrt(max(float(cov[2, 2]), 0.0))), 3),
            protection_m=_finite(level, 3),
            protection_level_m=_finite(level, 3),
            level_along_m=None if around.stale else _finite(estimate.level_along_m, 3),
            level_across_m=None if around.stale else _finite(estimate.level_across_m, 3),
            protection_risk=around.protection_risk,
            radius95_m=_radius95(hypotheses, pose.x, pose.y) if pose else None,
            gnss_scale=round(estimate.gnss_scale, 3),
            map_scale=round(estimate.map_scale, 3),
            p_road=round(estimate.p_road, 6),
            p_way=round(estimate.p_way, 6),
            p_off_road=round(estimate.p_off_road, 6),
            road=self._road(estimate),
            status=status,
            reason=reason,
            dead_reckoning=around.dead_reckoning,
            stale=around.stale,
            age_s=round(around.age, 3),
            lagged=None if around.lagged is None else self._lagged(around.lagged),
            decided_until=None if until is None else round(until, 6),
            hypotheses=[self._hypothesis(h) for h in hypotheses],
            fix=_fix(estimate, around),
            reckoning=around.reckoning,
            sensors=list(around.sensors),
            heard=list(around.heard),
            levels=self._levels_of(hypotheses),
            ahead=None if places is None else places.of(estimate.ahead(AHEAD_M)),
            nearby=None if places is None else places.of(estimate.nearby(NEARBY_M)),
            gnss_masked=around.gnss_masked,
            play=around.play,
            latency_ms=around.latency_ms,
        )

    def _levels_of(self, hypotheses: Sequence[Hypothesis]) -> list[LevelMessage]:
        edges = [-1 if one.edge is None else one.edge for one in hypotheses]
        found = self._levels.of(
            edges, [one.abscissa for one in hypotheses], [one.p for one in hypotheses]
        )
        return level_messages(found)

    def _lagged(self, estimate: Estimate) -> LaggedMessage | None:
        """The smoothed estimate, of the moment the lag ago."""
        pose, map_pose = estimate.pose, estimate.map_pose
        ellipse = _ellipse(self._roads.plane, pose, estimate.cov)
        if pose is None or map_pose is None or ellipse is None:
            return None
        return LaggedMessage(
            time=iso(estimate.time),
            epoch_s=round(estimate.time, 6),
            pose=_pose(pose, estimate.speed),
            map_lat=round(map_pose.lat, 8),
            map_lon=round(map_pose.lon, 8),
            ellipse=ellipse,
            p_road=round(estimate.p_road, 6),
            p_way=round(estimate.p_way, 6),
            p_off_road=round(estimate.p_off_road, 6),
            road=self._road(estimate),
            status=estimate.status,
        )

    def _road(self, estimate: Estimate) -> RoadMessage:
        if estimate.edge is None or estimate.matched is None:
            return NO_ROAD
        street = self._street(estimate.edge, estimate.abscissa)
        lat, lon = estimate.matched
        return RoadMessage(
            edge_id=self._roads.edge_id(estimate.edge),
            source_id=street["source_id"],
            forward=street["forward"],
            name=street.get("name"),
            highway=street.get("highway"),
            speed_limit_kmh=street.get("speed_limit_kmh"),
            abscissa_m=round(estimate.abscissa, 3),
            lateral_m=round(estimate.lateral, 3),
            matched_lat=round(lat, 8),
            matched_lon=round(lon, 8),
        )

    def _hypothesis(self, one: Hypothesis) -> HypothesisMessage:
        name = None if one.edge is None else self._street(one.edge, one.abscissa).get("name")
        pose = one.pose
        return HypothesisMessage(
            p=round(one.p, 6),
            edge_id=None if one.edge is None else self._roads.edge_id(one.edge),
            name=name,
            lat=round(pose.lat, 8),
            lon=round(pose.lon, 8),
            bearing_deg=round(pose.bearing_deg, 3),
            ellipse=_ellipse_of(self._roads.plane, pose, one.cov),
        )

    def _street(self, edge: int, s: float) -> dict[str, Any]:
        """Columns of the street there, each read once."""
        piece = int(self._roads.piece(edge, s)[0])
        street = self._streets.get(piece)
        if street is None:
            if len(self._streets) >= 4096:
                self._streets.clear()
            source, forward = self._roads.source(edge, s)
            street = {
                **self._roads.attributes(edge, s), "source_id": str(source), "forward": forward,
            }  # fmt: skip
            self._streets[piece] = street
        return street


def _status(estimate: Estimate, around: Around) -> tuple[str, str]:
    """Status and reason; a stale estimate tells where the vehicle was, not where it is."""
    if not around.stale or not estimate.answered:
        return estimate.status, estimate.reason
    return "lost", f"no sensor delivers: the pose is of {around.age:.0f} s ago"


def _pose(pose: Pose, speed: float | None) -> PoseMessage:
    return PoseMessage(
        lat=round(pose.lat, 8),
        lon=round(pose.lon, 8),
        bearing_deg=round(pose.bearing_deg, 3),
        speed_mps=None if speed is None else round(speed, 3),
    )


def iso(time: float) -> str:
    """Seconds since 1970 as ISO 8601 in UTC, to the millisecond."""
    moment = datetime.fromtimestamp(round(time, 3), UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def level_messages(levels: Sequence[LevelShare]) -> list[LevelMessage]:
    """Levels as they are published; the least probable are left out."""
    return [
        LevelMessage(level=one.level, kind=one.kind, p=round(one.p, 4))
        for one in levels
        if one.p >= LEAST_P
    ]


def _finite(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


def _ellipse(plane: Plane, pose: Pose | None, cov: Array | None) -> Ellipse | None:
    return None if pose is None or cov is None else _ellipse_of(plane, pose, cov)


def _ellipse_of(plane: Plane, pose: Pose, cov: Array) -> Ellipse:
    """1 sigma ellipse of a position in the plane, its bearing from true north."""
    xx, xy, yy = float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
    return _axes(xx, xy, yy, plane.convergence(pose.x, pose.y))


def _axes(ee: float, en: float, nn: float, turn: float = 0.0) -> Ellipse:
    mean, half = 0.5 * (ee + nn), math.hypot(0.5 * (ee - nn), en)
    heading = 0.5 * math.atan2(2.0 * en, ee - nn)
    return Ellipse(
        major_m=round(math.sqrt(max(mean + half, 0.0)), 3),
        minor_m=round(math.sqrt(max(mean - half, 0.0)), 3),
        bearing_deg=round(axis_bearing_of(heading, turn), 2),
    )


def _fix(estimate: Estimate, around: Around) -> FixMessage | None:
    fix = around.fix
    if fix is None:
        return None
    said = around.receiver or UNKNOWN
    reported = math.isfinite(fix.cov_ee) and math.isfinite(fix.cov_nn)
    return FixMessage(
        epoch_s=round(fix.time, 6),
        age_s=round(max(estimate.time + around.age - fix.time, 0.0), 3),
        lat=round(fix.lat_deg, 8),
        lon=round(fix.lon_deg, 8),
        ellipse=_axes(fix.cov_ee, fix.cov_en, fix.cov_nn) if reported else None,
        believed=None if around.fix_masked else estimate.disbelieved == 0.0,
        masked=around.fix_masked,
        satellites=said.satellites,
        hdop=said.hdop,
        altitude_m=said.altitude,
        geoid_m=said.geoid,
    )


def _radius95(hypotheses: Sequence[Hypothesis], x: float, y: float) -> float | None:
    """A radius round (x, y) that at least 95 % of the mixture lies in, m.

    Each Gaussian lies within r of its own middle with 1 - exp(-r² / 2 major²) or more, so
    the smallest r with  Σ p_i exp(-(r - d_i)² / 2 major_i²) <= 0.05  will do.
    """
    parts = []
    for one in hypotheses:
        xx, xy, yy = float(one.cov[0, 0]), float(one.cov[0, 1]), float(one.cov[1, 1])
        variance = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
        parts.append((one.p, math.hypot(one.pose.x - x, one.pose.y - y), max(variance, 1e-12)))
    low, high = 0.0, max(d + 4.0 * math.sqrt(v) for _, d, v in parts)
    while high - low > 0.01 * high:
        r = 0.5 * (low + high)
        outside = sum(
            p * (math.exp(-0.5 * (r - d) ** 2 / v) if r > d else 1.0) for p, d, v in parts
        )
        low, high = (r, high) if outside > 0.05 else (low, r)
    return round(high, 3)
