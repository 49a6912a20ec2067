"""The schema of what the service publishes: classes of JSON objects, version 1.

A reader passes over keys that it does not know; a key that is there keeps its meaning and unit
as long as `version` does.  Angles are degrees clockwise from north, times are UTC, ellipses are
1 sigma.  What is not known is null, never NaN.  Names and types are those of the tables.
"""

from dataclasses import dataclass
from typing import TypedDict

VERSION = 1


class PoseMessage(TypedDict):
    """Where the middle of the rear axle is."""

    lat: float
    lon: float
    bearing_deg: float
    speed_mps: float | None


class Ellipse(TypedDict):
    """A 1 sigma ellipse."""

    major_m: float
    minor_m: float
    bearing_deg: float  # of the major axis, [0, 180)


class RoadMessage(TypedDict):
    """The most probable road; every field is null off the roads and before the first fix."""

    edge_id: int | None
    source_id: str | None  # text, as in the tables
    forward: bool | None  # driven as the source drew it
    name: str | None
    highway: str | None
    speed_limit_kmh: float | None
    abscissa_m: float | None  # from the edge's beginning
    lateral_m: float | None  # right of its centre line
    matched_lat: float | None  # the point on it
    matched_lon: float | None


class HypothesisMessage(TypedDict):
    """One road that the vehicle may be on (edge_id null: off the roads), with its own pose."""

    p: float
    edge_id: int | None
    name: str | None
    lat: float | None  # null, as the rest: replayed from a table of points, which has no poses
    lon: float | None
    bearing_deg: float | None
    ellipse: Ellipse | None


class FixMessage(TypedDict):
    """The last GNSS fix, the antenna's place."""

    epoch_s: float
    age_s: float
    lat: float
    lon: float
    ellipse: Ellipse | None  # null: the receiver reported none
    believed: bool | None  # false: too far from the estimate; null: masked
    masked: bool  # withheld from the filter by hand
    satellites: int | None  # used, as the receiver says; null: it does not, or it is a recording
    hdop: float | None
    altitude_m: float | None  # above mean sea level
    geoid_m: float | None  # mean sea level above the ellipsoid


class ReckoningMessage(TypedDict):
    """Wheels alone since `since_epoch_s`, for comparison; neither GNSS nor the map enter."""

    lat: float
    lon: float
    bearing_deg: float
    since_epoch_s: float
    travelled_m: float


class LaggedMessage(TypedDict):
    """What is known by now of a moment the lag ago."""

    time: str  # ISO 8601, UTC
    epoch_s: float
    pose: PoseMessage
    map_lat: float
    map_lon: float
    ellipse: Ellipse
    p_road: float
    p_way: float
    p_off_road: float
    road: RoadMessage
    status: str


class SensorMessage(TypedDict):
    """The health of one input."""

    name: str
    kind: str  # gnss, wheels, readings (of further sensors), or file
    state: str  # waiting, ok, silent, lost, ended
    reason: str | None  # why it is lost
    ok: bool
    rate_hz: float
    age_s: float | None  # since it last spoke
    delay_s: float | None  # usual time from an observation's own time to its arrival
    count: int  # observations so far
    skipped: int  # records that could not be used
    refused: int  # fixes of a second sender on the same port


class LearntMessage(TypedDict):
    """A number that the filter has learnt of a sensor."""

    what: str  # errors (over what is reported), scale, drift or bias (of turns, to the left)
    value: float
    sigma: float | None
    unit: str


class HeardMessage(TypedDict):
    """One sensor as the filter hears it, on whatever input it comes."""

    name: str  # gnss, wheels, odometer, speed_and_gyro, gyro, or a further sensor's own
    further: bool
    count: int  # readings so far
    rate_hz: float
    age_s: float | None  # since the last one; null: there was none
    doubted: list[str] | None  # what of it is not believed now; null: not known
    misfits: int | None  # readings of a further sensor that fitted no hypothesis,
    withheld: int | None  # and those that were left out
    learnt: list[LearntMessage]


