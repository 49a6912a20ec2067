"""The estimate of one epoch: its record is copied at once, and decoded when a property is read."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingError
from ..filter.state import OFF_ROAD
from ..filter.summary.estimate import LOST_UNKNOWN
from ..geodesy.plane import Plane
from ..observations import Array, Pose
from ..places import AHEAD_M, NEARBY_M, Places, RelativePlace
from ..roadmap import RoadMap
from ..roadmap.attribute_names import known_name
from ..roadmap.attribute_shares import shares_by_value
from ..roadmap.extent import OffMap, beyond, off_map
from ..tables.status import RECENT, STATUS, reason
from .epoch_filter import Living, Row, living, row_of

if TYPE_CHECKING:
    from collections.abc import Iterator

_FEW = 1e-3  # weight of all hypotheses on roads, below which it tells nothing of the others


def pose_at(plane: Plane, x: float, y: float, heading: float) -> Pose:
    """A pose in the plane, in degrees too."""
    return Pose(x, y, heading, *plane.pose(x, y, heading))


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """The vehicle is on this edge, with its own Gaussian.

    Attributes:
        p: Probability of the hypothesis, 0 to 1.
        edge: Number of the directed edge in the map; None: off the roads.
        pose: Mean of the Gaussian.
        cov: (3, 3) of x, y (true metres along the plane's axes) and heading; m², m rad, rad².
        abscissa: m from the edge's start; 0 off road.
        lateral: m right of the centre line in the map's frame; 0 off road.
    """

    p: float
    edge: int | None
    pose: Pose
    cov: Array
    abscissa: float
    lateral: float


class Estimate:
    """Pose, road and probabilities at one moment.

    Before the first fix (or a start pose) nothing is known: `answered` is False, `status` is
    "lost", and `pose`, `cov`, `map_pose`, `map_cov`, `matched` and `speed` are None.

    Places are in metres of the map's plane (`Pose` says what that is) and in WGS 84 degrees.
    Headings are in radians counter-clockwise from the plane's x axis, bearings in degrees
    clockwise from true north.

    It never changes: what the filter held is copied when it is made.  Most of it is worked out
    when it is first asked for.

    Args:
        time: s since 1970.
        row: A record of `filter.summary.estimate.ESTIMATE`.
        hypotheses: As `living_words` copies them.
        roads: The map.
        far_fix: Time of the last fix (s), and how far away it lies if it is not believed (m).
        unknown: P(what no hypothesis knows).
        about: Places, and the hypotheses as these see them; None: no places were given.
    """

    __slots__ = (
        "_about",
        "_far_fix",
        "_fields",
        "_hypotheses",
        "_none",
        "_pose",
        "_record",
        "_roads",
        "_time",
        "_unknown",
    )  # fmt: skip

    def __init__(
        self, time: float, row: bytes, hypotheses: NDArray[np.int64], roads: RoadMap,
        far_fix: tuple[float, float], unknown: float, about: tuple[Places, bytes] | None = None,
    ) -> None:  # fmt: skip
        self._time, self._record, self._hypotheses = time, row, hypotheses
        self._roads, self._far_fix, self._unknown = roads, far_fix, unknown
        self._about = about
        self._fields: Row | None = None
        self._pose: Pose | None = None
        self._none: float | None = None

    @property
    def _known_to_none(self) -> float:
        """P(what no hypothesis knows): that much less `p_road` is than their weights say.

        More than usual where fixes fit none, or the vehicle may have driven off unmeasured.
        """
        if self._none is None:
            known = self._living()
            on_roads = float(known.weight[known.edge != OFF_ROAD].sum())
            least = LOST_UNKNOWN if self.status == "lost" else 0.0
            if on_roads >= _FEW:
                least = 1.0 - (1.0 - self.p_off_road) / on_roads
            self._none = max(self._unknown, least)
        return self._none

    def __repr__(self) -> str:
        names = ("time", "pose", "cov", "edge", "p_road", "p_way", "p_off_road", "status",
                 "abscissa", "lateral", "protection_level", "gnss_scale", "map_scale")  # fmt: skip
        return f"Estimate({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"

    @property
    def _values(self) -> Row:
        if self._fields is None:
            self._fields = row_of(self._record)
        return self._fields

    @property
    def time(self) -> float:
        """Of the observation, s since 1970."""
        return self._time

    @property
    def answered(self) -> bool:
        """Whether there is a pose: a fix came, or a start was given."""
        return self._values.live > 0

    @property
    def pose(self) -> Pose | None:
        """Where M, the middle of the rear axle, is: the mean of all hypotheses; None: unknown."""
        if self._pose is None and self.answered:
            at = self._values
            self._pose = pose_at(self._roads.plane, at.x, at.y, at.heading)
        return self._pose

    @property
    def cov(self) -> Array | None:
        """Its covariance, (3, 3) x, y, heading; m², m rad, rad²; None: there is no pose.

        x and y are axes of the map's stereographic plane, not east and north: `cov_enu` is.
        The metres are true ones.
        """
        at = self._values
        if not at.live:
            return None
        return np.array(
            [
                [at.xx, at.xy, at.xh],
                [at.xy, at.yy, at.yh],
                [at.xh, at.yh, at.hh],
            ]
        )

    @property
    def cov_enu(self) -> Array | None:
        """The same of true east, true north and heading (rad, counter-clockwise).

        It is turned by the convergence of the map's plane; None: there is no pose.
        """
        cov, at = self.cov, self._values
        if cov is None:
            return None
        turn = self._roads.plane.convergence(at.x, at.y)
        c, s = math.cos(turn), math.sin(turn)
        to_east = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return cast(Array, to_east @ cov @ to_east.T)

    @property
    def edge(self) -> int | None:
        """The most probable edge; None: off the roads or lost."""
        edge = self._values.edge
        return edge if edge >= 0 else None

    @property
    def p_road(self) -> float:
        """P(the vehicle is on that edge)."""
        return self._values.p_edge

    @property
    def p_way(self) -> float:
        """P(the vehicle is on the way that this edge is of), at least `p_road`.

        It is P of the most probable chain of edges that follow each other.  Passing a node
        lowers `p_road` for a moment, and not this; a decision that is open lowers both.
        """
        return self._values.p_way

    @property
    def p_off_road(self) -> float:
        """P(the vehicle is on no mapped road)."""
        return self._values.p_off_road

    @property
    def status(self) -> str:
        """on_road, ambiguous, off_road, outage, stopped or lost."""
        return STATUS[self._values.status]

    @property
    def abscissa(self) -> float:
        """Place on the edge, m from its start."""
        return self._values.s

    @property
    def lateral(self) -> float:
        """Offset right of the centre line in the map's frame, m."""
        return self._values.lateral

    @property
    def protection_level(self) -> float:
        """Bound on the position error at `Settings.protection_risk`, m; inf before an answer."""
        return self._values.protection_level if self.answered else math.inf

    @property
    def level_along_m(self) -> float:
        """Bound on the error along the heading, at the same risk, m; inf before an answer."""
        return self._values.level_along if self.answered else math.inf

    @property
    def level_across_m(self) -> float:
        """Bound on the error across the heading, at the same risk, m; inf before an answer."""
        return self._values.level_across if self.answered else math.inf

    @property
    def gnss_scale(self) -> float:
        """GNSS errors over what is reported, as learnt; 1 before an answer."""
        return self._values.gnss_scale if self.answered else 1.0

    @property
    def map_scale(self) -> float:
        """Errors of the map over `Settings.map_sigma`, as learnt; 1 before an answer."""
        return self._values.map_scale if self.answered else 1.0

    @property
    def reason(self) -> str:
        """Why the status is what it is, for people; the competing roads where it is ambiguous.

        A vehicle outside the map is told so, with the distance.
        """
        known = self._living()
        shares: dict[int, float] = {}
        weights = ((1.0 - self._known_to_none) * known.weight).tolist()
        for edge, p in zip(known.edge.tolist(), weights, strict=True):
            shares[edge] = shares.get(edge, 0.0) + p
        words = reason(
            self.status,
            roads=sorted(shares.items(), key=lambda share: -share[1]),
            name=self._street,
            disbelieved=self.disbelieved,
            scale=self._values.gnss_scale,
            answered=len(shares) > 0,
        )
        outside = self._outside(known) if self.status in ("off_road", "lost") else None
        return words if outside is None else f"{words}; {outside.text}"

    def _outside(self, known: Living) -> OffMap | None:
        """Whether the most probable is outside of the circle about the map; no road is sought."""
        if not len(known.weight):
            return None
        top = int(np.argmax(known.weight))
        place = self._roads.plane.to_geodetic(float(known.x[top]), float(known.y[top]))
        return off_map(self._roads, *place, float(beyond(self._roads, *place)))

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """All hypotheses, most probable first, and the probability that none of them is right.

        That is off the roads, and where the vehicle is by all of them.
        """
        known = self._living()
        found, pose, cov = list(self._each(known)), self.pose, self.cov
        unknown = self._known_to_none
        if found and unknown and pose is not None and cov is not None:
            found.append(Hypothesis(unknown, None, pose, cov, 0.0, 0.0))
        return tuple(sorted(found, key=lambda one: -one.p))

    def attribute(self, name: str) -> list[tuple[Any, float]]:
        """Values of an attribute of my road, such as "maxspeed", each with its probability.

        Args:
            name: A column of the points with attributes; "maxspeed" is `speed_limit_kmh`.

        Returns:
            The most probable first, summed over hypotheses.  None is for roads without a
            value, off the roads, and what no hypothesis knows.

        Raises:
            SettingError: The map has no such attribute.
        """
        column = known_name(self._roads.ways, name)
        places = ((h.edge, h.abscissa, h.p) for h in self.hypotheses if h.edge is not None)
        return shares_by_value(self._roads, column, places)

    def ahead(self, within_m: float = AHEAD_M) -> list[RelativePlace]:
        """The places that the vehicle will come past, the nearest first.

        P is that of driving past within the distance, if the vehicle drives on: at each junction
        ahead it is multiplied by the prior of the turn.  The distance is that along the road,
        given that it is passed.

        Args:
            within_m: How far ahead, 0 to 5000 m.

        Raises:
            SettingError: The localizer was made without places, or the distance is none.
        """
        places, stances = self._surroundings()
        return places.ahead(stances, within_m, 1.0 - self._known_to_none)

    def nearby(self, radius_m: float = NEARBY_M) -> list[RelativePlace]:
        """The places within a radius of the vehicle in a straight line, the nearest first.

        Args:
            radius_m: 0 to 5000 m.

        Raises:
            SettingError: The localizer was made without places, or the radius is none.
        """
        places, stances = self._surroundings()
        return places.nearby(stances, radius_m, 1.0 - self._known_to_none)

    def _surroundings(self) -> tuple[Places, bytes]:
        if self._about is None:
            raise SettingError(
                "places: there are none; a Localizer that was made with places=... was expected"
            )
        return self._about

    @property
    def map_pose(self) -> Pose | None:
        """The pose in the map's frame: what to draw on the map; None: there is no pose."""
        at = self._values
        if not at.live:
            return None
        return pose_at(self._roads.plane, at.map_x, at.map_y, at.heading)

    @property
    def map_cov(self) -> Array | None:
        """Covariance of the position in the map's frame, (2, 2) x, y of the plane, m².

        None: there is no pose.
        """
        at = self._values
        if not at.live:
            return None
        return np.array([[at.map_xx, at.map_xy], [at.map_xy, at.map_yy]])

    @property
    def matched(self) -> tuple[float, float] | None:
        """Latitude and longitude (degrees) of the point on the edge; the pose's where none is.

        None: there is no pose.
        """
        if not self.answered:
            return None
        return self._roads.plane.to_geodetic(self._values.match_x, self._values.match_y)

    @property
    def speed(self) -> float | None:
        """Speed, m/s, negative in reverse; None: there is no pose."""
        return self._values.speed if self.answered else None

    @property
    def disbelieved(self) -> float:
        """How far away the last fix lies, if it is not believed, m; else 0."""
        time, metres = self._far_fix
        return metres if self._time - time <= RECENT else 0.0

    def _living(self) -> Living:
        return living(self._hypotheses)

    def _each(self, known: Living) -> "Iterator[Hypothesis]":
        plane, share = self._roads.plane, 1.0 - self._known_to_none
        for i in np.argsort(-known.weight):
            x, y, heading, lateral, xx, xy, xh, yy, yh, hh, weight, along = (
                float(column[i]) for column in known[:-1]
            )
            edge = int(known.edge[i])
            on = edge != OFF_ROAD
            yield Hypothesis(
                share * weight,
                edge if on else None,
                pose_at(plane, x, y, heading),
                np.array([[xx, xy, xh], [xy, yy, yh], [xh, yh, hh]]),
                along if on else 0.0,
                lateral if on else 0.0,
            )

    def _street(self, edge: int) -> str | None:
        return cast(str | None, self._roads.attributes(edge).get("name"))
