"""NMEA 0183 as it arrives: a fix with the last sentence of its burst, in microseconds.

Says the same as `nmea.NmeaParser`, which looks at blocks and is made for logs; this one
takes one sentence after the other and is made for a line that speaks ten times a second.
"""

import math
import re
from collections import Counter
from datetime import date
from functools import reduce
from operator import xor
from typing import NamedTuple

from ..records import GeoFix
from ..settings import Settings
from .digits import LONGEST
from .fixes import CREDIBLE, IMPOSSIBLE, MOVING, NOT_A_COVARIANCE, SIGMA_SPEED
from .sentences import CHECKSUM, FEWEST, KNOT, NUMBER, SHORT

_SENTENCE = re.compile(rb"\$([A-Z0-9]{5}),([^$*\r\n]{0,1000})\*([0-9A-Fa-f]{2})")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")
_LINE = 4096  # bytes without a line break that are held back
_HALF_DAY, _DAY = 43_200_000, 86_400_000  # ms
_SURE = 3  # bursts that must end alike before their end is known
_EPOCH = date(1970, 1, 1).toordinal()
UNFINISHED = "bytes that are no sentence"
_RANK = ("ZDA", "VTG", "RMC", "GGA", "GST")  # what later ones say counts more


class _Bad(ValueError):
    """A sentence with a field that cannot be."""


class _Said(NamedTuple):
    """One sentence: its type, its time of day (ms), and what it says."""

    kind: str
    tod: int | None
    values: dict[str, float]


