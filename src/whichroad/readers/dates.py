"""Dates and times as people, spreadsheets and tools write them, as seconds since 1970 UTC.

ISO 8601 is read by Arrow, a column at a time; other writings cell by cell.  The years 1970
to 2100 are plausible, others are no times.
"""

import math
import re
from collections.abc import Sequence
from datetime import UTC, date, datetime, timedelta, timezone, tzinfo
from typing import NamedTuple
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..errors import ReadError
from ..observations import Array
from .digit_dates import ORDERS, Taken, dashed

EARLIEST = 315_532_800.0  # s, 1980: below it a bare number counts from a start, not from 1970
LATEST = 4_102_444_800.0  # s, 2100
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_BLANK = re.compile(r"\s+(?=Z$|[+-]\d\d:?\d\d$)")  # before the zone
DAY = 86_400.0  # s
# UTC by name, or the name of a zone behind an offset: 12:00:00+02:00[Europe/Berlin]
_NAMED = ("UTC", "GMT", "]")
_ZONE = re.compile(r"(?<=\d)\s*(?:UTC|GMT)$|(?:(?<=[+-]\d\d:\d\d)|(?<=Z))\[[^\[\]]*\]$")
_ISO = re.compile(r"\s*\d{4}[-/]\d\d?[-/]\d\d?(?:$|[T ]\s*\d\d?(?!.*[apAP]\.?[mM]))")
HAS_ZONE = re.compile(r"(?:Z|UTC|GMT|\]|:?\d\d[+-]\d\d(?::?\d\d)?|\d[+-]\d\d:?\d\d)\s*$")
_CLOCK = (
    r"(?P<H>\d{1,2}):(?P<M>\d\d)(?::(?P<S>\d\d)(?:[.,](?P<f>\d+))?)?\s*(?P<ap>[AaPp]\.?[Mm]\.?)?"
)
_OFFSET = r"\s*(?P<z>Z|(?:UTC|GMT)?[+-]\d\d:?\d\d|UTC|GMT)?(?:\s*\([A-Za-z ]+\))?"
_LAYOUTS = tuple(
    re.compile(layout + r"\s*$")
    for layout in (
        r"(?P<Y>\d{4})(?P<m>\d\d)(?P<d>\d\d)[T_ -]?(?P<H>\d\d):?(?P<M>\d\d):?(?P<S>\d\d)"
        rf"(?:[.,](?P<f>\d+))?{_OFFSET}",
        rf"(?P<Y>\d{{4}})[-/.](?P<m>\d\d?)[-/.](?P<d>\d\d?)[T ,]+{_CLOCK}{_OFFSET}",
        rf"(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<Y>\d{{4}})[T ,]+{_CLOCK}{_OFFSET}",
        rf"(?P<first>\d\d?)[/-](?P<second>\d\d?)[/-](?P<Y>\d{{4}})[T ,]+{_CLOCK}{_OFFSET}",
        rf"(?:[A-Za-z]{{3,9}},?\s+)?(?P<d>\d\d?)[ -](?P<word>[A-Za-z]{{3,9}})\.?[ ,-]+"
        rf"(?P<Y>\d{{4}})[ ,T]+{_CLOCK}{_OFFSET}",
        rf"(?:[A-Za-z]{{3,9}},?\s+)?(?P<word>[A-Za-z]{{3,9}})\.?\s+(?P<d>\d\d?),?\s+(?P<Y>\d{{4}}),?"
        rf"\s+(?:at\s+)?{_CLOCK}{_OFFSET}",
        rf"[A-Za-z]{{3}}\s+(?P<word>[A-Za-z]{{3}})\s+(?P<d>\d\d?)\s+{_CLOCK}{_OFFSET}\s+(?P<Y>\d{{4}})",
    )
)
_OF_DAY = re.compile(rf"{_CLOCK}{_OFFSET}\s*$")
_DIGITS = re.compile(r"\d{5,6}(?:\.\d+)?$")
_MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"]


