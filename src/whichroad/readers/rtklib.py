"""RTKLIB solutions (.pos): fixes with their full covariance."""

from collections import Counter
from typing import Any

import numpy as np

from ..errors import ReadError
from ..geodesy.angles import course_of
from ..observations import Array, Drive
from ..settings import Settings
from .checks import LAST, NO_TIME, Skipped, keep
from .dates import iso_seconds
from .reported_fixes import Reported, make_fixes
from .source import Source

_LEAP = 18.0  # s, GPS time ahead of UTC since 2017
_GPS_EPOCH = 315_964_800.0  # 1980-01-06
_WEEK = 604_800.0
_SHORT = "line cut short"
_NUMBER = "unparsable number"


def read_pos(file: Any, settings: Settings | None = None) -> Drive:
    """Read an RTKLIB solution in degrees.

    Its covariance terms are signed square roots; GPS time becomes UTC.

    Args:
        file: A path or source of a .pos file, with its header.
        settings: Gives the sigma of fixes that report none.

    Raises:
        ReadError: The header does not name latitude and longitude in degrees, or no line
            follows.
    """
    source = Source.of(file)
    where = source.name
    lines = source.data.decode("utf-8", "replace").splitlines()
    head = next((line for line in lines if line.startswith("%") and "latitude(deg)" in line), None)
    if head is None:
        raise ReadError(
            f"{where}: no header with latitude(deg) and longitude(deg); an RTKLIB solution in "
            "degrees (out-solformat = llh) was expected"
        )
    names = head.lstrip("%").split()
    clock = names[0]
    skipped: Skipped = Counter()
    rows = [line.split() for line in lines if line.strip() and not line.startswith("%")]
    # date and time of day, or week and seconds, stand under one name
    whole = keep(np.array([len(row) > 5 for row in rows], bool), _SHORT, skipped)
    rows = [row for row, good in zip(rows, whole, strict=True) if good]
    if not rows:
        raise ReadError(f"{where}: no solution follows the header; was the file cut short?")
    time = _times([row[0] for row in rows], [row[1] for row in rows], clock)

    def column(name: str) -> Array:
        at = names.index(name) + 1 if name in names else -1
        return np.array([_number(row[at]) if 0 < at < len(row) else np.nan for row in rows])

    lat, lon = column("latitude(deg)"), column("longitude(deg)")
    east, north, mixed = column("sde(m)"), column("sdn(m)"), column("sdne(m)")
    mixed = np.where(np.isnan(mixed), 0.0, mixed)
    placed = keep(~(np.isnan(lat) | np.isnan(lon)), _NUMBER, skipped)
    timed = keep((np.abs(time) < LAST) | ~placed, NO_TIME, skipped)
    v_east, v_north = column("ve(m/s)"), column("vn(m/s)")
    with np.errstate(over="ignore"):  # what overflows is no covariance and is counted as such
        reported = Reported(
            time=time,
            lat_deg=lat,
            lon_deg=lon,
            cov_ee=east**2,
            cov_en=mixed * np.abs(mixed),
            cov_nn=north**2,
            speed=np.hypot(v_east, v_north),
            bearing_deg=course_of(v_east, v_north),
        ).rows(np.flatnonzero(placed & timed))
    fixes = make_fixes(reported, settings or Settings(), skipped)
    return Drive(source.stem, fixes, sources=(source.path,), skipped=dict(skipped))


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _times(first: list[str], second: list[str], clock: str) -> Array:
    """UTC seconds from date and time, or from GPS week and seconds of week."""
    if "/" in first[0]:
        time = iso_seconds([f"{a}T{b}" for a, b in zip(first, second, strict=True)])
    else:
        week = np.array([_number(a) for a in first])
        with np.errstate(over="ignore", invalid="ignore"):
            time = _GPS_EPOCH + _WEEK * week + np.array([_number(b) for b in second])
    shift = {"GPST": -_LEAP, "JST": -9 * 3600.0}.get(clock, 0.0)
    return time + shift
