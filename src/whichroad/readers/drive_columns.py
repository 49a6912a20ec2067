"""The columns of one drive to its fixes and its odometry."""

from collections.abc import Set

import numpy as np

from ..observations import (
    Array,
    Drive,
    Odometer,
    OdometryLog,
    SpeedYawRate,
    WheelCounts,
    WheelSpeeds,
    WithGyro,
    YawRates,
)
from ..sensors.gyro_turns import covers
from ..sensors.validation import FASTEST, SPINNING
from ..settings import Settings, Vehicle
from .checks import NO_POSITION, Skipped, in_order, keep
from .known_grids import Lattice
from .reported_fixes import NO_ACCURACY, RADIUS_68, Reported, from_ellipse, make_fixes
from .vehicle import ROLES
from .wheel_counters import Reversing, held, wheel_counts, wheel_speeds

Beside = Odometer | WheelCounts | WheelSpeeds  # what has a gyro beside it
Columns = dict[str, Array]  # SI (degrees for angles of position), NaN where a cell is empty
WHEELS = frozenset(("wheel_rl", "wheel_rr", "wheel_rl_ticks", "wheel_rr_ticks"))
MOTION = WHEELS | {"odometer", "speed", "yaw_rate"}  # what may tell how a vehicle moves
_USED: dict[type, frozenset[str]] = {
    WheelCounts: frozenset(("wheel_rl_ticks", "wheel_rr_ticks")),
    WheelSpeeds: frozenset(("wheel_rl", "wheel_rr")),
    SpeedYawRate: frozenset(("yaw_rate",)),
    WithGyro: frozenset(("yaw_rate",)),
}
_STALE = 0.5  # s, largest age of what one sensor says beside the reading of another
_VAGUE = 1e9  # m, far beyond `WORST`
_TOO_FAST = f"speed beyond {FASTEST:g} m/s"
_TOO_TURNING = f"yaw rate beyond {SPINNING:g} rad/s"


def drive_of(
    columns: Columns, vehicle: Vehicle, settings: Settings, skipped: Skipped,
    grid: Lattice | None = None,
) -> Drive:  # fmt: skip
    """The drive, without name, that these columns describe.

    Speed is odometry where a yaw rate stands beside it, where there is no position, or where most
    speeds stand in rows without one, as where OBD was joined to fixes; else it is the receiver's.

    Args:
        columns: By the names of `names.NAMES`; `time` is finite everywhere.
        vehicle: Gives the scale and width of wheel counters.
        settings: Gives the sigma of fixes that report none.
        skipped: Where to count.
        grid: On which the places of its table are.
    """
    notes: list[str] = []
    has_position = {"lat", "lon"} <= columns.keys()
    between = has_position and _speeds_between(columns)
    has = {k for k, v in columns.items() if np.isfinite(v).any()}
    odometry = _odometry(columns, has, between or not has_position, vehicle, skipped, notes)
    gyro = _gyro(columns, skipped) if odometry is None else None
    notes += unused(has if gyro is None else has - {"yaw_rate"}, odometry)
    fixes = None
    if has_position:
        blank = np.isnan(columns["lat"]) & np.isnan(columns["lon"])
        if odometry is None:
            keep(~blank, NO_POSITION, skipped)
        own = dict(columns)
        if blank.any():
            rows = np.flatnonzero(~blank)
            own = {k: v[rows] for k, v in columns.items()}
        if between or isinstance(odometry, SpeedYawRate):
            own.pop("speed")
        elif "bearing" in own and "speed" not in own:
            notes.append("bearings not used: without a speed it is unknown whether they are valid")
        fixes = make_fixes(reported(own, skipped), settings, skipped, grid)
    geared = odometry is not None and "reverse" in has
    return Drive("", fixes, odometry, notes=tuple(notes), gyro=gyro, geared=geared)


def reported(columns: Columns, skipped: Skipped) -> Reported:
    """Fixes from columns, by the most exact of their covariances."""
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is counted as no covariance
        ee, en, nn = _covariance(columns, skipped)
    return Reported(
        time=columns["time"],
        lat_deg=columns["lat"],
        lon_deg=columns["lon"],
        cov_ee=ee,
        cov_en=en,
        cov_nn=nn,
        hdop=columns.get("hdop"),
        quality=columns.get("quality"),
        speed=columns.get("speed"),
        bearing_deg=columns.get("bearing"),
    )


