"""Dead reckoning by odometry alone, for comparison with the filter."""

from ..geodesy.plane import Plane
from ..observations import Distance, GeoFix, Observation, SensorReading, YawRate
from ..online import Estimate
from ..sensors.odometry import dead_reckoned, step_between
from ..settings import Vehicle
from .message_types import ReckoningMessage


class DeadReckoning:
    """Integrates equation (1) of the paper with uncorrected odometry.

    Args:
        plane: Plane of the map.
        vehicle: Metres per count and track width.
    """

    def __init__(self, plane: Plane, vehicle: Vehicle) -> None:
        self._plane, self._vehicle = plane, vehicle
        self._before: Observation | None = None
        self._pose: tuple[float, float, float] | None = None
        self._since = self._travelled = 0.0

    def reset(self, estimate: Estimate) -> None:
        """Restart at the pose of an estimate, if it has one."""
        pose = estimate.pose
        self._pose = None if pose is None else (pose.x, pose.y, pose.heading)
        self._since, self._travelled = estimate.time, 0.0

    def stop(self) -> None:
        """Discard the pose until the next reset."""
        self._pose = self._before = None

    @property
    def begun(self) -> bool:
        """Whether there was a reset."""
        return self._pose is not None

    def take(self, reading: Observation) -> None:
        """Move by one odometry reading; readings out of order are ignored."""
        if isinstance(reading, GeoFix | Distance | YawRate | SensorReading):
            return
        before, pose = self._before, self._pose
        if before is not None and reading.time <= before.time:
            return
        self._before = reading
        if before is None or pose is None or type(before) is not type(reading):
            return
        arc, turn = step_between(before, reading, self._vehicle)
        scale = float(self._plane.scale(pose[0], pose[1]))
        self._pose = dead_reckoned(pose, arc, turn, scale)
        self._travelled += abs(arc)

    def message(self) -> ReckoningMessage | None:
        """The published message; None without a reset or a heading."""
        if self._pose is None or self._before is None:
            return None
        lat, lon, bearing = self._plane.pose(*self._pose)
        return ReckoningMessage(
            lat=round(lat, 8),
            lon=round(lon, 8),
            bearing_deg=round(bearing, 3),
            since_epoch_s=round(self._since, 3),
            travelled_m=round(self._travelled, 2),
        )
