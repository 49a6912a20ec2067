"""What numba makes of the operation of `graph._ahead`: nothing, which has the same result."""

from typing import Any

from numba.core import types
from numba.extending import lower_builtin as _lower_builtin
from numba.extending import type_callable as _type_callable

type_callable: Any = _type_callable  # these have no types
lower_builtin: Any = _lower_builtin


def teach(ahead: Any) -> None:
    """Teach numba the operation."""

    @type_callable(ahead.prefetch)  # type: ignore[untyped-decorator]
    def _type_prefetch(context: Any) -> Any:
        return lambda record: types.none if isinstance(record, types.Record) else None

    @lower_builtin(ahead.prefetch, types.Record)  # type: ignore[untyped-decorator]
    def _lower_prefetch(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.get_dummy_value()
