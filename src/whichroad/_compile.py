"""The decorators of kernels, and which of three ways runs them.

A kernel is a plain function over numbers, arrays, records and named tuples of these.  Called
from Python it runs as Python, so that debuggers and coverage see it.  An *entry* is a kernel
that Python code calls: it runs compiled.  `WHICHROAD_KERNELS` says how:

    native  by the library that was built ahead of time (`whichroad.native`); the usual way
    jit     compiled by numba when first called: for developers, and platforms without a library
    python  as plain Python, which is a hundred times slower; so does NUMBA_DISABLE_JIT=1

Without the variable: native where there is a library or one can be built, else jit.
"""

import functools
import importlib
import inspect
import os
import sys
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Generic, ParamSpec, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from .native.layout import Array as Array
from .native.layout import Layout

if TYPE_CHECKING:
    from .native import library

Vector = Annotated[NDArray[np.float64], Array(np.dtype("f8"), 1)]
Matrix = Annotated[NDArray[np.float64], Array(np.dtype("f8"), 2)]
Cube = Annotated[NDArray[np.float64], Array(np.dtype("f8"), 3)]
Ints = Annotated[NDArray[np.int64], Array(np.dtype("i8"), 1)]
Ints32 = Annotated[NDArray[np.int32], Array(np.dtype("i4"), 1)]
Bytes = Annotated[NDArray[np.uint8], Array(np.dtype("u1"), 1)]
Records = Any  # np.recarray of one of the structured dtypes; annotated with which, where it matters
Record = Any  # one row of it

P = ParamSpec("P")
R = TypeVar("R")

_KERNELS: list[tuple[Callable[..., Any], bool]] = []  # every kernel, and whether it is inlined
_ENTRIES: "dict[str, Entry[..., Any]]" = {}
_TEACHERS: list[tuple[str, str]] = []  # who teaches numba which module, when numba is used
_TAUGHT: list[str] = []  # these modules
_LOCK = threading.RLock()


@overload
def kernel(function: Callable[P, R]) -> Callable[P, R]: ...
@overload
def kernel(*, inline: bool) -> Callable[[Callable[P, R]], Callable[P, R]]: ...
def kernel(function: Any = None, *, inline: bool = False) -> Any:
    """A function that can be compiled, and runs as Python when Python calls it.

    Divisions follow NumPy (no exception), and nothing is reordered (no fastmath: log-weights
    may be infinite).  A kernel allocates nothing, so its arrays need no reference counts.

    Args:
        function: The kernel.
        inline: Whether it becomes part of its callers: for hot code with one caller.
    """
    if function is None:
        return lambda one: _known(one, inline)
    return _known(function, inline)


def _known(function: Callable[P, R], inlined: bool) -> Callable[P, R]:
    with _LOCK:
        _KERNELS.append((function, inlined))
        if _jit_is_on():
            _teach(function, inlined)
    return function


class Entry(Generic[P, R]):
    """A kernel that Python code calls: by the library, by numba, or as it is."""

    def __init__(self, function: Callable[P, R], ahead: bool = True) -> None:
        functools.update_wrapper(self, function)
        self._ahead = ahead  # of time: the library holds it
        self.function = function
        self._run: Callable[..., R] = self._first

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        if kwargs:
            return self._run(*self._signature.bind(*args, **kwargs).args)
        return self._run(*args)

    def bind(self, *args: Any) -> Callable[..., R]:
        """The same call over and over: pointers are taken once.

        Args:
            args: As the kernel takes them; `...` for numbers that each call will give.

        Returns:
            A function of those numbers, in the order of the arguments.  It holds the arrays,
            and is for one thread at a time.
        """
        if kernel_mode() == "native" and self._ahead:
            return self._native.bind(args)
        free = [k for k, arg in enumerate(args) if arg is ...]
        values = list(args)

        def call(*given: Any) -> R:
            for k, value in zip(free, given, strict=True):
                values[k] = value
            return self._run(*values)

        return call

    @functools.cached_property
    def layout(self) -> Layout:
        """What C sees of its arguments and its result."""
        return Layout.of(self.function)

    @functools.cached_property
    def _native(self) -> "library.Call":
        """It in the library, once its layout was compared: that takes as long as a short drive."""
        from .native import library

        return library.call_of(self.layout)

    @functools.cached_property
    def _signature(self) -> inspect.Signature:
        return inspect.signature(self.function)

    def _first(self, *args: Any) -> R:
        """Find out how to run, when called for the first time."""
        with _LOCK:
            mode = kernel_mode() if self._ahead or kernel_mode() == "python" else "jit"
            run: Callable[..., R] = np.errstate(all="ignore")(self.function)  # as compiled code
            if mode == "native":
                run = self._native
            elif mode == "jit":
                run = jit(self.function)
            self._run = run
        return run(*args)

    @property
    def _numba_type_(self) -> Any:
        """What numba takes it for, where another kernel calls it."""
        return _teach(self.function, False)


