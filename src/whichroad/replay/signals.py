"""The sensors of a recorded drive, for display beside the estimates."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..diagnosis.sensor_states import SensorState
from ..geodesy.angles import axis_bearing_of, degrees, radians, wrap_bearing
from ..geodesy.units import METRES_PER_DEGREE
from ..live.heard_sensors import heard_message
from ..observations import (
    Array,
    Drive,
    Fixes,
    Odometer,
    SpeedYawRate,
    WheelCounts,
    WheelSpeeds,
    WithGyro,
)
from ..sensors import Sensor
from ..sensors.gnss import ellipse
from ..sensors.odometry import Motion, motion_of
from ..settings import Vehicle

if TYPE_CHECKING:
    from ..live.message_types import HeardMessage, ReckoningMessage, SensorMessage

_RATE_WINDOW = 5.0  # s over which a rate is averaged
_SILENT = 3.0  # s after which a sensor counts as silent
_GAP = 5.0  # s without a fix after which wheels alone are shown
_RECENT = 64  # readings that give a rate
_EMPTY = np.zeros(0)
_LOGS = {
    WheelCounts: "wheels", WheelSpeeds: "wheels", Odometer: "odometer",
    SpeedYawRate: "speed_and_gyro",
}  # fmt: skip


class Estimates(Protocol):
    """The estimates at whose poses dead reckoning begins."""

    time: Array
    columns: dict[str, Array]


@dataclass(frozen=True, slots=True)
class Reckoning:
    """Dead reckoning through every GNSS outage, (n,) each, NaN outside of outages."""

    lat: Array
    lon: Array
    bearing_deg: Array
    since: Array  # s since 1970
    travelled: Array  # m

    def at(self, k: int) -> "ReckoningMessage | None":
        """Dead reckoning at epoch k."""
        if not len(self.lat) or not np.isfinite(self.lat[k]):
            return None
        return {
            "lat": round(float(self.lat[k]), 8),
            "lon": round(float(self.lon[k]), 8),
            "bearing_deg": round(float(self.bearing_deg[k]), 2),
            "since_epoch_s": round(float(self.since[k]), 6),
            "travelled_m": round(float(self.travelled[k]), 1),
        }


class Signals:
    """Fixes and motion of a drive; nothing where there is no drive.

    Args:
        drive: As the readers give it.
        vehicle: For the odometry.
        sensors: Further ones, whose readings the drive may hold.
    """

    def __init__(
        self, drive: Drive | None = None, vehicle: Vehicle | None = None,
        sensors: Sequence[Sensor] = (),
    ) -> None:  # fmt: skip
        fixes = drive.fixes if drive is not None else None
        self.fixes = fixes if fixes is not None and len(fixes) else None
        self.fix_times: Array = self.fixes.time if self.fixes is not None else _EMPTY
        self._shape = _shape(self.fixes) if self.fixes is not None else None
        log = drive.odometry if drive is not None else None
        self.motion: Motion | None = motion_of(log, vehicle or Vehicle()) if log else None
        self.heard = _times_of(drive, sensors) if drive is not None else {}
        self._further = {one.name for one in sensors}

    def fix(self, time: float) -> dict[str, Any] | None:
        """The last fix at a time (s since 1970)."""
        i = int(np.searchsorted(self.fix_times, time + 1e-6, side="right")) - 1
        return self.fix_at(i, time) if i >= 0 else None

    def fix_at(self, i: int, time: float) -> dict[str, Any]:
        """Fix i as a message has it."""
        assert self.fixes is not None
        assert self._shape is not None
        major, minor, axis = (float(column[i]) for column in self._shape)
        shape = {
            "major_m": round(major, 3), "minor_m": round(minor, 3), "bearing_deg": round(axis, 2),
        }  # fmt: skip
        return {
            "epoch_s": round(float(self.fix_times[i]), 6),
            "age_s": round(max(time - float(self.fix_times[i]), 0.0), 3),
            "lat": round(float(self.fixes.lat_deg[i]), 8),
            "lon": round(float(self.fixes.lon_deg[i]), 8),
            "ellipse": shape if np.isfinite(major) else None,
        }

    def sensors(self, time: float) -> "list[SensorMessage]":
        """Their health at a time."""
        sensors: list[SensorMessage] = []
        motion = self.motion.time if self.motion is not None else _EMPTY
        for kind, times in (("gnss", self.fix_times), ("wheels", motion)):
            if not len(times):
                continue
            count = int(np.searchsorted(times, time + 1e-6, side="right"))
            recent = count - int(np.searchsorted(times, time - _RATE_WINDOW, side="right"))
            age = time - float(times[count - 1]) if count else None
            ok = age is not None and age <= _SILENT
            state = "ok" if ok else "waiting" if age is None else "silent"
            sensors.append(
                {
                    "name": kind, "kind": kind, "state": state, "reason": None, "ok": ok,
                    "rate_hz": round(recent / _RATE_WINDOW, 1),
                    "age_s": None if age is None else round(age, 2),
                    "count": count, "refused": 0, "skipped": 0, "delay_s": None,
                }
            )  # fmt: skip
        return sensors

    def heard_at(self, time: float, states: Sequence[SensorState]) -> "list[HeardMessage]":
        """Every sensor as it was heard until a time.

        Args:
            time: s since 1970.
            states: What the filter held of them then; empty: not known.
        """
        known, found = {one.name: one for one in states}, []
        for name, times in self.heard.items():
            count, rate, age = heard_until(times, time)
            further = name in self._further
            found.append(heard_message(name, count, rate, age, known, further=further))
        return found

    def reckoning(self, estimates: Estimates, used: Array) -> Reckoning:
        """Equation (1) of the paper through every gap, from the pose before it.

        Args:
            estimates: The estimates.
            used: Times of the fixes that it was given.
        """
        n = len(estimates.time)
        out = Reckoning(*(np.full(n, np.nan) for _ in range(5)))
        motion = self.motion
        if motion is None or motion.turn is None or not len(self.fix_times):
            return out
        edges = np.concatenate([used, estimates.time[-1:] + _GAP if n else used[:0]])
        for begin, end in itertools.pairwise(edges):
            if end - begin <= _GAP:
                continue
            a, b = np.searchsorted(estimates.time, (begin, end))
            if a < n and np.isfinite(estimates.columns["lat"][a]):
                _reckon(motion, estimates, slice(int(a), min(int(b) + 1, n)), out)
        return out


def heard_until(times: Array, now: float) -> tuple[int, float, float | None]:
    """How many of some times (s, rising) have passed, how many a second lately, and s since then.

    The age is None before the first.  There is no rate after a silence of seconds.
    """
    count = int(np.searchsorted(times, now + 1e-6, side="right"))
    if not count:
        return 0, 0.0, None
    first, age = max(count - _RECENT, 0), max(now - float(times[count - 1]), 0.0)
    usual = float(times[count - 1] - times[first]) / max(count - 1 - first, 1)
    heard = usual > 0.0 and age <= max(5.0 * usual, _SILENT)
    return count, 1.0 / usual if heard else 0.0, age


def _times_of(drive: Drive, sensors: Sequence[Sensor]) -> dict[str, Array]:
    """When each sensor of a drive was heard, (n,) s each, by the names of messages."""
    found: dict[str, Array] = {}
    if drive.fixes is not None and len(drive.fixes):
        found["gnss"] = drive.fixes.time
    log = drive.odometry
    if isinstance(log, WithGyro):
        found[_LOGS[type(log.distance)]], found["gyro"] = log.distance.time, log.gyro.time
    elif log is not None and len(log.time):
        found[_LOGS[type(log)]] = log.time
    for one in sensors:
        columns = frozenset(one.columns)
        found[one.name] = np.array([
            reading.time for reading in drive.sensed
            if reading.sensor == one.name
            or (not reading.sensor and columns & reading.values.keys())
        ], np.float64)  # fmt: skip
    return found


def _reckon(motion: Motion, estimates: Estimates, rows: slice, out: Reckoning) -> None:
    """Integrate distance and turn from the pose of the first row on."""
    assert motion.turn is not None
    time = estimates.time[rows]
    distance = np.interp(time, motion.time, motion.distance)
    turn = np.interp(time, motion.time, motion.turn)
    lat0, lon0, bearing0 = (estimates.columns[n][rows.start] for n in ("lat", "lon", "bearing_deg"))
    bearing = radians(bearing0) - (turn - turn[0])
    middle, step = 0.5 * (bearing[1:] + bearing[:-1]), np.diff(distance)
    east = np.concatenate([[0.0], np.cumsum(step * np.sin(middle))])
    north = np.concatenate([[0.0], np.cumsum(step * np.cos(middle))])
    out.lat[rows] = lat0 + north / METRES_PER_DEGREE
    out.lon[rows] = lon0 + east / METRES_PER_DEGREE / np.cos(radians(lat0))
    out.bearing_deg[rows] = wrap_bearing(degrees(bearing))
    out.since[rows] = time[0]
    out.travelled[rows] = np.concatenate([[0.0], np.cumsum(np.abs(step))])


def _shape(fixes: Fixes) -> tuple[Array, Array, Array]:
    """1 sigma ellipses of fixes: axes (m) and the bearing of the major one (degrees)."""
    with np.errstate(invalid="ignore"):
        known = np.isfinite(fixes.cov_ee) & np.isfinite(fixes.cov_nn)
        ee, en, nn = (np.where(known, c, 1.0) for c in (fixes.cov_ee, fixes.cov_en, fixes.cov_nn))
        major, minor, heading = ellipse(ee, en, nn)
    return np.where(known, major, np.inf), minor, axis_bearing_of(heading, 0.0)
