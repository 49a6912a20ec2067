"""A simulated drive in the formats of a real one: NMEA, CAN with its .dbc, vehicle.toml, truth."""

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import WriteError
from ..geodesy.angles import degrees, wrap_axis, wrap_bearing
from ..geodesy.units import KNOT, kmh_of_mps
from ..nmea_frame import sealed
from ..observations import Array, Fixes
from ..settings import Vehicle
from ..tables.schema import times
from .simulated_drive import START, SimulatedDrive

if TYPE_CHECKING:
    import pyarrow as pa

    from ..roadmap import RoadMap

FILES = ("drive.nmea", "can.log", "vehicle.dbc", "vehicle.toml", "truth.parquet")
"""Names of the files that `write_drive` writes."""

_COUNTER_BITS = 16
_KMH = 0.01  # km/h, one step of the wheel speeds on the bus
_FORWARD, _STANDING = 4, 0  # values of the gear signal

SIGNALS = {
    "wheel_rl_ticks": "WheelTicksRearLeft",
    "wheel_rr_ticks": "WheelTicksRearRight",
    "reverse": "Gear",
    "reverse_value": "R",
}
"""Roles in vehicle.toml and the signals that `DBC` names."""

DBC = """VERSION ""

NS_ :

BS_:

BU_: Brakes Gearbox Localizer

BO_ 928 WheelTicks: 8 Brakes
 SG_ WheelTicksRearLeft : 0|16@1+ (1,0) [0|65535] "" Localizer
 SG_ WheelTicksRearRight : 16|16@1+ (1,0) [0|65535] "" Localizer
 SG_ WheelTicksAlive : 32|4@1+ (1,0) [0|15] "" Localizer

BO_ 930 WheelSpeeds: 8 Brakes
 SG_ WheelSpeedRearLeft : 7|16@0+ (0.01,0) [0|655.35] "km/h" Localizer
 SG_ WheelSpeedRearRight : 23|16@0+ (0.01,0) [0|655.35] "km/h" Localizer

BO_ 1056 Transmission: 2 Gearbox
 SG_ Gear : 0|4@1+ (1,0) [0|15] "" Localizer

CM_ BO_ 928 "Rear wheel pulse counters of the anti-lock brakes; they never count down.";
VAL_ 1056 Gear 0 "N" 1 "P" 2 "R" 4 "D" ;
"""
"""The signals on the simulated car's bus, ours."""


def nmea_text(drive: SimulatedDrive) -> str:
    """The receiver's log: GGA, GST, RMC, VTG and ZDA each second, also without a fix."""
    fixes = drive.drive.fixes
    assert fixes is not None
    bursts = dict(zip(fixes.time.tolist(), _bursts(fixes), strict=True))
    for time in (START + drive.fix_truth.time[~drive.seen_fix]).tolist():
        bursts[time] = _empty_burst(time)
    sentences = (sealed(body) for time in sorted(bursts) for body in bursts[time])
    return b"".join(sentences).decode()


def _bursts(fixes: Fixes) -> list[list[str]]:
    """Sentences of each fix, without frame and checksum."""
    mean, half = 0.5 * (fixes.cov_ee + fixes.cov_nn), 0.5 * (fixes.cov_ee - fixes.cov_nn)
    stretch = np.hypot(half, fixes.cov_en)
    columns = (
        fixes.time,
        fixes.lat_deg,
        fixes.lon_deg,
        fixes.speed,
        fixes.bearing_deg,
        fixes.sigma_bearing_deg,
        np.sqrt(mean + stretch),
        np.sqrt(mean - stretch),
        # of the major axis, clockwise from north
        wrap_axis(degrees(0.5 * np.arctan2(2.0 * fixes.cov_en, -2.0 * half))),
        np.sqrt(fixes.cov_nn),
        np.sqrt(fixes.cov_ee),
    )
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [_burst(*row) for row in rows]


