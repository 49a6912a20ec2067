"""A module of kernels for the tests: every kind of argument, and what C must make of it."""

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whichroad._compile import Cube, Ints32, Matrix, Vector, entry, kernel
from whichroad.native.layout import Array

TRACK = np.dtype(
    [("mean", "f8", (3,)), ("cov", "f8", (3, 3)), ("weight", "f8"), ("edge", "i4"), ("new", "u1")],
    align=True,
)
STATE = np.dtype([("time", "f8"), ("counts", "i8", (2,)), ("first", TRACK)], align=True)

Tracks = Annotated[NDArray[np.void], Array(TRACK, 1)]
State = Annotated[Any, Array(STATE, 0)]


class Inner(NamedTuple):
    """Inside of `Outer`."""

    values: Vector
    factor: float


class Outer(NamedTuple):
    """A tuple in a tuple."""

    inner: Inner
    table: Matrix
    numbers: Ints32
    on: bool


class Span(NamedTuple):
    """Numbers alone."""

    first: int
    factor: float
    on: bool


@kernel
def sum_of(values: Vector, factor: float) -> float:
    """Lowered by another process than its caller."""
    total = 0.0
    for i in range(len(values)):
        total += factor * math.sin(values[i])
    return total


@kernel(inline=True)
def _inlined(table: Matrix) -> float:
    return table[0, 1] - table[1, 0]


@entry
def toy_numbers(a: int, b: float, c: bool) -> tuple[float, int, bool]:
    """Numbers in and out."""
    return (b / a if c else b * a, a // 3, not c)


@entry
def toy_span(values: Vector, span: Span, k: int) -> float:
    """A tuple of numbers between others."""
    return values[span.first] * span.factor + k if span.on else -1.0


@entry
def toy_tuples(outer: Outer, cube: Cube, k: int) -> float:
    """Named tuples, nested, and a cube."""
    outer.inner.values[0] += 1.0
    outer.numbers[1] = k
    if not outer.on:
        return -1.0
    return sum_of(outer.inner.values, outer.inner.factor) + _inlined(outer.table) + cube[1, 0, k]


@entry
def toy_records(tracks: Tracks, state: State, dt: float) -> int:
    """Records: read, written, copied, a field that is an array."""
    state["time"] += dt
    state["counts"][1] += 1
    for i in range(len(tracks)):
        tracks[i]["mean"][2] = math.hypot(tracks[i]["mean"][0], tracks[i]["mean"][1])
        tracks[i]["cov"][1, 2] *= 1.0 + dt
        tracks[i]["edge"] += 1
    tracks[1] = tracks[0]
    return len(tracks)


@entry
def toy_nothing(values: Vector) -> None:
    """No result, perhaps no array."""
    for i in range(len(values)):
        values[i] = math.sqrt(values[i])
