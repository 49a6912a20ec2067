"""A recorded drive as single observations, as they come on line."""

from collections.abc import Iterator

from whichroad import Distance, GeoFix, SpeedYaw, WheelSpeed, WheelTicks, YawRate
from whichroad.observations import (
    Drive,
    Fixes,
    Observation,
    Odometer,
    OdometryLog,
    SpeedYawRate,
    WheelCounts,
    WithGyro,
)

_FIX = (
    "time", "lat_deg", "lon_deg", "cov_ee", "cov_en", "cov_nn", "speed", "sigma_speed",
    "bearing_deg", "sigma_bearing_deg",
)  # fmt: skip


def observations(drive: Drive) -> list[Observation]:
    """All readings in time order; of one moment the odometry comes before the fix."""
    return sorted(_readings(drive), key=lambda o: (o.time, isinstance(o, GeoFix)))


def _readings(drive: Drive) -> Iterator[Observation]:
    if drive.fixes is not None:
        yield from (GeoFix(*row) for row in _rows(drive.fixes, *_FIX))
    if drive.odometry is not None:
        yield from _odometry(drive.odometry)


def _odometry(log: OdometryLog) -> Iterator[Observation]:
    if isinstance(log, WithGyro):
        yield from (YawRate(*row) for row in _rows(log.gyro, "time", "rate"))
        yield from _odometry(log.distance)
    elif isinstance(log, Odometer):
        yield from (Distance(*row) for row in _rows(log, "time", "distance"))
    elif isinstance(log, SpeedYawRate):
        yield from (SpeedYaw(*row) for row in _rows(log, "time", "speed", "yaw_rate"))
    else:
        one = WheelTicks if isinstance(log, WheelCounts) else WheelSpeed
        yield from (one(*row) for row in _rows(log, "time", "left", "right"))


def _rows(log: Fixes | object, *names: str) -> Iterator[tuple[float, ...]]:
    return zip(*(getattr(log, name).tolist() for name in names), strict=True)
