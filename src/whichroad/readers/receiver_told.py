"""What NMEA says of satellites and heights, as readings for sensors that ask for it.

satellites  in use, of GGA; 0 where it has no fix
height_m    of the antenna over the sea, of GGA
cn0_dbhz    mean of the four strongest satellites, of the GSV since the last GGA
"""

import math
from collections.abc import Iterable

from ..observations import SensorReading
from .names import SENSED

NAMES = ("satellites", "height_m", "cn0_dbhz")
_DAY = 86_400.0
_BEST = 4  # satellites that a mean is of
_LONGEST = 1 << 12  # bytes without a line break that are held back


class ReceiverTold:
    """Sentences in, readings out, one for each GGA.

    Args:
        near: A time within half a day of the first sentence, s since 1970.
        wanted: Which of `NAMES`.
    """

    def __init__(self, near: float, wanted: Iterable[str] = NAMES) -> None:
        self._near, self._wanted = near, frozenset(wanted)
        self._held = b""
        self._strengths: list[float] = []

    def feed(self, data: bytes) -> list[SensorReading]:
        """Take the next bytes; returns the readings of the lines that they complete."""
        *lines, self._held = (self._held + data).split(b"\n")
        self._held = self._held[-_LONGEST:]
        return [one for line in lines for one in self._line(line)]

    def _line(self, line: bytes) -> list[SensorReading]:
        begin = line.rfind(b"$")
        kind = line[begin + 3 : begin + 6]
        if begin < 0 or kind not in (b"GGA", b"GSV"):
            return []
        body, star, sum_ = line[begin + 1 :].strip().partition(b"*")
        if star and sum_[:2].upper() != b"%02X" % _sum(body):
            return []
        fields = body.decode("ascii", "replace").split(",")
        if kind == b"GSV":
            self._strengths += [n for n in map(_number, fields[7::4]) if n is not None]
            return []
        return self._of_gga(fields)

    def _of_gga(self, fields: list[str]) -> list[SensorReading]:
        strengths, self._strengths = sorted(self._strengths)[-_BEST:], []
        day = _number(fields[1]) if len(fields) > 9 else None
        if day is None:
            return []
        hours, rest = divmod(day, 1e4)
        minutes, seconds = divmod(rest, 100.0)
        time = 3600.0 * hours + 60.0 * minutes + seconds
        time += _DAY * round((self._near - time) / _DAY)
        self._near = time
        has_fix = fields[6] not in ("", "0")
        values = {"satellites": _number(fields[7]) if has_fix else 0.0}
        values["height_m"] = _number(fields[9]) if has_fix else None
        values["cn0_dbhz"] = sum(strengths) / len(strengths) if strengths else None
        told = {k: v for k, v in values.items() if k in self._wanted and v is not None}
        return [SensorReading(time, told)] if told else []


def wanted(columns: Iterable[str]) -> frozenset[str]:
    """Which of `NAMES` are among the columns that a caller gave readers to keep."""
    return frozenset(name.removeprefix(SENSED) for name in columns) & frozenset(NAMES)


def _sum(body: bytes) -> int:
    total = 0
    for letter in body:
        total ^= letter
    return total


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
