"""Operators and functions of numbers, as NumPy and Python define them, in LLVM's instructions.

Nothing is reordered and nothing contracted: each gives the bits that numba's code gives.
"""

import ast
import math
from collections.abc import Callable
from typing import Any

from .kinds import (
    BOOL,
    INT,
    REAL,
    SINGLE,
    Emit,
    NotInKernels,
    Number,
    Value,
    cast,
    literal,
    text,
    unified,
)

INTRINSICS = {math.exp: "exp", math.log: "log", math.sin: "sin", math.cos: "cos", math.fabs: "fabs"}
LIBM = {  # and how many arguments; the system's mathematical library has them
    math.sqrt: ("sqrt", 1), math.tan: ("tan", 1), math.asin: ("asin", 1), math.acos: ("acos", 1),
    math.atan: ("atan", 1), math.sinh: ("sinh", 1), math.cosh: ("cosh", 1), math.tanh: ("tanh", 1),
    math.asinh: ("asinh", 1), math.acosh: ("acosh", 1), math.atanh: ("atanh", 1),
    math.erf: ("erf", 1), math.erfc: ("erfc", 1), math.log1p: ("log1p", 1),
    math.expm1: ("expm1", 1), math.atan2: ("atan2", 2), math.hypot: ("hypot", 2),
}  # fmt: skip
_WHOLE = {math.floor: "floor", math.ceil: "ceil", math.trunc: "trunc"}
_OPERATIONS = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
_BITS = {
    ast.BitAnd: "and", ast.BitOr: "or", ast.BitXor: "xor", ast.LShift: "shl", ast.RShift: "ashr",
}  # fmt: skip
_ORDER = {ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge"}
_TESTS = {  # of whole numbers; of others, which are unequal where one is NaN
    ast.Eq: ("eq", "oeq"), ast.NotEq: ("ne", "une"),
    **{test: (f"s{name}", f"o{name}") for test, name in _ORDER.items()},
}  # fmt: skip
_MOST_SQUARES = 0x10000  # exponents up to this are products


class Arithmetic:
    """Operations of numbers, written as instructions.

    Args:
        emit: Writes one instruction and names its result.
        declare: Says a function that is elsewhere, by its signature.
    """

    def __init__(self, emit: Emit, declare: Callable[[str], None]) -> None:
        self.emit, self.declare = emit, declare

    def _call(self, name: str, kind: Number, *leaves: str) -> Value:
        arguments = ", ".join(f"{kind.name} {leaf}" for leaf in leaves)
        pure = "" if name.startswith("llvm.") else " nounwind readnone"
        self.declare(f"{kind.name} @{name}({', '.join([kind.name] * len(leaves))}){pure}")
        return Value(kind, (self.emit(f"call {kind.name} @{name}({arguments})"),))

    def _both(self, a: Value, b: Value, kind: Number) -> tuple[str, str]:
        return cast(a, kind, self.emit).leaves[0], cast(b, kind, self.emit).leaves[0]

    def binary(self, operator: ast.operator, a: Value, b: Value) -> Value:
        """The operator of two numbers."""
        kind = unified(a.kind, b.kind)
        if not isinstance(kind, Number):
            raise NotInKernels(f"{type(operator).__name__} of {text(a.kind)} and {text(b.kind)}")
        if a.constant is not None and b.constant is not None:
            folded = _folded(operator, a, b)
            if folded is not None:
                return folded
        match operator:
            case ast.Pow():
                return self._power(a, b)
            case ast.Div():
                kind = SINGLE if kind == SINGLE else REAL
                x, y = self._both(a, b, kind)
                return Value(kind, (self.emit(f"fdiv {kind.name} {x}, {y}"),))
            case ast.FloorDiv() | ast.Mod():
                return self._divided(operator, a, b, kind)
        if type(operator) in _BITS and kind in (BOOL, INT):
            whole = BOOL if kind == BOOL and not isinstance(operator, ast.LShift) else INT
            x, y = self._both(a, b, whole)
            return Value(whole, (self.emit(f"{_BITS[type(operator)]} {whole.name} {x}, {y}"),))
        kind = INT if kind == BOOL else kind
        x, y = self._both(a, b, kind)
        name = _OPERATIONS.get(type(operator))
        if name is None:
            raise NotInKernels(f"{type(operator).__name__} of {text(a.kind)} and {text(b.kind)}")
        letter = "" if kind == INT else "f"
        return Value(kind, (self.emit(f"{letter}{name} {kind.name} {x}, {y}"),))

    def _power(self, a: Value, b: Value) -> Value:
        if b.kind == INT:
            if not isinstance(b.constant, int) or abs(b.constant) > _MOST_SQUARES:
                raise NotInKernels("a power whose whole exponent is no constant")
            if b.constant < 0 and a.kind == INT:
                raise NotInKernels("a negative power of an int")
            return self._squares(a, b.constant)
        kind = SINGLE if a.kind == b.kind == SINGLE else REAL
        x, y = self._both(a, b, kind)
        return self._call("llvm.pow.f64" if kind == REAL else "llvm.pow.f32", kind, x, y)

    def _squares(self, a: Value, exponent: int) -> Value:
        kind = a.kind if a.kind in (SINGLE, REAL) else INT
        assert isinstance(kind, Number)
        multiply = "mul i64" if kind == INT else f"fmul {kind.name}"
        factor, made = cast(a, kind, self.emit).leaves[0], ""
        left = abs(exponent)
        while left:
            if left & 1:
                made = self.emit(f"{multiply} {made}, {factor}") if made else factor
            left >>= 1
            if left:
                factor = self.emit(f"{multiply} {factor}, {factor}")
        made = made or ("1" if kind == INT else "1.0")
        if exponent < 0:
            made = self.emit(f"fdiv {kind.name} 1.0, {made}")
        return Value(kind, (made,))

    def _divided(self, operator: ast.operator, a: Value, b: Value, kind: Number) -> Value:
        """The floor of a quotient, or what is left, which has the divisor's sign."""
        if kind not in (INT, BOOL):
            raise NotInKernels(f"{type(operator).__name__} of floats")
        x, y = self._both(a, b, INT)
        rest = self.emit(f"srem i64 {x}, {y}")
        signs = self.emit(f"icmp slt i64 {self.emit(f'xor i64 {rest}, {y}')}, 0")
        some = self.emit(f"icmp ne i64 {rest}, 0")
        less = self.emit(f"and i1 {signs}, {some}")
        if isinstance(operator, ast.Mod):
            added = self.emit(f"add i64 {rest}, {y}")
            return Value(INT, (self.emit(f"select i1 {less}, i64 {added}, i64 {rest}"),))
        quotient = self.emit(f"sdiv i64 {x}, {y}")
        taken = self.emit(f"zext i1 {less} to i64")
        return Value(INT, (self.emit(f"sub i64 {quotient}, {taken}"),))

    def unary(self, operator: ast.unaryop, a: Value) -> Value:
        """Minus, plus or the inverse of a number's bits."""
        if a.constant is not None and isinstance(operator, ast.USub):
            return literal(-a.constant)
        number = cast(a, INT, self.emit) if a.kind == BOOL else a
        match operator, number.kind:
            case ast.UAdd(), Number():
                return number
            case ast.USub(), Number("i64"):
                return Value(INT, (self.emit(f"sub i64 0, {number.leaves[0]}"),))
            case ast.USub(), Number(name):
                return Value(number.kind, (self.emit(f"fneg {name} {number.leaves[0]}"),))
            case ast.Invert(), Number("i64"):
                return Value(INT, (self.emit(f"xor i64 {number.leaves[0]}, -1"),))
        raise NotInKernels(f"{type(operator).__name__} of {text(a.kind)}")

    def test(self, operator: ast.cmpop, a: Value, b: Value) -> Value:
        """Whether two numbers compare."""
        kind = unified(a.kind, b.kind)
        if type(operator) not in _TESTS or not isinstance(kind, Number):
            raise NotInKernels(f"{type(operator).__name__} of {text(a.kind)} and {text(b.kind)}")
        whole, other = _TESTS[type(operator)]
        if kind == BOOL and not isinstance(operator, ast.Eq | ast.NotEq):
            kind = INT
        x, y = self._both(a, b, kind)
        name = f"icmp {whole}" if kind in (BOOL, INT) else f"fcmp {other}"
        return Value(BOOL, (self.emit(f"{name} {kind.name} {x}, {y}"),))

    def extreme(self, values: list[Value], largest: bool) -> Value:
        """`max` or `min`: the first of equals, and never NaN where it stands second."""
        best = values[0]
        for value in values[1:]:
            kind = unified(best.kind, value.kind)
            if not isinstance(kind, Number):
                raise NotInKernels(f"max or min of {text(kind)}")
            best, value = cast(best, kind, self.emit), cast(value, kind, self.emit)
            wins = self.test(ast.Gt() if largest else ast.Lt(), value, best).leaves[0]
            x, y = value.leaves[0], best.leaves[0]
            chosen = self.emit(f"select i1 {wins}, {kind.name} {x}, {kind.name} {y}")
            best = Value(kind, (chosen,))
        return best

    def function(self, known: Any, arguments: list[Value]) -> Value | None:
        """A function of Python's or of `math`; None: it is none of these."""
        if known in (max, min):
            return self.extreme(arguments, known is max)
        first = arguments[0] if arguments else None
        if first is None or not all(isinstance(one.kind, Number) for one in arguments):
            return None
        if known is float:
            kind = SINGLE if first.kind == SINGLE else REAL
            return cast(first, kind, self.emit)
        if known in (int, bool):
            return cast(first, INT if known is int else BOOL, self.emit)
        if known is abs and first.kind in (INT, BOOL):
            number = cast(first, INT, self.emit)
            minus = self.emit(f"sub i64 0, {number.leaves[0]}")
            return self.extreme([number, Value(INT, (minus,))], largest=True)
        singles = all(one.kind == SINGLE for one in arguments)
        kind, bits, suffix = (SINGLE, "f32", "f") if singles else (REAL, "f64", "")
        leaves = [cast(one, kind, self.emit).leaves[0] for one in arguments]
        if known is abs:
            known = math.fabs
        if known in INTRINSICS:
            return self._call(f"llvm.{INTRINSICS[known]}.{bits}", kind, *leaves)
        if known is math.copysign:
            return self._call(f"llvm.copysign.{bits}", kind, *leaves)
        if known in LIBM and len(leaves) == LIBM[known][1]:
            return self._call(LIBM[known][0] + suffix, kind, *leaves)
        if known in _WHOLE:
            return cast(self._call(_WHOLE[known] + suffix, kind, *leaves), INT, self.emit)
        if known is round and len(leaves) == 1:
            return cast(self._call(f"llvm.rint.{bits}", kind, *leaves), INT, self.emit)
        return self._kind_of_float(known, kind, *leaves)

    def _kind_of_float(self, known: Any, kind: Number, leaf: str, *_: str) -> Value | None:
        if known is math.isnan:
            return Value(BOOL, (self.emit(f"fcmp uno {kind.name} {leaf}, {leaf}"),))
        tests = {math.isinf: "oeq", math.isfinite: "one"}
        if known not in tests:
            return None
        size = self._call("llvm.fabs.f64" if kind == REAL else "llvm.fabs.f32", kind, leaf)
        infinite = "0x7FF0000000000000"
        return Value(
            BOOL, (self.emit(f"fcmp {tests[known]} {kind.name} {size.leaves[0]}, {infinite}"),)
        )


def _folded(operator: ast.operator, a: Value, b: Value) -> Value | None:
    """The result for two constants of whole numbers, so that it can be an exponent or an index."""
    if a.kind != INT or b.kind != INT:
        return None
    match operator:
        case ast.Add():
            return literal(a.constant + b.constant)
        case ast.Sub():
            return literal(a.constant - b.constant)
        case ast.Mult():
            return literal(a.constant * b.constant)
    return None
