"""A recorded drive as single observations, as they come on line."""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from whichroad import Distance, GeoFix, SpeedYaw, WheelSpeed, WheelTicks, YawRate
from whichroad.observations import (
    Drive,
    Observation,
    Odometer,
    SpeedYawRate,
    WheelCounts,
    WheelSpeeds,
    WithGyro,
    YawRates,
)
from whichroad.readers.reported_fixes import as_records

_ONE: dict[type, Any] = {  # of a log's readings; its columns are in the order of the log's
    WheelCounts: WheelTicks,
    WheelSpeeds: WheelSpeed,
    Odometer: Distance,
    SpeedYawRate: SpeedYaw,
    YawRates: YawRate,
}


def observations(drive: Drive) -> list[Observation]:
    """All readings in time order; of one moment the odometry comes before the fix."""
    fixes = [] if drive.fixes is None else as_records(drive.fixes)
    return sorted(
        [*_readings(drive.odometry), *fixes], key=lambda o: (o.time, isinstance(o, GeoFix))
    )


def _readings(log: Any) -> Iterator[Observation]:
    if isinstance(log, WithGyro):
        yield from _readings(log.gyro)
        yield from _readings(log.distance)
    elif log is not None:
        columns = (getattr(log, column.name).tolist() for column in fields(log))
        yield from map(_ONE[type(log)], *columns)
