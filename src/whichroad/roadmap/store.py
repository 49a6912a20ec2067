"""A compiled map as one file: a header, then arrays that are mapped into memory.

The mapping is copy-on-write: processes share its pages, the file never changes, and the
arrays have the same type for the compiled kernels as those of a map just built (read-only
ones would have every kernel compiled a second time).

    bytes 0-31   magic, version, header's length and checksum, file's length
    header       JSON: what the map is, and each array's type, shape, place and checksum
    arrays       little-endian, each at a multiple of 64 bytes
"""

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

from ..errors import MapError, WriteError
from ..graph.network import EDGE, SEGMENT, TURN, VERTEX

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


def write(path: Path, about: dict[str, Any], arrays: Arrays) -> None:
    """Write a map; the file is there as a whole or not at all.

    Args:
        path: Where to; an existing file is replaced.
        about: Description of the map, as JSON can hold it.
        arrays: By name.

    Raises:
        WriteError: The file cannot be written.
    """
    table, place = {}, 0
    data = []
    for name, array in arrays.items():
        little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
        table[name] = [_kind(little.dtype), list(little.shape), place, zlib.crc32(_bytes(little))]
        data.append((place, little))
        place = _aligned(place + little.nbytes)
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
            f.truncate(start + place)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise WriteError(
            f"{path}: {error.strerror}; a folder that can be written was expected; choose another"
        ) from error


def _bytes(array: NDArray[Any]) -> Any:
    """The memory of an array."""
    return array.view(np.uint8).data if array.dtype.names else array.data


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def read(path: Path) -> tuple[dict[str, Any], Arrays]:
    """Open a map: its arrays are views of the file.

    Args:
        path: A file that `write` made.

    Returns:
        The description, and the arrays.

    Raises:
        MapError: It cannot be read, is another kind of file, of another version, cut short
            or damaged.
    """
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
            name: _array(path, memory, start, name, entry)
            for name, entry in header["arrays"].items()
        }
        return header["about"], arrays
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise MapError(_refusal(path, "its header is of another kind")) from error


def is_compiled(path: Path) -> bool:
    """Whether a file begins as a compiled map does."""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def _refusal(path: Path, seen: str) -> str:
    return f"{path}: {seen}; a compiled map was expected; make it by `whichroad map build`"


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


def _array(path: Path, memory: mmap.mmap, start: int, name: str, entry: list[Any]) -> NDArray[Any]:
    """One array, checked."""
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
    if zlib.crc32(_bytes(array)) != checksum:
        raise MapError(_refusal(path, f"its array {name} is damaged"))
    return array.view(np.recarray) if dtype.names else array
