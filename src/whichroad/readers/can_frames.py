"""CAN frames of a log: candump text by our own parser, other formats by python-can."""

import re
from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import ReadError, SettingError, comes_with
from ..observations import Array
from . import mf4
from .blf import check_blf
from .checks import Skipped, counted_warnings, read_bytes

_COMPACT = re.compile(
    rb"^[ \t]*\((\d+\.\d+)\)[ \t]+\S+[ \t]+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})"
    rb"#(?:#[0-9A-Fa-f])?([0-9A-Fa-f]*|R\d*)(?:[ \t]+[RT])?[ \t]*\r?$",
    re.MULTILINE,
)
_SPACED = re.compile(
    rb"^[ \t]*\((\d+\.\d+)\)[ \t]+\S+[ \t]+(?:[RT]X[ \t]+\S+[ \t]+\S+[ \t]+)?"
    rb"([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})[ \t]+\[\d+\][ \t]*((?:[0-9A-Fa-f]{2}[ \t]*)*)\r?$",
    re.MULTILINE,
)
EXTENDED = 1 << 31  # marks ids of 29 bits in `key`
_ERROR = 0x20000000  # candump's flag of an error frame
_BY_LIBRARY = {  # suffix -> python-can's class and the mode it wants
    ".blf": ("BLFReader", "rb"),
    ".mf4": ("MF4Reader", "rb"),  # in a process of its own
    ".asc": ("ASCReader", "r"),
    ".trc": ("TRCReader", "r"),
    ".csv": ("CSVReader", "r"),
}


Names = Callable[[int], int | None]  # an id -> that under which its frames are kept, or none


class Frames(NamedTuple):
    """Frames of one id, in the order of the log."""

    time: Array  # (n,) s since 1970 UTC
    data: NDArray[np.uint8]  # (n, most bytes), zeros beyond `length`
    length: NDArray[np.int64]  # (n,) bytes that came


def key(identifier: int, extended: bool) -> int:
    """One number for an id and whether it has 29 bits."""
    return identifier | EXTENDED if extended else identifier


def read_frames(
    path: str | PathLike[str], wanted: set[int] | Names, skipped: Skipped
) -> dict[int, Frames]:
    """The frames with the wanted ids.

    Args:
        path: candump text (compact or spaced), or anything python-can reads.
        wanted: Ids as `key` makes them, or what gives each id the one to keep it under.
        skipped: Where to count lines that are no frames, remote and error frames.

    Returns:
        Id -> frames; ids that never came are absent.

    Raises:
        ReadError: The file cannot be read or holds no frame.
    """
    names = {k: k for k in wanted}.get if isinstance(wanted, set) else wanted
    if Path(path).suffix.lower() in _BY_LIBRARY:
        found = _by_library(path, names, skipped)
    else:
        found = _candump(path, names, skipped)
    return {k: _columns(rows) for k, rows in found.items()}


Rows = list[tuple[float, bytes]]


def _candump(path: str | PathLike[str], names: Names, skipped: Skipped) -> dict[int, Rows]:
    content = read_bytes(path)
    frames = _COMPACT.findall(content) or _SPACED.findall(content)
    if not frames:
        raise ReadError(
            f"{Path(path).name}: no CAN frame in it; lines like "
            "(1690000000.123456) can0 123#AABB were expected"
        )
    lines = content.count(b"\n") + (not content.endswith(b"\n"))
    blank = len(re.findall(rb"^[ \t]*\r?$", content, re.MULTILINE)) - content.endswith(b"\n")
    if lines - blank > len(frames):
        skipped["not a CAN frame"] += lines - blank - len(frames)
    found: dict[int, Rows] = {}
    for time, name, data in frames:
        identifier = int(name, 16)
        if data[:1] == b"R":
            skipped["remote frame"] += 1
            continue
        extended = len(name) == 8
        if extended and identifier & _ERROR:
            skipped["error frame"] += 1
            continue
        if (k := names(key(identifier, extended))) is not None:
            text = data.replace(b" ", b"").replace(b"\t", b"")
            if len(text) % 2:
                skipped["frame cut short"] += 1
                continue
            found.setdefault(k, []).append((float(time), bytes.fromhex(text.decode())))
    return found


def _by_library(path: str | PathLike[str], names: Names, skipped: Skipped) -> dict[int, Rows]:
    found: dict[int, Rows] = {}
    count = 0
    try:
        with counted_warnings("can", "part of the log not understood", skipped):
            if Path(path).suffix.lower() == ".mf4":
                messages = mf4.messages(Path(path), skipped)
            else:
                messages = _messages(path)
            for time, identifier, extended, data, is_data in messages:
                count += 1
                if not is_data:
                    skipped["remote or error frame"] += 1
                elif (k := names(key(identifier, extended))) is not None:
                    found.setdefault(k, []).append((time, data))
    except (ReadError, SettingError):
        raise
    except Exception as error:  # python-can lets out whatever its parsers meet
        raise ReadError(
            f"{Path(path).name}: frame {count + 1} cannot be read ({type(error).__name__}: "
            f"{error}); a CAN log was expected"
        ) from None
    if not count:
        raise ReadError(f"{Path(path).name}: no CAN frame in it; a CAN log was expected")
    return found


def _messages(path: str | PathLike[str]) -> Iterator[mf4.Message]:
    suffix = Path(path).suffix.lower()
    with comes_with("can", f"{Path(path).name}: this format"):
        import can

    reader, mode = _BY_LIBRARY[suffix]
    if suffix == ".blf":
        check_blf(read_bytes(path), Path(path).name)
    more = {"relative_timestamp": False} if suffix == ".asc" else {}
    text = mode == "r"
    # opened here: python-can leaves a file open whose header it does not understand
    with Path(path).open(
        mode, errors="replace" if text else None, encoding="utf-8" if text else None
    ) as file:
        for m in getattr(can, reader)(file, **more):
            is_data = not (m.is_remote_frame or m.is_error_frame)
            yield m.timestamp, m.arbitration_id, m.is_extended_id, bytes(m.data), is_data


def _columns(rows: Rows) -> Frames:
    length = np.array([len(d) for _, d in rows], np.int64)
    width = max(int(length.max()), 8)
    padded = b"".join(d.ljust(width, b"\0") for _, d in rows)
    data = np.frombuffer(padded, np.uint8).reshape(len(rows), width)
    return Frames(np.array([t for t, _ in rows]), data, length)
