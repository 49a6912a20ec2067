"""What numba makes of the operations of `filter._simd`: vector instructions, in LLVM's terms.

A compiled loop over twelve numbers is unrolled to twelve instructions of one number each.  These
say that they are a row, and halve the time of all that is done to covariances.  Imported when
kernels are compiled, never else.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils as _cgutils
from numba.core import types
from numba.extending import lower_builtin as _lower_builtin
from numba.extending import type_callable as _type_callable
from numba.np import arrayobj as _arrayobj

cgutils: Any = _cgutils  # these have no types
arrayobj: Any = _arrayobj
type_callable: Any = _type_callable
lower_builtin: Any = _lower_builtin

_ROW = types.Array(types.float64, 1, "C")
_WIDTH = 4  # numbers that one vector instruction takes

Work = Callable[..., Any]  # (builder, values…) -> the new value of the first


def _is_row(kind: Any) -> bool:
    return isinstance(kind, types.Array) and kind.dtype == types.float64 and kind.layout == "C"


def _vectors(context: Any, builder: Any, kind: Any, argument: Any, first: int, width: int) -> Any:
    """Where a part of a row lies, None for a number; and its values."""
    vector = ir.VectorType(ir.DoubleType(), width)
    if isinstance(kind, types.Array):
        data = context.make_array(kind)(context, builder, argument).data
        at = builder.gep(data, [ir.Constant(ir.IntType(64), first)])
        place = builder.bitcast(at, vector.as_pointer())
        return place, builder.load(place, align=8)
    one = builder.insert_element(
        ir.Constant(vector, ir.Undefined), argument, ir.Constant(ir.IntType(32), 0)
    )
    mask = ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width)
    return None, builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), mask)


def teach(rows: Any) -> None:
    """Teach numba the operations of a module that says their N and what they do in Python."""
    n = rows.N

    @type_callable(rows.new_row)  # type: ignore[untyped-decorator]
    def _type_new_row(context: Any) -> Any:
        return lambda: _ROW

    @lower_builtin(rows.new_row)  # type: ignore[untyped-decorator]
    def _lower_new_row(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        row = arrayobj.make_array(_ROW)(context, builder)
        data = cgutils.alloca_once(builder, ir.DoubleType(), size=n)
        number = context.get_constant
        arrayobj.populate_array(
            row, data=data, shape=[number(types.intp, n)], strides=[number(types.intp, 8)],
            itemsize=number(types.intp, 8), meminfo=None,
        )  # fmt: skip
        return row._getvalue()

    def _row_operation(function: Callable[..., None], work: Work, with_factor: bool) -> None:
        """Teach numba one of the operations: it sets the first argument, vector by vector."""

        @type_callable(function)  # type: ignore[untyped-decorator]
        def _type(context: Any) -> Any:
            def of(target: Any, *others: Any) -> Any:
                return types.none if _is_row(target) and _is_row(others[-1]) else None

            if with_factor:
                return lambda target, factor, source: of(target, factor, source)
            return lambda target, source: of(target, source)

        between = (types.Float,) if with_factor else ()

        @lower_builtin(function, types.Array, *between, types.Array)  # type: ignore[untyped-decorator]
        def _lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            for first in range(0, n, _WIDTH):
                parts = [
                    _vectors(context, builder, kind, argument, first, _WIDTH)
                    for kind, argument in zip(signature.args, arguments, strict=True)
                ]
                builder.store(work(builder, *(values for _, values in parts)), parts[0][0], align=8)
            return context.get_dummy_value()

    _row_operation(rows.add_times, lambda b, a, f, s: b.fadd(a, b.fmul(f, s)), True)
    _row_operation(rows.set_times, lambda b, a, f, s: b.fmul(f, s), True)
    _row_operation(rows.scale_by, lambda b, a, f, s: b.fmul(a, b.fmul(f, s)), True)
    _row_operation(rows.set_to, lambda b, a, s: s, False)

    @type_callable(rows.copy_record)  # type: ignore[untyped-decorator]
    def _type_copy_record(context: Any) -> Any:
        def of(target: Any, source: Any) -> Any:
            return types.none if isinstance(target, types.Record) and target == source else None

        return of

    @lower_builtin(rows.copy_record, types.Record, types.Record)  # type: ignore[untyped-decorator]
    def _lower_copy_record(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        size = context.get_constant(types.intp, signature.args[0].size)
        cgutils.raw_memcpy(builder, arguments[0], arguments[1], size, 1)
        return context.get_dummy_value()
