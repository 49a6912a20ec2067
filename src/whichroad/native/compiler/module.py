"""Kernels of Python as one module of LLVM's.

A kernel is compiled once for each combination of kinds of its arguments that it is called with:
nearly always one.  Numbers of all sizes are numbers of 64 bits when they are handed on, but for
`float32`.
"""

import ast
import functools
import inspect
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from ..layout import Array, Fields, Layout
from ..layout import Kind as Annotated
from .addresses import COPY
from .kinds import (
    BOOL,
    INT,
    NOTHING,
    REAL,
    Kind,
    NotInKernels,
    Number,
    Parts,
    Value,
    cast,
    of_annotation,
    returned,
    scalars,
    text,
)
from .rows import PREFETCH
from .statements import Statements, always_returns, parameter_names, parameters

ENTRY = "whichroad_"  # with this begins what C calls
SMALL = Number("i32")  # of what C gets back

Report = Callable[[str], None]  # called with the name of each kernel that is done

_MOST_ROUNDS = 8  # until the kinds of a kernel's variables settle


@dataclass(slots=True)
class _Unit:
    """One function of LLVM's."""

    symbol: str
    parameters: list[tuple[str, str]]  # LLVM's type and name
    result: Kind
    attributes: str
    lines: list[str]
    calls: dict[str, None]  # symbols of other units, in order


class Module:
    """Kernels and entries.

    Args:
        kernels: All, and whether each becomes a part of its callers.
        operations: Functions on rows that are vector instructions.
        shared: Kernels whose code two parts of the module can share, each by its function.
        report: Called with each kernel that is done.
    """

    def __init__(
        self, kernels: Iterable[tuple[Any, bool]], operations: Iterable[Any] = (),
        shared: Iterable[Any] = (), report: Report = lambda name: None,
    ) -> None:  # fmt: skip
        known = {one.__name__: one for one in operations}
        self.operations = {id(one) for one in known.values()}
        self.row_length = len(known["new_row"]()) if "new_row" in known else 0
        self._kernels = {id(one): inlined for one, inlined in kernels}
        self._shared = {id(one) for one in shared}
        self._report = report
        self._made: dict[tuple[int, tuple[Kind, ...]], _Unit] = {}
        self._units: dict[str, _Unit] = {}
        self._visible: set[str] = set()  # symbols of what parts share
        self._declared: dict[str, None] = {}
        self._tables: dict[tuple[str, ...], str] = {}
        self._open: list[tuple[str, dict[str, None]]] = []  # being compiled, and what each calls
        self.declare(f"void @{COPY}(ptr, ptr, i64, i1)")
        self.declare(f"void @{PREFETCH}(ptr, i32, i32, i32)")

    def declare(self, signature: str) -> None:
        """A function that is elsewhere, as LLVM writes it."""
        self._declared[signature] = None

    def table(self, name: str, leaves: list[str]) -> str:
        """A constant array; where it stands."""
        key = (name, *leaves)
        if key not in self._tables:
            self._tables[key] = f"@table.{len(self._tables)}"
        return self._tables[key]

    def text(self, entries: Iterable[str], shared: Iterable[Any]) -> str:
        """A part of it, as LLVM reads it, with all that it calls.

        Args:
            entries: Names of entries that the part has.
            shared: Kernels of those that are shared that the part has; it calls the others.
        """
        roots = [f"whichroad_{name}" for name in entries]
        here = {id(one) for one in shared}
        roots += [unit.symbol for (key, _), unit in self._made.items() if key in here]
        waiting, reached = list(roots), dict.fromkeys(roots)
        declared: dict[str, None] = {}
        while waiting:
            for symbol in self._units[waiting.pop()].calls:
                if symbol in self._visible and symbol not in reached:
                    declared[self._declaration(self._units[symbol])] = None
                elif symbol not in reached:
                    reached[symbol] = None
                    waiting.append(symbol)
        tables = [
            f"{where} = internal constant [{len(leaves)} x {name}] "
            f"[{', '.join(f'{name} {leaf}' for leaf in leaves)}]"
            for (name, *leaves), where in self._tables.items()
        ]
        outside = [f"declare {one}" for one in (*self._declared, *declared)]
        bodies = [self._definition(self._units[symbol]) for symbol in reached]
        return "\n".join([*tables, *outside, *bodies, ""])

    def _declaration(self, unit: _Unit) -> str:
        given = ", ".join(scalar for scalar, _ in unit.parameters)
        return f'hidden {returned(unit.result)} @"{unit.symbol}"({given})'

    def _definition(self, unit: _Unit) -> str:
        linkage = "hidden" if unit.symbol in self._visible else "internal"
        if unit.symbol.startswith(ENTRY):
            linkage = ""
        given = ", ".join(f"{scalar} {name}" for scalar, name in unit.parameters)
        head = f'{linkage} {returned(unit.result)} @"{unit.symbol}"({given}) {unit.attributes}'
        return f"define {head} {{\n" + "\n".join(unit.lines) + "\n}"

    def call(
        self, caller: Statements, thing: Any, arguments: list[Value], named: dict[str, Value]
    ) -> Value:
        """Call a kernel from another, which is compiled where it was not yet."""
        function = getattr(thing, "function", thing)  # of an entry
        if not inspect.isfunction(function):
            kinds = ", ".join(text(one.kind) for one in arguments)
            raise NotInKernels(f"a call of {thing!r} with {kinds}")
        if id(function) not in self._kernels:
            raise NotInKernels(
                f"a call of {function.__qualname__}, which is not marked as a kernel"
            )
        node = definition(function)
        values = parameters(node, arguments, named, list(function.__defaults__ or ()))
        return self._called(caller, function, values)

    def _called(self, caller: Statements, function: Any, values: list[Value]) -> Value:
        unit = self.function(function, tuple(one.kind for one in values))
        if self._open:
            self._open[-1][1][unit.symbol] = None
        given = [pair for one in values for pair in zip(scalars(one.kind), one.leaves, strict=True)]
        return caller.call(f'"{unit.symbol}"', unit.result, given)

    def function(self, function: Any, kinds: tuple[Kind, ...]) -> _Unit:
        """Compile a kernel for arguments of some kinds.

        Raises:
            NotInKernels: With file and line, what cannot be compiled.
        """
        key = (id(function), kinds)
        if key not in self._made:
            path = f"{function.__module__.removeprefix('whichroad.')}.{function.__name__}"
            if path in [name for name, _ in self._open]:
                raise NotInKernels(f"{path} calls itself")
            calls: dict[str, None] = {}
            self._open.append((path, calls))
            symbol = f"{path}.{len(self._made)}"
            if id(function) in self._shared:
                symbol = f"inner.{path}"
                if symbol in self._units:
                    raise NotInKernels(f"{path} is shared, and called with two kinds of arguments")
                self._visible.add(symbol)
            body, given = self._body(function, kinds)
            attributes = "alwaysinline nounwind" if self._kernels[id(function)] else "nounwind"
            unit = _Unit(symbol, given, body.result or NOTHING, attributes, body.code(), calls)
            self._made[key] = self._units[symbol] = unit
            self._open.pop()
            self._report(path)
        return self._made[key]

    def _body(
        self, function: Any, kinds: tuple[Kind, ...]
    ) -> tuple[Statements, list[tuple[str, str]]]:
        """A kernel's instructions, and its parameters."""
        node = definition(function)
        made = Statements(self, function.__globals__, function.__code__.co_filename)
        arguments: dict[str, Value] = {}
        given: list[tuple[str, str]] = []
        for name, kind in zip(parameter_names(node), kinds, strict=True):
            leaves = tuple(f"%{name}.given.{k}" for k in range(len(scalars(kind))))
            arguments[name] = Value(kind, leaves)
            given += zip(scalars(kind), leaves, strict=True)
        for _ in range(_MOST_ROUNDS):
            made.begin()
            for name, value in arguments.items():
                made.assign(name, value)
            made.body(node.body)
            if not scalars(made.result or NOTHING):
                made.write("ret void")
            elif always_returns(node.body):
                made.write("unreachable")
            else:
                raise NotInKernels(
                    f"{made.where}:{node.lineno}: {node.name} may end without a result"
                )
            if not made.changed:
                return made, given
        raise NotInKernels(f"{made.where}: {node.name}: the kinds of its variables do not settle")

    def entry(self, layout: Layout, function: Any) -> None:
        """What C calls: it unpacks a block of words, calls a kernel, and packs the result.

        Raises:
            NotInKernels: The kernel cannot be compiled, or gives what its annotations do not say.
        """
        caller = Statements(self, {}, layout.name)
        words = _Words(caller)
        calls: dict[str, None] = {}
        self._open.append((layout.name, calls))
        result = self._called(caller, function, [words.load(k) for k in layout.arguments.values()])
        self._open.pop()
        if layout.result is not None:
            words.store(cast(result, of_annotation(layout.result), caller.emit))
        caller.write("ret i32 0")
        symbol = f"{ENTRY}{layout.name}"
        unit = _Unit(symbol, [("ptr", "%block")], SMALL, "nounwind", caller.code(), calls)
        self._units[symbol] = unit


