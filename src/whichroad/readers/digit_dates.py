"""Dates in a column of their own, written in digits: 20260601, 010626, 260601, 01/06/26.

Six digits do not show which of them are the year.  Of the three usual orders those remain in
which most of a column's dates can be, and none lies in the future.  A recording goes over few
days: where it has several, the order is taken in which they are the nearest to each other.
"""

import re
from collections.abc import Sequence
from datetime import date, timedelta

from ..errors import ReadError

ORDERS = ("ymd", "dmy", "mdy")
"""Of year, month and day."""

_DIGITS = re.compile(r"\d{5,8}|\d\d?([-/.])\d\d?\1\d\d")
_MIDNIGHT = re.compile(r"(?:\.0|[ T]00:00:00)$")
_YEARS = range(1980, 2100)
_NEARER = 3  # times as near to each other as in any other order


def dashed(cells: Sequence[str | None], order: str | None, where: str) -> list[str | None]:
    """Dates in ISO 8601 where they are written in digits, and other cells as they are.

    Args:
        cells: The dates.
        order: One of `ORDERS`, as the caller says; None: they show it.
        where: The source and its column, for errors.

    Raises:
        ReadError: The order cannot be told.
    """
    plain = {cell: _MIDNIGHT.sub("", cell.strip()) for cell in set(cells) if cell}
    digits = {
        cell: "".join(part.zfill(2) for part in re.split("[-/.]", text))
        for cell, text in plain.items()
        if _DIGITS.fullmatch(text)
    }
    for width in (6, 8):  # of numbers the first digit may be lost
        several = sorted({d.zfill(width) for d in digits.values() if width - 1 <= len(d) <= width})
        days = _days_of(several, order, where)
        for cell, text in digits.items():
            day = days.get(text.zfill(width))
            if day is not None:
                plain[cell] = day.isoformat()
    return [plain[cell] if cell else None for cell in cells]


def _days_of(digits: list[str], order: str | None, where: str) -> dict[str, date | None]:
    """The days of dates of six or of eight digits."""
    found = {each: {text: _day_of(text, each) for text in digits} for each in ORDERS}
    known = {each: sorted(filter(None, days.values())) for each, days in found.items()}
    most = max(map(len, known.values()))
    left = [each for each in ORDERS if most and len(known[each]) == most]
    if order is not None and (order in left or (digits and len(digits[0]) == 6)):
        return found[order]
    soon = date.today() + timedelta(days=1)
    left = [each for each in left if known[each][-1] <= soon] or left
    if not left:
        return {}
    left.sort(key=lambda each: known[each][-1] - known[each][0])
    first, *others = left
    spans = [known[each][-1] - known[each][0] for each in left]
    if all(found[each] == found[first] for each in others) or spans[0] * _NEARER < spans[1]:
        return found[first]
    raise ReadError(
        f"{where}: dates beside it such as {digits[0]!r} do not show which digits are the year, "
        "the month and the day; ISO 8601 (2026-06-01) was expected; write them so, or say it by "
        "dates= (--dates): dmy, mdy or ymd"
    )


def _day_of(digits: str, order: str) -> date | None:
    """The day of a date of six or eight digits; None where it cannot be."""
    two = len(digits) - 6  # digits of the century
    parts = (digits[: two + 2], digits[two + 2 : -2], digits[-2:])
    if order != "ymd":
        parts = (digits[4:], digits[2:4], digits[:2])
    year, month, day = map(int, parts)
    if order == "mdy":
        month, day = day, month
    if not two:
        year += 1900 if year >= 80 else 2000
    try:
        return date(year, month, day) if year in _YEARS else None
    except ValueError:
        return None
