"""What C calls: a function of one block of words, which unpacks it and calls a kernel."""

from collections.abc import Callable
from typing import Any

from numba import types as _types
from numba.core import cgutils as _cgutils
from numba.extending import intrinsic as _intrinsic
from numba.np import arrayobj as _arrayobj
from numba.np.numpy_support import from_dtype

from .layout import Array, Fields, Kind, Layout

types: Any = _types  # these have no types, or not all of them
cgutils: Any = _cgutils
intrinsic: Any = _intrinsic
arrayobj: Any = _arrayobj

WORDS = types.CPointer(types.int64)  # a block


def numba_type(kind: Kind) -> Any:
    """The type by which numba knows it."""
    if isinstance(kind, Fields):
        parts = [numba_type(one) for one in kind.types]
        return (
            types.NamedTuple(parts, kind.make)
            if isinstance(kind.make, type)
            else (types.Tuple(parts))
        )
    if isinstance(kind, Array):
        dtype = from_dtype(kind.dtype)
        return types.Array(dtype, kind.ndim, "C") if kind.ndim else dtype
    return {int: types.int64, float: types.float64, bool: types.boolean}[kind]


class _Words:
    """Reads and writes a block's words one behind the other, as code."""

    def __init__(self, context: Any, builder: Any, block: Any) -> None:
        self.context, self.builder, self.block, self.at = context, builder, block, 0

    def _next(self) -> Any:
        at = self.context.get_constant(types.intp, self.at)
        self.at += 1
        return self.builder.gep(self.block, [at])

    def load(self, kind: Kind) -> Any:
        context, builder = self.context, self.builder
        known = numba_type(kind)
        if isinstance(kind, Fields):
            return context.make_tuple(builder, known, [self.load(one) for one in kind.types])
        if isinstance(kind, Array):
            word = builder.load(self._next())
            if not kind.ndim:
                return builder.inttoptr(word, context.get_value_type(known))
            shape = [builder.load(self._next()) for _ in range(kind.ndim)]
            strides = [context.get_constant(types.intp, kind.dtype.itemsize)]
            for length in shape[:0:-1]:
                strides.insert(0, builder.mul(strides[0], length))
            array = arrayobj.make_array(known)(context, builder)
            arrayobj.populate_array(
                array, data=builder.inttoptr(word, array.data.type), shape=shape,
                strides=strides, itemsize=context.get_constant(types.intp, kind.dtype.itemsize),
                meminfo=None,
            )  # fmt: skip
            return array._getvalue()
        place = self._next()
        if kind is float:
            pointer = context.get_value_type(types.float64).as_pointer()
            return builder.load(builder.bitcast(place, pointer))
        word = builder.load(place)
        return cgutils.is_not_null(builder, word) if kind is bool else word

    def store(self, kind: Kind, value: Any) -> None:
        builder = self.builder
        if isinstance(kind, Fields):
            for k, one in enumerate(kind.types):
                self.store(one, builder.extract_value(value, k))
            return
        place = self._next()
        if kind is float:
            place = builder.bitcast(place, value.type.as_pointer())
        elif kind is bool:
            value = builder.zext(value, place.type.pointee)
        builder.store(value, place)


def outer(layout: Layout, kernel: Any) -> Callable[[Any], None]:
    """The function of one block that calls a kernel."""
    arguments = types.Tuple([numba_type(kind) for kind in layout.arguments.values()])

    @intrinsic  # type: ignore[untyped-decorator]
    def load(typing_context: Any, block: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            words = _Words(context, builder, args[0])
            values = [words.load(kind) for kind in layout.arguments.values()]
            return context.make_tuple(builder, arguments, values)

        return arguments(WORDS), generate

    if layout.result is None:

        def call(block: Any) -> None:
            kernel(*load(block))

        return call

    kind, result = layout.result, numba_type(layout.result)
    at = min(leaf.at for leaf in layout.leaves() if leaf.is_result)

    @intrinsic  # type: ignore[untyped-decorator]
    def store(typing_context: Any, block: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            words = _Words(context, builder, args[0])
            words.at = at
            words.store(kind, context.cast(builder, args[1], value, result))
            return context.get_dummy_value()

        return types.void(WORDS, value), generate

    def call_and_store(block: Any) -> None:
        store(block, kernel(*load(block)))

    return call_and_store
