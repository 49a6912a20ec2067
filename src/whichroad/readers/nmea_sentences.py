"""NMEA 0183 sentences: bytes to columns, a block at a time.

A block may be one burst of a receiver or megabytes of a log.  Checksums of all sentences
come from one running exclusive-or, numbers of all fields from one call.  This module
knows neither epochs nor dates.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geodesy.units import KNOT
from ..nmea_frame import checksum
from ..observations import Array
from .checks import NO_TIME, Bools, Ints, Skipped, keep
from .dates import day_of
from .fix_quality import RECKONED, quality_of_modes
from .parsing import Bytes, decimal, hexadecimal

LONGEST = 1024  # bytes from $ to checksum; the standard allows 82, some receivers exceed it
CHECKSUM = "wrong checksum"
TRUNCATED = "sentence cut short"
NUMBER = "unparsable number"
PROPRIETARY = "proprietary sentence"
SHORT = "too few fields"

# What the sentences report: rows of a table of epochs.
COLUMNS = (
    *("lat", "lon", "quality", "hdop"),  # GGA, GNS
    *("rmc_lat", "rmc_lon", "speed", "course", "day", "valid"),  # RMC; VTG, ZDA have some
    "rmc_quality",
    *("major", "minor", "orientation", "sigma_lat", "sigma_lon"),  # GST
)


@dataclass(frozen=True, slots=True)
class _Type:
    """One type of sentence; field 0 is the address."""

    code: int  # its three letters as one number
    fewest: int  # fields that it must have
    numbers: tuple[int, ...]  # fields that are numbers, the time of day first
    letters: tuple[int, ...]  # fields of which a letter is read: the first, then the second ...
    columns: tuple[int, ...]  # what it reports, as rows of `COLUMNS`
    timed: bool = True


def _type(
    name: str,
    fewest: int,
    numbers: Sequence[int],
    letters: Sequence[int],
    columns: str,
    timed: bool = True,
) -> _Type:
    indices = tuple(COLUMNS.index(column) for column in columns.split())
    code = int.from_bytes(name.encode())
    return _Type(code, fewest, tuple(numbers), tuple(letters), indices, timed)


_SYSTEMS = 6  # of satellites, each of which has a mode in GNS
# Later types overwrite: GGA's position is the finer one, RMC's date and speed the surer.
TYPES = {
    "ZDA": _type("ZDA", 5, (1, 2, 3, 4), (), "day"),
    "VTG": _type("VTG", 8, (1, 5), (6,), "course speed", timed=False),
    "RMC": _type(
        "RMC",
        10,
        (1, 3, 5, 7, 8, 9),
        (2, 4, 6, 12),
        "rmc_lat rmc_lon speed course day valid rmc_quality",
    ),
    "GNS": _type("GNS", 9, (1, 2, 4, 8), (3, 5, *[6] * _SYSTEMS), "lat lon quality hdop"),
    "GGA": _type("GGA", 9, (1, 2, 4, 6, 8), (3, 5), "lat lon quality hdop"),
    "GST": _type("GST", 9, (1, 3, 4, 5, 6, 7), (), "major minor orientation sigma_lat sigma_lon"),
}


@dataclass(slots=True)
class Sentences:
    """Good sentences in the order of the log.

    Attributes:
        code: Three letters of the type as one number, shape (n,); all types.
        tod: Time of day, ms (whole numbers), shape (n,); NaN: none, or not read.
        values: By type, what its sentences report, (columns of the type, sentences of the
            type); NaN where a field is empty.
    """

    code: Ints
    tod: Array
    values: dict[str, Array]

    def __len__(self) -> int:
        """How many sentences."""
        return len(self.code)

    def __contains__(self, name: str) -> bool:
        """Whether there is a sentence of this type."""
        return bool(self.values[name].shape[1])

    def split(self, n: int) -> tuple["Sentences", "Sentences"]:
        """The first `n` sentences, and the others."""
        first, others = {}, {}
        for name, values in self.values.items():
            m = int(np.count_nonzero(self.code[:n] == TYPES[name].code))
            first[name], others[name] = values[:, :m], values[:, m:]
        return (
            Sentences(self.code[:n], self.tod[:n], first),
            Sentences(self.code[n:], self.tod[n:], others),
        )

    def parted(self, chosen: Sequence[bool]) -> tuple["Sentences", "Sentences"]:
        """Those that are chosen, shape (n,), and the others, each in the order of the log."""
        mine = np.asarray(chosen, np.bool_)
        return self._where(mine), self._where(~mine)

    def _where(self, mine: Bools) -> "Sentences":
        return Sentences(
            self.code[mine],
            self.tod[mine],
            {
                name: values[:, mine[self.code == TYPES[name].code]]
                for name, values in self.values.items()
            },
        )


def joined(batches: Sequence[Sentences]) -> Sentences:
    """Batches of sentences, one behind the other; at least one."""
    if len(batches) == 1:
        return batches[0]
    return Sentences(
        np.concatenate([b.code for b in batches]),
        np.concatenate([b.tod for b in batches]),
        {name: np.concatenate([b.values[name] for b in batches], axis=1) for name in TYPES},
    )


def sealed(data: bytes) -> bytes:
    """Sentences without checksums with them, so that a log that has none can be read.

    A last line without its end may be cut short, and stays without.
    """
    lines = []
    for line in data.splitlines(keepends=True):
        begin, body = line.find(b"$"), line.rstrip()
        if begin >= 0 and body != line:
            line = b"%s*%02X\r\n" % (body, checksum(body[begin + 1 :]))
        lines.append(line)
    return b"".join(lines)


def scan(data: bytes, skipped: Skipped, others: Counter[str]) -> tuple[Sentences, Bools]:
    """Find and read the sentences of a block of bytes.

    Args:
        data: Whole lines; anything may stand between sentences.
        skipped: Counts what is not used, by reason.
        others: Counts good sentences of types that are not needed.

    Returns:
        The sentences, and whether other bytes stand before each `$` that begins one, good or
        not, and behind the last.
    """
    text = np.frombuffer(data, np.uint8)
    start, star, foreign = _frames(text, skipped)
    code = np.zeros(len(start), np.int64)
    for letter in (3, 4, 5):
        code = code * 256 + text[start + letter]
    commas = np.append(np.flatnonzero(text == ord(",")), len(text))
    first = np.searchsorted(commas, start)
    count = np.searchsorted(commas, star) - first
    good = np.ones(len(start), np.bool_)
    needed = np.zeros(len(start), np.bool_)
    rows: dict[str, Ints] = {}
    for name, kind in TYPES.items():
        mine = np.flatnonzero(code == kind.code)
        needed[mine] = True
        whole = count[mine] + 1 >= kind.fewest
        if not keep(whole, SHORT, skipped).all():
            good[mine[~whole]] = False
            mine = mine[whole]
        rows[name] = mine
    if not needed.all():
        codes, counts = np.unique(code[~needed], return_counts=True)
        for other, number in zip(codes.tolist(), counts.tolist(), strict=True):
            others[other.to_bytes(3).decode("ascii")] += number

    fields = _Fields(text, commas, first, star)
    tod, values = _read(fields, rows, good, skipped)
    return Sentences(code[good], tod[good], values), foreign


def _read(
    fields: "_Fields", rows: dict[str, Ints], good: Bools, skipped: Skipped
) -> tuple[Array, dict[str, Array]]:
    """Times of all sentences, and what those of `rows` report; bad ones leave `good`."""
    spans = [fields.spans(rows[name], kind.numbers) for name, kind in TYPES.items()]
    begin = np.concatenate([s[0].ravel() for s in spans])
    number, wrong = decimal(fields.text, begin, np.concatenate([s[1].ravel() for s in spans]))
    tod = np.full(len(good), np.nan)
    values = {}
    at = 0
    for name, kind in TYPES.items():
        mine = rows[name]
        shape = (len(kind.numbers), len(mine))
        numbers = number[at : at + shape[0] * shape[1]].reshape(shape)
        bad: Bools = np.any(wrong[at : at + shape[0] * shape[1]].reshape(shape), axis=0)
        at += shape[0] * shape[1]
        if not len(mine):
            values[name] = np.empty((len(kind.columns), 0))
            continue
        if kind.timed:
            tod[mine] = _time_of_day(numbers[0], bad)
        decoded = _MEANING[name](numbers, fields.letters(mine, kind.letters), bad)
        fine = keep(~bad, NUMBER, skipped)
        if kind.timed:
            fine = fine & keep(bad | ~np.isnan(tod[mine]), NO_TIME, skipped)
        if not fine.all():
            good[mine[~fine]] = False
            decoded = decoded[:, fine]
        values[name] = decoded
    return tod, values


def _frames(text: Bytes, skipped: Skipped) -> tuple[Ints, Ints, Bools]:
    """Where good sentences begin (`$`) and end (`*`), and between which ones other bytes stand."""
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
    begun = address | at_line
    foreign = _foreign(dollar[begun], end[begun], breaks, len(text))
    dollar, end, proprietary, star = (x[address] for x in (dollar, end, proprietary, star))

    whole = (star + 3 <= end) & (star - dollar < LONGEST)
    if not keep(whole, TRUNCATED, skipped).all():
        dollar, star, proprietary = dollar[whole], star[whole], proprietary[whole]

    running = np.bitwise_xor.accumulate(text) if len(text) else text
    decoded, bad = hexadecimal(text, star + 1)
    good = ~bad & ((running[star - 1] ^ running[dollar]) == decoded)
    keep(good, CHECKSUM, skipped)
    keep(~(good & proprietary), PROPRIETARY, skipped)
    good &= ~proprietary
    return dollar[good], star[good], foreign


def _foreign(start: Ints, end: Ints, breaks: Ints, length: int) -> Bools:
    """(n + 1,) whether more than line breaks stands before each sentence and behind the last."""
    begin, until = np.append(0, end), np.append(start, length)
    between: Ints = np.searchsorted(breaks, until) - np.searchsorted(breaks, begin)
    other: Bools = until - begin > between
    return other


def _at(values: NDArray[np.generic], index: Ints) -> NDArray[np.generic]:
    return values[np.minimum(index, len(values) - 1)]


def _next(places: Ints, start: Ints, otherwise: int) -> Ints:
    """The first of `places` behind each start."""
    found = np.append(places, otherwise)
    return found[np.searchsorted(places, start, side="right")]


@dataclass(frozen=True, slots=True)
class _Fields:
    """The comma-separated fields of all sentences of a block.

    Attributes:
        text: The block.
        commas: Places of all commas, and one behind the end of the text.
        first: Number of each sentence's first comma.
        star: Place of each sentence's star.
    """

    text: Bytes
    commas: Ints
    first: Ints
    star: Ints

    def spans(self, rows: Ints, numbers: tuple[int, ...]) -> tuple[Ints, Ints]:
        """Where the fields `numbers` of the sentences `rows` begin and end, (fields, rows).

        Short sentences lack the last fields: these are empty, and lie behind the star.
        """
        comma = self.first[rows] + np.array(numbers, np.int64)[:, None]
        star, last = self.star[rows], len(self.commas) - 1  # the last stands behind the text
        begin = self.commas[np.minimum(comma - 1, last)] + 1
        end = np.minimum(self.commas[np.minimum(comma, last)], star)
        return begin, np.maximum(begin, end)

    def letters(self, rows: Ints, numbers: tuple[int, ...]) -> Bytes:
        """Letters of those fields, 0 where a field is shorter, shape (fields, rows).

        A field that is named again gives its next letter.
        """
        begin, end = self.spans(rows, numbers)
        begin += np.array([numbers[:k].count(n) for k, n in enumerate(numbers)], np.int64)[:, None]
        at = np.minimum(begin, len(self.text) - 1)
        return np.where(end > begin, self.text[at], 0).astype(np.uint8)


# What the fields mean: numbers (fields, n), letters (fields, n), and which of the n
# sentences have a field that cannot be; gives (columns, n).


def _time_of_day(value: Array, bad: Bools) -> Array:
    """Milliseconds since midnight from `hhmmss.sss`."""
    hour = np.floor(value / 1e4)
    minute = np.floor(value / 100) - 100 * hour
    second = value - 1e4 * hour - 100 * minute
    possible = (hour < 24) & (minute < 60) & (second < 61) & (value >= 0)
    np.logical_or(bad, ~np.isnan(value) & ~possible, out=bad)
    return np.asarray(np.round(3.6e6 * hour + 6e4 * minute + 1e3 * second))


_POSITIVE = np.frombuffer(b"NE", np.uint8)[:, None]
_NEGATIVE = np.frombuffer(b"SW", np.uint8)[:, None]


def _place(value: Array, letter: Bytes, bad: Bools) -> Array:
    """Latitude and longitude in degrees from `dddmm.mmm` and hemispheres, shape (2, n)."""
    degrees = np.floor(value / 100)
    minutes = value - 100 * degrees
    negative = letter == _NEGATIVE
    possible = (negative | (letter == _POSITIVE)) & (minutes < 60) & (value >= 0)
    np.logical_or(bad, (~np.isnan(value) & ~possible).any(axis=0), out=bad)
    angle = degrees + minutes / 60
    return np.asarray(np.where(negative, -angle, angle))


def _gga(numbers: Array, letters: Bytes, bad: Bools) -> Array:
    return np.concatenate([_place(numbers[1:3], letters, bad), numbers[3:]])


def _gns(numbers: Array, letters: Bytes, bad: Bools) -> Array:
    place = _place(numbers[1:3], letters[:2], bad)
    return np.vstack([place, quality_of_modes(letters[2:]), numbers[3:]])


def _rmc(numbers: Array, letters: Bytes, bad: Bools) -> Array:
    valid = letters[0] == ord("A")
    place = _place(numbers[1:3], letters[1:3], bad)
    quality = np.where(letters[3] == ord("E"), RECKONED, np.nan)
    decoded = np.vstack([place, KNOT * numbers[3], numbers[4], _day(numbers[5]), valid, quality])
    decoded[:5, ~valid] = np.nan  # receivers that search write anything
    return decoded


def _gst(numbers: Array, letters: Bytes, bad: Bools) -> Array:
    return numbers[1:]


def _vtg(numbers: Array, letters: Bytes, bad: Bools) -> Array:
    # units stand behind the numbers; sentences before version 2.3 have none
    lettered = (letters[0] == ord("N")) | (letters[0] == 0)
    return np.where(lettered, np.stack([numbers[0], KNOT * numbers[1]]), np.nan)


def _zda(numbers: Array, letters: Bytes, bad: Bools) -> Array:
    return day_of(numbers[3], numbers[2], numbers[1])[None]


_MEANING = {"GGA": _gga, "GNS": _gns, "RMC": _rmc, "GST": _gst, "VTG": _vtg, "ZDA": _zda}


def _day(date: Array) -> Array:
    """Days since 1970 from `ddmmyy`."""
    day = np.floor(date / 1e4)
    month = np.floor(date / 100) - 100 * day
    year = date - 1e4 * day - 100 * month
    return day_of(np.where(year >= 80, 1900 + year, 2000 + year), month, day)
