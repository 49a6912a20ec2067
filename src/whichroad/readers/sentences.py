"""NMEA 0183 sentences: bytes to columns, a block at a time.

Checksums of all sentences come from one running exclusive-or over the block; the
fields of one sentence type are read together.  Knows no epochs and no dates.
"""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..records import Array
from .digits import Bytes, decimal, hexadecimal
from .door import Bools, Ints, Skipped, keep

KNOT = 1852 / 3600  # m/s
FEWEST = {"GGA": 9, "RMC": 10, "GST": 9, "VTG": 8, "ZDA": 5}  # fields, the address included
TYPES = tuple(FEWEST)
_LONGEST = 1024  # bytes from $ to checksum; the standard says 82, some receivers exceed it
CHECKSUM = "wrong checksum"
TRUNCATED = "sentence cut short"
NUMBER = "unparsable number"
PROPRIETARY = "proprietary sentence"
SHORT = "too few fields"


@dataclass(slots=True)
class Sentences:
    """Sentences of one type, in the order of the log; NaN where a field is empty."""

    order: Ints  # place of the sentence in the log, bytes
    tod: Array  # time of day, ms (whole numbers); NaN: the type has none
    columns: dict[str, Array] = field(default_factory=dict)

    def after(self, place: int) -> "Sentences":
        """The sentences that stand at or after `place`."""
        return self._rows(self.order >= place)

    def before(self, place: int) -> "Sentences":
        """The sentences that stand before `place`."""
        return self._rows(self.order < place)

    def _rows(self, mask: Bools) -> "Sentences":
        columns = {name: values[mask] for name, values in self.columns.items()}
        return Sentences(self.order[mask], self.tod[mask], columns)


def scan(
    data: bytes, skipped: Skipped, others: Counter[str], place: int = 0
) -> dict[str, Sentences]:
    """Find and read the wanted sentences of a block of bytes.

    Args:
        data: Whole lines; anything may stand between sentences.
        skipped: Counts what is not used, by reason.
        others: Counts good sentences of types that are not needed.
        place: Where `data` begins in the log.

    Returns:
        Sentences by type, for those of `TYPES` that occur.
    """
    text = np.frombuffer(data, np.uint8)
    start, star = _frames(text, skipped)
    kind = np.zeros(len(start), np.int64)
    for letter in (3, 4, 5):
        kind = kind * 256 + text[start + letter]
    found = {}
    commas = np.flatnonzero(text == ord(","))
    wanted = np.zeros(len(start), np.bool_)
    for name in TYPES:
        mine = kind == int.from_bytes(name.encode())
        wanted |= mine
        if mine.any():
            fields = _Fields(text, commas, start[mine], star[mine])
            found[name] = _read(name, fields, skipped, place)
    codes, counts = np.unique(kind[~wanted], return_counts=True)
    for code, count in zip(codes.tolist(), counts.tolist(), strict=True):
        others[code.to_bytes(3).decode("ascii")] += count
    return found


def _frames(text: Bytes, skipped: Skipped) -> tuple[Ints, Ints]:
    """Where good sentences begin (`$`) and end (`*`)."""
    dollar = np.flatnonzero(text == ord("$"))
    breaks = np.flatnonzero((text == ord("\n")) | (text == ord("\r")))
    stars = np.flatnonzero(text == ord("*"))
    end = np.append(dollar[1:], len(text))[: len(dollar)]
    end = np.minimum(end, _next(breaks, dollar, len(text)))
    capital = (text >= ord("A")) & (text <= ord("Z")) | (text >= ord("0")) & (text <= ord("9"))
    proprietary = _at(text, dollar + 1) == ord("P")
    address = end - dollar > 6
    for k in (1, 2, 3, 4, 5):
        address &= _at(capital, dollar + k)
    address &= (_at(text, dollar + 6) == ord(",")) | proprietary
    # a $ that begins a line begins a sentence, elsewhere it may be any byte of a binary message
    at_line = (dollar == 0) | (text[dollar - 1] == ord("\n"))
    star = _next(stars, dollar, len(text))
    keep(address | ~at_line | (star < end), TRUNCATED, skipped)
    keep(address | ~at_line | (star >= end), PROPRIETARY, skipped)
    dollar, end, proprietary = dollar[address], end[address], proprietary[address]

    star = _next(stars, dollar, len(text))
    whole = (star + 3 <= end) & (star - dollar < _LONGEST)
    keep(whole, TRUNCATED, skipped)
    dollar, star, proprietary = dollar[whole], star[whole], proprietary[whole]

    running = np.bitwise_xor.accumulate(text) if len(text) else text
    said, bad = hexadecimal(text, star + 1, 2)
    good = ~bad & ((running[star - 1] ^ running[dollar]) == said)
    keep(good, CHECKSUM, skipped)
    keep(~(good & proprietary), PROPRIETARY, skipped)
    good &= ~proprietary
    return dollar[good], star[good]


def _at(values: NDArray[np.generic], index: Ints) -> NDArray[np.generic]:
    return values[np.minimum(index, len(values) - 1)]


def _next(places: Ints, start: Ints, otherwise: int) -> Ints:
    """The first of `places` behind each start."""
    found = np.append(places, otherwise)
    return found[np.searchsorted(places, start, side="right")]


