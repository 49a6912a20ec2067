"""The compiled library: found, compared with the package, and called by ctypes."""

import ctypes
import functools
import importlib.util
import struct
import sys
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ..errors import WhichroadError
from . import cache
from .layout import NUMBERS, Array, Fields, Kind, Layout

_dtype_of: Any = np.ndarray.dtype.__get__  # past recarray's own
_shape_of: Any = np.ndarray.shape.__get__  # lookup of names
_MET = 64  # dtypes that are remembered for each array
Put = Callable[[Any, list[Any]], None]
_byte_of, _address_of = ctypes.c_char.from_buffer, ctypes.addressof
_LOCK = threading.RLock()
_FAILED = "the kernel {} failed; this is a bug; please report it"


class LibraryError(WhichroadError):
    """The compiled kernels are not those of this package, or cannot be loaded."""


def packed() -> Path:
    """Where a wheel keeps its library: for any machine of its platform, or better ones."""
    end = cache.suffix(cache.own_target())
    usual = Path(__file__).with_name(f"kernels{end}")
    better = (usual.with_name(f"kernels-{one}{end}") for one in cache.processors())
    return next((path for path in better if path.exists()), usual)


def ready() -> Path | None:
    """The library for this package's kernels, where there is one already."""
    if packed().exists():
        return packed()
    kept = cache.libraries(cache.source_digest(), cache.own_target())
    return kept[0] if kept else None


@functools.cache
def found() -> Path:
    """The library for this package's kernels: the wheel's, a kept one, or built now.

    Raises:
        WhichroadError: There is none, and what is missing to build one.
    """
    from . import progress

    return ready() or progress.build_own()


def kernel_mode(requested: str) -> str:
    """How entries run: "native" where there is a library or can be one, else "jit".

    Args:
        requested: What the user requested for: "native", or nothing.

    Raises:
        WhichroadError: It is neither, and what to install.
    """
    if requested not in {"", "native"}:
        raise LibraryError(
            f"WHICHROAD_KERNELS is {requested!r}; native, jit, python or nothing was expected"
        )
    with _LOCK:
        if ready() is not None:
            return "native"
        from . import build

        missing = build.why_not()
        if missing is None or requested == "native":
            found()  # builds it, or says why not
            return "native"
        if importlib.util.find_spec("numba") is None:
            raise LibraryError(missing)
        sys.stderr.write(f"{missing}; until then numba compiles at each first call\n")
        return "jit"


@functools.cache
def _loaded() -> ctypes.CDLL:
    """The library, once it is known to be of these kernels."""
    path = found()
    library = load(path)
    expected = cache.source_digest()
    source = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(library, "whichroad_source")))
    if source.decode("ascii", "replace") != expected:
        raise LibraryError(
            f"{path}: holds the kernels {source.decode('ascii', 'replace')}; those of this "
            f"package, {expected}, were expected; install whichroad again, or delete that file"
        )
    return library


def load(path: Path) -> ctypes.CDLL:
    """Load a library of kernels, of whichever sources.

    Raises:
        LibraryError: It is none, or is for another machine.
    """
    try:
        library = ctypes.CDLL(str(path))
        ctypes.c_char.in_dll(library, "whichroad_source")
    except (OSError, ValueError) as error:
        raise LibraryError(
            f"{path}: {error}; a library of whichroad's kernels for {cache.own_target()} was "
            "expected; install whichroad again, or delete that file"
        ) from None
    return library


def call_of(layout: Layout, library: ctypes.CDLL | None = None) -> "Call":
    """An entry of the library, once its arguments are known to be laid out alike.

    Args:
        layout: As Python lays them out.
        library: Which; None: the one of this package.

    Raises:
        LibraryError: The library lays them out otherwise, or does not have it.
    """
    with _LOCK:
        library = library or _loaded()
    name = layout.name
    try:
        function = library[f"whichroad_{name}"]
        theirs = ctypes.c_int64.in_dll(library, f"whichroad_layout_{name}").value
    except (AttributeError, ValueError):
        theirs = None
    if theirs != layout.checksum():
        raise LibraryError(
            f"{library._name}: arguments of {name} have the layout {theirs}; "
            f"{layout.checksum()} was expected, which are this package's records; install "
            "whichroad again, or delete that file"
        )
    function.restype = ctypes.c_int32
    return Call(layout, function)


