"""Dates in a column of their own, written in digits: 20260601, 010626, 260601, 01/06/26.

Six digits do not show which of them are the year.  Of the three usual orders those remain in
which most of a column's dates can be, and none lies in the future.  A recording goes over few
days: where it has several, the order is taken in which they are the nearest to each other.
Numbers of five digits may also be days since 1970, such as 20637.
"""

import re
from collections.abc import Sequence
from datetime import date, timedelta
from typing import NamedTuple

from ..errors import ReadError

ORDERS = ("ymd", "dmy", "mdy")
"""Of year, month and day."""
DAYS = "days"
"""As which numbers of days since 1970 are read."""

_DIGITS = re.compile(r"\d{5,8}|\d\d?([-/.])\d\d?\1\d\d")
_MIDNIGHT = re.compile(r"(?:\.0|[ T]00:00:00)$")
_YEARS = range(1980, 2100)
_NEARER = 3  # times as near to each other as in any other order
_FIRST = date(2000, 1, 1)  # hardly anybody recorded drives before


class Taken(NamedTuple):
    """How digits were read that do not show it themselves."""

    order: str  # one of `ORDERS`, or `DAYS`
    cell: str  # an example
    day: date  # what it was read as


def dashed(
    cells: Sequence[str | None], order: str | None, where: str
) -> tuple[list[str | None], Taken | None]:
    """Dates in ISO 8601 where they are written in digits, and other cells as they are.

    The second result is None where the digits themselves, or the caller, show their order.

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
    taken = None
    for width in (6, 8):  # of numbers the first digit may be lost
        several = {
            text.zfill(width): cell
            for cell, text in digits.items()
            if width - 1 <= len(text) <= width
        }
        days, said = _days_of(dict(sorted(several.items())), order, where)
        taken = taken or said
        for cell, text in digits.items():
            day = days.get(text.zfill(width))
            if day is not None:
                plain[cell] = day.isoformat()
    return [plain[cell] if cell else None for cell in cells], taken


def _days_of(
    several: dict[str, str], order: str | None, where: str
) -> tuple[dict[str, date | None], Taken | None]:
    """The days of dates of six or of eight digits, by these, in order; with their cells."""
    digits = list(several)
    soon = date.today() + timedelta(days=1)
    found = {each: {text: _day_of(text, each) for text in digits} for each in ORDERS}
    found[DAYS] = {text: _counted(cell, soon) for text, cell in several.items()}
    known = {each: sorted(filter(None, days.values())) for each, days in found.items()}
    most = max(map(len, known.values()))
    left = [each for each in found if most and len(known[each]) == most]
    if order is not None and (order in left or (digits and len(digits[0]) == 6)):
        return found[order], None
    left = [each for each in left if known[each][-1] <= soon] or left
    if not left:
        return {}, None
    left.sort(key=lambda each: known[each][-1] - known[each][0])
    first, *others = left
    spans = [known[each][-1] - known[each][0] for each in left]
    same = all(found[each] == found[first] for each in others)
    if same or (
        spans[0] * _NEARER < spans[1] and not any(_are_months(known[each]) for each in others)
    ):
        text, day = next((text, day) for text, day in found[first].items() if day)
        shown = same and first != DAYS
        return found[first], None if shown else Taken(first, several[text], day)
    raise ReadError(
        f"{where}: dates such as {several[digits[0]].strip()!r} do not show which digits are the "
        "year, the month and the day; ISO 8601 (2026-06-01) was expected; write them so, or say it "
        "by dates= (--dates): dmy, mdy or ymd"
    )


def _are_months(days: list[date]) -> bool:
    """Whether two days are the same one of two months, which a recording may be of as well."""
    return len(days) == 2 and len({(each.year, each.day) for each in days}) == 1


def _counted(cell: str, end: date) -> date | None:
    """The day of a number of days since 1970; None where it is none, or of no likely year."""
    text = _MIDNIGHT.sub("", cell.strip())
    if len(text) != 5 or not text.isdecimal():
        return None
    day = date(1970, 1, 1) + timedelta(days=int(text))
    return day if _FIRST <= day <= end else None


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
