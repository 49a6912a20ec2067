"""Statements of kernels, as instructions."""

import ast
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from .addresses import Place
from .expressions import Expressions
from .kinds import (
    INT,
    NOTHING,
    Found,
    Grid,
    Kind,
    Known,
    NotInKernels,
    Parts,
    Value,
    cast,
    literal,
    returned,
    scalars,
    split,
    text,
    unified,
)


class Statements(Expressions):
    """Instructions of one function: its body.

    Args:
        module: The module that it becomes a part of.
        names: The kernel's globals.
        where: The kernel's file, for errors.
    """

    def __init__(self, module: Any, names: dict[str, Any], where: str) -> None:
        self.result: Kind | None = None
        self.where = where
        self._loops: list[tuple[str, str]] = []  # of each: where to go on, where it ends
        super().__init__(module, names)

    def body(self, statements: list[ast.stmt]) -> None:
        """Write some statements.

        Raises:
            NotInKernels: With the line, one of them cannot be compiled.
        """
        for statement in statements:
            try:
                self._statement(statement)
            except Found:
                raise
            except (NotInKernels, AttributeError, AssertionError, KeyError, IndexError) as error:
                raise Found(f"{self.where}:{statement.lineno}: {error}") from error

    def _statement(self, node: ast.stmt) -> None:
        match node:
            case ast.Assign(targets, value):
                given = self.value(value)
                for target in targets:
                    self._set(target, given)
            case ast.AnnAssign(target, _, value) if value is not None:
                self._set(target, self.value(value))
            case ast.AugAssign(target, operator, value):
                self._augment(target, operator, value)
            case ast.If(test, body, orelse):
                self._if(test, body, orelse)
            case ast.While(test, body, []):
                self._while(test, body)
            case ast.For(target, iterated, body, []):
                self._for(target, iterated, body)
            case ast.Return(value):
                self._return(Value(NOTHING) if value is None else self.value(value))
            case ast.Expr(ast.Constant()) | ast.Pass():
                pass
            case ast.Expr(value):
                self.value(value)
            case ast.Continue():
                self._leave(self._loops[-1][0])
            case ast.Break():
                self._leave(self._loops[-1][1])
            case _:
                raise NotInKernels(f"{type(node).__name__} is not for kernels")

    def _leave(self, label: str) -> None:
        self.jump(label)
        self.block(self.label())  # what follows is never reached

    def _set(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            if isinstance(value.kind, Known):
                raise NotInKernels(f"a variable that is {text(value.kind)}")
            self.assign(target.id, value)
        elif isinstance(target, ast.Tuple):
            parts = self._taken_apart(value)
            if len(parts) != len(target.elts):
                raise NotInKernels(f"{text(value.kind)} is not {len(target.elts)} values")
            for one, part in zip(target.elts, parts, strict=True):
                self._set(one, part)
        else:
            place = self.place(target)
            if isinstance(place, Place):
                self.addresses.store(value, place)
            else:
                self._fill(place, value)

    def _taken_apart(self, value: Value) -> list[Value]:
        """The parts of a tuple, or the elements of an array whose length the compiler knows."""
        if isinstance(value.kind, Parts):
            return split(value.kind.kinds, value.leaves)
        if not isinstance(value.kind, Grid) or not value.leaves[1].isdecimal():
            raise NotInKernels(f"{text(value.kind)} is taken apart")
        at = [self.addresses.element(value, [literal(k)]) for k in range(int(value.leaves[1]))]
        return [self.addresses.load(one) if isinstance(one, Place) else one for one in at]

    @contextmanager
    def _counted(self, first: str, last: str, step: int) -> Iterator[Value]:
        """A loop over whole numbers; what is written inside is its body."""
        at, again, inside, following, end = (self.reserve("i64"), *(self.label() for _ in range(4)))
        self.write(f"store i64 {first}, ptr {at}")
        self.jump(again)
        self.block(again)
        index = self.emit(f"load i64, ptr {at}")
        more = self.emit(f"icmp {'slt' if step > 0 else 'sgt'} i64 {index}, {last}")
        self.write(f"br i1 {more}, label %{inside}, label %{end}")
        self.block(inside)
        self._loops.append((following, end))
        yield Value(INT, (index,))
        self._loops.pop()
        self.jump(following)
        self.block(following)
        index = self.emit(f"load i64, ptr {at}")
        self.write(f"store i64 {self.emit(f'add nsw i64 {index}, {step}')}, ptr {at}")
        self.jump(again)
        self.block(end)

    def _fill(self, array: Value, value: Value) -> None:
        """Set all elements of an array of one dimension to a number."""
        with self._counted("0", array.leaves[1], 1) as index:
            place = self.addresses.element(array, [index])
            if not isinstance(place, Place):
                raise NotInKernels(f"{text(array.kind)} is set as a whole")
            self.addresses.store(value, place)

    def _augment(self, target: ast.expr, operator: ast.operator, value: ast.expr) -> None:
        if isinstance(target, ast.Name):
            before = self.value(ast.Name(target.id, ast.Load()))
            self.assign(target.id, self.numbers.binary(operator, before, self.value(value)))
            return
        place = self.place(target)
        if not isinstance(place, Place):
            raise NotInKernels(f"{text(place.kind)} is changed as a whole")
        before = self.addresses.load(place)
        self.addresses.store(self.numbers.binary(operator, before, self.value(value)), place)

    def _if(self, test: ast.expr, body: list[ast.stmt], orelse: list[ast.stmt]) -> None:
        then, end = self.label(), self.label()
        other = self.label() if orelse else end
        self.branch(test, then, other)
        self.block(then)
        self.body(body)
        self.jump(end)
        if orelse:
            self.block(other)
            self.body(orelse)
            self.jump(end)
        self.block(end)

    def _while(self, test: ast.expr, body: list[ast.stmt]) -> None:
        again, inside, end = self.label(), self.label(), self.label()
        self.jump(again)
        self.block(again)
        self.branch(test, inside, end)
        self.block(inside)
        self._loops.append((again, end))
        self.body(body)
        self._loops.pop()
        self.jump(again)
        self.block(end)

    def _for(self, target: ast.expr, iterated: ast.expr, body: list[ast.stmt]) -> None:
        elements: Value | None = None
        if isinstance(iterated, ast.Call) and self.value(iterated.func).kind == Known(range):
            bounds = [self.value(one) for one in iterated.args]
        else:
            elements = self.value(iterated)
            if not isinstance(elements.kind, Parts):
                raise NotInKernels(f"a loop over {text(elements.kind)}")
            bounds = [literal(len(elements.kind.kinds))]
        if len(bounds) == 1:
            bounds.insert(0, literal(0))
        if len(bounds) == 2:
            bounds.append(literal(1))
        first, last = (cast(one, INT, self.emit).leaves[0] for one in bounds[:2])
        step = bounds[2].constant
        if not isinstance(step, int) or step == 0:
            raise NotInKernels("a range whose step is no constant")
        with self._counted(first, last, step) as index:
            self._set(target, index if elements is None else self._part(elements, index))
            self.body(body)

    def _return(self, value: Value) -> None:
        kind = value.kind if self.result is None else unified(self.result, value.kind)
        if kind != self.result:
            self.changed = self.changed or self.result is not None
            self.result = kind
        made = cast(value, kind, self.emit)
        kinds = scalars(kind)
        if not kinds:
            self.write("ret void")
        elif len(kinds) == 1:
            self.write(f"ret {kinds[0]} {made.leaves[0]}")
        else:
            whole, name = returned(kind), "poison"
            for k, (scalar, leaf) in enumerate(zip(kinds, made.leaves, strict=True)):
                name = self.emit(f"insertvalue {whole} {name}, {scalar} {leaf}, {k}")
            self.write(f"ret {whole} {name}")
        self.block(self.label())  # what follows is never reached


def always_returns(statements: list[ast.stmt]) -> bool:
    """Whether a function's last statement leaves it, whatever came before."""
    match statements[-1]:
        case ast.Return():
            return True
        case ast.If(_, body, orelse):
            return bool(orelse) and always_returns(body) and always_returns(orelse)
        case ast.While(ast.Constant(True), body):
            return not any(isinstance(one, ast.Break) for part in body for one in ast.walk(part))
    return False


def parameter_names(node: ast.FunctionDef) -> list[str]:
    """What a function calls its arguments."""
    return [one.arg for one in (*node.args.posonlyargs, *node.args.args)]


def parameters(
    node: ast.FunctionDef, values: list[Value], named: dict[str, Value], defaults: list[Any]
) -> list[Value]:
    """The arguments of a call in the order of the parameters.

    Args:
        node: The function.
        values: By position.
        named: By name.
        defaults: Of the last parameters.
    """
    names = parameter_names(node)
    usual = dict(zip(names[len(names) - len(defaults) :], map(literal, defaults), strict=True))
    given = usual | dict(zip(names, values, strict=False)) | named
    if len(values) > len(names) or set(given) != set(names):
        raise NotInKernels(f"{node.name} takes {', '.join(names)}; {', '.join(given)} is given")
    return [given[name] for name in names]
