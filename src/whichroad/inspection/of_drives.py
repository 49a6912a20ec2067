"""What a drive holds: rates, gaps, sigmas and their source, what was read as what."""

from typing import Any

import numpy as np

from ..geodesy.angles import DEGREE
from ..geodesy.units import EARTH_RADIUS, KMH, KNOT, METRES_PER_DEGREE, MPH
from ..observations import (
    ASSUMED,
    FROM_HDOP,
    FROM_QUALITY,
    Array,
    Drive,
    Fixes,
    Odometer,
    OdometryLog,
    SpeedYawRate,
    WheelCounts,
    WheelSpeeds,
    WithGyro,
)
from ..readers.names import Column, Seen, normal
from ..settings import Settings
from ..wording import moment
from .section import Section, duration, rate, spread

_ODOMETRY = {
    WheelCounts: "counters of both rear wheels",
    WheelSpeeds: "speeds of both rear wheels",
    Odometer: "cumulative distance",
    SpeedYawRate: "speed and yaw rate",
}
_SI = {
    "time": "s", "lat": "degrees", "lon": "degrees", "bearing": "degrees", "x": "m", "y": "m",
    "sigma": "m", "sigma_e": "m", "sigma_n": "m", "sigma_major": "m", "sigma_minor": "m",
    "sigma_bearing": "degrees", "accuracy": "m, radius of 68 %", "cov_ee": "m²", "cov_en": "m²",
    "cov_nn": "m²", "speed": "m/s", "wheel_rl": "m/s", "wheel_rr": "m/s", "yaw_rate": "rad/s",
    "odometer": "m",
}  # unit of a quantity  # fmt: skip
_OTHERS = {
    KMH: "km/h", KNOT: "knots", MPH: "mph", DEGREE: "degrees/s", 1e3: "km", 1e-3: "ms",
    1e-6: "µs", 1e-9: "ns", 0.0: "unit by its size",
}  # other units, by their factor to that one  # fmt: skip
_COVER = 0.9  # share of the fixes' time that odometry usually covers


def drive_section(drive: Drive, settings: Settings) -> Section:
    """What one drive holds.

    Args:
        drive: As it was read.
        settings: Those it was read with.
    """
    rows: list[tuple[str, str]] = []
    logs = [log.time for log in (drive.fixes, drive.odometry) if log is not None and len(log.time)]
    if logs:
        begin, end = min(t[0] for t in logs), max(t[-1] for t in logs)
        rows.append(("time", f"{moment(begin)} to {moment(end)}, {duration(end - begin)}"))
    if drive.fixes is not None and len(drive.fixes):
        rows += _of_fixes(drive.fixes, settings)
    else:
        rows.append(("fixes", "none"))
    rows += _of_odometry(drive.odometry, drive.fixes)
    skipped = tuple(f"skipped: {reason}: {count:,}" for reason, count in drive.skipped.items())
    return Section(
        f"drive {drive.drive_id}", rows, skipped + tuple(f"note: {n}" for n in drive.notes)
    )


def columns_section(title: str, seen: Seen) -> Section:
    """What the columns of a table were taken as.

    Args:
        title: The table.
        seen: Its columns, those that are used by quantity.
    """
    rows = [
        (quantity, _column_text(quantity, column, seen)) for quantity, column in seen.found.items()
    ]
    used = {normal(column.name) for column in seen.found.values()}
    others = [name or "(no name)" for name in seen.names if normal(name) not in used]
    if others:
        rows.append(("not used", ", ".join(others)))
    return Section(f"columns of {title}", rows)


def _column_text(quantity: str, column: Column, seen: Seen) -> str:
    unit = _SI.get(quantity, "") if column.factor == 1.0 else _OTHERS.get(column.factor, "")
    if column.factor == 0.0 and _are_dates(seen.table.column(column.place)):
        unit = "dates"
    if column.bare:
        unit = f"{unit} unless a note says otherwise, as the name has no unit"
    return f"column {column.name!r}" + (f", {unit}" if unit else "")


def _are_dates(cells: Any) -> bool:
    """Whether the first cell of a column that holds anything is no number."""
    first = next((cell for cell in cells.slice(0, 1000).to_pylist() if cell not in (None, "")), 0.0)
    try:
        float(first)
    except (TypeError, ValueError):
        return True
    return False


def _of_fixes(fixes: Fixes, settings: Settings) -> list[tuple[str, str]]:
    lat, lon = fixes.lat_deg, fixes.lon_deg
    area = f"lat {lat.min():.5f} to {lat.max():.5f}, lon {lon.min():.5f} to {lon.max():.5f}"
    rows = [("fixes", rate(fixes.time)), ("places", f"{area}; {_driven(lat, lon) / 1e3:,.1f} km")]
    sigma = np.sqrt(np.maximum(0.5 * (fixes.cov_ee + fixes.cov_nn), 0.0))
    n = len(fixes)
    hdop, assumed, kind = ((fixes.flags & b) > 0 for b in (FROM_HDOP, ASSUMED, FROM_QUALITY))
    by_hdop = f"HDOP times {settings.user_range_error_m:g} m"
    default = f"the setting default_sigma_m, {settings.default_sigma_m:g} m"
    by_kind = "by the kind of fix (RTK, dead reckoning)"
    for which, source in (
        (~(hdop | assumed), "as reported"),
        (hdop & ~kind, by_hdop),
        (hdop & kind, f"{by_hdop}, {by_kind}"),
        (assumed & ~kind, f"none reported: {default}"),
        (assumed & kind, f"none reported: {default}, {by_kind}"),
    ):
        if which.any():
            share = "" if which.all() else f" of {which.sum():,} fixes"
            rows.append((f"sigma{share}", f"{spread(sigma[which], 'm')}, {source}"))
    speed, course = np.isfinite(fixes.sigma_speed), np.isfinite(fixes.sigma_bearing_deg)
    reported = f"with {speed.sum():,} of {n:,} fixes"
    rows.append(
        ("speed", f"{spread(fixes.speed[speed], 'm/s')}, {reported}" if speed.any() else "none")
    )
    rows.append(("course", f"with {course.sum():,} of {n:,} fixes" if course.any() else "none"))
    return rows


def _driven(lat: Array, lon: Array) -> float:
    """Metres from fix to fix."""
    north = METRES_PER_DEGREE * np.diff(lat)
    east = EARTH_RADIUS * DEGREE * np.diff(lon) * np.cos(DEGREE * lat[1:])
    return float(np.hypot(north, east).sum())


def _named(log: OdometryLog) -> str:
    """What odometry measures, and how often."""
    if isinstance(log, WithGyro):
        return f"{_named(log.distance)}, and a yaw rate: {rate(log.gyro.time)}"
    return f"{_ODOMETRY[type(log)]}: {rate(log.time)}"


def _of_odometry(log: OdometryLog | None, fixes: Fixes | None) -> list[tuple[str, str]]:
    if log is None or not len(log.time):
        return [("odometry", "none")]
    rows = [("odometry", _named(log))]
    if fixes is not None and len(fixes) > 1 and fixes.time[-1] > fixes.time[0]:
        overlap = min(log.time[-1], fixes.time[-1]) - max(log.time[0], fixes.time[0])
        share = max(float(overlap), 0.0) / float(fixes.time[-1] - fixes.time[0])
        if share < _COVER:
            rows.append(("odometry covers", f"{100.0 * share:.0f} % of the time of the fixes"))
    return rows
