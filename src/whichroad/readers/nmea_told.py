"""What NMEA says beside fixes, as readings for sensors that ask for it.

satellites    in use, of GGA; 0 where it has no fix
height_m      of the antenna over the sea, of GGA
cn0_dbhz      mean of the four strongest satellites, of the GSV since the last GGA
antennas_deg  true heading of the antennas, of THS or HDT
compass_deg   magnetic heading, of HDG with its deviation

Headings have no time of their own: the first behind a GGA or RMC has that one's time, and more of
them until the next time are passed over.
"""

import math
from collections.abc import Iterable

from ..nmea_frame import checksum
from ..observations import SensorReading
from .names import TOLD

_HEADINGS = {"THS": "antennas_deg", "HDT": "antennas_deg", "HDG": "compass_deg"}
_KINDS = (b"GGA", b"RMC", b"GSV", b"THS", b"HDT", b"HDG")
READ_BY = {
    "THS": ("antennas_deg", "DualAntenna"), "HDT": ("antennas_deg", "DualAntenna"),
    "HDG": ("compass_deg", "Compass"), "GSV": ("cn0_dbhz", "Sky"),
}  # fmt: skip
"""Sentences that fixes do not need: their column, and the class of a sensor that reads it."""

_DAY = 86_400.0
_BEST = 4  # satellites that a mean is of
_LONGEST = 1 << 12  # bytes without a line break that are held back


class NmeaTold:
    """Sentences in, readings out: one for each GGA, one for each heading of an epoch.

    Args:
        near: A time within half a day of the first sentence, s since 1970.
        wanted: Which of `names.TOLD`.
    """

    def __init__(self, near: float, wanted: Iterable[str] = TOLD) -> None:
        self._near, self._wanted = near, frozenset(wanted)
        self._held = b""
        self._strengths: list[float] = []
        self._time: float | None = None  # of the epoch, s since 1970
        self._turned: set[str] = set()  # headings of this epoch that were heard

    def feed(self, data: bytes) -> list[SensorReading]:
        """Take the next bytes; returns the readings of the lines that they complete."""
        *lines, self._held = (self._held + data).split(b"\n")
        self._held = self._held[-_LONGEST:]
        return [one for line in lines for one in self._line(line)]

    def _line(self, line: bytes) -> list[SensorReading]:
        begin = line.rfind(b"$")
        kind = line[begin + 3 : begin + 6]
        if begin < 0 or kind not in _KINDS:
            return []
        body, star, sum_ = line[begin + 1 :].strip().partition(b"*")
        if star and sum_[:2].upper() != b"%02X" % checksum(body):
            return []
        fields = body.decode("ascii", "replace").split(",")
        if kind == b"GSV":
            self._strengths += [n for n in map(_number, fields[7::4]) if n is not None]
            return []
        if kind in (b"GGA", b"RMC"):
            self._begin(fields)
            return self._of_gga(fields) if kind == b"GGA" else []
        return self._of_heading(fields)

    def _begin(self, fields: list[str]) -> None:
        """A sentence with a time: maybe of a new epoch."""
        day = _number(fields[1]) if len(fields) > 9 else None
        if day is None:
            return
        hours, rest = divmod(day, 1e4)
        minutes, seconds = divmod(rest, 100.0)
        time = 3600.0 * hours + 60.0 * minutes + seconds
        time += _DAY * round((self._near - time) / _DAY)
        if time != self._time:
            self._turned.clear()
        self._near = self._time = time

    def _of_heading(self, fields: list[str]) -> list[SensorReading]:
        kind = fields[0][-3:]
        name = _HEADINGS[kind]
        value = _number(fields[1]) if len(fields) > 2 else None
        valid = kind != "THS" or fields[2] not in ("V", "S")
        if self._time is None or value is None or not valid or name in self._turned:
            return []
        self._turned.add(name)
        if kind == "HDG":
            deviation = _number(fields[2]) or 0.0
            value += deviation if fields[3:4] == ["E"] else -deviation
        return [SensorReading(self._time, {name: value})] if name in self._wanted else []

    def _of_gga(self, fields: list[str]) -> list[SensorReading]:
        strengths, self._strengths = sorted(self._strengths)[-_BEST:], []
        if len(fields) < 10 or _number(fields[1]) is None or self._time is None:
            return []
        time = self._time
        has_fix = fields[6] not in ("", "0")
        values = {"satellites": _number(fields[7]) if has_fix else 0.0}
        values["height_m"] = _number(fields[9]) if has_fix else None
        values["cn0_dbhz"] = sum(strengths) / len(strengths) if strengths else None
        told = {k: v for k, v in values.items() if k in self._wanted and v is not None}
        return [SensorReading(time, told)] if told else []


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
