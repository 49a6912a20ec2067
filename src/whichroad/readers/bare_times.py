"""Times of bare numbers: ticks since 1970, and the digits of a date.

A column may mix them, with each other or with texts: where a device was updated, or where
tables of several devices were joined.
"""

from datetime import tzinfo

import numpy as np

from ..observations import Array
from .checks import Bools, Ints
from .dates import DAY, EARLIEST, LATEST, Moments, day_of, plausible, to_utc

_PER_SECOND = (1.0, 1e-3, 1e-6, 1e-9)  # s in a tick of a bare number, s to ns
# s from 1970 back to the year 1 and to 1601, from which .NET and Windows count 100 ns
_TICK, _STARTS = 1e-7, (62_135_596_800.0, 11_644_473_600.0)
_COMPACT = ((12, 1), (14, 1), (17, 1000))  # digits of YYYYMMDDhhmm, with ss, with thousandths
_FIRST_START = len(_PER_SECOND) + len(_COMPACT)
_STEPS, _PAUSE = 5, 600.0  # steps that tell clocks, of those that are shorter, s
_SAME = 1e-6  # difference of two means of steps that are the same
_YEAR = 366.0 * DAY  # s, within which times of two kinds fit each other


def tick_of(size: float) -> float | None:
    """Seconds in a tick of a clock that counts from 1970 and shows `size`; None: there is none."""
    kind = int(_kinds(np.array([size]))[0])
    return _PER_SECOND[kind] if 0 <= kind < len(_PER_SECOND) else None


def of_numbers(values: Array, zone: tzinfo | None) -> Moments | None:
    """Times of bare numbers that count from 1970 or are written digits of a date.

    The middle one tells the kind.  Numbers of another kind are read as that where it puts them
    within a year of the others.

    Args:
        values: (n,) numbers, NaN where there is none.
        zone: Of written dates; None: UTC.

    Returns:
        None where the numbers count from something else.
    """
    sizes = np.abs(values[np.isfinite(values)])
    if not len(sizes):
        return Moments(values)
    middle = (len(sizes) - 1) // 2
    kind = int(_kinds(np.partition(sizes, middle)[[middle]])[0])
    if kind < 0:
        return None
    seconds = _read_as(kind, values, zone)
    if kind >= _FIRST_START:
        seconds = plausible(seconds)  # a 0 among ticks is no time of the year 1
    alike = _kinds(np.abs(values)) == kind
    read = Moments(seconds, _is_local(kind), ticks=kind >= _FIRST_START)
    return with_numbers(read, np.where(alike, np.nan, values), zone)


def with_numbers(read: Moments, values: Array, zone: tzinfo | None) -> Moments:
    """The times of a column with those of numbers of other kinds, as far as they fit.

    Args:
        read: The times so far.
        values: (n,) numbers, NaN where a cell is none, or its time is known.
        zone: Of written dates; None: UTC.
    """
    known = read.seconds[np.isnan(values) & np.isfinite(read.seconds)]
    kinds = _kinds(np.abs(values))
    if not len(known) or (kinds < 0).all():
        return read
    seconds, zoneless, others = read.seconds.copy(), read.zoneless, read.others
    for kind in np.unique(kinds[kinds >= 0]).tolist():
        rows = np.flatnonzero(kinds == kind)
        more = _read_as(kind, values[rows], zone)
        fit = (more > known.min() - _YEAR) & (more < known.max() + _YEAR)
        seconds[rows[fit]] = more[fit]
        zoneless |= _is_local(kind) and bool(fit.any())
        others += int(np.count_nonzero(fit))
    return read._replace(seconds=seconds, zoneless=zoneless, others=others)


def are_clocks(values: Array) -> bool:
    """Whether bare numbers are times of day, 74640 for 07:46:40.

    Their minutes and seconds go up to 59, and the steps across full minutes are as long as the
    others by a clock, not as numbers.  Where no full minute or hour shows that, they are not.
    """
    known = values[np.isfinite(values)]
    hour, rest = np.divmod(known, 10_000.0)
    minute, second = np.divmod(rest, 100.0)
    valid = (known >= 0.0) & (hour < 24.0) & (minute < 60.0) & (second < 60.0)
    if len(known) <= _STEPS or not valid.all():
        return False
    number, clock = np.diff(known), np.diff(3600.0 * hour + 60.0 * minute + second) % DAY
    near = (clock > 0.0) & (clock < _PAUSE)
    number, clock = number[near], clock[near]
    if len(clock) < _STEPS or (number == clock).all():
        return False
    as_number, as_clock = (np.abs(steps / np.median(steps) - 1.0) for steps in (number, clock))
    even = float(as_number.mean() - as_clock.mean())
    return even > _SAME


def _kinds(sizes: Array) -> Ints:
    """What each number is: an index of `_PER_SECOND`, `_COMPACT` or `_STARTS` in a row, or -1."""
    kinds = np.full(len(sizes), -1)
    for kind, tick in enumerate(_PER_SECOND):
        kinds[_within(sizes * tick, EARLIEST, LATEST)] = kind
    for kind, (digits, _) in enumerate(_COMPACT, len(_PER_SECOND)):
        kinds[_within(sizes / 10.0 ** (digits - 4), 1980.0, 2100.0)] = kind  # the year
    for kind, start in enumerate(_STARTS, _FIRST_START):  # .NET's of today are ns of 1990
        kinds[_within(sizes * _TICK - start, EARLIEST, LATEST)] = kind
    return kinds


def _within(values: Array, low: float, end: float) -> Bools:
    return np.asarray((values >= low) & (values < end))


def _is_local(kind: int) -> bool:
    """Whether numbers of a kind are on the clocks of a zone that they do not name."""
    return len(_PER_SECOND) <= kind < _FIRST_START


def _read_as(kind: int, values: Array, zone: tzinfo | None) -> Array:
    """Seconds since 1970 of numbers of one kind."""
    if kind >= _FIRST_START:
        return values * _TICK - _STARTS[kind - _FIRST_START]
    if not _is_local(kind):
        return values * _PER_SECOND[kind]
    return to_utc(_written(values, *_COMPACT[kind - len(_PER_SECOND)]), zone)


def _written(values: Array, digits: int, parts: int) -> Array:
    """Local seconds of numbers whose digits are year, month, day, hour, minute and second."""
    with np.errstate(invalid="ignore"):
        rest, fraction = np.divmod(values, parts)
        rest = np.where(np.isfinite(rest), rest, 0.0)
        fraction = np.where(rest > 0, fraction / parts, np.nan)
    whole = np.floor(rest)
    fraction = fraction + (rest - whole)
    second = np.zeros(len(values))
    if digits > 12:
        whole, second = np.divmod(whole, 100)
    whole, minute = np.divmod(whole, 100)
    whole, hour = np.divmod(whole, 100)
    whole, day = np.divmod(whole, 100)
    year, month = np.divmod(whole, 100)
    possible = (hour < 24) & (minute < 60) & (second < 61)
    days = np.where(possible, day_of(year, month, day), np.nan)
    return np.asarray(DAY * days + 3600.0 * hour + 60.0 * minute + second + fraction)
