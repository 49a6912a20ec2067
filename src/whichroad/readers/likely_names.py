"""Columns that are likely meant where a table lacks a quantity: offered, never taken.

A name is likely by its words (`Pos. Lat` has `lat`), or as it is nearly an accepted one.
"""

import difflib
import re
from collections.abc import Mapping, Sequence

from .names import NAMES, find, normal

_ALIKE = 0.85  # of an accepted name and one that is it with a slip of the pen
_LONGEST = 40  # characters of a name that is offered
_AWKWARD = frozenset(",=\"'$`\\!")  # characters that a shell or --columns takes otherwise
_PLAIN = re.compile(r"[\w.-]+")
_OFFERED = ("time", "date", "lat", "lon", "speed")
_OTHERS = frozenset(
    (
        *("error", "err", "std", "sigma", "acc", "accuracy", "cov", "dev", "deviation"),
        *("name", "text", "zone", "offset"),
    )
)  # words of columns that say something else of a quantity
_MORE = {
    "time": "zeit uhrzeit zeitstempel heure horodatage hora fecha_hora ora tid",
    "date": "datum fecha data",
    "lat": "breite breitengrad latitud latitudine",
    # normal() leaves no umlauts
    "lon": "laenge laengengrad l_nge l_ngengrad longitud longitudine",
    "speed": "geschwindigkeit tempo vitesse velocidad velocita",
}  # words of other languages
_WORDS = {
    quantity: frozenset((*NAMES[quantity], *_MORE[quantity].split())) for quantity in _OFFERED
}


def likely_columns(names: Sequence[str]) -> Mapping[str, str]:
    """Quantities that a table with these columns lacks, and the one column that may be each."""
    found = find(names)
    lacking = [quantity for quantity in _OFFERED if quantity not in found]
    used = {column.name for column in found.values()}
    meant: dict[str, list[str]] = {}
    for name in names:
        if name in used or len(name) > _LONGEST or not name.isprintable() or _AWKWARD & set(name):
            continue
        alike = [quantity for quantity in lacking if _may_be(normal(name), quantity)]
        if len(alike) == 1:
            meant.setdefault(alike[0], []).append(name)
    likely = {quantity: found[0] for quantity, found in meant.items() if len(found) == 1}
    if "time" in lacking and "time" not in meant and "date" in likely:
        likely["time"] = likely.pop("date")  # one column with both
    return {quantity: likely[quantity] for quantity in _OFFERED if quantity in likely}


def _may_be(name: str, quantity: str) -> bool:
    """Whether words of a name, or all of it but for a letter, name a quantity."""
    parts, words = name.split("_"), _WORDS[quantity]
    if _OTHERS & set(parts):
        return False
    runs = ("_".join(parts[i:k]) for i in range(len(parts)) for k in range(i + 1, len(parts) + 1))
    if any(len(run) > 1 and run in words for run in runs):
        return True
    return bool(difflib.get_close_matches(name, words, 1, _ALIKE))


def as_option(likely: Mapping[str, str]) -> str:
    """Columns as the command line takes them: `time=Zeit,lat="Pos. Lat"`."""
    return ",".join(
        f"{quantity}={name}" if _PLAIN.fullmatch(name) else f'{quantity}="{name}"'
        for quantity, name in likely.items()
    )