def _burst(
    time: float,
    lat: float,
    lon: float,
    speed: float,
    bearing: float,
    sigma_bearing: float,
    major: float,
    minor: float,
    angle: float,
    sigma_lat: float,
    sigma_lon: float,
) -> list[str]:
    clock, date = _clock(time)
    place = f"{_minutes(lat, 2)},{'N' if lat >= 0 else 'S'},"
    place += f"{_minutes(lon, 3)},{'E' if lon >= 0 else 'W'}"
    course = f"{wrap_bearing(round(bearing, 2)):.2f}" if np.isfinite(sigma_bearing) else ""
    knots = speed / KNOT
    ellipse = f"{major:.2f},{minor:.2f},{angle:.1f},{sigma_lat:.2f},{sigma_lon:.2f}"
    return [
        f"GPGGA,{clock},{place},1,09,0.9,52.0,M,45.0,M,,",
        f"GPGST,{clock},1.2,{ellipse},{1.5 * major:.2f}",
        f"GPRMC,{clock},A,{place},{knots:.3f},{course},{date:%d%m%y},,,A",
        f"GPVTG,{course},T,,M,{knots:.3f},N,{kmh_of_mps(speed):.3f},K,A",
        f"GPZDA,{clock},{date:%d,%m,%Y},00,00",
    ]


def _empty_burst(time: float) -> list[str]:
    clock, date = _clock(time)
    return [
        f"GPGGA,{clock},,,,,0,00,99.9,,M,,M,,",
        f"GPRMC,{clock},V,,,,,,,{date:%d%m%y},,,N",
        f"GPZDA,{clock},{date:%d,%m,%Y},00,00",
    ]