class Writing(NamedTuple):
    """How times are written, where they do not show it themselves."""

    zone: tzinfo | None = None  # of those that name none; None: UTC
    order: str | None = None  # mdy or dmy, in dates such as 06/01/2026, or ymd; None: they show it

    @property
    def month_first(self) -> bool | None:
        """Whether dates such as 06/01/2026 name the month first; None: as their numbers show."""
        return None if self.order in (None, "ymd") else self.order == "mdy"

    @classmethod
    def of(cls, tz: str | None, dates: str | None) -> "Writing":
        """By what callers say: a zone, and `mdy`, `dmy` or `ymd`.

        Raises:
            ReadError: It is neither.
        """
        if dates not in (None, *ORDERS):
            raise ReadError(
                f"dates: {dates!r} is no order of day, month and year; mdy (06/28/2026), dmy "
                "(28/06/2026) or ymd (260628) was expected"
            )
        return cls(zone_of(tz), dates)


UNSAID = Writing()


class Moments(NamedTuple):
    """A column of times."""

    seconds: Array  # (n,) since 1970 UTC, NaN where a cell is no time
    zoneless: bool = False  # some name no zone; the caller's, else UTC, was taken
    others: int = 0  # cells in another format than the one the column was read by
    ticks: bool = False  # numbers of 100 ns that count from the year 1 or 1601
    taken: Taken | None = None  # how dates of digits were read that do not show it


def zone_of(name: str | None) -> tzinfo | None:
    """The zone of a name such as Europe/Berlin or +02:00; None of None.

    Raises:
        ReadError: There is no such zone.
    """
    if name is None:
        return None
    try:
        return _offset(name) or ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise ReadError(
            f"tz: {name!r} is not a known time zone; a name such as Europe/Berlin, or an offset "
            "such as +02:00, was expected"
        ) from None


def taken_as_utc(column: str) -> str:
    """What to say of a column whose times name no zone."""
    return (
        f"times in column {column!r} name no zone and were taken as UTC; where they are local give "
        "--tz (tz=), such as Europe/Berlin"
    )


def iso_seconds(cells: Sequence[str | None], zone: tzinfo | None = None) -> Array:
    """Seconds since 1970 UTC of ISO 8601 texts, NaN where one is not.

    Args:
        cells: The texts.
        zone: Of those that name none; None: UTC.
    """
    if any(cell and cell.endswith(_NAMED) for cell in cells):
        cells = [_ZONE.sub(_zone_as_letter, cell) if cell else None for cell in cells]
    plain = [cell.replace("/", "-").replace(",", ".") if cell else None for cell in cells]
    seconds = _of_column(plain)
    if zone is not None:
        local = np.array([bool(cell) and not HAS_ZONE.search(cell or "") for cell in cells], bool)
        seconds[local] = to_utc(seconds[local], zone)
    return plausible(seconds)


def _of_column(cells: list[str | None]) -> Array:
    """`iso_seconds` of cells that all name a zone or none, at once; of others one by one."""
    texts = pa.array(cells, pa.string())
    for kind in (pa.timestamp("ns", "UTC"), pa.timestamp("ns")):
        try:
            nanos = texts.cast(kind).cast(pa.int64())
        except pa.ArrowInvalid:  # one of them is written otherwise, or is no time
            continue
        micros = nanos.fill_null(0).to_numpy() // 1000
        return np.where(nanos.is_valid().to_numpy(zero_copy_only=False), micros / 1e6, np.nan)
    return np.array([_of_cell(cell) for cell in cells], np.float64)


def _of_cell(cell: str | None) -> float:
    """Seconds since 1970 of one text, NaN where it is no time."""
    try:
        moment = datetime.fromisoformat(_BLANK.sub("", (cell or "").strip()))
    except ValueError:
        return math.nan
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return (moment - _EPOCH) / timedelta(microseconds=1) / 1e6


def plausible(seconds: Array) -> Array:
    """Seconds since 1970, NaN where they are of no plausible year."""
    return np.where((seconds >= 0.0) & (seconds < LATEST), seconds, np.nan)


def _zone_as_letter(match: re.Match[str]) -> str:
    return "" if match[0].startswith("[") else "Z"


def of_texts(cells: Sequence[str | None], written: Writing, where: str) -> Moments | None:
    """Times of texts; None where no cell is a date with a time of day.

    Args:
        cells: The texts, None where a cell is empty.
        written: How they are written, where they do not show it.
        where: The source and its column, for errors.

    Raises:
        ReadError: Day and month cannot be told apart.
    """
    filled = [cell for cell in cells if cell and cell.strip()]
    if not filled:
        return None
    dated = [cell for cell in filled if _ISO.match(cell)]
    if dated:
        if all(len(cell.strip()) <= len("2026-03-28") for cell in filled):
            return None  # dates without a time of day
        zoneless = any(not HAS_ZONE.search(cell) for cell in dated)
        read = Moments(iso_seconds(cells, written.zone), zoneless)
        return _with_other_dates(read, cells, written, where)
    found = [_match(cell) for cell in cells]
    if not any(found):
        return None
    return _of_matches(found, _month_first(found, written.month_first, where), written.zone)


