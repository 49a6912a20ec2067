"""Cells of tables of roads: one value, or a list of them, as it is or as text.

OSMnx joins streets and lists their tags; files keep such lists as `"['steps', 'footway']"`.
"""

import ast
import json
from collections.abc import Callable, Hashable, Iterable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=Hashable)

_BRACKETS = {"[": "]", "{": "}"}


def parts_of(value: object) -> tuple[object, ...]:
    """The values of a cell: those of a list, a set or the text of one, else the cell itself."""
    if isinstance(value, str):
        text = value.strip()
        if len(text) < 2 or _BRACKETS.get(text[0]) != text[-1]:
            return (value,)
        listed = _listed(text)
        return (value,) if listed is None else listed
    if isinstance(value, list | tuple | set | frozenset | np.ndarray):
        return tuple(value)
    return (value,)


def _listed(text: str) -> tuple[object, ...] | None:
    """The values of the text of a list; None: it is of none."""
    for read in (ast.literal_eval, json.loads):
        try:
            found = read(text)
        except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
            continue
        return tuple(found) if isinstance(found, list | tuple | set) else None
    return None


def each(values: NDArray[Any], function: Callable[[Any], T]) -> list[T]:
    """A function of every cell, worked out once for each different one."""
    known: dict[Any, T] = {}
    out = []
    for value in values.tolist():
        key = value if isinstance(value, Hashable) else str(value)
        if key not in known:
            known[key] = function(value)
        out.append(known[key])
    return out


def first(function: Callable[[Any], T], absent: T) -> Callable[[Any], T]:
    """The function of a cell's first value that gives something.

    Args:
        function: Of one value.
        absent: What it gives where there is nothing.
    """

    def of_cell(cell: object) -> T:
        found = (function(value) for value in parts_of(cell))
        return next((one for one in found if one != absent), absent)

    return of_cell


def best(
    function: Callable[[Any], T], choose: Callable[[Iterable[T]], T], empty: T
) -> Callable[[Any], T]:
    """The function of all of a cell's values, of which one is chosen.

    Args:
        function: Of one value.
        choose: Such as `max`.
        empty: For an empty list.
    """

    def of_cell(cell: object) -> T:
        found = [function(value) for value in parts_of(cell)]
        return choose(found) if found else empty

    return of_cell


def as_word(value: object) -> str:
    """One value as a word, empty where there is nothing."""
    if value is None or (isinstance(value, float) and value != value):
        return ""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value).strip()


def as_number(value: Any) -> float:
    """One value as a number, NaN where it is none."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return float("nan")
