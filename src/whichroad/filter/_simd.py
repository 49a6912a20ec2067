"""Rows of a covariance as vectors, and the copy of a record.

Compiled, each of these is a few vector instructions (`native.rows`), in half the time of a
loop.  What stands here is what they do, and what runs as plain Python: the same bits.
"""

import numpy as np

from .._compile import Record, Vector, lowered_by

N = 12  # states of a hypothesis, and so the length of a row (filter.state)

lowered_by("whichroad.native.rows", __name__)


def new_row() -> Vector:
    """A row, not cleared, for as long as the kernel runs that asks for it."""
    return np.empty(N)


def add_times(target: Vector, factor: float, source: Vector) -> None:
    """Target += factor · source, for rows."""
    target += factor * source


def set_times(target: Vector, factor: float, source: Vector) -> None:
    """Target = factor · source, for rows."""
    target[:] = factor * source


def scale_by(target: Vector, factor: float, source: Vector) -> None:
    """Element by element, target *= factor · source, for rows."""
    target *= factor * source


def set_to(target: Vector, source: Vector) -> None:
    """Target = source, for rows."""
    target[:] = source


def copy_record(target: Record, source: Record) -> None:
    """Copy all fields of a record over those of another."""
    for name in target.dtype.names:
        target[name] = source[name]
