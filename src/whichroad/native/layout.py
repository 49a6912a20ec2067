"""What a compiled kernel takes and gives, as C sees it: one block of 8-byte words.

The annotations of a kernel say its types, and nothing else does: `int`, `float`, `bool`,
arrays (`Annotated` with `Array`), records (`Array` of no dimension) and named tuples of these,
nested.  Each argument is laid out in order: a number is one word, a record one pointer, an
array its pointer and one length a dimension (C order, so strides follow).  Results come last.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np


class Array(NamedTuple):
    """Type of an array in C order; of no dimension: a record, or a number by pointer."""

    dtype: np.dtype[Any]
    ndim: int


@dataclass(frozen=True, slots=True)
class Fields:
    """Type of a tuple, named or not."""

    make: Callable[..., Any]
    names: tuple[str, ...]
    types: tuple["Kind", ...]


Kind = type | Array | Fields  # int, float, bool; an array; a tuple

NUMBERS = {int: "q", float: "d", bool: "q"}  # and their words, as `struct` names them


class Leaf(NamedTuple):
    """One number, record or array of a block."""

    path: str  # "belief.mean"; "result…" for the result
    kind: type | Array
    at: int  # first word

    @property
    def words(self) -> int:
        """How many words it takes."""
        return 1 + self.kind.ndim if isinstance(self.kind, Array) else 1

    @property
    def is_result(self) -> bool:
        """Whether it is of the result."""
        return self.path.partition(".")[0] == "result"


@dataclass(frozen=True, slots=True)
class Layout:
    """The block of one kernel."""

    name: str
    arguments: dict[str, Kind]
    result: Kind | None

    @classmethod
    def of(cls, function: Callable[..., Any]) -> "Layout":
        """The layout of a kernel's annotations.

        Args:
            function: The kernel, every argument and its result annotated.

        Raises:
            TypeError: An annotation is none of the types that a kernel can take.
        """
        where = f"{function.__module__}.{function.__qualname__}"
        hints = get_type_hints(function, include_extras=True)
        result = hints.pop("return")
        return cls(
            function.__name__.strip("_"),
            {name: kind_of(hint, f"{where}: {name}") for name, hint in hints.items()},
            None if result is type(None) else kind_of(result, f"{where}: result"),
        )

    def leaves(self) -> list[Leaf]:
        """All leaves of the arguments, then those of the result."""
        leaves: list[Leaf] = []
        parts = [*self.arguments.items()]
        if self.result is not None:
            parts.append(("result", self.result))
        for name, kind in parts:
            for path, leaf in _walk(name, kind):
                at = leaves[-1].at + leaves[-1].words if leaves else 0
                leaves.append(Leaf(path, leaf, at))
        return leaves

    @property
    def words(self) -> int:
        """Length of the block, at least one."""
        leaves = self.leaves()
        return leaves[-1].at + leaves[-1].words if leaves else 1

    def text(self) -> str:
        """The layout as text: what must be equal for a library to fit."""
        lines = [self.name]
        for path, kind, at in self.leaves():
            kind_text = (
                f"{_dtype_text(kind.dtype)} {kind.ndim}d"
                if isinstance(kind, Array)
                else kind.__name__
            )
            lines.append(f"{at} {path} {kind_text}")
        return "\n".join(lines)

    def checksum(self) -> int:
        """The same as a number of 63 bits."""
        return int.from_bytes(hashlib.sha256(self.text().encode()).digest()[:8], "big") >> 1


def kind_of(hint: Any, where: str) -> Kind:
    """What an annotation means to C.

    Args:
        hint: The annotation, with its extras.
        where: Whose it is, for errors.

    Raises:
        TypeError: It is none that a kernel can take.
    """
    if hint in NUMBERS:
        return hint  # type: ignore[no-any-return]
    if get_origin(hint) is Annotated:
        for extra in hint.__metadata__:
            if isinstance(extra, Array):
                return Array(np.dtype(extra.dtype), extra.ndim)
    if get_origin(hint) is tuple:
        kinds = tuple(kind_of(one, where) for one in get_args(hint))
        return Fields(lambda *values: values, tuple(f"f{i}" for i in range(len(kinds))), kinds)
    if isinstance(hint, type) and issubclass(hint, tuple) and hasattr(hint, "_fields"):
        hints = get_type_hints(hint, include_extras=True)
        return Fields(
            hint, hint._fields, tuple(kind_of(hints[f], f"{where}.{f}") for f in hint._fields)
        )
    raise TypeError(
        f"{where}: {hint!r}; int, float, bool, an array of `_compile` or a NamedTuple of these "
        "was expected, because the compiled kernel's arguments follow from it"
    )


def _walk(path: str, kind: Kind) -> Iterator[tuple[str, type | Array]]:
    if isinstance(kind, Fields):
        for name, one in zip(kind.names, kind.types, strict=True):
            yield from _walk(f"{path}.{name}", one)
    else:
        yield path, kind


def _dtype_text(dtype: np.dtype[Any]) -> str:
    """Type, and for records every field with its offset."""
    if dtype.subdtype is not None:
        base, shape = dtype.subdtype
        return f"{_dtype_text(base)}{list(shape)}"
    if dtype.fields is None:
        return dtype.str
    fields = (f"{name}@{at}:{_dtype_text(of)}" for name, (of, at, *_) in dtype.fields.items())
    return f"{{{' '.join(fields)} size {dtype.itemsize}}}"
