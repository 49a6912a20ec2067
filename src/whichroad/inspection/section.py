"""What is said of one file or drive, and how numbers are written there."""

from typing import NamedTuple

import numpy as np

from ..observations import Array


class Section(NamedTuple):
    """What one file or drive holds."""

    title: str
    rows: list[tuple[str, str]]  # what, and its value
    said: tuple[str, ...] = ()  # what was skipped, notes and errors, one sentence each


def duration(seconds: float) -> str:
    """A duration in seconds, minutes or hours."""
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"


def spread(values: Array, unit: str) -> str:
    """The median of some numbers, and their range where it is not the same."""
    low, median, high = (float(v) for v in np.quantile(values, (0.0, 0.5, 1.0)))
    text = f"{median:.3g} {unit}"
    return text if f"{low:.3g}" == f"{high:.3g}" else f"{text} (median; {low:.3g} to {high:.3g})"


def rate(time: Array) -> str:
    """How often something was read, and its longest gap.

    Args:
        time: (n,) in order, s.
    """
    n = len(time)
    if n < 2:
        return f"{n}"
    steps = np.diff(time)
    usual = float(np.median(steps))
    every = f"{1.0 / usual:.3g} Hz" if usual < 0.95 else f"one every {usual:.3g} s"
    limit = max(5.0 * usual, 2.0)
    gaps = int((steps > limit).sum())
    told = f"{n:,}, {every}"
    if gaps:
        what = "gap" if gaps == 1 else "gaps"
        told += f"; {gaps:,} {what} over {limit:.3g} s, the longest {duration(float(steps.max()))}"
    return told
