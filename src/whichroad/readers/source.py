"""One file of a drive: its name and its bytes, unpacked, wherever they come from."""

import bz2
import gzip
import io
import lzma
import sys
import zipfile
import zlib
from dataclasses import dataclass
from os import PathLike
from pathlib import Path, PurePath
from typing import Any

from ..errors import ReadError
from .checks import cannot_be_read

STDIN = "-"
_PACKED = (  # first bytes, suffix, and what unpacks them
    (b"\x1f\x8b", ".gz", gzip.decompress),
    (b"BZh", ".bz2", bz2.decompress),
    (b"\xfd7zXZ\x00", ".xz", lzma.decompress),
)
_ZIP = b"PK\x03\x04"
_SPREADSHEET = "[Content_Types].xml"  # member of every file of Excel


@dataclass(frozen=True, slots=True)
class Source:
    """A file of a drive."""

    name: str  # in messages
    path: str  # in `Drive.sources`
    data: bytes

    @property
    def stem(self) -> str:
        """The drive's name, where the file gives none."""
        return PurePath(self.name).stem or self.name

    @property
    def suffix(self) -> str:
        """What the name ends with, in lower case, without that of a packer."""
        return PurePath(self.name).suffix.lower()

    @classmethod
    def of(cls, file: Any) -> "Source":
        """A source of itself, a path, `-` (standard input) or an open file.

        Raises:
            ReadError: It cannot be read or unpacked; the message gives the reason.
        """
        if isinstance(file, Source):
            return file
        path = str(getattr(file, "name", "open file")) if hasattr(file, "read") else str(file)
        name = "standard input" if path == STDIN else PurePath(path).name or path
        try:
            if hasattr(file, "read"):
                data = file.read()
            elif path == STDIN:
                data = sys.stdin.buffer.read()
            else:
                data = Path(path).read_bytes()
        except (OSError, ValueError) as error:
            raise ReadError(cannot_be_read(path, error)) from None
        return unpacked(cls(name, path, data.encode() if isinstance(data, str) else data))


def is_file(thing: Any) -> bool:
    """Whether something is the path of a file, or an open one."""
    return isinstance(thing, str | PathLike) or is_file_object(thing)


def is_file_object(thing: Any) -> bool:
    """Whether something is an open file."""
    return hasattr(thing, "read") and not isinstance(thing, PathLike)


def unpacked(source: Source) -> Source:
    """The source itself, or what is packed in it.

    Raises:
        ReadError: It is damaged.
    """
    name, data = source.name, source.data
    for mark, suffix, unpack in _PACKED:
        if data.startswith(mark):
            try:
                inner = unpack(data)
            except (OSError, EOFError, ValueError, zlib.error, lzma.LZMAError) as error:
                raise ReadError(
                    f"{name}: compressed, and cannot be unpacked ({_reason(error)}); unpack it "
                    "yourself, or write it again"
                ) from None
            shorter = name[: -len(suffix)] if name.lower().endswith(suffix) else name
            return Source(shorter, source.path, inner)
    return _unzipped(source) if data.startswith(_ZIP) else source


def _unzipped(source: Source) -> Source:
    """The only file of an archive, or the document of a .kmz; else the archive."""
    try:
        with zipfile.ZipFile(io.BytesIO(source.data)) as archive:
            members = [m for m in archive.namelist() if not m.endswith("/")]
            documents = [m for m in members if m.lower().endswith(".kml")]
            if _SPREADSHEET in members or len(documents or members) != 1:
                return source
            (member,) = documents or members
            return Source(PurePath(member).name, source.path, archive.read(member))
    except (OSError, ValueError, EOFError, zlib.error, RuntimeError, NotImplementedError,
            zipfile.BadZipFile):  # fmt: skip
        return source


def _reason(error: Exception) -> str:
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return str(text).splitlines()[0]