def entry(function: Callable[P, R]) -> Entry[P, R]:
    """A kernel that Python code calls, compiled.

    Its annotations are the types it is compiled for: `int`, `float`, `bool`, arrays of this
    module, NamedTuples of these.  Arrays are in C order.
    """
    made = Entry(_known(function, False))
    name = function.__name__.strip("_")
    known = _ENTRIES.get(name)
    if known is not None and known.function.__module__ != function.__module__:
        raise TypeError(f"two entries are called {name}: one name each was expected")
    _ENTRIES[name] = made
    return made


def by_numba(function: Callable[P, R]) -> Entry[P, R]:
    """A kernel outside of the core, for developers: compiled by numba, never ahead of time."""
    return Entry(_known(function, False), ahead=False)


def entries() -> "dict[str, Entry[..., Any]]":
    """All entries by name, as far as their modules are imported."""
    return dict(_ENTRIES)


def kernels() -> list[tuple[Callable[..., Any], bool]]:
    """All kernels, as far as their modules are imported, and whether each is inlined."""
    return list(_KERNELS)


def operations() -> list[Callable[..., Any]]:
    """The functions of modules that compilers are taught, see `lowered_by`."""
    return [
        one for name in _TAUGHT for one in vars(sys.modules[name]).values()
        if inspect.isfunction(one) and one.__module__ == name
    ]  # fmt: skip


@functools.cache
def kernel_mode() -> str:
    """How entries run: "native", "jit" or "python"."""
    requested = os.environ.get("WHICHROAD_KERNELS", "")
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in {"", "0"}:
        requested = "python"
    if requested in {"python", "jit"}:
        return requested
    from .native import library

    return library.kernel_mode(requested)


# numba, where it is asked for


def lowered_by(teacher: str, module: str) -> None:
    """Say which module's `teach` tells numba what it cannot compile of a module by itself."""
    with _LOCK:
        _TAUGHT.append(module)
        _TEACHERS.append((teacher, module))
        if _jit_is_on():
            _import_teachers()


def _import_teachers() -> None:
    while _TEACHERS:
        teacher, module = _TEACHERS.pop()
        importlib.import_module(teacher).teach(importlib.import_module(module))


def _jit_is_on() -> bool:
    return _is_taught


_is_taught = False
OPTIONS: dict[str, Any] = {  # of `numba.njit`, for kernels that kernels call
    "error_model": "numpy", "nogil": True, "_nrt": False,
    "no_cpython_wrapper": True, "no_cfunc_wrapper": True,
}  # fmt: skip


def teach_numba() -> None:
    """Make every kernel, also those to come, one that numba can compile."""
    global _is_taught
    with _LOCK:
        if not _is_taught:
            _is_taught = True
            for function, inlined in _KERNELS:
                _teach(function, inlined)
            _import_teachers()


def _teach(function: Any, inlined: bool) -> Any:
    """Give a kernel the mark by which numba finds its dispatcher."""
    with _LOCK:
        if not hasattr(function, "_numba_type_"):
            import numba

            made = numba.njit(forceinline=inlined, **OPTIONS)(function)
            function._dispatcher = made  # its type holds it weakly
            function._numba_type_ = made._numba_type_
        return function._numba_type_


def jit(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel compiled by numba as Python calls it, for those who call one that is no entry.

    What it calls is part of its machine code, so this alone is kept.  numba takes the cache folder
    from its settings when the dispatcher is made, and keeps machine code beside the sources
    otherwise, where it outlives a change of a callee.
    """
    import numba

    from .native.cache import jit_folder

    with _LOCK:
        teach_numba()
        folder = jit_folder()
        config: Any = numba.config  # its attributes are made at run time
        before = config.CACHE_DIR
        if folder is not None:
            config.CACHE_DIR = str(folder)
        try:
            options = OPTIONS | {"no_cpython_wrapper": False, "cache": folder is not None}
            return numba.njit(**options)(function)  # type: ignore[no-any-return]
        finally:
            config.CACHE_DIR = before
