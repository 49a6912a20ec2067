"""Rows of a covariance as vectors: ten numbers at once.

Compiled, each of these is a few vector instructions (`core.rows_llvm`), in half the time of a
loop.  What stands here is what they do, and what runs as plain Python: the same bits.
"""

import numpy as np

from ._jit import Vector, lowered_by
from .belief import N

lowered_by("whichroad.core.rows_llvm")


def ten() -> Vector:
    """Room for a row, not cleared, for as long as the kernel runs that asks for it."""
    return np.empty(N)


def add_times(target: Vector, factor: float, source: Vector) -> None:
    """Target += factor · source, for rows."""
    target += factor * source


def set_times(target: Vector, factor: float, source: Vector) -> None:
    """Target = factor · source, for rows."""
    target[:] = factor * source


def scale_by(target: Vector, factor: float, source: Vector) -> None:
    """Number by number, target *= factor · source, for rows."""
    target *= factor * source


def set_to(target: Vector, source: Vector) -> None:
    """Target = source, for rows."""
    target[:] = source
