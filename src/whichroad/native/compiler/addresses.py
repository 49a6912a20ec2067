"""Where values stand in memory: fields of records, elements of arrays, rows."""

from typing import Any, NamedTuple

import numpy as np

from .kinds import (
    BOOL,
    INT,
    REAL,
    SINGLE,
    Emit,
    Grid,
    Kind,
    NotInKernels,
    Number,
    Record,
    Value,
    cast,
    of_pointer,
    text,
)

COPY = "llvm.memcpy.p0.p0.i64"


class Place(NamedTuple):
    """A number, record or array in memory."""

    dtype: np.dtype[Any]
    pointer: str
    align: int  # bytes, that its address is a multiple of


class Addresses:
    """Loads, stores and addresses, written as instructions.

    Args:
        emit: Writes one instruction and names its result.
        write: Writes one that has none.
    """

    def __init__(self, emit: Emit, write: Any) -> None:
        self.emit, self.write = emit, write

    def field(self, record: Value, name: str) -> Place:
        """Where a field of a record stands."""
        assert isinstance(record.kind, Record)
        fields = record.kind.dtype.fields
        if fields is None or name not in fields:
            raise NotInKernels(f"{text(record.kind)} has no {name}")
        dtype, offset = fields[name][:2]
        pointer = record.leaves[0]
        if offset:
            pointer = self.emit(f"getelementptr inbounds i8, ptr {pointer}, i64 {offset}")
        return Place(dtype, pointer, _alignment(dtype) if record.kind.dtype.isalignedstruct else 1)

    def element(self, array: Value, indices: list[Value]) -> Place | Value:
        """Where an element of an array stands; with fewer indices than dimensions: a row."""
        assert isinstance(array.kind, Grid)
        dtype, ndim = array.kind.dtype, array.kind.ndim
        pointer, *lengths = array.leaves
        if len(indices) > ndim:
            raise NotInKernels(f"{len(indices)} indices of {text(array.kind)}")
        at = ""
        for index, length in zip(indices, lengths, strict=False):
            if index.kind not in (INT, BOOL):
                raise NotInKernels(f"an index that is {text(index.kind)}")
            step = cast(index, INT, self.emit).leaves[0]
            if at:
                step = self.emit(f"add i64 {self.emit(f'mul i64 {at}, {length}')}, {step}")
            at = step
        for length in lengths[len(indices) :]:
            at = self.emit(f"mul i64 {at}, {length}")
        place = self.emit(f"getelementptr inbounds {_unit(dtype)}, ptr {pointer}, i64 {at}")
        if len(indices) < ndim:
            rest = lengths[len(indices) :]
            return Value(Grid(dtype, len(rest)), (place, *rest))
        return Place(dtype, place, _alignment(dtype))

    def slice(self, array: Value, low: Value | None, high: Value | None) -> Value:
        """Some successive elements of an array of one dimension, as they stand."""
        if not isinstance(array.kind, Grid) or array.kind.ndim != 1:
            raise NotInKernels(f"a slice of {text(array.kind)}")
        pointer, length = array.leaves

        def within(bound: Value | None, usual: str) -> str:
            if bound is None:
                return usual
            at = cast(bound, INT, self.emit).leaves[0]
            counted = self.emit(f"add i64 {at}, {length}")
            below = self.emit(f"icmp slt i64 {at}, 0")
            at = self.emit(f"select i1 {below}, i64 {counted}, i64 {at}")
            at = self._extreme("sgt", at, "0")
            return self._extreme("slt", at, length)

        first, last = within(low, "0"), within(high, length)
        count = self._extreme("sgt", self.emit(f"sub i64 {last}, {first}"), "0")
        unit = _unit(array.kind.dtype)
        pointer = self.emit(f"getelementptr inbounds {unit}, ptr {pointer}, i64 {first}")
        return Value(array.kind, (pointer, count))

    def _extreme(self, test: str, a: str, b: str) -> str:
        wins = self.emit(f"icmp {test} i64 {a}, {b}")
        return self.emit(f"select i1 {wins}, i64 {a}, i64 {b}")

    def load(self, place: Place) -> Value:
        """What stands in a place: a number; records and arrays stay where they are."""
        kind = of_pointer(place.dtype)
        if isinstance(kind, Grid):
            assert place.dtype.subdtype is not None
            return Value(kind, (place.pointer, *map(str, place.dtype.subdtype[1])))
        if isinstance(kind, Record):
            return Value(kind, (place.pointer,))
        width = f"i{8 * place.dtype.itemsize}"
        if kind in (REAL, SINGLE):
            kind_name = kind.name
            return Value(kind, (self._load(kind_name, place),))
        loaded = self._load(width, place)
        if kind == BOOL:
            return Value(kind, (self.emit(f"icmp ne {width} {loaded}, 0"),))
        if place.dtype.itemsize < 8:
            extend = "zext" if place.dtype.kind == "u" else "sext"
            loaded = self.emit(f"{extend} {width} {loaded} to i64")
        return Value(kind, (loaded,))

    def _load(self, name: str, place: Place) -> str:
        return self.emit(f"load {name}, ptr {place.pointer}, align {place.align}")

    def store(self, value: Value, place: Place) -> None:
        """Put a number into a place, or copy a record over another."""
        kind: Kind = of_pointer(place.dtype)
        if isinstance(kind, Record):
            self.copy(value, Value(kind, (place.pointer,)))
            return
        if not isinstance(kind, Number):
            raise NotInKernels(f"{text(kind)} is set as a whole: its elements can be")
        leaf = cast(value, kind, self.emit).leaves[0]
        name = kind.name
        if kind in (BOOL, INT):
            name = f"i{8 * place.dtype.itemsize}"
            if kind == BOOL:
                leaf = self.emit(f"zext i1 {leaf} to {name}")
            elif place.dtype.itemsize < 8:
                leaf = self.emit(f"trunc i64 {leaf} to {name}")
        self.write(f"store {name} {leaf}, ptr {place.pointer}, align {place.align}")

    def copy(self, source: Value, target: Value) -> None:
        """Copy all of a record over another of its kind."""
        if not isinstance(target.kind, Record) or target.kind != source.kind:
            raise NotInKernels(f"{text(source.kind)} is copied over {text(target.kind)}")
        size = target.kind.dtype.itemsize
        to, at = target.leaves[0], source.leaves[0]
        self.write(f"call void @{COPY}(ptr {to}, ptr {at}, i64 {size}, i1 false)")


def _unit(dtype: np.dtype[Any]) -> str:
    """LLVM's type of one element."""
    kind = of_pointer(dtype)
    if kind in (REAL, SINGLE):
        return kind.name
    return f"[{dtype.itemsize} x i8]" if isinstance(kind, Record) else f"i{8 * dtype.itemsize}"


def _alignment(dtype: np.dtype[Any]) -> int:
    return 1 if dtype.fields is not None else dtype.base.itemsize
