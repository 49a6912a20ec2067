"""Types of values in kernels, and values: what LLVM calls them by.

A value is a row of *leaves*, each one of LLVM's scalars: a number is one, a record one pointer,
an array a pointer and its lengths (C order), a tuple the leaves of its parts.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..layout import Array, Fields
from ..layout import Kind as Annotated


class NotInKernels(TypeError):
    """Python that kernels cannot contain."""


class Found(NotInKernels):
    """The same, with its file and line."""


@dataclass(frozen=True, slots=True)
class Number:
    """A scalar, by LLVM's name of it."""

    name: str


@dataclass(frozen=True, slots=True)
class Record:
    """One row of a structured array, by pointer."""

    dtype: np.dtype[Any]


@dataclass(frozen=True, slots=True)
class Grid:
    """An array in C order."""

    dtype: np.dtype[Any]
    ndim: int


@dataclass(frozen=True, slots=True)
class Parts:
    """A tuple, named or not."""

    kinds: tuple["Kind", ...]
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Known:
    """What is no value: a module, a kernel, a class."""

    thing: Any


BOOL, INT, SINGLE, REAL = Number("i1"), Number("i64"), Number("float"), Number("double")
NOTHING = Parts(())
_RANK = {BOOL: 0, INT: 1, SINGLE: 2, REAL: 3}

_STORED = {
    "f8": REAL, "f4": SINGLE, "b1": BOOL, "i8": INT, "i4": INT, "i2": INT, "i1": INT,
    "u4": INT, "u2": INT, "u1": INT,
}  # fmt: skip

Kind = Number | Record | Grid | Parts | Known


class Value(NamedTuple):
    """A value of a kernel while it is compiled."""

    kind: Kind
    leaves: tuple[str, ...] = ()
    constant: Any = None  # its value, where the compiler knows it


def scalars(kind: Kind) -> list[str]:
    """LLVM's types of the leaves of a kind."""
    match kind:
        case Number(name):
            return [name]
        case Record():
            return ["ptr"]
        case Grid(_, ndim):
            return ["ptr", *["i64"] * ndim]
        case Parts(kinds):
            return [one for part in kinds for one in scalars(part)]
    return []


def returned(kind: Kind) -> str:
    """LLVM's type of a function's result."""
    names = scalars(kind)
    return "void" if not names else names[0] if len(names) == 1 else f"{{ {', '.join(names)} }}"


def unified(a: Kind, b: Kind) -> Kind:
    """The kind that holds values of two.

    Raises:
        NotInKernels: There is none.
    """
    if a == b:
        return a
    if isinstance(a, Number) and isinstance(b, Number):
        wider = max(a, b, key=lambda one: _RANK[one])
        return REAL if {a, b} == {INT, SINGLE} else wider
    if isinstance(a, Parts) and isinstance(b, Parts) and len(a.kinds) == len(b.kinds):
        return Parts(tuple(map(unified, a.kinds, b.kinds)), a.names or b.names)
    raise NotInKernels(f"one variable is {text(a)} and {text(b)}")


def text(kind: Kind) -> str:
    """A kind, for errors."""
    match kind:
        case Number():
            return {BOOL: "a bool", INT: "an int", SINGLE: "a float32", REAL: "a float"}[kind]
        case Grid(dtype, ndim):
            return f"an array of {ndim} dimensions of {dtype.names or dtype}"
        case Record(dtype):
            return f"a record of {dtype.names}"
        case Parts(kinds):
            return f"a tuple of {', '.join(map(text, kinds)) or 'nothing'}"
        case Known(thing):
            return repr(thing)


def of_annotation(kind: Annotated) -> Kind:
    """The kind of an annotated argument or result."""
    if isinstance(kind, Fields):
        return Parts(tuple(map(of_annotation, kind.types)), kind.names)
    if isinstance(kind, Array):
        return Grid(kind.dtype, kind.ndim) if kind.ndim else of_pointer(kind.dtype)
    return {int: INT, float: REAL, bool: BOOL}[kind]


def of_pointer(dtype: np.dtype[Any]) -> Kind:
    """The kind of what stands in memory: records and arrays stay there.

    Raises:
        NotInKernels: No number of kernels holds it.
    """
    if dtype.subdtype is not None:
        return Grid(dtype.subdtype[0], len(dtype.subdtype[1]))
    if dtype.fields is not None:
        return Record(dtype)
    kind = _STORED.get(dtype.str[1:])
    if kind is None or not dtype.isnative:
        raise NotInKernels(f"a number in memory that is {dtype}")
    return kind


def split(kinds: tuple[Kind, ...], leaves: tuple[str, ...]) -> list[Value]:
    """The parts of a tuple's leaves."""
    parts, at = [], 0
    for kind in kinds:
        count = len(scalars(kind))
        parts.append(Value(kind, leaves[at : at + count]))
        at += count
    return parts


def joined(parts: list[Value], names: tuple[str, ...] = ()) -> Value:
    """Some values as one tuple."""
    known = tuple(one.constant for one in parts)
    return Value(
        Parts(tuple(one.kind for one in parts), names),
        tuple(leaf for one in parts for leaf in one.leaves),
        None if any(one is None for one in known) else known,
    )


def literal(value: Any) -> Value:
    """A Python number, or a tuple of these, as a value; else something that is known."""
    if isinstance(value, bool | np.bool_):
        return Value(BOOL, ("true" if value else "false",), bool(value))
    if isinstance(value, int | np.integer):
        return Value(INT, (str(int(value)),), int(value))
    if isinstance(value, float | np.floating):
        return Value(REAL, (real(float(value)),), float(value))
    if isinstance(value, tuple):
        return joined([literal(one) for one in value], getattr(value, "_fields", ()))
    return Value(Known(value))


def real(value: float) -> str:
    """A number as LLVM writes it: its bits."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


Emit = Callable[[str], str]  # an instruction -> the name of its result


def cast(value: Value, kind: Kind, emit: Emit) -> Value:
    """A value as one of another kind.

    Raises:
        NotInKernels: It cannot be.
    """
    if value.kind == kind:
        return value
    if isinstance(value.kind, Number) and isinstance(kind, Number):
        return Value(kind, (_number(value, value.kind, kind, emit),))
    if isinstance(value.kind, Parts) and isinstance(kind, Parts):
        parts = split(value.kind.kinds, value.leaves)
        if len(parts) == len(kind.kinds):
            made = [cast(*pair, emit) for pair in zip(parts, kind.kinds, strict=True)]
            return joined(made, kind.names)
    raise NotInKernels(f"{text(value.kind)} stands where {text(kind)} was expected")


def _number(value: Value, have: Number, want: Number, emit: Emit) -> str:
    (leaf,) = value.leaves
    if isinstance(value.constant, int) and want == REAL:
        return real(float(value.constant))
    if have in (SINGLE, REAL):
        if want == BOOL:
            return emit(f"fcmp une {have.name} {leaf}, 0.0")
        if want == INT:
            return emit(f"fptosi {have.name} {leaf} to i64")
        return emit(f"{'fpext' if want == REAL else 'fptrunc'} {have.name} {leaf} to {want.name}")
    if want == BOOL:
        return emit(f"icmp ne i64 {leaf}, 0")
    if want == INT:
        return emit(f"zext i1 {leaf} to i64")
    return emit(f"{'uitofp' if have == BOOL else 'sitofp'} {have.name} {leaf} to {want.name}")
