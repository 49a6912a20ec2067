"""The one compile decorator, and the array types of the kernels."""

import contextlib
import functools
import hashlib
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast, overload

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]
Floats32 = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Records = Any  # np.recarray of one of the structured dtypes
Record = Any  # one row of it

F = TypeVar("F", bound=Callable[..., Any])

_LOCK = threading.RLock()
_KEEP_DAYS = 30
_PACKAGE = Path(__file__).parent


def digest(folder: Path = _PACKAGE) -> str:
    """Digest of every kernel file: what the compiled code depends on."""
    files = [folder / "_compile.py", folder / "roadmap" / "topology.py"]
    for name in ("filter", "graph", "geodesy"):
        files += sorted((folder / name).glob("*.py"))
    return hashlib.sha256(b"\0".join(f.name.encode() + f.read_bytes() for f in files)).hexdigest()


def _writable(base: Path) -> bool:
    try:
        base.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=base):
            return True
    except OSError:
        return False


@functools.cache
def cache_folder() -> Path | None:
    """First writable place for compiled kernels, or None: compile anew each time."""
    bases = [os.environ.get("WHICHROAD_CACHE_DIR"), _config().CACHE_DIR]
    xdg = os.environ.get("XDG_CACHE_HOME")
    bases.append(f"{xdg}/whichroad" if xdg else None)
    with contextlib.suppress(RuntimeError):
        bases.append(str(Path.home() / ".cache" / "whichroad"))
    bases.append(str(Path(tempfile.gettempdir()) / f"whichroad-{getattr(os, 'getuid', int)()}"))
    for base in bases:
        if base and _writable(Path(base)):
            root = Path(base) / "kernels"
            folder = root / digest()[:24]
            if not _writable(folder):
                return None
            with contextlib.suppress(OSError):
                os.utime(folder)  # its age counts from its last use
            _delete_stale(root)
            return folder
    return None


def _delete_stale(root: Path) -> None:
    """Delete kernels of versions that nobody has used for a month."""
    limit = time.time() - _KEEP_DAYS * 86400.0
    with contextlib.suppress(OSError):
        for folder in root.iterdir():
            if folder.is_dir() and folder.stat().st_mtime < limit:
                shutil.rmtree(folder, ignore_errors=True)


def _config() -> Any:
    """Numba's settings, attributes made at run time."""
    from numba import config

    return config


class _Kernel:
    """A kernel that numba hears of when it is first called, or a kernel that calls it compiled.

    So importing, opening a map and building one need no compiler: numba alone is 70 MiB.
    """

    def __init__(self, function: Callable[..., Any], inlined: bool) -> None:
        functools.update_wrapper(self, function)
        self._made_of = function, inlined

    def __call__(self, *args: Any) -> Any:
        return self._dispatcher(*args)

    def __getattr__(self, name: str) -> Any:
        if name == "_dispatcher":
            with _LOCK:  # two threads must not make two, which would compile apart
                if name not in self.__dict__:
                    self._dispatcher = _compile(*self._made_of)
                return self.__dict__[name]
        if name.startswith("__"):  # asked by copy and pickle before there is anything
            raise AttributeError(name)
        return getattr(self._dispatcher, name)  # `_numba_type_`: what numba takes this for


def _compile(function: Callable[..., Any], inlined: bool) -> Any:
    import numba

    njit: Any = numba.njit  # `_nrt` is not in its public signature
    config, folder = _config(), cache_folder()
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder) if folder else before
    try:
        return njit(
            cache=folder is not None, nogil=True, error_model="numpy", _nrt=False,
            forceinline=inlined,
        )(function)  # fmt: skip
    finally:
        config.CACHE_DIR = before


@overload
def kernel(function: F) -> F: ...
@overload
def kernel(*, inline: bool) -> Callable[[F], F]: ...
def kernel(function: F | None = None, *, inline: bool = False) -> Any:
    """Compile a function of numbers, arrays, records and tuples of these.

    Divisions follow NumPy (no exception), the interpreter lock is released, and nothing is
    reordered (no fastmath: log-weights may be infinite).  A kernel allocates nothing.

    Args:
        function: The kernel.
        inline: Whether it becomes part of its callers: for hot code with one caller.
    """
    if function is None:
        return lambda f: cast(Any, _Kernel(f, inlined=inline))
    return _Kernel(function, inlined=inline)


class _Intrinsic:
    """A function that is generated code when compiled, and itself in plain Python."""

    def __init__(self, function: Callable[..., Any], lower: Callable[[], Any]) -> None:
        functools.update_wrapper(self, function)
        self._function, self._lower = function, lower

    def __call__(self, *args: Any) -> Any:
        return self._function(*args)

    def __getattr__(self, name: str) -> Any:
        if name == "_generated":
            with _LOCK:
                if name not in self.__dict__:
                    from numba.extending import intrinsic as make

                    self._generated = cast(Any, make)(self._lower())
                return self.__dict__[name]
        if name == "_numba_type_":  # what numba takes this for
            from numba.core.typing import templates

            known = cast(Any, templates).builtin_registry.globals
            return next(kind for value, kind in known if value is self._generated)
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._generated, name)


def intrinsic(lower: Callable[[], Any]) -> Callable[[Any], Any]:
    """Give a plain function its generated code: `lower` makes what numba's intrinsic takes."""
    return lambda function: _Intrinsic(function, lower)
