"""The rules of one of Overture's segments: what holds at a place, for a car.

A rule holds on the share `between` of the segment, everywhere without it.  Rules on access are
taken in their order, the later one decides.
"""

import ast
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from ..observations import Array
from . import tags as meaning

_CARS = frozenset(("vehicle", "motor_vehicle", "car"))
_KMH_OF_MPH = 1.609344
_RULES = ("access_restrictions", "speed_limits", "road_flags", "level_rules", "width_rules",
          "subclass_rules", "routes")  # fmt: skip
_OPENED = frozenset(("as_customer", "at_destination", "to_deliver", "to_farm", "for_forestry",
                     "as_permitted", "as_employee", "as_student"))  # fmt: skip
# as pandas writes arrays of records
_ARRAY = re.compile(r"\barray(?=\()|,\s*dtype=\w+(?=\))")
_COMMAS = re.compile(r"\}\s+\{")


def _decoded(cell: Any) -> Any:
    """A cell, or what its text says: of JSON, or as Python writes lists and records."""
    if not isinstance(cell, str):
        return cell
    cell = _COMMAS.sub("}, {", _ARRAY.sub("", cell))
    for read in (json.loads, ast.literal_eval):
        try:
            return read(cell)
        except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
            continue
    return None


def items(cell: Any) -> list[dict[str, Any]]:
    """The records of a cell: a list of them, the text of one, or none."""
    cell = _decoded(cell)
    if isinstance(cell, list | tuple | np.ndarray):
        return [one for one in cell if isinstance(one, dict)]
    return []


def _record(cell: Any) -> dict[str, Any]:
    """A cell that is a record, or the text of one; empty: it is none."""
    cell = _decoded(cell)
    return cell if isinstance(cell, dict) else {}


def _words(cell: Any) -> list[str]:
    """The words of a cell."""
    if isinstance(cell, str):
        return [cell]
    return [str(one) for one in cell] if isinstance(cell, list | tuple | np.ndarray) else []


def _range(rule: Mapping[str, Any]) -> tuple[float, float] | None:
    """The share of the segment on which a rule holds; None: it cannot be understood."""
    between = rule.get("between")
    if between is None:
        return 0.0, 1.0
    try:
        begin, end = (float(value) for value in between)
    except (TypeError, ValueError):
        return None
    return (begin, end) if 0.0 <= begin < end <= 1.0 else None


def parts_between(at: Array, breaks: list[float]) -> Iterator[tuple[int, int]]:
    """First and last vertex of each part of a line.

    Args:
        at: (n,) places of its vertices, m.
        breaks: Places of vertices at which it is cut, m.
    """
    places = sorted({0, len(at) - 1, *(int(np.abs(at - b).argmin()) for b in breaks)})
    yield from pairwise(places)


class Rules:
    """The rules of a segment.

    Args:
        row: The segment's cells.
        skipped: Counts what is not used.

    Attributes:
        breaks: Shares of the segment at which a rule begins or ends.
    """

    def __init__(self, row: Mapping[str, Any], skipped: Counter[str]) -> None:
        self._skipped = skipped
        self._by: dict[str, list[tuple[float, float, dict[str, Any]]]] = {}
        names = _record(row.get("names"))
        self._name = str(names.get("primary") or "")
        self._subclass = str(row.get("subclass") or "")
        cells = {what: items(row.get(what)) for what in _RULES}
        cells["names"] = [] if self._name else items(names.get("rules"))
        for what, rules in cells.items():
            for rule in rules:
                share = _range(rule)
                if share is None:
                    skipped["rules whose range cannot be understood"] += 1
                elif self._used(what, rule):
                    self._by.setdefault(what, []).append((*share, rule))
        self._limits_differ(skipped)
        self.breaks = sorted(
            {end for rules in self._by.values() for a, b, _ in rules for end in (a, b)} - {0.0, 1.0}
        )

    @staticmethod
    def for_cars(when: Mapping[str, Any]) -> bool:
        """Whether a rule's modes include cars."""
        modes = _words(when.get("mode"))
        return not modes or bool(_CARS & set(modes))

    def _used(self, what: str, rule: Mapping[str, Any]) -> bool:
        """Whether a rule is for cars at any time; others are counted."""
        when = rule.get("when") or {}
        if not self.for_cars(when):
            return False
        if when.get("during") or len(_words(when.get("vehicle"))):
            self._skipped[f"{what} at certain times or for certain vehicles"] += 1
            return False
        return True

    def _limits_differ(self, skipped: Counter[str]) -> None:
        headings = {
            (rule.get("when") or {}).get("heading")
            for _, _, rule in self._by.get("speed_limits", ())
        }
        if headings - {None}:
            skipped["segments whose speed limit depends on the direction (the higher is kept)"] += 1

    def _at(self, what: str, share: float) -> list[dict[str, Any]]:
        """The rules that hold at a place, in their order."""
        return [rule for begin, end, rule in self._by.get(what, ()) if begin <= share <= end]

    def access(self, share: float) -> tuple[int, bool, bool]:
        """Access for cars, and whether driving forward, and backward, is against a one-way."""
        access, against = meaning.OPEN, {"forward": False, "backward": False}
        for rule in self._at("access_restrictions", share):
            when = rule.get("when") or {}
            heading = when.get("heading")
            denied = rule.get("access_type") == "denied"
            some = {*_words(when.get("using")), *_words(when.get("recognized"))}
            if heading in against:
                if not some:
                    against[heading] = denied
            elif some and denied:
                self._skipped["access denied to some (taken as open)"] += 1
            elif some:
                if access == meaning.CLOSED and some & _OPENED:
                    access = meaning.LIMITED
            else:
                access = meaning.CLOSED if denied else meaning.OPEN
        return access, against["forward"], against["backward"]

    def limit_kmh(self, share: float) -> float:
        """The speed limit, the higher of both directions; 0: none is known."""
        highest = 0.0
        for rule in self._at("speed_limits", share):
            limit = rule.get("max_speed") or {}
            value = meaning.number(limit.get("value"))
            mph = str(limit.get("unit") or "").lower() in ("mph", "mi/h")
            highest = max(highest, value * (_KMH_OF_MPH if mph else 1.0))
        return highest

    def flags(self, share: float) -> set[str]:
        """Words of `road_flags` at a place."""
        return {w for rule in self._at("road_flags", share) for w in _words(rule.get("values"))}

    def level(self, share: float) -> int:
        """Level above ground."""
        return next((meaning.whole(r.get("value")) for r in self._at("level_rules", share)), 0)

    def width(self, share: float) -> float:
        """Width, m; 0: not known."""
        return next((meaning.number(r.get("value")) for r in self._at("width_rules", share)), 0.0)

    def subclass(self, share: float) -> str:
        """What the segment is within its class."""
        rules = self._at("subclass_rules", share)
        return str(rules[0].get("value") or "") if rules else self._subclass

    def name(self, share: float) -> str:
        """The primary name, else that of a part, else the number of a route."""
        if self._name:
            return self._name
        for what, key in (("names", "value"), ("routes", "ref")):
            for rule in self._at(what, share):
                if rule.get(key):
                    return str(rule[key])
        return ""
