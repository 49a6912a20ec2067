"""BLF logs are read by python-can; here only what it does not survive is refused.

The objects of a BLF log stand one behind the other, each with its size.  python-can goes
on by that size: over an object without one it never comes.
"""

import struct
import zlib
from collections.abc import Iterator

from ..errors import ReadError

_FILE_HEADER = 144  # bytes
_OBJECT = struct.Struct("<4sHHII")  # mark, header's size, version, size, type
_CONTAINER = struct.Struct("<H6xI4x")  # method, size once unpacked
_MARK = b"LOBJ"
_OF_OBJECTS, _DEFLATED = 10, 2
_PADDING = 8  # bytes within which the next object begins


def check_blf(data: bytes, where: str) -> None:
    """Pass over a log's objects.

    Args:
        data: The file.
        where: Its name, for the error.

    Raises:
        ReadError: An object is smaller than its own header.
    """
    stream = b"".join(_containers(data))
    at = 0
    while (at := stream.find(_MARK, at, at + _PADDING)) >= 0 and at + _OBJECT.size <= len(stream):
        size = _OBJECT.unpack_from(stream, at)[3]
        if size < _OBJECT.size:
            raise ReadError(
                f"{where}: an object of {size} bytes in the log; {_OBJECT.size} or more were "
                "expected; is the file damaged?"
            )
        at += size


def _containers(data: bytes) -> Iterator[bytes]:
    """What the containers of a log hold, unpacked."""
    begin = int.from_bytes(data[4:8], "little")
    at = begin if begin >= _FILE_HEADER else len(data)
    while at + _OBJECT.size <= len(data):
        mark, _, _, size, kind = _OBJECT.unpack_from(data, at)
        if mark != _MARK:
            return
        end = at + size if size >= _OBJECT.size else len(data)
        body = data[at + _OBJECT.size : end]
        at = end + size % 4
        if kind == _OF_OBJECTS and len(body) >= _CONTAINER.size:
            packed = body[_CONTAINER.size :]
            deflated = _CONTAINER.unpack_from(body)[0] == _DEFLATED
            yield zlib.decompressobj().decompress(packed) if deflated else packed
