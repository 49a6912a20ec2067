"""Kernels for the tests of the compiler: one for each part of Python that it knows."""

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whichroad._compile import Ints, Ints32, Matrix, Vector, entry, kernel
from whichroad.native.layout import Array

SMALL = np.dtype(
    [("weight", "f4"), ("speed", "f4"), ("edge", "i4"), ("rule", "u1"), ("on", "?"),
     ("pair", "f8", (2,)), ("table", "i4", (2, 3))]
)  # fmt: skip
NESTED = np.dtype([("time", "f8"), ("small", SMALL), ("each", SMALL, (2,))], align=True)
Smalls = Annotated[NDArray[np.void], Array(SMALL, 1)]
Nested = Annotated[Any, Array(NESTED, 0)]

_SQUARE = 2
_STEPS = (3, -1, 4)
_RATES = (0.5, 1.0, 2.25)


class Sums(NamedTuple):
    """Of two kinds."""

    count: int
    total: float


@entry
def toy_whole_numbers(a: int, b: int) -> tuple[int, int, int, int, int, int, int, int, int]:
    """Operators of whole numbers."""
    return (
        a // b, a % b, (a << 3) >> 1, a & b, (a | b) ^ 5, ~a, -a, a**3 - b**_SQUARE, abs(a) * +b,
    )  # fmt: skip


@entry
def toy_floats(
    x: float, y: float, a: int
) -> tuple[float, float, float, float, float, float, float]:
    """Operators of floats, and of floats and ints."""
    z = x
    z -= y * a
    z /= 3
    return x / y, x**2 - y**3, abs(x) ** 0.5, y**-2, -x * a, (abs(a) / 7) ** 1.5, z


@entry
def toy_extremes(x: float, y: float, a: int) -> tuple[float, float, float, int]:
    """`max` and `min`: the first of equals, and of what is no number."""
    return max(x, y, 1.0), min(x, y), max(a, x), min(a, 3, -a)


@entry
def toy_functions(x: float, y: float, out: Vector) -> None:
    """What `math` has."""
    a = abs(x) + 0.1
    out[0], out[1], out[2], out[3] = math.sqrt(a), math.exp(x), math.log(a), math.sin(x)
    out[4], out[5], out[6], out[7] = math.cos(x), math.tan(x), math.atan(x), math.atan2(y, x)
    out[8], out[9], out[10] = math.hypot(x, y), math.tanh(x), math.asinh(x)
    out[11], out[12], out[13] = math.sinh(x), math.cosh(x), math.erfc(x)
    out[14], out[15], out[16] = math.copysign(a, y), math.fabs(y), math.atanh(math.tanh(x))
    out[17], out[18], out[19] = math.asin(math.sin(y)), math.acos(math.cos(y)), math.expm1(x)
    out[20], out[21], out[22] = math.log1p(a), math.erf(y), math.acosh(1.0 + a)


@entry
def toy_roundings(x: float) -> tuple[int, int, int, int, int, bool, bool, bool, bool]:
    """From floats to whole numbers and truth."""
    return (
        math.floor(x), math.ceil(x), math.trunc(x), int(x), round(x), bool(x),
        math.isnan(x - x), math.isfinite(x), math.isinf(x * 1e308),
    )  # fmt: skip


@entry
def toy_truths(x: float, a: int, values: Vector) -> tuple[bool, bool, bool, bool, float, int]:
    """Tests, of which no more is asked than decides."""
    safe = a < len(values) and values[a] > x
    either = a >= len(values) or not values[a] > x
    chained = 0 <= a < 3 <= len(values)
    mixed = a if x > 0.5 else x
    both = (x > 0.0) == (a > 1)
    flag = 1 if safe != either else False
    return safe, either, chained, both, mixed, flag


@entry
def toy_loops(n: int, values: Vector) -> tuple[int, float, int, int]:
    """Loops of all sorts, left and gone on with from inside."""
    total = 0  # becomes a float
    last = -1
    for i in range(n - 1, -1, -2):
        if values[i] < 0.2:
            continue
        if values[i] > 0.95:
            break
        total += values[i]
        last = i
    turns = 0
    while True:
        turns += 1
        if turns * turns > n:
            break
    inner = 0
    for i in range(2, n, 3):
        for j in range(i):
            if j == 4:
                break
            inner += j
    for i in range(n):
        i += 10
        inner += i
    return last, total, turns, inner


@entry
def toy_constants(k: int, x: float) -> tuple[int, float, int, float]:
    """Tuples that are constants, values, and gone through."""
    left, right = k, k + 2
    left, right = right, left
    total = left - right
    for step in _STEPS:
        total += step * k
    a, (b, c) = k, (x, _sums(k, x))
    d = e = a + 1
    weighted = 0.0
    for rate in _RATES:
        weighted = weighted * 2.0 + rate
    return total + _STEPS[k % 3] + len(_STEPS), b + c.total + _RATES[-1], d + e + c[0], weighted


@kernel
def _sums(count: int, scale: float = 0.25, more: int = 2) -> Sums:
    return Sums(total=scale * count, count=count + more)


@kernel
def _scaled(x: float, by: float = 2.0, and_by: float = 1.5) -> float:
    """By name, by place and not at all."""
    return x * by * and_by


@entry
def toy_calls(x: float) -> float:
    """Arguments of all sorts."""
    return _scaled(x) + _scaled(x, and_by=3.0) + _scaled(and_by=x, x=1.0, by=x) + _scaled(1, 2)


@entry
def toy_arrays(table: Matrix, ints: Ints, short: Ints32, values: Vector) -> tuple[float, int, int]:
    """Rows, slices, lengths, and elements of all sizes."""
    row = table[1]
    row[0] += 1.0
    total = 0.0
    part = values[1:3]
    for i in range(len(part)):
        part[i] *= 2.0
    for i in range(len(values[5:9])):
        total += 100.0 * i
    values[:2] = 7.0
    total += _sum(table[0]) + _sum(values[-2:])
    short[0] = ints[0] + short[1] * 2
    ints[1] -= short[0]
    return total, table.size, values[2:].size


@kernel
def _sum(values: Vector) -> float:
    total = 0.0
    for i in range(len(values)):
        total += values[i]
    return total


@entry
def toy_fields(smalls: Smalls, nested: Nested, x: float) -> tuple[float, float, int, bool]:
    """Fields of all sizes, nested; numbers of 32 bits are counted with as such."""
    small = smalls[0]
    product = small["weight"] * small["speed"]
    mixed = small["weight"] * x + small["speed"] * 2
    small["edge"] -= 1
    smalls[1]["weight"] = small["weight"] + x
    smalls[1]["rule"] = smalls[0]["rule"] | 129
    smalls[1]["on"] = small["rule"] & 1 == 1
    nested["small"]["pair"][1] = product
    nested["each"][1] = smalls[1]
    nested["each"][0]["table"][1, 2] = 9 + small["edge"]
    low, high = nested["small"]["pair"]
    return float(product), mixed + low - high, smalls[1]["rule"] + 1, smalls[1]["on"]
