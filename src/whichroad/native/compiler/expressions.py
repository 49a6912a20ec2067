"""Expressions of kernels, as instructions."""

import ast
import builtins
from typing import Any

from .addresses import Addresses, Place
from .arithmetic import Arithmetic
from .kinds import (
    BOOL,
    INT,
    NOTHING,
    Grid,
    Kind,
    Known,
    NotInKernels,
    Number,
    Parts,
    Record,
    Value,
    cast,
    joined,
    literal,
    returned,
    scalars,
    split,
    text,
    unified,
)
from .rows import Rows


class Expressions:
    """Instructions of one function, and its variables.

    A function is gone through until the kinds of its variables no longer change: a variable has
    one kind, which holds all that it is set to.

    Args:
        module: The module that it becomes a part of.
        names: The kernel's globals.
    """

    def __init__(self, module: Any, names: dict[str, Any]) -> None:
        self.module, self.globals = module, names
        self.kinds: dict[str, Kind] = {}
        self.changed = False
        self.begin()

    def begin(self) -> None:
        """Forget the instructions; the variables' kinds stay."""
        self.lines: list[str] = []
        self.reserved: list[str] = []  # places on the stack
        self._count = 0
        self.changed = False
        self.numbers = Arithmetic(self.emit, self.module.declare)
        self.addresses = Addresses(self.emit, self.write)
        self.rows = Rows(self.emit, self.addresses, self.reserve, self.module.row_length)

    def code(self) -> list[str]:
        """All instructions, behind the places that they need."""
        variables = [
            f"{slot} = alloca {scalar}"
            for name, kind in self.kinds.items()
            for slot, scalar in zip(self.slots(name), scalars(kind), strict=True)
        ]
        return [*variables, *self.reserved, *self.lines]

    def write(self, line: str) -> None:
        """Write an instruction that has no result."""
        self.lines.append(line)

    def emit(self, line: str) -> str:
        """Write an instruction; the name of its result."""
        name = self._name()
        self.lines.append(f"{name} = {line}")
        return name

    def _name(self) -> str:
        self._count += 1
        return f"%t{self._count}"

    def reserve(self, what: str) -> str:
        """A place on the stack for the whole call."""
        name = self._name()
        self.reserved.append(f"{name} = alloca {what}")
        return name

    def label(self) -> str:
        """The name of a new block."""
        return self._name()[1:]

    def block(self, name: str) -> None:
        """Begin a block: what is written from here on."""
        self.lines.append(f"{name}:")

    def jump(self, name: str) -> None:
        """End a block."""
        self.write(f"br label %{name}")

    def branch(self, test: ast.expr, then: str, other: str) -> None:
        """End a block by a test, of which no more is computed than decides."""
        match test:
            case ast.BoolOp(ast.And() | ast.Or() as operator, values):
                for value in values[:-1]:
                    further = self.label()
                    if isinstance(operator, ast.And):
                        self.branch(value, further, other)
                    else:
                        self.branch(value, then, further)
                    self.block(further)
                self.branch(values[-1], then, other)
            case ast.UnaryOp(ast.Not(), operand):
                self.branch(operand, other, then)
            case _:
                holds = self.value(test)
                if holds.constant is not None and isinstance(holds.kind, Number):
                    self.jump(then if holds.constant else other)
                    return
                leaf = cast(holds, BOOL, self.emit).leaves[0]
                self.write(f"br i1 {leaf}, label %{then}, label %{other}")

    # variables

    def slots(self, name: str) -> list[str]:
        """Where a variable's leaves stand."""
        return [f"%{name}.{k}" for k in range(len(scalars(self.kinds[name])))]

    def assign(self, name: str, value: Value) -> None:
        """Set a variable."""
        kind = unified(self.kinds.get(name, value.kind), value.kind)
        if self.kinds.get(name) != kind:
            self.kinds[name] = kind
            self.changed = True
        self._keep(value, kind, self.slots(name))

    def _keep(self, value: Value, kind: Kind, slots: list[str]) -> None:
        """Store a value's leaves as those of a kind."""
        leaves = cast(value, kind, self.emit).leaves
        for leaf, scalar, slot in zip(leaves, scalars(kind), slots, strict=True):
            self.write(f"store {scalar} {leaf}, ptr {slot}")

    def _kept(self, kind: Kind, slots: list[str]) -> Value:
        """What `_keep` has stored."""
        pairs = zip(scalars(kind), slots, strict=True)
        return Value(kind, tuple(self.emit(f"load {scalar}, ptr {slot}") for scalar, slot in pairs))

    # expressions

    def value(self, node: ast.expr) -> Value:
        """The value of an expression."""
        match node:
            case ast.Constant(value):
                return literal(value)
            case ast.Name(name):
                if name in self.kinds:
                    return self._kept(self.kinds[name], self.slots(name))
                if name in self.globals:
                    return literal(self.globals[name])
                if hasattr(builtins, name):
                    return literal(getattr(builtins, name))
                raise NotInKernels(f"{name} is read before it is set")
            case ast.Tuple(elements):
                return joined([self.value(one) for one in elements])
            case ast.Attribute() | ast.Subscript():
                found = self.place(node)
                return self.addresses.load(found) if isinstance(found, Place) else found
            case ast.BinOp(left, operator, right):
                return self.numbers.binary(operator, self.value(left), self.value(right))
            case ast.UnaryOp(ast.Not()) | ast.BoolOp():
                return self._choice(node, None, None)
            case ast.UnaryOp(operator, operand):
                return self.numbers.unary(operator, self.value(operand))
            case ast.Compare(left, operators, others):
                return self._comparison(left, operators, others)
            case ast.IfExp(test, body, orelse):
                return self._choice(test, body, orelse)
            case ast.Call():
                return self._call(node)
        raise NotInKernels(type(node).__name__)

    def _comparison(
        self, left: ast.expr, operators: list[ast.cmpop], others: list[ast.expr]
    ) -> Value:
        a = self.value(left)
        if len(others) == 1:
            return self.numbers.test(operators[0], a, self.value(others[0]))
        result, end = self.reserve("i1"), self.label()
        for operator, other in zip(operators, others, strict=True):
            b = self.value(other)
            holds = self.numbers.test(operator, a, b).leaves[0]
            self.write(f"store i1 {holds}, ptr {result}")
            further = self.label()
            self.write(f"br i1 {holds}, label %{further}, label %{end}")
            self.block(further)
            a = b
        self.jump(end)
        self.block(end)
        return Value(BOOL, (self.emit(f"load i1, ptr {result}"),))

    def _choice(self, test: ast.expr, body: ast.expr | None, orelse: ast.expr | None) -> Value:
        """One of two values by a test; without values: whether the test holds."""
        then, other, end = self.label(), self.label(), self.label()
        self.branch(test, then, other)
        made: list[tuple[Value, int]] = []
        for label, node, usual in ((then, body, True), (other, orelse, False)):
            self.block(label)
            value = literal(usual) if node is None else self.value(node)
            made.append((value, len(self.lines)))  # its cast and store go here
            self.jump(end)
        kind = unified(made[0][0].kind, made[1][0].kind)
        places = [self.reserve(scalar) for scalar in scalars(kind)]
        written = self.lines
        for value, at in reversed(made):
            self.lines = []
            self._keep(value, kind, places)
            written[at:at] = self.lines
        self.lines = written
        self.block(end)
        return self._kept(kind, places)

    def place(self, node: ast.expr) -> Place | Value:
        """Where an attribute or an element stands, or its value where that is not in memory."""
        if isinstance(node, ast.Attribute):
            return self._attribute(self.value(node.value), node.attr)
        if not isinstance(node, ast.Subscript):
            raise NotInKernels(f"{type(node).__name__} is set")
        base = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            low, high = node.slice.lower, node.slice.upper
            return self.addresses.slice(
                base, self.value(low) if low else None, self.value(high) if high else None
            )
        index = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        indices = [self.value(one) for one in index]
        if isinstance(base.kind, Grid):
            return self.addresses.element(base, indices)
        if isinstance(base.kind, Record) and isinstance(indices[0].kind, Known):
            return self.addresses.field(base, indices[0].kind.thing)
        if isinstance(base.kind, Parts) and len(indices) == 1:
            return self._part(base, indices[0])
        raise NotInKernels(f"an index of {text(base.kind)}")

    def _attribute(self, base: Value, name: str) -> Place | Value:
        match base.kind:
            case Known(thing):
                return literal(getattr(thing, name))
            case Record():
                return self.addresses.field(base, name)
            case Parts(kinds, names) if name in names:
                at = names.index(name)
                constant = None if base.constant is None else base.constant[at]
                part: Value = split(kinds, base.leaves)[at]._replace(constant=constant)
                return part
            case Grid() if name == "size":
                size = literal(1)
                for length in base.leaves[1:]:
                    size = self.numbers.binary(ast.Mult(), size, Value(INT, (length,)))
                return size
        raise NotInKernels(f"{text(base.kind)} has no {name}")

    def _part(self, base: Value, index: Value) -> Value:
        assert isinstance(base.kind, Parts)
        if index.constant is not None:
            constant = None if base.constant is None else base.constant[index.constant]
            part: Value = split(base.kind.kinds, base.leaves)[index.constant]
            return part._replace(constant=constant)
        kind, where = self.table(base)
        at = cast(index, INT, self.emit).leaves[0]
        pointer = self.emit(f"getelementptr inbounds {kind.name}, ptr {where}, i64 {at}")
        return Value(kind, (self.emit(f"load {kind.name}, ptr {pointer}"),))

    def table(self, base: Value) -> tuple[Number, str]:
        """A constant tuple as an array; the kind of its elements, and where it stands."""
        assert isinstance(base.kind, Parts)
        kind: Kind = base.kind.kinds[0] if base.kind.kinds else INT
        for one in base.kind.kinds[1:]:
            kind = unified(kind, one)
        if base.constant is None or not isinstance(kind, Number):
            raise NotInKernels("a tuple that is no constant is taken element by element")
        make: Any = {BOOL: bool, INT: int}.get(kind, float)
        leaves = [literal(make(one)).leaves[0] for one in base.constant]
        return kind, self.module.table(kind.name, leaves)

    # calls

    def _call(self, node: ast.Call) -> Value:
        known = self.value(node.func).kind
        if not isinstance(known, Known):
            raise NotInKernels(f"a call of {text(known)}")
        thing = known.thing
        arguments = [self.value(one) for one in node.args]
        if any(one.arg is None for one in node.keywords):
            raise NotInKernels("a call with a dictionary of arguments")
        named = {str(one.arg): self.value(one.value) for one in node.keywords}
        if isinstance(thing, type) and issubclass(thing, tuple) and hasattr(thing, "_fields"):
            given = dict(zip(thing._fields, arguments, strict=False)) | named
            if len(arguments) > len(thing._fields) or set(given) != set(thing._fields):
                raise NotInKernels(f"{thing.__name__} takes {', '.join(thing._fields)}")
            return joined([given[name] for name in thing._fields], thing._fields)
        if thing is len and isinstance(arguments[0].kind, Grid):
            return Value(INT, (arguments[0].leaves[1],))
        if thing is len and isinstance(arguments[0].kind, Parts):
            return literal(len(arguments[0].kind.kinds))
        if thing is range:
            raise NotInKernels("a range outside of a loop")
        if id(thing) in self.module.operations:
            return self.rows.call(thing, arguments)
        if isinstance(thing, type(len) | type) and not named:
            made = self.numbers.function(thing, arguments)
            if made is not None:
                return made
        called: Value = self.module.call(self, thing, arguments, named)
        return called

    def call(self, symbol: str, kind: Kind, arguments: list[tuple[str, str]]) -> Value:
        """Call a function of the module.

        Args:
            symbol: Its name.
            kind: Of its result.
            arguments: LLVM's types and the leaves.
        """
        given = ", ".join(f"{scalar} {leaf}" for scalar, leaf in arguments)
        whole, count = returned(kind), len(scalars(kind))
        if not count:
            self.write(f"call void @{symbol}({given})")
            return Value(NOTHING)
        made = self.emit(f"call {whole} @{symbol}({given})")
        if count == 1:
            return Value(kind, (made,))
        parts = (self.emit(f"extractvalue {whole} {made}, {k}") for k in range(count))
        return Value(kind, tuple(parts))