def _clock(time: float) -> tuple[str, datetime]:
    hundredths = round(time * 100.0)
    date = datetime.fromtimestamp(hundredths // 100, UTC)
    return f"{date:%H%M%S}.{hundredths % 100:02d}", date


def _minutes(angle: float, digits: int) -> str:
    """Degrees as `ddmm.mmmmmm`, without a sign."""
    micro = round(abs(angle) * 60e6)
    return f"{micro // 60_000_000:0{digits}d}{micro % 60_000_000 / 1e6:09.6f}"


def can_text(drive: SimulatedDrive) -> str:
    """The car's bus as candump writes it: counters and speeds at each reading, the gear at 1 Hz."""
    from ..observations import WheelCounts

    counts = drive.drive.odometry
    assert isinstance(counts, WheelCounts)
    wrap = 1 << _COUNTER_BITS
    left = (counts.left.astype(np.int64) % wrap).tolist()
    right = (counts.right.astype(np.int64) % wrap).tolist()
    speed_left, speed_right = (
        np.round(kmh_of_mps(v) / _KMH).astype(int).tolist() for v in _speeds(drive)
    )
    lines, gear_due = [], -np.inf
    for k, time in enumerate(counts.time.tolist()):
        frame = left[k].to_bytes(2, "little") + right[k].to_bytes(2, "little")
        frame += bytes([k % 16, 0, 0, 0])
        lines.append(f"({time:.6f}) can0 3A0#{frame.hex().upper()}")
        frame = speed_left[k].to_bytes(2, "big") + speed_right[k].to_bytes(2, "big") + bytes(4)
        lines.append(f"({time + 0.0004:.6f}) can0 3A2#{frame.hex().upper()}")
        if time >= gear_due:
            gear = _STANDING if k == 0 else _FORWARD
            lines.append(f"({time + 0.0011:.6f}) can0 420#{gear:02X}00")
            gear_due = time + 1.0
    return "\n".join([*lines, ""])


def _speeds(drive: SimulatedDrive) -> tuple[Array, Array]:
    """What the wheels' speeds are on the bus, m/s: true ones over the wheels' true scale."""
    truth, wheels = drive.truth, drive.wheels
    yaw = np.gradient(np.unwrap(truth.heading), truth.time)
    turn = 0.5 * wheels.track_width * yaw
    half = 0.5 * wheels.differential
    left = (truth.speed - turn) / (wheels.scale * (1.0 + half))
    right = (truth.speed + turn) / (wheels.scale * (1.0 - half))
    # a wheel's speed is a count of pulses per time: never negative on this bus
    return np.maximum(left, 0.0), np.maximum(right, 0.0)


def vehicle_text(vehicle: Vehicle, *, counter_bits: int = _COUNTER_BITS) -> str:
    """`vehicle.toml` of the simulated car, with the signals that `DBC` names.

    Args:
        vehicle: The car.
        counter_bits: Bits of its wheel counters in the log; 0: they never wrap.
    """
    lines = [
        "# The car as its user believes it to be.",
        f'driving_side = "{vehicle.driving_side}"',
        "",
        "[wheels]",
        f"track_width_m = {vehicle.track_width}",
        f"metres_per_tick_left = {vehicle.metres_per_tick_left}",
        f"metres_per_tick_right = {vehicle.metres_per_tick_right}",
        f"counter_bits = {counter_bits}",
        "",
        "[antenna]",
        f"forward_m = {vehicle.antenna_forward}",
        f"left_m = {vehicle.antenna_left}",
        "",
        "[signals]",
        *(f'{role} = "{name}"' for role, name in SIGNALS.items()),
    ]
    return "\n".join([*lines, ""])


def truth_table(drive: SimulatedDrive, roads: "RoadMap") -> "pa.Table":
    """The truth as a table, one row per odometry reading.

    Args:
        drive: What was simulated.
        roads: The map it was simulated on.

    Returns:
        time (UTC), lat, lon, bearing_deg, edge_id, abscissa_m, speed_mps, on_road,
        map_lat, map_lon (the map's frame), travelled_m, outage (no GNSS then).
    """
    import pyarrow as pa

    t = drive.truth
    lat, lon, bearing = roads.plane.pose(t.x, t.y, t.heading)
    map_lat, map_lon = roads.plane.to_geodetic(t.map_x, t.map_y)
    outage = np.zeros(len(t), dtype=bool)
    for begin, end in drive.outages:
        outage |= (t.time >= begin) & (t.time <= end)
    return pa.table(
        {
            "time": times(t.time),
            "lat": lat,
            "lon": lon,
            "bearing_deg": bearing,
            "edge_id": t.edge,
            "abscissa_m": t.along,
            "speed_mps": t.speed,
            "on_road": np.ones(len(t), dtype=bool),
            "map_lat": map_lat,
            "map_lon": map_lon,
            "travelled_m": t.travelled,
            "outage": outage,
        }
    )


def write_drive(
    drive: SimulatedDrive, roads: "RoadMap", folder: str | os.PathLike[str], *, force: bool = False
) -> list[Path]:
    """Write `FILES`: drive.nmea, can.log, vehicle.dbc, vehicle.toml and truth.parquet.

    Args:
        drive: What was simulated.
        roads: The map it was simulated on.
        folder: Where to; made if it is not there.
        force: Replace files that exist.

    Returns:
        The files.

    Raises:
        WriteError: A file exists already, or the system refuses.
    """
    import pyarrow.parquet as pq

    place = Path(folder)
    texts = (nmea_text(drive), can_text(drive), DBC, vehicle_text(drive.vehicle))
    paths = [place / name for name in FILES]
    prepare(paths, force=force)
    try:
        for path, text in zip(paths, texts, strict=False):
            path.write_bytes(text.encode())
        pq.write_table(truth_table(drive, roads), paths[-1])
    except OSError as error:
        raise WriteError(
            f"{place}: cannot be written ({error.strerror or error}); a folder that may be "
            "written to was expected; choose another place"
        ) from error
    return paths


def prepare(paths: list[Path], *, force: bool) -> None:
    """Make the folder of files to come; refuse now what would be refused later.

    Raises:
        WriteError: A file exists without `force`, or the folder cannot be made.
    """
    for path in paths:
        if path.exists() and not force:
            raise WriteError(
                f"{path}: exists already; a new name was expected; choose another or give --force"
            )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise WriteError(
                f"{path.parent}: cannot be made ({error.strerror or error}); a folder that may "
                "be written to was expected; choose another place"
            ) from error
