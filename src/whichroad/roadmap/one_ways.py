"""One-way columns of tables of roads: words, numbers, and the codes of national providers."""

import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import tags as meaning
from .sheet import Sheet, plain
from .values import as_number, as_word, each, first

NAMES = ("oneway", "one_way", "dir_travel", "travel_dir", "rijrichtng", "sens_de_circulation",
         "directionality", "ajosuunta")  # fmt: skip
_CODED = 0.01  # share of rows with other numbers than -1, 0, 1, from which on these are a code
_LISTED = 6  # of its numbers
# of columns whose words are their own: 1 along the drawing, -1 against it, 0 both
_CODES: Mapping[str, Mapping[str, int]] = {
    "rijrichtng": {"h": 1, "t": -1, "b": 0},  # NWB: heen, terug, beide
    "sens_de_circulation": {"sens direct": 1, "sens inverse": -1, "double sens": 0},  # BD TOPO
    "directionality": {"indirection": 1, "inoppositedirection": -1, "bothdirections": 0},  # OS
    "ajosuunta": {"4": 1, "3": -1, "2": 0},  # Digiroad
}
_SPACED = frozenset(("directionality",))  # words that files write with spaces or without
_FROM_TO = frozenset(("ft", "tf"))  # beside which N is closed both ways, in the tables of TomTom
_LIKELY = re.compile(
    r"one.?way|einbahn|rijrich|fahrtri|verkehrsri|^sens(_|$)|sens_circ|sentido|suunta|"
    r"k[oö]rrikt|ensret|(^|_)dir(ection)?(_travel)?$|directional|trafdir"
)
_PLAIN = ("oneway", "one_way")
_MOST = 0.5  # share of words that are understood, beyond which a column is read
_FEW = 12  # different words of a column that may be one

_oneway: Callable[[Any], int | None] = first(meaning.oneway_word, 0)
_word: Callable[[Any], str] = first(as_word, "")


def column_of(sheet: Sheet) -> str | None:
    """The name of the column on one-way roads that is read: the first whose words are understood.

    Else it is one that says nothing, or one that is called as in OpenStreetMap.
    """
    names = [name for name in NAMES if name in sheet.columns]
    shares = {name: _understood(name, plain(sheet.columns[name])) for name in names}
    found = [name for name in names if (shares[name] or 0.0) > _MOST]
    rest = [name for name in names if shares[name] is None or name in _PLAIN]
    return next(iter(found + rest), None)


def with_one(sheet: Sheet) -> Sheet:
    """The table without the columns on one-way roads that are not read."""
    found = column_of(sheet)
    return replace(
        sheet,
        columns={n: c for n, c in sheet.columns.items() if n == found or n not in NAMES},
    )


def _understood(name: str, cells: NDArray[Any]) -> float | None:
    """The share of a column's words that are understood; None: it has none."""
    read = _by_code(name) if name in _CODES else _oneway
    words = [cell for cell, word in zip(cells, each(cells, _word), strict=True) if word]
    known = each(np.array(words, dtype=object), read)
    return sum(one is not None for one in known) / len(words) if words else None


def likely_column(sheet: Sheet) -> str | None:
    """The name of a column that may be one, where none is read."""
    for name, column in sheet.columns.items():
        if name in NAMES or _LIKELY.search(name):
            words = {as_word(cell) for cell in plain(column).tolist()}
            if 1 < len(words - {""}) <= _FEW:
                return name
    return None


def why_none(likely: str | None) -> str:
    """What is counted of roads where no column on one-way roads is read.

    Args:
        likely: Of `likely_column`.
    """
    if likely is None:
        return "roads without one-way information, as the table has none (taken as two-way)"
    return (
        f"roads without one-way information, as it is not known what {likely!r} says (taken as "
        "two-way; if it tells directions call it oneway, with F along, T against, B both)"
    )


def directions(name: str, cells: NDArray[Any], skipped: Counter[str]) -> NDArray[np.int8]:
    """1 where a row may be driven as drawn only, -1 against it only, 0 both.

    Words that nobody knows close nothing.  Where many numbers are none of -1, 0 and 1, these are
    of a code too, and close nothing either.

    Args:
        name: Of the column.
        cells: (n,) of it.
        skipped: Counts what was not understood.
    """
    found = each(cells, _by_code(name) if name in _CODES else _oneway)
    along = np.array([one or 0 for one in found], dtype=np.int8)
    unknown = np.array([one is None for one in found], dtype=bool)
    if not unknown.any():
        return along
    words = each(cells, _word)
    number = ~np.isnan(np.array([as_number(word) for word in words], dtype=np.float64))
    if name not in _CODES and np.count_nonzero(unknown & number) > _CODED * len(words):
        seen = Counter(word for word, is_one in zip(words, number, strict=True) if is_one)
        listed = ", ".join(f"{word} ({count:,})" for word, count in seen.most_common(_LISTED))
        why = f"one-way numbers of a code that is not known: {listed} (all taken as two-way; give "
        skipped[f"{why}F along, T against, B both)"] += int(number.sum())
        along[number], unknown[number] = 0, False
    if unknown.any():
        reason = "one-way words that were not understood (taken as two-way)"
        skipped[reason] += int(unknown.sum())
    return along


def _by_code(name: str) -> Callable[[Any], int | None]:
    code = _CODES[name]

    def of_word(value: Any) -> int | None:
        word = as_word(value).lower()
        word = word.replace(" ", "") if name in _SPACED else word
        return code.get(word) if word else 0

    return of_word


def closed(cells: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether each row is closed both ways: N beside FT and TF."""
    words = np.array(each(cells, lambda cell: _word(cell).lower()), dtype=object)
    if not _FROM_TO & set(words.tolist()):
        return np.zeros(len(words), dtype=bool)
    return np.asarray(words == "n", dtype=bool)