def _covariance(
    columns: Columns, skipped: Skipped
) -> tuple[Array | None, Array | None, Array | None]:
    """The most exact covariance that the columns give: matrix, ellipse, then circle."""
    get = columns.get
    ee, en, nn = get("cov_ee"), get("cov_en"), get("cov_nn")
    if ee is not None and nn is not None:
        return ee, np.zeros(len(ee)) if en is None else np.where(np.isnan(en), 0.0, en), nn
    major, minor = _bounded(get("sigma_major")), _bounded(get("sigma_minor"))
    bearing = get("sigma_bearing")
    if major is not None and minor is not None and bearing is not None:
        return from_ellipse(major, minor, bearing)
    east, north = _bounded(get("sigma_e")), _bounded(get("sigma_n"))
    if east is not None and north is not None:
        return east**2, np.zeros(len(east)), north**2
    circle, accuracy = _bounded(get("sigma")), _bounded(get("accuracy"))
    if circle is None and accuracy is not None:
        circle = accuracy / RADIUS_68
    if circle is None:
        return None, None, None
    # zero or less is what receivers write for unknown: a HDOP is used instead, or it is counted
    unknown = circle <= 0
    if "hdop" not in columns:
        keep(~unknown, NO_ACCURACY, skipped)
    variance = np.where(unknown, np.nan, circle**2)
    return variance, np.zeros(len(circle)), variance


def _bounded(sigma: Array | None) -> Array | None:
    """An error that says nothing of the place, however large it is, also where it is infinite."""
    return None if sigma is None else np.minimum(sigma, _VAGUE)


def _odometry(
    columns: Columns,
    has: Set[str],
    own_speed: bool,
    vehicle: Vehicle,
    skipped: Skipped,
    notes: list[str],
) -> OdometryLog | None:
    """The best odometry that the columns offer: counters, wheel speeds, yaw rate, distance.

    A speed alone is one where it is the vehicle's own, not the receiver's.  `has` are the columns
    that hold a number.
    """
    time, reversing = columns["time"], _reversing(columns)
    if {"wheel_rl_ticks", "wheel_rr_ticks"} <= has:
        left, right = (time, columns["wheel_rl_ticks"]), (time, columns["wheel_rr_ticks"])
        counts = wheel_counts(left, right, vehicle, skipped, reversing=reversing, notes=notes)
        return steered(counts, _gyro(columns, skipped)) if len(counts.time) else None
    if {"wheel_rl", "wheel_rr"} <= has:
        left, right = (time, columns["wheel_rl"]), (time, columns["wheel_rr"])
        speeds = wheel_speeds(left, right, skipped, reversing=reversing)
        return steered(speeds, _gyro(columns, skipped)) if len(speeds.time) else None
    speed = columns.get("speed", np.full(len(time), np.nan))
    if reversing is not None:
        speed = np.where(held(reversing, time), -np.abs(speed), speed)
    if {"speed", "yaw_rate"} <= has:
        return speed_yaw_rate(time, speed, columns["yaw_rate"], skipped)
    if "odometer" in has:
        log = odometer(time, columns["odometer"], skipped)
        return steered(log, _gyro(columns, skipped))
    if "speed" in has and own_speed:
        where = ", which stands in rows without a position" if "lat" in has else ""
        notes.append(f"distance integrated from speed{where}")
        return odometer_from_speed(time, speed, skipped)
    return None


def _speeds_between(columns: Columns) -> bool:
    """Whether most speeds stand in rows without a position: no receiver writes so."""
    if "speed" not in columns:
        return False
    told = np.isfinite(columns["speed"])
    placed = np.isfinite(columns["lat"]) & np.isfinite(columns["lon"])
    return bool(2 * np.count_nonzero(told & placed) < np.count_nonzero(told))


def _gyro(columns: Columns, skipped: Skipped) -> YawRates | None:
    """The readings of a gyro, where there are some."""
    if "yaw_rate" not in columns or not np.isfinite(columns["yaw_rate"]).any():
        return None
    return yaw_rates(columns["time"], columns["yaw_rate"], skipped)