class PlaceMessage(TypedDict):
    """A point object relative to the vehicle."""

    id: int | str
    distance_m: float  # along the road, where it is ahead; nearby in a straight line
    sigma_m: float
    p: float  # of driving past it, or of being so near
    lat: float
    lon: float


class LevelMessage(TypedDict):
    """A level of the road, with the probability of all roads on it."""

    level: int | None  # roads above the ground; null: off the roads, or what no hypothesis knows
    kind: str | None  # bridge, tunnel or ground
    p: float


class PlayMessage(TypedDict):
    """Whether time is the world's or a recording's."""

    mode: str  # live or replay
    paused: bool
    speed: float | None  # times real time; null: as fast as possible
    position_s: float | None  # from the recording's beginning
    length_s: float | None


LIVE = PlayMessage(mode="live", paused=False, speed=1.0, position_s=None, length_s=None)


class LatencyMessage(TypedDict):
    """From the arrival of a sentence or frame to the estimate's publication, last minute."""

    p50: float | None
    p99: float | None


class EstimateMessage(TypedDict):
    """What is published of one epoch."""

    version: int
    type: str  # "estimate"
    vehicle: str | None  # its name, where a service has several
    seq: int  # rises by one a message; a gap: messages that this client was too slow for
    time: str  # ISO 8601, UTC
    epoch_s: float  # the same in seconds since 1970
    answered: bool  # false until the first fix; pose and ellipse are null then
    pose: PoseMessage | None
    map_lat: float | None  # the pose in the map's frame: what to draw on the map
    map_lon: float | None
    ellipse: Ellipse | None
    sigma_bearing_deg: float | None
    protection_m: float | None  # farther from the truth than this with at most that probability
    protection_level_m: float | None  # the same by its name in the tables
    level_along_m: float | None  # the same along the bearing, and across it
    level_across_m: float | None
    protection_risk: float
    radius95_m: float | None  # radius of the circle round the pose that holds 95 %
    gnss_scale: float  # GNSS errors over what is reported, as learnt
    map_scale: float  # the map's error over `map_sigma`, as learnt
    p_road: float  # of `road.edge_id`
    p_way: float  # of the chain of edges that it is of
    p_off_road: float
    road: RoadMessage
    status: str  # on_road, ambiguous, off_road, outage, stopped, lost
    reason: str  # why, in words; empty where none is needed
    dead_reckoning: bool  # predicted: no sensor has delivered for a while
    stale: bool  # status is lost: sensors are silent for longer than is predicted
    age_s: float  # from epoch_s to now, by the arrival of the newest observation
    lagged: LaggedMessage | None  # null: no --lag, or nothing reaches back so far
    decided_until: float | None  # s since 1970, before which roads are decided; null: none is
    hypotheses: list[HypothesisMessage]  # most probable first
    fix: FixMessage | None
    reckoning: ReckoningMessage | None
    sensors: list[SensorMessage]  # the inputs
    heard: list[HeardMessage]  # what came in on them
    levels: list[LevelMessage]  # most probable first; empty where the map tells none
    ahead: list[PlaceMessage] | None  # within 500 m along the road; null: there are no places
    nearby: list[PlaceMessage] | None  # within 50 m
    gnss_masked: bool
    play: PlayMessage
    latency_ms: LatencyMessage


@dataclass(frozen=True, slots=True)
class ReceiverStatus:
    """What a receiver says of a fix besides the position; None where it does not.

    Attributes:
        satellites: Used for the fix.
        hdop: Horizontal dilution of precision.
        altitude: Of the antenna above mean sea level, m.
        geoid: Height of mean sea level above the ellipsoid, m.
    """

    satellites: int | None = None
    hdop: float | None = None
    altitude: float | None = None
    geoid: float | None = None


UNKNOWN = ReceiverStatus()