class _Words:
    """Reads and writes a block's words one behind the other."""

    def __init__(self, caller: Statements) -> None:
        self.caller, self.at = caller, 0

    def _next(self) -> str:
        self.at += 1
        return self.caller.emit(f"getelementptr i64, ptr %block, i64 {self.at - 1}")

    def load(self, kind: Annotated) -> Value:
        """The next argument."""
        emit = self.caller.emit
        if isinstance(kind, Fields):
            parts = [self.load(one) for one in kind.types]
            leaves = tuple(leaf for one in parts for leaf in one.leaves)
            return Value(Parts(tuple(one.kind for one in parts), kind.names), leaves)
        if isinstance(kind, Array):
            names = ["ptr", *["i64"] * kind.ndim]
            leaves = tuple(emit(f"load {name}, ptr {self._next()}") for name in names)
            return Value(of_annotation(kind), leaves)
        if kind is float:
            return Value(REAL, (emit(f"load double, ptr {self._next()}"),))
        word = Value(INT, (emit(f"load i64, ptr {self._next()}"),))
        return cast(word, BOOL, emit) if kind is bool else word

    def store(self, value: Value) -> None:
        """The result."""
        for scalar, leaf in zip(scalars(value.kind), value.leaves, strict=True):
            if scalar == "i1":
                scalar, leaf = "i64", self.caller.emit(f"zext i1 {leaf} to i64")
            self.caller.write(f"store {scalar} {leaf}, ptr {self._next()}")


def definition(function: Any) -> ast.FunctionDef:
    """A function's source, taken apart."""
    found = definitions(sys.modules[function.__module__].__file__).get(function.__name__)
    if found is None:
        raise NotInKernels(f"{function.__module__}.{function.__name__}: it stands in no file")
    return found


@functools.cache
def definitions(path: str) -> dict[str, ast.FunctionDef]:
    """All functions of a file, by name."""
    with open(path, encoding="utf-8") as file:
        tree = ast.parse(file.read())
    return {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