def _with_other_dates(
    read: Moments, cells: Sequence[str | None], written: Writing, where: str
) -> Moments:
    """The times of a column with those of cells that are dates, but not in ISO 8601.

    Where 06/01/2026 does not show its month, the order is taken that is nearer to the others.
    """
    known = np.isfinite(read.seconds)
    found = [None if k else _match(c) for c, k in zip(cells, known.tolist(), strict=True)]
    if not any(found):
        return read
    if written.month_first is None and known.any():
        middle = np.median(read.seconds[known])
        both = [_of_matches(found, order, written.zone) for order in (False, True)]
        more = max(both, key=lambda one: _likeness(one.seconds, middle))
    else:
        more = _of_matches(found, _month_first(found, written.month_first, where), written.zone)
    seconds = np.where(known, read.seconds, more.seconds)
    others = int(np.count_nonzero(np.isfinite(more.seconds)))
    return Moments(seconds, read.zoneless or more.zoneless, others)


def _likeness(seconds: Array, middle: float) -> tuple[int, float]:
    """How many times are possible, and how near they are to those that are known."""
    possible = seconds[np.isfinite(seconds)]
    if not len(possible):
        return 0, 0.0
    return len(possible), -abs(float(np.median(possible)) - middle)


def _of_matches(
    found: Sequence[re.Match[str] | None], month_first: bool, zone: tzinfo | None
) -> Moments:
    """Times of texts that match a layout, NaN where one does not."""
    seconds = np.array([_seconds(m, month_first) if m else np.nan for m in found])
    local = np.array([m is not None and not m["z"] for m in found], bool)
    seconds[local] = to_utc(seconds[local], zone)
    return Moments(plausible(seconds), bool(local.any()))


def of_days(
    dates: Sequence[str | None], clocks: Sequence[str | None], written: Writing, where: str
) -> Moments | None:
    """Times of dates and times of day in columns of their own; None where they are none.

    Args:
        dates: The dates, None where a cell is empty.
        clocks: The times of day.
        written: How the dates are written, where they do not show it.
        where: The source and its column of dates, for errors.

    Raises:
        ReadError: Day, month and year cannot be told apart.
    """
    days, taken = dashed(dates, written.order, where)
    texts = [
        None if not day or not clock else f"{day} {_coloned(clock)}"
        for day, clock in zip(days, clocks, strict=True)
    ]
    read = of_texts(texts, written, where)
    return None if read is None else read._replace(taken=taken)


def of_clocks(clocks: Sequence[str | None]) -> Array | None:
    """Seconds since the first midnight of mere times of day, carried over midnights."""
    found = [_OF_DAY.match(_coloned(cell).strip()) if cell else None for cell in clocks]
    if not any(found):
        return None
    seconds = np.array([_of_day(m) if m else np.nan for m in found])
    known = np.flatnonzero(np.isfinite(seconds))
    falls = np.diff(seconds[known], prepend=seconds[known][:1]) < -0.5 * DAY
    seconds[known] += DAY * np.cumsum(falls)
    return seconds


def is_clock(cell: str) -> bool:
    """Whether a text is a mere time of day."""
    return bool(_OF_DAY.match(cell.strip()))


def from_serial(days: Array, zone: tzinfo | None) -> Array:
    """Seconds since 1970 UTC of a spreadsheet's days since 1899-12-30."""
    return to_utc((days - 25_569.0) * DAY, zone)


def to_utc(local: Array, zone: tzinfo | None) -> Array:
    """Seconds since 1970 UTC of seconds on the clocks of a zone; None: that of UTC.

    An hour that comes twice is taken as its first; steps of a log within it are kept.
    """
    if zone is None:
        return local
    known = np.isfinite(local) & (np.abs(local) < LATEST)
    hours, back = np.unique(np.floor(local[known] / 900.0), return_inverse=True)
    naive = [datetime(1970, 1, 1) + timedelta(seconds=900.0 * hour) for hour in hours]
    shifts = [(moment.replace(tzinfo=zone).utcoffset() or timedelta()) for moment in naive]
    result = np.full(len(local), np.nan)
    offsets = np.array([shift.total_seconds() for shift in shifts])
    result[known] = local[known] - (offsets[back] if len(offsets) else 0.0)
    return result


