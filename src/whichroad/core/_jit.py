"""The one compile decorator, and the array types of the kernels.

Numba stamps a cached kernel with the file of that kernel alone, so a callee that
changed in another file would go on running as it was.  Here the cache folder is
named by a digest of all kernel files: any change recompiles everything.
"""

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
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]
Floats32 = NDArray[np.float32]
Bytes = NDArray[np.uint8]

F = TypeVar("F", bound=Callable[..., Any])

_LOCK = threading.RLock()
_KEEP_DAYS = 30


def digest(folder: Path = Path(__file__).parent) -> str:
    """Digest of every kernel file: what the compiled code depends on."""
    files = sorted(folder.glob("*.py"))
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


def kernel(function: F) -> F:
    """Compile `function` at its first call and remember it until any kernel changes.

    Divisions follow NumPy (no exception), the interpreter lock is released, and
    nothing is reordered (no fastmath: log-weights may be infinite).  A kernel allocates
    nothing, so arrays need no reference counts: the caller holds them.  Counting them
    took three quarters of the filter's time, since a belief and a map are some sixty
    arrays, each counted at each call.
    """
    return cast(F, _Kernel(function, inlined=False))


def part(function: F) -> F:
    """A kernel that becomes a part of those that call it: for what has one caller.

    A map, a belief and the scratch are some hundred arrays of seven numbers, each of which a
    call passes anew: 0.1 to 0.2 µs, more than much of what is called takes.
    """
    return cast(F, _Kernel(function, inlined=True))
