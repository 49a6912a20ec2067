"""NMEA 0183: GGA, RMC and GST of every epoch, as receivers write them."""

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa

from ..geodesy.angles import axis_bearing_of, wrap_bearing
from ..geodesy.units import KNOT
from ..nmea_frame import sealed
from ..sensors.gnss import ellipse
from .positions import Positions, positions

_ALONE = ("outage", "lost")  # status of epochs without GNSS


def write(table: pa.Table, path: Path) -> None:
    """Write points as sentences, drive after drive.

    Raises:
        WriteError: The table has no positions.
    """
    with open(path, "wb") as sink:
        for drive in positions(table, path):
            for row in range(len(drive.time)):
                sink.writelines(map(sealed, _bodies(drive, row)))


def _bodies(p: Positions, k: int) -> list[str]:
    """The sentences of one epoch without frame and checksum."""
    moment = datetime.fromtimestamp(round(float(p.time[k]), 3), UTC)
    clock = f"{moment:%H%M%S}.{moment.microsecond // 1000:03d}"
    place = place_of(float(p.lat[k]), float(p.lon[k]))
    alone = p.status[k] in _ALONE
    speed = abs(float(p.speed[k])) / KNOT
    course = wrap_bearing(float(p.bearing_deg[k]) + (180.0 if p.speed[k] < 0.0 else 0.0))
    bodies = [
        f"GNGGA,{clock},{place},{6 if alone else 1},,,,M,,M,,",
        f"GNRMC,{clock},A,{place},{_number(speed, 3)},{_number(course, 2)},"
        f"{moment:%d%m%y},,,{'E' if alone else 'A'}",
    ]
    cov = np.array([[p.cov_ee[k]], [p.cov_en[k]], [p.cov_nn[k]]])
    if np.isfinite(cov).all():
        major, minor, axis = (float(v[0]) for v in ellipse(*cov))
        bearing = axis_bearing_of(axis, 0.0)
        bodies.append(
            f"GNGST,{clock},,{major:.3f},{minor:.3f},{bearing:.1f},{math.sqrt(cov[2, 0]):.3f},"
            f"{math.sqrt(cov[0, 0]):.3f},"
        )
    return bodies


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else ""


def place_of(lat_deg: float, lon_deg: float) -> str:
    """Latitude and longitude with their hemispheres, as GGA and RMC have them."""
    return f"{_angle(lat_deg, 2, 'NS')},{_angle(lon_deg, 3, 'EW')}"


def _angle(degrees: float, digits: int, signs: str) -> str:
    """Degrees as `ddmm.mmmmmm` and the hemisphere."""
    micro = round(abs(degrees) * 60e6)
    letter = signs[0] if degrees >= 0.0 else signs[1]
    return f"{micro // 60_000_000:0{digits}d}{micro % 60_000_000 / 1e6:09.6f},{letter}"
