"""The compiled library: found, compared with the package, and called by ctypes."""

import ctypes
import functools
import struct
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..errors import WhichroadError
from .layout import NUMBERS, Array, Fields, Kind, Layout

LOCK = threading.RLock()


class Call:
    """One entry of the library, called with Python's values."""

    def __init__(self, layout: Layout, function: Any) -> None:
        self._kinds = list(layout.arguments.items())
        self._name = layout.name
        self._function = function
        words = [leaf.at for leaf in layout.leaves() if leaf.path.split(".")[0] == "result"]
        self._result_at = 8 * (words[0] if words else layout.words)
        self._format = _format(layout)
        self._pack = struct.Struct(self._format[: self._result_at // 8]).pack_into
        self._size = 8 * layout.words
        self._block = ctypes.c_char * self._size
        self._result = _result_of(layout.result, self._format[self._result_at // 8 :])

    def __call__(self, *args: Any) -> Any:
        values: list[Any] = []
        if len(args) != len(self._kinds):
            raise TypeError(f"{self._name}: {len(args)} arguments; {len(self._kinds)} expected")
        for (name, kind), arg in zip(self._kinds, args, strict=True):
            _flatten(name, kind, arg, values)
        block = self._block()
        self._pack(block, 0, *values)
        if self._function(block):
            raise WhichroadError(f"the kernel {self._name} failed; this is a bug")
        return self._result(block, self._result_at)

    def bind(self, args: Sequence[Any]) -> Callable[..., Any]:
        """The call with its pointers taken; `...` where each call gives a number."""
        values: list[Any] = []
        free: list[int] = []
        for (name, kind), arg in zip(self._kinds, args, strict=True):
            if arg is ... and kind in NUMBERS:
                free.append(len(values))
                values.append(0)
            else:
                _flatten(name, kind, arg, values)
        block = self._block()
        self._pack(block, 0, *values)
        puts = [(struct.Struct(self._format[at]).pack_into, 8 * at) for at in free]
        pointer = ctypes.c_void_p(ctypes.addressof(block))
        function, result, result_at, name = self._function, self._result, self._result_at, self._name
        kept = (block, tuple(args))  # what the pointers point to

        def call(*given: Any, _kept: Any = kept) -> Any:
            for (put, at), value in zip(puts, given, strict=True):
                put(block, at, value)
            if function(pointer):
                raise WhichroadError(f"the kernel {name} failed; this is a bug")
            return result(block, result_at)

        return call


def _format(layout: Layout) -> str:
    """Type of each word, as `struct` names it."""
    return "".join(
        "q" * leaf.words if isinstance(leaf.kind, Array) else NUMBERS[leaf.kind]
        for leaf in layout.leaves()
    )


def _flatten(name: str, kind: Kind, value: Any, into: list[Any]) -> None:
    """The words of a value, checked: a wrong array would be a wrong pointer."""
    if isinstance(kind, Array):
        about = value.__array_interface__
        if (
            value.dtype != kind.dtype or value.ndim != kind.ndim or about["strides"] is not None
        ):
            raise TypeError(
                f"{name}: an array of {value.dtype} and shape {value.shape}, strides "
                f"{value.strides}; {kind.ndim} dimensions of {kind.dtype} in C order expected"
            )
        into.append(about["data"][0])
        into.extend(about["shape"])
    elif isinstance(kind, Fields):
        for part, one, v in zip(kind.names, kind.types, value, strict=True):
            _flatten(part, one, v, into)
    else:
        into.append(value)


def _result_of(kind: Kind | None, words: str) -> Callable[[Any, int], Any]:
    if kind is None:
        return lambda block, at: None
    unpack = struct.Struct(words).unpack_from
    if kind is bool:
        return lambda block, at: bool(unpack(block, at)[0])
    if isinstance(kind, Fields):
        make = kind.make
        return lambda block, at: make(*unpack(block, at))
    return lambda block, at: unpack(block, at)[0]


@functools.cache
def _loaded() -> ctypes.CDLL:
    import os
    return ctypes.CDLL(os.environ["WHICHROAD_LIBRARY"])


def call_of(layout: Layout) -> Call:
    """An entry of the library, once it is known to fit."""
    function = getattr(_loaded(), f"whichroad_{layout.name}")
    function.restype = ctypes.c_int32
    return Call(layout, function)


def way(asked: str) -> str:
    return "native"