class Call:
    """One entry of the library, called with Python's values."""

    def __init__(self, layout: Layout, function: Any) -> None:
        self._name, self._function = layout.name, function
        self._kinds = list(layout.arguments.items())
        self._puts = [_putter(name, kind) for name, kind in self._kinds]
        leaves = layout.leaves()
        codes = "".join(
            "q" * leaf.words if isinstance(leaf.kind, Array) else NUMBERS[leaf.kind]
            for leaf in leaves
        )
        taken = sum(leaf.words for leaf in leaves if not leaf.is_result)
        self._codes, self._result_at = codes, 8 * taken
        self._pack = struct.Struct(codes[:taken]).pack_into
        self._block = ctypes.c_char * (8 * layout.words)
        self._result = _result_of(layout.result, codes[taken:])

    def __call__(self, *args: Any) -> Any:
        """Call it once: each array is looked at."""
        block = self._block()
        self._pack(block, 0, *self._words(args))
        if self._function(block):
            raise LibraryError(_FAILED.format(self._name))
        return self._result(block, self._result_at)

    def _words(self, args: Sequence[Any]) -> list[Any]:
        if len(args) != len(self._puts):
            raise TypeError(f"{self._name}: {len(args)} arguments; {len(self._puts)} were expected")
        words: list[Any] = []
        for put, arg in zip(self._puts, args, strict=True):
            put(arg, words)
        return words

    def bind(self, args: Sequence[Any]) -> Callable[..., Any]:
        """The call with its pointers taken; `...` where each call will give a number, or several.

        Several are a tuple of nothing but numbers, as the kernel takes it.
        """
        values, at, free = [], 0, []
        for (_, kind), put, arg in zip(self._kinds, self._puts, args, strict=True):
            words: list[Any] = []
            if arg is ... and not isinstance(kind, Array | Fields):
                free.append((struct.Struct(NUMBERS[kind]).pack_into, 8 * at))
                words = [0]
            elif arg is ... and isinstance(kind, Fields):
                free.append((_packer(kind), 8 * at))
                words = [0] * len(kind.types)
            else:
                put(arg, words)
            values += words
            at += len(words)
        block = self._block()
        self._pack(block, 0, *values)
        function, result, result_at = self._function, self._result, self._result_at
        pointer = ctypes.c_void_p(ctypes.addressof(block))
        failed = _FAILED.format(self._name)

        def call(*numbers: Any, kept: Any = tuple(args)) -> Any:  # what is pointed to must live
            for (put, place), number in zip(free, numbers, strict=True):
                put(block, place, number)
            if function(pointer):
                raise LibraryError(failed)
            return result(block, result_at)

        return call


def _packer(kind: Fields) -> Callable[[Any, int, Any], None]:
    """What puts a tuple of numbers at its place in a block."""
    codes = [NUMBERS[one] for one in kind.types if isinstance(one, type)]
    pack = struct.Struct("".join(codes)).pack_into
    return lambda block, place, numbers: pack(block, place, *numbers)


def _putter(name: str, kind: Kind) -> Put:
    """What appends the words of a value, checked: a wrong array would be a wrong pointer."""
    if isinstance(kind, Array):
        return _array_putter(name, kind)
    if not isinstance(kind, Fields):
        return lambda value, words: words.append(value)
    count = len(kind.types)
    if not any(isinstance(one, Array | Fields) for one in kind.types):

        def put_numbers(value: Any, words: list[Any]) -> None:
            if len(value) != count:
                raise TypeError(f"{name}: {len(value)} numbers; {count} were expected")
            words.extend(value)

        return put_numbers
    puts = [_putter(part, one) for part, one in zip(kind.names, kind.types, strict=True)]

    def put_fields(value: Any, words: list[Any]) -> None:
        for put, inner in zip(puts, value, strict=True):
            put(inner, words)

    return put_fields


def _array_putter(name: str, kind: Array) -> Put:
    expected, ndim, alignment = kind.dtype, kind.ndim, kind.dtype.alignment
    known = {id(expected): expected}  # equal ones that were met: comparing fields takes time
    met: dict[int, tuple[Any, tuple[Any, ...]]] = {}  # arrays that live, by id, and their words

    def put(value: Any, words: list[Any]) -> None:
        number = id(value)
        known_words = met.get(number)
        if known_words is not None and known_words[0]() is value:
            words.extend(known_words[1])
            return
        own = words_of(value)
        if ndim:  # a row of an array cannot be watched
            met[number] = weakref.ref(value, lambda _: met.pop(number, None)), own
        words.extend(own)

    def words_of(value: Any) -> tuple[Any, ...]:
        dtype, shape = (_dtype_of(value), _shape_of(value)) if ndim else (value.dtype, value.shape)
        if id(dtype) not in known:
            if dtype != expected:
                refuse(value)
            if len(known) < _MET:
                known[id(dtype)] = dtype
        try:
            address = _address_of(_byte_of(value))
        except ValueError:  # nothing is in it, so that nobody looks
            address = 0
        except TypeError:
            if not value.flags.c_contiguous:
                refuse(value)
            # read-only: an entry writes only to what its docstring says
            address = int(np.asarray(value).ctypes.data)
        if len(shape) != ndim or address % alignment:
            refuse(value)
        return (address, *shape)

    def refuse(value: Any) -> NoReturn:
        raise TypeError(
            f"{name}: an array of {value.dtype} and shape {value.shape}, strides "
            f"{getattr(value, 'strides', None)}; {ndim} dimensions of {expected} in C order were "
            "expected"
        )

    return put


def _result_of(kind: Kind | None, codes: str) -> Callable[[Any, int], Any]:
    """What reads the result from a block."""
    if kind is None:
        return lambda block, at: None
    unpack = struct.Struct(codes).unpack_from
    if kind in {int, float}:
        return lambda block, at: unpack(block, at)[0]
    if isinstance(kind, Fields) and set(kind.types) <= {int, float}:
        make = kind.make if isinstance(kind.make, type) else None
        return (lambda block, at: make(*unpack(block, at))) if make else unpack
    return lambda block, at: _made(kind, iter(unpack(block, at)))


def _made(kind: Kind, words: Iterator[Any]) -> Any:
    """A number or a tuple of them, from words."""
    if isinstance(kind, Fields):
        return kind.make(*(_made(one, words) for one in kind.types))
    return bool(next(words)) if kind is bool else next(words)