class _Fields:
    """The comma-separated fields of some sentences, field 0 being the address."""

    def __init__(self, text: Bytes, commas: Ints, start: Ints, star: Ints) -> None:
        self.text, self.commas, self.start, self.star = text, commas, start, star
        self.first = np.searchsorted(commas, start)
        self.count = np.searchsorted(commas, star) - self.first
        self.bad = np.zeros(len(start), np.bool_)

    def select(self, rows: Bools) -> "_Fields":
        return _Fields(self.text, self.commas, self.start[rows], self.star[rows])

    def span(self, k: int) -> tuple[Ints, Ints]:
        """Where field k begins and ends; empty where a sentence has fewer."""
        begin = np.where(k <= self.count, self._comma(k - 1) + 1, self.star)
        return begin, np.where(k < self.count, self._comma(k), self.star)

    def _comma(self, k: int) -> Ints:
        return self.commas[np.minimum(self.first + k, len(self.commas) - 1)]

    def number(self, k: int) -> Array:
        value, bad = decimal(self.text, *self.span(k))
        self.bad |= bad
        return value

    def letter(self, k: int) -> Bytes:
        begin, end = self.span(k)
        return np.where(end > begin, _at(self.text, begin), 0).astype(np.uint8)

    def angle(self, k: int, positive: str, negative: str) -> Array:
        """Degrees from `dddmm.mmm` in field k and the hemisphere behind it."""
        value, letter = self.number(k), self.letter(k + 1)
        degrees = np.floor(value / 100)
        minutes = value - 100 * degrees
        south = letter == ord(negative)
        known = ~np.isnan(value)
        self.bad |= known & ~(south | (letter == ord(positive)))
        self.bad |= known & ~((minutes < 60) & (value >= 0))
        angle = degrees + minutes / 60
        return np.asarray(np.where(south, -angle, angle))

    def time_of_day(self, k: int) -> Array:
        """Milliseconds since midnight from `hhmmss.sss`."""
        value = self.number(k)
        hour = np.floor(value / 1e4)
        minute = np.floor(value / 100) - 100 * hour
        second = value - 1e4 * hour - 100 * minute
        known = ~np.isnan(value)
        self.bad |= known & ~((hour < 24) & (minute < 60) & (second < 61) & (value >= 0))
        return np.asarray(np.round(3.6e6 * hour + 6e4 * minute + 1e3 * second))


def _read(name: str, fields: _Fields, skipped: Skipped, place: int) -> Sentences:
    """The columns of one type; sentences with bad fields are skipped and counted."""
    long_enough = fields.count + 1 >= FEWEST[name]
    if not keep(long_enough, SHORT, skipped).all():
        fields = fields.select(long_enough)
    tod = np.full(len(fields.start), np.nan) if name == "VTG" else fields.time_of_day(1)
    columns = _COLUMNS[name](fields)
    good = keep(~fields.bad, NUMBER, skipped)
    if name != "VTG":
        good = good & keep(fields.bad | ~np.isnan(tod), "no time", skipped)
    columns = {key: values[good] for key, values in columns.items()}
    return Sentences(fields.start[good] + place, tod[good], columns)


def _gga(f: _Fields) -> dict[str, Array]:
    return {
        "lat": f.angle(2, "N", "S"),
        "lon": f.angle(4, "E", "W"),
        "quality": f.number(6),
        "hdop": f.number(8),
    }


def _rmc(f: _Fields) -> dict[str, Array]:
    valid = f.letter(2) == ord("A")
    day = _day(f.number(9), valid)
    columns = {
        "rmc_lat": f.angle(3, "N", "S"),
        "rmc_lon": f.angle(5, "E", "W"),
        "speed": KNOT * f.number(7),
        "course": f.number(8),
    }
    columns = {key: np.where(valid, values, np.nan) for key, values in columns.items()}
    return {**columns, "day": day, "status": valid.astype(np.float64)}


def _gst(f: _Fields) -> dict[str, Array]:
    names = ("major", "minor", "orientation", "sigma_lat", "sigma_lon")
    return {name: f.number(k) for k, name in enumerate(names, start=3)}


def _vtg(f: _Fields) -> dict[str, Array]:
    # units stand behind the numbers; sentences before version 2.3 have none
    lettered = (f.letter(6) == ord("N")) | (f.letter(6) == 0)
    return {
        "course": np.where(lettered, f.number(1), np.nan),
        "speed": np.where(lettered, KNOT * f.number(5), np.nan),
    }


def _zda(f: _Fields) -> dict[str, Array]:
    day, month, year = f.number(2), f.number(3), f.number(4)
    return {"day": _date(year, month, day)}


def _day(date: Array, valid: Bools) -> Array:
    """Days since 1970 from `ddmmyy`; receivers that search write any date."""
    day = np.floor(date / 1e4)
    month = np.floor(date / 100) - 100 * day
    year = date - 1e4 * day - 100 * month
    year = np.where(year >= 80, 1900 + year, 2000 + year)
    return np.where(valid, _date(year, month, day), np.nan)


def _date(year: Array, month: Array, day: Array) -> Array:
    known = (year >= 1980) & (year < 2100) & (month >= 1) & (month <= 12)
    known &= (day >= 1) & (day <= 31)
    months = np.where(known, 12 * (year - 1970) + month - 1, 0).astype(np.int64)
    first = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)
    return np.where(known, first + day - 1, np.nan)


_COLUMNS = {"GGA": _gga, "RMC": _rmc, "GST": _gst, "VTG": _vtg, "ZDA": _zda}