def unused(has: Set[str], odometry: OdometryLog | None) -> list[str]:
    """Notes on wheels and yaw rates that a drive has, and that its odometry is not made of.

    Args:
        has: Roles of `vehicle.ROLES` that have readings.
        odometry: What was made of them.
    """
    used = _USED.get(type(odometry), frozenset())
    if isinstance(odometry, WithGyro):
        used |= _USED.get(type(odometry.distance), frozenset())
    left = sorted((has & (WHEELS | {"yaw_rate"})) - used)
    if not left:
        return []
    if isinstance(odometry, Odometer) and left == ["yaw_rate"]:
        why = "it is missing beside half of the odometer's readings or more"
    elif odometry is not None:
        why = "one odometry is used at a time, wheels first"
    elif "yaw_rate" in left:
        why = "a speed beside it was expected, or an odometer"
    else:
        why = "both rear wheels were expected"
    names = ", ".join(ROLES[role].partition(",")[0] for role in left)
    return [f"{names} not used: {why}"]


def speed_yaw_rate(
    time: Array, speed: Array, yaw_rate: Array, skipped: Skipped
) -> SpeedYawRate | None:
    """The possible readings where both are known, in order; None where there are none."""
    known = np.isfinite(speed) & np.isfinite(yaw_rate) & np.isfinite(time)
    known &= keep(~known | (np.abs(speed) <= FASTEST), _TOO_FAST, skipped)
    known &= keep(~known | (np.abs(yaw_rate) <= SPINNING), _TOO_TURNING, skipped)
    rows = np.flatnonzero(known)
    rows = rows[in_order(time[rows], skipped)]
    return SpeedYawRate(time[rows], speed[rows], yaw_rate[rows]) if len(rows) else None


def steered(log: Beside | None, gyro: YawRates | None) -> Beside | WithGyro | None:
    """An odometer with the gyro beside it, where that covers its readings, or wheels with one."""
    if log is None or gyro is None:
        return log
    if isinstance(log, Odometer) and not covers(gyro, log.time):
        return log
    return WithGyro(log, gyro)


def yaw_rates(time: Array, rate: Array, skipped: Skipped) -> YawRates | None:
    """The possible readings of a gyro, in order; None where there are less than two."""
    known = np.isfinite(rate) & np.isfinite(time)
    known &= keep(~known | (np.abs(rate) <= SPINNING), _TOO_TURNING, skipped)
    rows = np.flatnonzero(known)
    rows = rows[in_order(time[rows], skipped)]
    return YawRates(time[rows], rate[rows]) if len(rows) > 1 else None


def odometer(time: Array, distance: Array, skipped: Skipped) -> Odometer | None:
    """The readings that are not empty, in order; None where there are none."""
    known = np.flatnonzero(np.isfinite(distance) & np.isfinite(time))
    rows = known[in_order(time[known], skipped)]
    return Odometer(time[rows], distance[rows]) if len(rows) else None


def odometer_from_speed(time: Array, speed: Array, skipped: Skipped) -> Odometer | None:
    """Distance as the integral of speed (trapezoids)."""
    known = np.isfinite(speed) & np.isfinite(time)
    known &= keep(~known | (np.abs(speed) <= FASTEST), _TOO_FAST, skipped)
    rows = np.flatnonzero(known)
    rows = rows[in_order(time[rows], skipped)]
    if len(rows) == 0:
        return None
    time, speed = time[rows], speed[rows]
    steps = np.diff(time) * (speed[1:] + speed[:-1]) / 2
    return Odometer(time, np.concatenate([[0.0], np.cumsum(steps)]))


def _reversing(columns: Columns) -> Reversing | None:
    if "reverse" not in columns:
        return None
    known = ~np.isnan(columns["reverse"])
    order = np.argsort(columns["time"][known], kind="stable")
    return columns["time"][known][order], columns["reverse"][known][order] > 0


def nearby(time: Array, known_at: Array, values: Array) -> Array:
    """Values of one sensor at the times of another, between readings; NaN where none is near.

    Args:
        time: (n,) s.
        known_at: (m,) s, in any order.
        values: (m,) at these times.
    """
    order = np.argsort(known_at, kind="stable")
    known_at, values = known_at[order], values[order]
    after = np.searchsorted(known_at, time).clip(0, len(known_at) - 1)
    before = np.maximum(after - 1, 0)
    apart = np.minimum(np.abs(known_at[after] - time), np.abs(known_at[before] - time))
    return np.where(apart <= _STALE, np.interp(time, known_at, values), np.nan)
