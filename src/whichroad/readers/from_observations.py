"""A recorded drive from single observations, as the on-line filter takes them."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np

from ..errors import ReadError
from ..observations import (
    Array,
    Distance,
    Drive,
    GeoFix,
    Observation,
    Odometer,
    OdometryLog,
    SensorReading,
    SpeedYaw,
    SpeedYawRate,
    WheelCounts,
    WheelSpeed,
    WheelSpeeds,
    WheelTicks,
    YawRate,
    YawRates,
)
from ..sensors.validation import validated
from ..settings import Settings, Vehicle
from .checks import Skipped, in_order
from .coarse_steps import coarse_notes
from .drive_columns import steered, unused
from .mixed_rows import mixed_notes
from .reported_fixes import Reported, make_fixes
from .resampled import resampling_notes
from .rounded_places import rounding_notes
from .wheel_counters import cumulative

_LOGS: dict[type, Callable[..., OdometryLog]] = {
    WheelTicks: WheelCounts, WheelSpeed: WheelSpeeds, SpeedYaw: SpeedYawRate, Distance: Odometer
}  # fmt: skip


def drive_of_observations(
    observations: Sequence[Observation], settings: Settings | None = None,
    vehicle: Vehicle | None = None,
) -> Drive:  # fmt: skip
    """The drive that consists of these observations, in any order.

    Counts that jump, as where a control unit starts anew, are bridged.

    Args:
        observations: Fixes, readings of one kind of odometry, and of a gyro beside it.
        settings: Gives the sigma of fixes that report none.
        vehicle: Gives the metres of a count.

    Raises:
        ReadError: Odometry is of several kinds, or something is no observation.
    """
    skipped: Skipped = Counter()
    possible = [o for o in (validated(one, skipped) for one in observations) if o is not None]
    kinds = {type(o) for o in possible} - {GeoFix, YawRate, SensorReading}
    if len(kinds) > 1:
        raise ReadError(
            f"observations: {', '.join(sorted(kind.__name__ for kind in kinds))} together; one "
            "kind of odometry was expected; leave the others out"
        )
    fixes = [o for o in possible if isinstance(o, GeoFix)]
    odometry: OdometryLog | None = None
    for kind in kinds:
        columns = _bridged(kind, _in_order(kind, possible, skipped), vehicle or Vehicle(), skipped)
        odometry = _LOGS[kind](*columns)
    if isinstance(odometry, Odometer | WheelCounts | WheelSpeeds):
        time, rate = _in_order(YawRate, possible, skipped)
        odometry = steered(odometry, YawRates(time, rate) if len(time) > 1 else None)
    has = {"yaw_rate"} if any(isinstance(o, YawRate) for o in possible) else set()
    notes = tuple(unused(has, odometry))
    settings = settings or Settings()
    located = make_fixes(_reported(fixes), settings, skipped) if fixes else None
    sensed = sorted((o for o in possible if isinstance(o, SensorReading)), key=lambda o: o.time)
    notes = (
        *notes, *mixed_notes(located), *rounding_notes(located), *resampling_notes(located),
        *coarse_notes(located),
    )  # fmt: skip
    return Drive(
        "drive", located, odometry, skipped=dict(skipped), notes=notes, sensed=tuple(sensed),
        geared=any(getattr(one, "geared", False) for one in observations),
    )  # fmt: skip


def _in_order(kind: type, observations: Sequence[Observation], skipped: Skipped) -> list[Array]:
    """Columns of the readings of a kind, in the order of time."""
    columns = _columns(kind, [o for o in observations if type(o) is kind])
    rows = in_order(columns["time"], skipped)
    return [values[rows] for values in columns.values()]


def _bridged(kind: type, columns: list[Array], car: Vehicle, skipped: Skipped) -> list[Array]:
    """Columns of readings, counts of which are without jumps."""
    metres = {
        WheelTicks: (car.metres_per_tick_left, car.metres_per_tick_right),
        Distance: (car.odometer_scale,),
    }.get(kind, ())
    time, *counts = columns
    for n, each in enumerate(metres):
        counts[n] = cumulative(time, counts[n], bits=0, metres_per_tick=each, skipped=skipped)
    return [time, *counts]


def _columns(kind: type, observations: Sequence[Observation]) -> dict[str, Array]:
    names = [f.name for f in fields(kind) if f.name != "geared"]
    return {n: np.array([getattr(o, n) for o in observations], np.float64) for n in names}


def _reported(fixes: Sequence[GeoFix]) -> Reported:
    """Fixes as in a log: NaN for what a record marks by an infinite sigma."""
    c = _columns(GeoFix, fixes)
    unknown = np.isinf(c["cov_ee"])
    return Reported(
        time=c["time"],
        lat_deg=c["lat_deg"],
        lon_deg=c["lon_deg"],
        cov_ee=np.where(unknown, np.nan, c["cov_ee"]),
        cov_en=c["cov_en"],
        cov_nn=np.where(unknown, np.nan, c["cov_nn"]),
        speed=np.where(np.isinf(c["sigma_speed"]), np.nan, c["speed"]),
        sigma_speed=c["sigma_speed"],
        bearing_deg=np.where(np.isinf(c["sigma_bearing_deg"]), np.nan, c["bearing_deg"]),
    )
