"""Which files of maps were checked in full, and maps that a process opened: both by their stamp.

A stamp is path, size, times of change and inode.  A map whose bytes change has another one: the
time of the inode's change cannot be set.  A file that changed a moment ago is not remembered,
for two changes within a tick of the clock may leave the same times.
"""

import contextlib
import hashlib
import os
import threading
import time
from collections import OrderedDict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..native.cache import cache_folder

if TYPE_CHECKING:
    from .roadmap import RoadMap

SETTLED = 2.0  # s since the last change of a file, after which its times tell changes
_KEEP = 30 * 86400.0  # s after which a file is checked again
_OPEN = 4  # maps that a process keeps open

_here: set[str] = set()  # stamps that this process has checked
_opened: "OrderedDict[tuple[str, str], RoadMap]" = OrderedDict()  # by stamp and system
_lock = threading.Lock()


def stamp(path: Path) -> str | None:
    """What tells a file from what it was before; None: it cannot be seen, or changed just now."""
    try:
        there = path.stat()
        name = str(path.resolve())
    except OSError:
        return None
    if time.time() - max(there.st_mtime, there.st_ctime) < SETTLED:
        return None
    parts = (name, there.st_dev, there.st_ino, there.st_size, there.st_mtime_ns, there.st_ctime_ns)
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


def was_checked(mark: str | None, version: int) -> bool:
    """Whether a file of this stamp was found whole, here or in the cache, within a month."""
    if mark is None:
        return False
    if mark in _here:
        return True
    folder = _folder()
    if folder is None:
        return False
    with contextlib.suppress(OSError):
        if time.time() - (folder / f"{mark}-{version}").stat().st_mtime < _KEEP:
            _here.add(mark)
            return True
    return False


def remember(mark: str | None, version: int) -> None:
    """Keep that a file of this stamp is whole."""
    if mark is None:
        return
    _here.add(mark)
    folder = _folder()
    if folder is not None:
        with contextlib.suppress(OSError):
            (folder / f"{mark}-{version}").write_bytes(b"")
            _delete_stale(folder)


def _folder() -> Path | None:
    """Where checked files are remembered."""
    kernels = cache_folder()
    if kernels is None:
        return None
    folder = kernels.parent / "maps"
    try:
        folder.mkdir(exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def _delete_stale(folder: Path) -> None:
    limit = time.time() - _KEEP
    for path in folder.iterdir():
        if path.stat().st_mtime < limit:
            path.unlink(missing_ok=True)


def shared_map(roads: Any, crs: Any = None) -> "RoadMap":
    """A map that this process opens once: `open_map`, and files by their stamp.

    The result is shared by all who ask; nobody may write to its arrays.

    Args:
        roads: As `open_map` takes it.
        crs: Likewise.

    Raises:
        MapError: It is no map, nor the path of one.
    """
    from .open_map import open_map

    if not isinstance(roads, str | Path):
        return open_map(roads, crs=crs)
    mark = stamp(Path(roads))
    key = mark or "", str(crs)
    with _lock:
        if key in _opened:
            _opened.move_to_end(key)
            return _opened[key]
        opened = open_map(roads, crs=crs)
        if mark is not None and mark == stamp(Path(roads)):
            _opened[key] = opened
            while len(_opened) > _OPEN:
                _opened.popitem(last=False)
        return opened
