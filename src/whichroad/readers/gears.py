"""Gear columns of tables: does the vehicle go backwards?"""

import math

import numpy as np

from ..observations import Array

_BACKWARDS = frozenset(("r", "rev", "reverse", "back", "backward", "backwards", "rear"))
_FORWARDS = frozenset(
    ("p", "n", "d", "s", "m", "l", "b", "park", "parking", "neutral", "drive", "sport", "manual",
     "low", "eco", "forward", "forwards", "brake")
)  # fmt: skip


def reversing(cells: list[str | None], name: str, notes: list[str]) -> Array:
    """Whether each row is in reverse: 1, 0, or NaN where the cell tells nothing.

    Words are those of selectors (`R`, `reverse`, `D3`), negative numbers are reverse gears.  A
    column without a word or a negative number tells no reverse gear: numbers alone are coded
    differently by each maker.

    Args:
        cells: (n,) of the column.
        name: Of the column, for the note.
        notes: Where it is said what means backwards.
    """
    kinds = {cell: _backwards(cell) for cell in set(cells)}
    told = sorted({str(cell).strip() for cell, kind in kinds.items() if kind == 1.0})
    if told:
        notes.append(f"column {name!r}: {', '.join(told[:5])} taken as going backwards")
    elif all(math.isnan(kind) or _is_number(cell) for cell, kind in kinds.items()):
        notes.append(
            f"column {name!r} not used: no value is known to mean backwards; a column reverse "
            "(0 or 1) or R, -1 in this one were expected"
        )
        return np.full(len(cells), np.nan)
    return np.array([kinds[cell] for cell in cells])


def _is_number(cell: str | None) -> bool:
    try:
        return math.isfinite(float(cell or ""))
    except ValueError:
        return False


def _backwards(cell: str | None) -> float:
    word = (cell or "").strip().lower().rpartition(".")[2]  # GearShifter.reverse
    if _is_number(cell):
        return float(float(cell or "0") < 0.0)
    letters = word.rstrip("0123456789 ")
    if word in _BACKWARDS or letters in _BACKWARDS:
        return 1.0
    return 0.0 if letters in _FORWARDS else math.nan
