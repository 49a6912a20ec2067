"""Rows of a covariance as vectors, and the copy of a record, in the compiler's own terms.

A compiled loop over twelve numbers is unrolled to twelve instructions of one number each.
These say that they work on a row, and halve the time of all that is done to covariances.  In
plain Python each is the NumPy expression that it stands for.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from .._compile import intrinsic

N = 12  # states of a hypothesis, and so the length of a row (filter.state)
_WIDTH = 4  # numbers that one vector instruction takes


def _is_row(kind: Any) -> bool:
    from numba.core import types

    return isinstance(kind, types.Array) and kind.dtype == types.float64 and kind.layout == "C"


def _row_operation(work: Callable[..., Any], rows: tuple[int, ...]) -> Callable[..., Any]:
    """Generator of code that sets the first argument, vector by vector."""
    from llvmlite import ir

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vector = ir.VectorType(ir.DoubleType(), _WIDTH)
        for first in range(0, N, _WIDTH):
            values, places = [], []
            for k, (kind, argument) in enumerate(zip(signature.args, arguments, strict=True)):
                if k in rows:
                    data = context.make_array(kind)(context, builder, argument).data
                    at = builder.gep(data, [ir.Constant(ir.IntType(64), first)])
                    place = builder.bitcast(at, vector.as_pointer())
                    places.append(place)
                    values.append(builder.load(place, align=8))
                else:
                    one = builder.insert_element(
                        ir.Constant(vector, ir.Undefined), argument, ir.Constant(ir.IntType(32), 0)
                    )
                    mask = ir.Constant(ir.VectorType(ir.IntType(32), _WIDTH), [0] * _WIDTH)
                    values.append(
                        builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), mask)
                    )
            builder.store(work(builder, *values), places[0], align=8)
        return context.get_dummy_value()

    return generate


def _lower_new_row() -> Any:
    from llvmlite import ir
    from numba.core import cgutils as _cgutils
    from numba.core import types
    from numba.np import arrayobj as _arrayobj

    cgutils: Any = _cgutils  # these have no types
    arrayobj: Any = _arrayobj
    kind = types.Array(types.float64, 1, "C")

    def new_row(typing_context: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            row = arrayobj.make_array(kind)(context, builder)
            data = cgutils.alloca_once(builder, ir.DoubleType(), size=N)
            number = context.get_constant
            arrayobj.populate_array(
                row, data=data, shape=[number(types.intp, N)], strides=[number(types.intp, 8)],
                itemsize=number(types.intp, 8), meminfo=None,
            )  # fmt: skip
            return row._getvalue()

        return kind(), generate

    return new_row


@intrinsic(_lower_new_row)
def new_row() -> Any:
    """A row, not cleared, for as long as the kernel runs that asks for it."""
    return np.empty(N)


def _lower_add_times() -> Any:
    from numba.core import types

    def add_times(typing_context: Any, target: Any, factor: Any, source: Any) -> Any:
        if not (_is_row(target) and _is_row(source)):
            return None

        def work(builder: Any, a: Any, f: Any, b: Any) -> Any:
            return builder.fadd(a, builder.fmul(f, b))

        return types.void(target, types.float64, source), _row_operation(work, (0, 2))

    return add_times


@intrinsic(_lower_add_times)
def add_times(target: Any, factor: float, source: Any) -> None:
    """Target += factor · source, for rows."""
    target += factor * source


def _lower_set_times() -> Any:
    from numba.core import types

    def set_times(typing_context: Any, target: Any, factor: Any, source: Any) -> Any:
        if not (_is_row(target) and _is_row(source)):
            return None

        def work(builder: Any, a: Any, f: Any, b: Any) -> Any:
            return builder.fmul(f, b)

        return types.void(target, types.float64, source), _row_operation(work, (0, 2))

    return set_times


@intrinsic(_lower_set_times)
def set_times(target: Any, factor: float, source: Any) -> None:
    """Target = factor · source, for rows."""
    target[:] = factor * source


def _lower_scale_by() -> Any:
    from numba.core import types

    def scale_by(typing_context: Any, target: Any, factor: Any, source: Any) -> Any:
        if not (_is_row(target) and _is_row(source)):
            return None

        def work(builder: Any, a: Any, f: Any, b: Any) -> Any:
            return builder.fmul(a, builder.fmul(f, b))

        return types.void(target, types.float64, source), _row_operation(work, (0, 2))

    return scale_by


@intrinsic(_lower_scale_by)
def scale_by(target: Any, factor: float, source: Any) -> None:
    """Element by element, target *= factor · source, for rows."""
    target *= factor * source


def _lower_set_to() -> Any:
    from numba.core import types

    def set_to(typing_context: Any, target: Any, source: Any) -> Any:
        if not (_is_row(target) and _is_row(source)):
            return None

        def work(builder: Any, a: Any, b: Any) -> Any:
            return b

        return types.void(target, source), _row_operation(work, (0, 1))

    return set_to


@intrinsic(_lower_set_to)
def set_to(target: Any, source: Any) -> None:
    """Target = source, for rows."""
    target[:] = source


def _lower_copy_record() -> Any:
    from numba.core import cgutils as _cgutils
    from numba.core import types

    cgutils: Any = _cgutils

    def copy_record(typing_context: Any, target: Any, source: Any) -> Any:
        if not isinstance(target, types.Record) or target != source:
            return None

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            size = context.get_constant(types.intp, target.size)
            cgutils.raw_memcpy(builder, arguments[0], arguments[1], size, 1)
            return context.get_dummy_value()

        return types.void(target, source), generate

    return copy_record


@intrinsic(_lower_copy_record)
def copy_record(target: Any, source: Any) -> None:
    """Copy all fields of a record over those of another."""
    for name in target.dtype.names:
        target[name] = source[name]
