"""Large arrays on disk while a map is built, so that memory holds what is worked on.

They are mapped from files without a name, in the system's folder for temporary files.  Their
pages leave this process's memory by `release`, and come back where they are used again.
"""

import mmap
import os
import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._compile import Records

LEAST = 1 << 20  # bytes of an array that is laid on disk


class _Shelved(mmap.mmap):
    """The memory of an array on disk."""


def stored(n: int, dtype: Any) -> NDArray[Any]:
    """Cleared array (n,) on disk, in memory where it is short or the disk has no room."""
    kind = np.dtype(dtype)
    size = n * kind.itemsize
    if size < LEAST or not hasattr(os, "posix_fallocate"):
        return np.zeros(n, kind)
    try:
        with tempfile.TemporaryFile(prefix="whichroad-") as file:
            os.posix_fallocate(file.fileno(), 0, size)
            memory = _Shelved(file.fileno(), size)
    except OSError:
        return np.zeros(n, kind)
    return np.frombuffer(memory, kind)


def table(n: int, dtype: np.dtype[Any]) -> Records:
    """Cleared records as of `stored`, of which fields are attributes."""
    return stored(n, dtype).view(np.recarray)


def laid(array: NDArray[Any]) -> NDArray[Any]:
    """A copy of an array (n,) as of `stored`."""
    copy = stored(len(array), array.dtype)
    copy[...] = array
    release(copy)
    return copy


def joined(parts: list[NDArray[Any]]) -> NDArray[Any]:
    """Arrays one after the other as of `stored`; the list is emptied."""
    whole = stored(sum(map(len, parts)), parts[0].dtype)
    at = 0
    for k, part in enumerate(parts):
        whole[at : at + len(part)] = part
        at += len(part)
        parts[k] = part[:0]
    parts.clear()
    release(whole)
    return whole


def release(*arrays: NDArray[Any]) -> None:
    """Let the pages of arrays on disk leave the memory; what they hold stays."""
    for array in arrays:
        base: Any = array
        while isinstance(base, np.ndarray):
            base = base.base
        base = base.obj if isinstance(base, memoryview) else base
        if isinstance(base, _Shelved) and hasattr(base, "madvise"):
            base.madvise(mmap.MADV_DONTNEED)
