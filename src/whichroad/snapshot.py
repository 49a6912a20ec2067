"""What the belief was at one moment, kept to be put into words when asked for."""

from typing import cast

import numpy as np

from .core.belief import NOW, OFF_ROAD, Belief, D, H, X, Y
from .core.output import (
    V_GNSS_SCALE,
    V_H,
    V_HH,
    V_MAP_X,
    V_MAP_XX,
    V_MAP_Y,
    V_MAP_YY,
    V_MATCH_X,
    V_MATCH_Y,
    V_SPEED,
    V_X,
    V_XX,
    V_Y,
    Output,
)
from .geodesy.plane import Plane
from .reasons import RECENT, STATUS, reason
from .records import Array, Hypothesis, Pose
from .roadmap import RoadMap


def pose_at(plane: Plane, x: float, y: float, heading: float) -> Pose:
    """A pose in the plane, in degrees too."""
    return Pose(x, y, heading, *plane.pose(x, y, heading))


class Snapshot:
    """The details of an estimate (`records.Detail`).

    Args:
        belief: Copied as far as it is needed.
        output: What the filter said, one row.
        value: Its values, as a list.
        roads: The map.
        far_fix: Time of the last fix (s), and how far away it lies if it is not believed (m).
        unknown: P(what no hypothesis knows).
    """

    __slots__ = ("_abscissa", "_cov", "_disbelieved", "_edge", "_mean", "_p", "_roads", "_status",
                 "_unknown", "_value")  # fmt: skip

    def __init__(
        self, belief: Belief, output: Output, value: list[float], roads: RoadMap,
        far_fix: tuple[float, float], unknown: float,
    ) -> None:  # fmt: skip
        n = int(belief.size[0])
        self._roads, self._value, self._status = roads, value, int(output.status[0])
        self._disbelieved = far_fix[1] if belief.clock[NOW] - far_fix[0] <= RECENT else 0.0
        self._p, self._edge = (1.0 - unknown) * belief.probability[:n], belief.edge[:n].copy()
        self._unknown = unknown if n else 0.0
        self._abscissa = belief.abscissa[:n].copy()
        self._mean, self._cov = belief.mean[:n].copy(), belief.cov[:n, :3, :3].copy()

    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """All living hypotheses, most probable first, and what none of them knows.

        That is off the roads, and where the vehicle is by all of them.
        """
        plane, edge, mean = self._roads.plane, self._edge, self._mean
        known = tuple(
            Hypothesis(
                float(self._p[i]),
                int(edge[i]) if edge[i] != OFF_ROAD else None,
                pose_at(plane, float(mean[i, X]), float(mean[i, Y]), float(mean[i, H])),
                self._cov[i],
                float(self._abscissa[i]) if edge[i] != OFF_ROAD else 0.0,
                float(mean[i, D]) if edge[i] != OFF_ROAD else 0.0,
            )
            for i in np.argsort(-self._p)
        )
        if not self._unknown:
            return known
        xx, xy, xh, yy, yh, hh = self._value[V_XX : V_HH + 1]
        cov = np.array([[xx, xy, xh], [xy, yy, yh], [xh, yh, hh]])
        pose = pose_at(plane, self._value[V_X], self._value[V_Y], self._value[V_H])
        none = Hypothesis(self._unknown, None, pose, cov, 0.0, 0.0)
        return tuple(sorted((*known, none), key=lambda h: -h.p))

    def reason(self) -> str:
        """Why the status is what it is."""
        shares: dict[int, float] = {}
        for edge, p in zip(self._edge.tolist(), self._p.tolist(), strict=True):
            shares[edge] = shares.get(edge, 0.0) + p
        return reason(
            STATUS[self._status],
            roads=sorted(shares.items(), key=lambda share: -share[1]),
            name=self._street,
            disbelieved=self._disbelieved,
            scale=self._value[V_GNSS_SCALE],
            answered=len(self._p) > 0,
        )

    def _street(self, edge: int) -> str | None:
        return cast(str | None, self._roads.attributes(edge).get("name"))

    def map_pose(self) -> Pose:
        """The pose in the map's frame."""
        value = self._value
        return pose_at(self._roads.plane, value[V_MAP_X], value[V_MAP_Y], value[V_H])

    def map_cov(self) -> Array:
        """Covariance of the position there, (2, 2), m²."""
        xx, xy, yy = self._value[V_MAP_XX : V_MAP_YY + 1]
        return np.array([[xx, xy], [xy, yy]])

    def matched(self) -> tuple[float, float]:
        """Latitude and longitude of the point on the most probable edge."""
        return self._roads.plane.to_geodetic(self._value[V_MATCH_X], self._value[V_MATCH_Y])

    def speed(self) -> float:
        """m/s, negative in reverse."""
        return self._value[V_SPEED]

    def disbelieved(self) -> float:
        """How far away the last fix lies, if it is not believed, m; else 0."""
        return self._disbelieved