def day_of(year: Array, month: Array, day: Array) -> Array:
    """Days since 1970 of calendar dates (n,), NaN for a date that cannot be, as 31 February."""
    known = (year >= 1980) & (year < 2100) & (month >= 1) & (month <= 12) & (day >= 1)
    months = np.where(known, 12 * (year - 1970) + month - 1, 0).astype(np.int64)
    first = _first_of(months)
    known &= day <= _first_of(months + 1) - first
    return np.where(known, first + day - 1, np.nan)


def _first_of(months: NDArray[np.int64]) -> NDArray[np.int64]:
    return months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)


def _match(cell: str | None) -> re.Match[str] | None:
    if not cell:
        return None
    text = cell.strip()
    return next((m for layout in _LAYOUTS if (m := layout.match(text))), None)


def _month_first(found: Sequence[re.Match[str] | None], told: bool | None, where: str) -> bool:
    """Whether 03/28/2026 names the month first, as the caller says or its numbers show."""
    slashed = [m for m in found if m is not None and "first" in m.re.groupindex]
    if not slashed:
        return False
    first = max(int(m["first"]) for m in slashed)
    second = max(int(m["second"]) for m in slashed)
    if told is not None:
        return told
    if max(first, second) > 12 or first == second:
        return second > 12 or first == second
    if len({m["first"] for m in slashed}) != len({m["second"] for m in slashed}):
        return len({m["first"] for m in slashed}) < len({m["second"] for m in slashed})
    raise ReadError(
        f"{where}: dates such as {slashed[0][0].strip()[:30]!r} do not show which number is the "
        "month; ISO 8601 (2026-03-28T22:30:00Z) was expected; write them so, or say it by dates= "
        "(--dates): mdy, or dmy where the day comes first"
    )


def _seconds(match: re.Match[str], month_first: bool) -> float:
    """Seconds since 1970 of one date, on the clocks of its zone where it names none; else UTC."""
    parts = match.groupdict()
    day, month = parts.get("d"), parts.get("m")
    if "first" in parts:
        first, second = parts["first"], parts["second"]
        day, month = (second, first) if month_first else (first, second)
    elif "word" in parts:
        word = str(parts["word"])[:3].lower()
        month = str(_MONTHS.index(word) + 1) if word in _MONTHS else "0"
    try:
        begin = date(int(parts["Y"] or 0), int(month or 0), int(day or 0))
    except ValueError:
        return np.nan
    seconds = (begin - date(1970, 1, 1)).days * DAY + _of_day(match)
    named = _offset(parts["z"])
    if named is None:
        return seconds
    return seconds - (named.utcoffset(None) or timedelta()).total_seconds()


def _of_day(match: re.Match[str]) -> float:
    """Seconds since midnight, NaN where they cannot be."""
    parts = match.groupdict()
    hour, minute, second = int(parts["H"]), int(parts["M"]), int(parts["S"] or 0)
    if parts.get("ap"):
        if not 1 <= hour <= 12:
            return np.nan
        hour = hour % 12 + (12 if parts["ap"][0] in "pP" else 0)
    if hour > 23 or minute > 59 or second > 60:
        return np.nan
    return 3600.0 * hour + 60.0 * minute + second + float(f"0.{parts['f'] or 0}")


def _offset(text: str | None) -> timezone | None:
    """The zone of `Z`, `+02:00`, `-0500` or `GMT+02:00`; None of anything else."""
    if not text:
        return None
    if text in ("Z", "UTC", "GMT"):
        return UTC
    match = re.fullmatch(r"(?:UTC|GMT)?([+-])(\d\d):?(\d\d)", text)
    if match is None or int(match[2]) > 23 or int(match[3]) > 59:
        return None
    size = timedelta(hours=int(match[2]), minutes=int(match[3]))
    return timezone(size if match[1] == "+" else -size)


def _coloned(clock: str) -> str:
    """A time of day of six digits with colons; those of hours before ten may lack one."""
    clock = clock.strip()
    if not _DIGITS.match(clock):
        return clock
    whole, _, fraction = clock.partition(".")
    whole = whole.zfill(6)
    return f"{whole[:2]}:{whole[2:4]}:{whole[4:]}" + (f".{fraction}" if fraction else "")
