"""What the belief was at one moment, kept to be put into words when asked for."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from ._compile import Record
from .filter.estimate import ESTIMATE
from .filter.state import OFF_ROAD, Belief, D, H, X, Y
from .geodesy.plane import Plane
from .observations import Array, Hypothesis, Pose
from .roadmap import RoadMap
from .tables.status import RECENT, STATUS, reason


def row_of(estimate: Record) -> Any:
    """A record of `filter.estimate.ESTIMATE` as plain Python, which is read ten times as fast."""
    row = SimpleNamespace(**dict(zip(ESTIMATE.names or (), estimate.item(), strict=True)))
    row.cov, row.map_cov = row.cov.tolist(), row.map_cov.tolist()
    return row


def pose_at(plane: Plane, x: float, y: float, heading: float) -> Pose:
    """A pose in the plane, in degrees too."""
    return Pose(x, y, heading, *plane.pose(x, y, heading))


class Snapshot:
    """The details of an estimate (`observations.Detail`).

    Args:
        belief: Copied as far as it is needed.
        row: Of the estimate, see `row_of`.
        roads: The map.
        far_fix: Time of the last fix (s), and how far away it lies if it is not believed (m).
        unknown: P(what no hypothesis knows).
    """

    __slots__ = ("_abscissa", "_cov", "_disbelieved", "_edge", "_mean", "_p", "_roads", "_row",
                 "_unknown")  # fmt: skip

    def __init__(
        self, belief: Belief, row: Any, roads: RoadMap, far_fix: tuple[float, float],
        unknown: float,
    ) -> None:  # fmt: skip
        state, hyp = belief.state.view(np.ndarray), belief.hyp.view(np.ndarray)
        hyp = hyp[: state["count"][0]]
        self._roads, self._row = roads, row
        self._disbelieved = far_fix[1] if state["time"][0] - far_fix[0] <= RECENT else 0.0
        self._p, self._edge = (1.0 - unknown) * hyp["weight"], hyp["edge"].copy()
        self._unknown = unknown if len(hyp) else 0.0
        self._abscissa = hyp["along"].copy()
        self._mean, self._cov = hyp["mu"].copy(), hyp["cov"][:, :3, :3].copy()

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
        xx, xy, xh, yy, yh, hh = self._row.cov
        cov = np.array([[xx, xy, xh], [xy, yy, yh], [xh, yh, hh]])
        pose = pose_at(plane, self._row.x, self._row.y, self._row.heading)
        none = Hypothesis(self._unknown, None, pose, cov, 0.0, 0.0)
        return tuple(sorted((*known, none), key=lambda h: -h.p))

    def reason(self) -> str:
        """Why the status is what it is."""
        shares: dict[int, float] = {}
        for edge, p in zip(self._edge.tolist(), self._p.tolist(), strict=True):
            shares[edge] = shares.get(edge, 0.0) + p
        return reason(
            STATUS[self._row.status],
            roads=sorted(shares.items(), key=lambda share: -share[1]),
            name=self._street,
            disbelieved=self._disbelieved,
            scale=self._row.gnss_scale,
            answered=len(self._p) > 0,
        )

    def _street(self, edge: int) -> str | None:
        return cast(str | None, self._roads.attributes(edge).get("name"))

    def map_pose(self) -> Pose:
        """The pose in the map's frame."""
        row = self._row
        return pose_at(self._roads.plane, row.map_x, row.map_y, row.heading)

    def map_cov(self) -> Array:
        """Covariance of the position there, (2, 2), m²."""
        xx, xy, yy = self._row.map_cov
        return np.array([[xx, xy], [xy, yy]])

    def matched(self) -> tuple[float, float]:
        """Latitude and longitude of the point on the most probable edge."""
        return self._roads.plane.to_geodetic(self._row.match_x, self._row.match_y)

    def speed(self) -> float:
        """m/s, negative in reverse."""
        return cast(float, self._row.speed)

    def disbelieved(self) -> float:
        """How far away the last fix lies, if it is not believed, m; else 0."""
        return self._disbelieved
