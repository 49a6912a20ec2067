"""Rows of a covariance as vectors: ten numbers at once.

A compiled loop over ten numbers is unrolled to ten instructions of one number each.  These
few say that they are a row, in the compiler's own terms, and halve the time of all that is
done to covariances.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils as _cgutils
from numba.core import types
from numba.extending import intrinsic as _intrinsic
from numba.np import arrayobj as _arrayobj

from .belief import N

intrinsic: Any = _intrinsic  # these have no types
cgutils: Any = _cgutils
arrayobj: Any = _arrayobj

_ROW = types.Array(types.float64, 1, "C")
_PARTS = ((0, 4), (4, 4), (8, N - 8))


def _is_row(kind: Any) -> bool:
    return isinstance(kind, types.Array) and kind.dtype == types.float64 and kind.layout == "C"


@intrinsic  # type: ignore[untyped-decorator]
def ten(typing_context: Any) -> Any:
    """Room for a row, not cleared, for as long as the kernel runs that asks for it."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        row = arrayobj.make_array(_ROW)(context, builder)
        data = cgutils.alloca_once(builder, ir.DoubleType(), size=N)
        number = context.get_constant
        arrayobj.populate_array(
            row, data=data, shape=[number(types.intp, N)], strides=[number(types.intp, 8)],
            itemsize=number(types.intp, 8), meminfo=None,
        )  # fmt: skip
        return row._getvalue()

    return _ROW(), generate


def _row_operation(work: Callable[..., Any], rows: tuple[int, ...]) -> Callable[..., Any]:
    """Generator of code that sets the first argument, vector by vector."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        for first, width in _PARTS:
            vector = ir.VectorType(ir.DoubleType(), width)
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
                    mask = ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width)
                    values.append(
                        builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), mask)
                    )
            builder.store(work(builder, *values), places[0], align=8)
        return context.get_dummy_value()

    return generate


@intrinsic  # type: ignore[untyped-decorator]
def add_times(typing_context: Any, target: Any, factor: Any, source: Any) -> Any:
    """Target += factor · source, for rows."""
    if not (_is_row(target) and _is_row(source)):
        return None

    def work(builder: Any, a: Any, f: Any, b: Any) -> Any:
        return builder.fadd(a, builder.fmul(f, b))

    return types.void(target, types.float64, source), _row_operation(work, (0, 2))


@intrinsic  # type: ignore[untyped-decorator]
def set_times(typing_context: Any, target: Any, factor: Any, source: Any) -> Any:
    """Target = factor · source, for rows."""
    if not (_is_row(target) and _is_row(source)):
        return None

    def work(builder: Any, a: Any, f: Any, b: Any) -> Any:
        return builder.fmul(f, b)

    return types.void(target, types.float64, source), _row_operation(work, (0, 2))


@intrinsic  # type: ignore[untyped-decorator]
def scale_by(typing_context: Any, target: Any, factor: Any, source: Any) -> Any:
    """Number by number, target *= factor · source, for rows."""
    if not (_is_row(target) and _is_row(source)):
        return None

    def work(builder: Any, a: Any, f: Any, b: Any) -> Any:
        return builder.fmul(a, builder.fmul(f, b))

    return types.void(target, types.float64, source), _row_operation(work, (0, 2))


@intrinsic  # type: ignore[untyped-decorator]
def set_to(typing_context: Any, target: Any, source: Any) -> Any:
    """Target = source, for rows."""
    if not (_is_row(target) and _is_row(source)):
        return None

    def work(builder: Any, a: Any, b: Any) -> Any:
        return b

    return types.void(target, source), _row_operation(work, (0, 1))
