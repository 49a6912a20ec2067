"""Operations on rows of numbers as vector instructions.

A compiled loop over twelve numbers is unrolled to twelve instructions of one number each.  These
say that they are a row, and halve the time of all that is done to covariances.
"""

from collections.abc import Callable
from typing import Any

from .addresses import Addresses
from .kinds import NOTHING, REAL, Emit, Grid, NotInKernels, Value, cast, text

_WIDTH = 4  # numbers that one vector instruction takes
_VECTOR = f"<{_WIDTH} x double>"

PREFETCH = "llvm.prefetch.p0"

Work = Callable[[str, str], str]  # (values, others) -> new values, each by its name


class Rows:
    """Rows of a covariance, and copies of records, written as instructions.

    Args:
        emit: Writes one instruction and names its result.
        addresses: Where they stand.
        reserve: Takes a place on the stack.
        length: Of a row.
    """

    def __init__(self, emit: Emit, addresses: Addresses, reserve: Emit, length: int) -> None:
        self.emit, self.addresses, self.reserve, self.length = emit, addresses, reserve, length

    def call(self, operation: Any, arguments: list[Value]) -> Value:
        """One of the operations.

        Args:
            operation: The function of Python that does the same.
            arguments: As it takes them.
        """
        match operation.__name__:
            case "new_row":
                place = self.reserve(f"[{self.length} x double], align 32")
                return Value(Grid(operation().dtype, 1), (place, str(self.length)))
            case "copy_record":
                target, source = arguments
                self.addresses.copy(source, target)
            case "prefetch":
                pointer = arguments[0].leaves[0]
                self.addresses.write(f"call void @{PREFETCH}(ptr {pointer}, i32 0, i32 3, i32 1)")
            case "set_to":
                self._each(arguments, lambda target, source: source)
            case name:
                self._each([arguments[0], arguments[2]], self._product(name, arguments[1]))
        return Value(NOTHING)

    def _product(self, name: str, number: Value) -> Work:
        leaf = cast(number, REAL, self.emit).leaves[0]
        one = self.emit(f"insertelement {_VECTOR} poison, double {leaf}, i32 0")
        factor = self.emit(
            f"shufflevector {_VECTOR} {one}, {_VECTOR} poison, <{_WIDTH} x i32> zeroinitializer"
        )
        combined = {"add_times": "fadd", "scale_by": "fmul", "set_times": ""}[name]

        def work(target: str, source: str) -> str:
            product = self.emit(f"fmul {_VECTOR} {factor}, {source}")
            return self.emit(f"{combined} {_VECTOR} {target}, {product}") if combined else product

        return work

    def _each(self, rows: list[Value], work: Work) -> None:
        if any(not isinstance(row.kind, Grid) or row.kind.ndim != 1 for row in rows):
            raise NotInKernels(f"rows that are {' and '.join(text(row.kind) for row in rows)}")
        for first in range(0, self.length, _WIDTH):
            places = [
                self.emit(f"getelementptr inbounds double, ptr {row.leaves[0]}, i64 {first}")
                for row in rows
            ]
            values = [self.emit(f"load {_VECTOR}, ptr {place}, align 8") for place in places]
            made = work(*values)
            self.addresses.write(f"store {_VECTOR} {made}, ptr {places[0]}, align 8")