class BurstParser:
    """NMEA bytes in, fixes out as soon as their burst ends.

    A receiver ends every burst with the same sentence; once it has done so three times, as
    silence or the next burst tells, the fix comes out with that sentence.

    Args:
        settings: Gives the range error and the sigma of fixes that report none.
        today: A time (s) of the day that is taken until RMC or ZDA says the date.

    Attributes:
        skipped: What was not used, by reason.
    """

    def __init__(self, settings: Settings | None = None, today: float = 0.0) -> None:
        self.skipped: Counter[str] = Counter()
        self._settings = settings or Settings()
        self._line = b""
        self._burst: dict[str, dict[str, float]] = {}
        self._tod: int | None = None  # of the burst
        self._out: int | None = None  # time of day of the burst that came out last
        self._day, self._last_tod = int(today // 86_400), -1
        self._last = -math.inf  # s, time of the last fix
        self._newest = ""  # type of the last sentence
        self._end, self._ends = "", ("", 0)

    def feed(self, data: bytes) -> list[GeoFix]:
        """Take the next bytes; returns the fixes that they complete."""
        data = self._line + data
        whole = data.rfind(b"\n") + 1
        if whole == 0 and len(data) > _LINE:
            whole = len(data)
        self._line = data[whole:]
        fixes: list[GeoFix] = []
        found = used = 0
        for match in _SENTENCE.finditer(data, 0, whole):
            found += 1
            used += match.end() - match.start()
            self._take(match, fixes)
        if whole - used > 2 * found + 2:  # more than line breaks
            self.skipped[UNFINISHED] += whole - used - 2 * found
        return fixes

    def flush(self) -> list[GeoFix]:
        """The line is silent: the fix of the burst that has ended."""
        if self._line or self._tod is None:
            return []
        self._learn()
        return self._emit()

    def _take(self, match: re.Match[bytes], fixes: list[GeoFix]) -> None:
        kind = match[1][2:].decode()
        if kind not in FEWEST or match[1][:1] == b"P":
            self._newest = kind
            if kind == self._end:
                fixes += self._emit()
            return
        body = match[0][1:-3]
        if reduce(xor, body) != int(match[3], 16):
            self.skipped[CHECKSUM] += 1
            return
        try:
            said = _read(kind, match[2].decode("latin-1").split(","))
        except _Bad as bad:
            self.skipped[str(bad)] += 1
            return
        if said.tod is not None and said.tod != self._tod:
            if self._tod is not None:
                self._learn()
                fixes += self._emit()
            if said.tod == self._out:  # its burst came out too early
                self._end, self._ends = "", ("", 0)
            self._tod = said.tod
        elif said.tod is None and self._tod is None:
            return
        self._newest = kind
        self._burst.setdefault(kind, {}).update(said.values)
        if kind == self._end:
            fixes += self._emit()

    def _learn(self) -> None:
        """A burst has ended, as silence or the next one tells."""
        end, times = self._ends
        self._ends = (self._newest, times + 1 if end == self._newest else 1)
        self._end = self._newest if self._ends[1] >= _SURE else ""

    def _emit(self) -> list[GeoFix]:
        """The fix of the burst, if it holds one."""
        burst, tod = self._burst, self._tod
        self._burst, self._tod = {}, None
        if tod is None:
            return []
        self._out = tod
        values: dict[str, float] = {}
        for kind in _RANK:
            values.update(burst.get(kind, {}))
        time = self._time(tod, values)
        fix = _fix(time, values, self._settings, self.skipped)
        if fix is None:
            return []
        if time <= self._last and time > self._last - 3600.0:
            self.skipped["time running backwards"] += 1
            return []
        self._last = time
        return [fix]

    def _time(self, tod: int, values: dict[str, float]) -> float:
        """Seconds since 1970; the date is carried over midnight."""
        if "day" in values:
            self._day = int(values["day"])
        elif self._last_tod >= 0:
            step = tod - self._last_tod
            self._day += (step < -_HALF_DAY) - (step > _HALF_DAY)
        self._last_tod = tod
        return (self._day * _DAY + tod) / 1e3


def _read(kind: str, fields: list[str]) -> _Said:
    """The fields behind the address as values; what is empty is left out."""
    if len(fields) + 1 < FEWEST[kind]:
        raise _Bad(SHORT)
    tod = None if kind == "VTG" else _time_of_day(fields[0])
    values: dict[str, float] = {}
    if kind == "GGA":
        _place(values, "lat", "lon", fields[1:5])
        _put(values, quality=fields[5], hdop=fields[7])
    elif kind == "RMC":
        valid = fields[1][:1] == "A"
        values["status"] = float(valid)
        said: dict[str, float] = {}
        _place(said, "rmc_lat", "rmc_lon", fields[2:6])
        _put(said, speed=fields[6], course=fields[7], date=fields[8])
        day = _day(said.pop("date", math.nan))
        if valid:
            values |= said
            if "speed" in values:
                values["speed"] *= KNOT
            if day is not None:
                values["day"] = day
    elif kind == "GST":
        names = ("major", "minor", "orientation", "sigma_lat", "sigma_lon")
        _put(values, **dict(zip(names, fields[2:7], strict=True)))
    elif kind == "VTG":
        said = {}
        _put(said, course=fields[0], speed=fields[4])
        if fields[5][:1] in ("N", ""):
            values |= said
            if "speed" in values:
                values["speed"] *= KNOT
    else:
        said = {}
        _put(said, day=fields[1], month=fields[2], year=fields[3])
        if len(said) == 3 and (day := _date(said["year"], said["month"], said["day"])) is not None:
            values["day"] = day
    return _Said(kind, tod, values)


def _number(text: str) -> float:
    if len(text) > LONGEST or _NUMBER.fullmatch(text) is None:
        raise _Bad(NUMBER)
    return float(text)


def _put(values: dict[str, float], **fields: str) -> None:
    for name, text in fields.items():
        if text:
            values[name] = _number(text)


def _place(values: dict[str, float], lat: str, lon: str, fields: list[str]) -> None:
    """Degrees from `dddmm.mmm` and hemispheres."""
    for name, text, letter, signs in ((lat, *fields[:2], "NS"), (lon, *fields[2:], "EW")):
        if not text:
            continue
        value = _number(text)
        degrees = math.floor(value / 100.0)
        minutes = value - 100.0 * degrees
        if letter[:1] not in signs or not letter or minutes >= 60.0 or value < 0.0:
            raise _Bad(NUMBER)
        angle = degrees + minutes / 60.0
        values[name] = -angle if letter[0] == signs[1] else angle


def _time_of_day(text: str) -> int:
    if not text:
        raise _Bad("no time")
    value = _number(text)
    hour, minute = math.floor(value / 1e4), math.floor(value / 100.0) % 100
    second = value - 1e4 * hour - 100.0 * minute
    if value < 0.0 or hour >= 24 or minute >= 60 or second >= 61.0:
        raise _Bad(NUMBER)
    return round(3.6e6 * hour + 6e4 * minute + 1e3 * second)


def _day(ddmmyy: float) -> int | None:
    if math.isnan(ddmmyy):
        return None
    day, month = math.floor(ddmmyy / 1e4), math.floor(ddmmyy / 100.0) % 100
    year = ddmmyy % 100.0
    return _date(1900.0 + year if year >= 80 else 2000.0 + year, month, day)


def _date(year: float, month: float, day: float) -> int | None:
    """Days since 1970; receivers that search write any date."""
    if not (1980 <= year < 2100 and 1 <= month <= 12 and 1 <= day <= 31):
        return None
    return date(int(year), int(month), 1).toordinal() - _EPOCH + int(day) - 1


def _fix(
    time: float, values: dict[str, float], settings: Settings, skipped: Counter[str]
) -> GeoFix | None:
    """The fix of one burst, its covariance chosen as `fixes.make_fixes` does."""
    quality = values.get("quality")
    names = ("rmc_lat", "rmc_lon") if quality is None else ("lat", "lon")
    lat, lon = (values.get(name) for name in names)
    if lat is None or lon is None or quality == 0.0:
        skipped["epoch without a fix"] += 1
        return None
    if abs(lat) > 90.0 or abs(lon) > 180.0 or (lat == 0.0 and lon == 0.0):
        skipped[IMPOSSIBLE] += 1
        return None
    ee, en, nn = _covariance(values, settings, skipped)
    speed = None if values.get("status") == 0.0 else values.get("speed")
    known = speed is not None and abs(speed) < 1e3
    speed = speed if speed is not None and known else 0.0
    course = values.get("course")
    moves = course is not None and known and abs(course) <= 720.0 and speed > MOVING
    return GeoFix(
        time, lat, lon, ee, en, nn, speed, SIGMA_SPEED if known else math.inf,
        course % 360.0 if course is not None and moves else 0.0,
        math.degrees(math.atan2(SIGMA_SPEED, speed)) if moves else math.inf,
    )  # fmt: skip


def _covariance(
    values: dict[str, float], settings: Settings, skipped: Counter[str]
) -> tuple[float, float, float]:
    """Of GST where it says something that can be, else of HDOP, else the settings' default."""
    north, east = values.get("sigma_lat", 0.0), values.get("sigma_lon", 0.0)
    if north > 0.0 and east > 0.0:
        ee, nn = east * east, north * north
        if math.isfinite(ee * nn) and ee * nn > 0.0:
            return ee, _correlation(values, ee, nn) * math.sqrt(ee * nn), nn
        skipped[NOT_A_COVARIANCE] += 1
        return (settings.default_sigma_m**2, 0.0, settings.default_sigma_m**2)
    hdop = values.get("hdop", 0.0)
    sigma = hdop * settings.user_range_error_m if hdop > 0.0 else settings.default_sigma_m
    return sigma * sigma, 0.0, sigma * sigma


def _correlation(values: dict[str, float], ee: float, nn: float) -> float:
    """That of the ellipse, where its size is that of the sigmas; else 0."""
    if not {"major", "minor", "orientation"} <= values.keys():
        return 0.0
    bearing = math.radians(values["orientation"])
    sin, cos = math.sin(bearing), math.cos(bearing)
    a, b = values["major"] ** 2, values["minor"] ** 2
    e_ee, e_nn = a * sin * sin + b * cos * cos, a * cos * cos + b * sin * sin
    if e_ee * e_nn <= 0.0:
        return 0.0
    ratio = (e_ee + e_nn) / (ee + nn)
    correlation = (a - b) * sin * cos / math.sqrt(e_ee * e_nn)
    credible = any(low < ratio < high for low, high in CREDIBLE) and abs(correlation) < 0.9999
    return correlation if credible else 0.0
