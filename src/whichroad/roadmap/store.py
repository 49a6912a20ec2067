"""A compiled map as one file: a header, then arrays that are mapped into memory.

The mapping is copy-on-write: processes share its pages, the file never changes, and the
arrays have the same type for the compiled kernels as those of a map just built (read-only
ones would have every kernel compiled a second time).

    bytes 0-31   magic, version, header's length and checksum, file's length
    header       JSON: what the map is, and each array's type, shape, place and checksum
    arrays       little-endian, each at a multiple of 64 bytes
"""

import hashlib
import json
import math
import mmap
import os
import struct
import tempfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MapError, refused
from ..graph.network import EDGE, SEGMENT, TURN, VERTEX
from . import checked
from .shelf import release

MAGIC = b"WHICHROAD"
VERSION = 6
_FIXED = struct.Struct("<9s3xIIIQ")  # magic, version, header's length and checksum, file's length
_ALIGN = 64
_NUMBERS = ("<f8", "<f4", "<i8", "<i4", "|i1", "|u1")

Arrays = dict[str, NDArray[Any]]


def _kind(dtype: np.dtype[Any]) -> Any:
    """A type as JSON can hold it: of records their fields, gaps between them included."""
    return dtype.str if dtype.names is None else [list(field) for field in dtype.descr]


_RECORDS = {json.dumps(_kind(dtype)): dtype for dtype in (VERTEX, EDGE, TURN, SEGMENT)}


def _aligned(place: int) -> int:
    return -(-place // _ALIGN) * _ALIGN


def described(arrays: Arrays) -> tuple[dict[str, Any], list[tuple[int, NDArray[Any]]], int]:
    """Of each array its type, shape, place and checksum; their places and bytes; where all end."""
    table: dict[str, Any] = {}
    data: list[tuple[int, NDArray[Any]]] = []
    place = 0
    for name, array in arrays.items():
        little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
        table[name] = [_kind(little.dtype), list(little.shape), place, zlib.crc32(_bytes(little))]
        release(little)
        data.append((place, little))
        place = _aligned(place + little.nbytes)
    return table, data, place


def write(path: Path, about: dict[str, Any], arrays: Arrays) -> None:
    """Write a map; the file is there as a whole or not at all.

    Args:
        path: Where to; an existing file is replaced.
        about: Description of the map, as JSON can hold it.
        arrays: By name.

    Raises:
        WriteError: The file cannot be written.
    """
    table, data, place = described(arrays)
    header = json.dumps({"about": about, "arrays": table}).encode()
    start = _aligned(_FIXED.size + len(header))
    fixed = _FIXED.pack(MAGIC, VERSION, len(header), zlib.crc32(header), start + place)
    temporary = None
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=path.name, delete=False) as f:
            temporary = f.name
            f.write(fixed + header)
            for offset, little in data:
                f.seek(start + offset)
                f.write(_bytes(little))
                release(little)
            f.truncate(start + place)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        else_ = "a folder that can be written was expected; choose another"
        raise refused(path, error, else_) from error


def _bytes(array: NDArray[Any]) -> Any:
    """The memory of an array."""
    return array.view(np.uint8).data if array.dtype.names else array.data


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def read(path: Path, *, check: bool | None = None) -> tuple[dict[str, Any], Arrays, str]:
    """Open a map: its arrays are views of the file.

    Header, version and length are checked each time, the sums of the arrays when a file is
    new: by path, size, times of change and inode (`checked`).

    Args:
        path: A file that `write` made.
        check: Whether the arrays are checked; None: where this was not done before.

    Returns:
        The description, the arrays, and the map's fingerprint.

    Raises:
        MapError: It cannot be read, is another kind of file, of another version, cut short
            or damaged.
    """
    mark = checked.stamp(path)
    full = not checked.was_checked(mark, VERSION) if check is None else check
    try:
        with path.open("rb") as f:
            size = os.fstat(f.fileno()).st_size
            if size == 0:
                raise MapError(_refusal(path, "it is empty"))
            memory = mmap.mmap(f.fileno(), 0, access=mmap.ACCESS_COPY)
    except OSError as error:
        raise MapError(
            f"{path}: {error.strerror}; a compiled map was expected; check the name"
        ) from error
    header, start = _header(path, memory)
    try:
        arrays = {
            name: _array(path, memory, start, name, entry, full)
            for name, entry in header["arrays"].items()
        }
        about, print_ = header["about"], fingerprint_of(header["about"], header["arrays"])
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise MapError(_refusal(path, "its header is of another kind")) from error
    if full and mark == checked.stamp(path):
        checked.remember(mark, VERSION)
    return about, arrays, print_


def fingerprint_of(about: dict[str, Any], table: dict[str, Any]) -> str:
    """What tells maps apart: equal where all arrays and the plane are, whatever the file's name.

    Args:
        about: The description.
        table: By name, each array's type, shape, place and checksum.
    """
    plane = {name: value for name, value in about.items() if name != "about"}
    arrays = {name: [kind, shape, crc] for name, (kind, shape, _, crc) in table.items()}
    text = json.dumps([VERSION, plane, arrays], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def is_compiled(path: Path) -> bool:
    """Whether a file begins as a compiled map does."""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def _refusal(path: Path, seen: str) -> str:
    return (
        f"{path}: {seen}; a compiled map was expected; make it by `whichroad map build`, or read "
        "roads by RoadMap.from_osm or RoadMap.from_edges"
    )


def _header(path: Path, memory: mmap.mmap) -> tuple[dict[str, Any], int]:
    """The header, and where the arrays begin."""
    if memory[: len(MAGIC)] != MAGIC:
        raise MapError(_refusal(path, "it does not begin like a compiled map"))
    if len(memory) < _FIXED.size:
        raise MapError(_refusal(path, f"it ends after {len(memory)} bytes"))
    _, version, length, checksum, size = _FIXED.unpack_from(memory)
    if version != VERSION:
        raise MapError(
            f"{path}: it is of version {version}; version {VERSION} was expected; "
            "make it anew by `whichroad map build`"
        )
    if len(memory) != size:
        raise MapError(
            f"{path}: it has {len(memory)} bytes; {size} were expected; "
            "it was cut short or changed: make it anew by `whichroad map build`"
        )
    text = memory[_FIXED.size : _FIXED.size + length]
    if zlib.crc32(text) != checksum:
        raise MapError(_refusal(path, "its header is damaged"))
    try:
        header: dict[str, Any] = json.loads(text)
    except ValueError as error:
        raise MapError(_refusal(path, "its header cannot be understood")) from error
    return header, _aligned(_FIXED.size + length)


def _array(
    path: Path, memory: mmap.mmap, start: int, name: str, entry: list[Any], full: bool
) -> NDArray[Any]:
    """One array, its place checked; `full`: and its bytes."""
    kind, shape, place, checksum = entry
    dtype = _RECORDS.get(json.dumps(kind))
    if dtype is None:
        if kind not in _NUMBERS:
            raise MapError(_refusal(path, f"its array {name} has the type {kind}"))
        dtype = np.dtype(kind)
    count = math.prod(shape)
    if start + place + count * dtype.itemsize > len(memory):
        raise MapError(_refusal(path, f"its array {name} ends beyond the file"))
    array = np.frombuffer(memory, dtype=dtype, count=count, offset=start + place).reshape(shape)
    if full and zlib.crc32(_bytes(array)) != checksum:
        raise MapError(_refusal(path, f"its array {name} is damaged"))
    return array.view(np.recarray) if dtype.names else array
