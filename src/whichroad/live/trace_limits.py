"""Limits of a posted trace, checked on its bytes before anything is decoded.

A small body can stand for a large table: a compressed Arrow buffer, or a JSON list of a million
empty lists.  What is counted here bounds the memory of the readers that come after.
"""

import struct
from typing import Any

from ..errors import ReadError

MOST_ROWS = 200_000
MOST_BYTES = 64 * 1024 * 1024  # of an Arrow stream, decompressed
_MOST_COLUMNS = 1000
_MOST_BATCHES = 20_000
_MOST_VALUES = 2_000_000  # of a JSON text: ten columns
_MOST_TAGS = 2_500_000  # of a GPX file: twelve for each point
_MOST_LINES = 5 * MOST_ROWS  # of an NMEA log: five sentences for each fix

_FILE, _FILE_HEAD = b"ARROW1", 8
_CONTINUED = 0xFFFFFFFF
_DICTIONARY_BATCH, _RECORD_BATCH = 2, 3  # kinds of messages in the Arrow format


class TooLargeTrace(ReadError):
    """A trace that stands for more than is matched at once."""


def check_size(data: bytes, suffix: str) -> None:
    """See that a trace is not larger than what is matched at once.

    Args:
        data: The body.
        suffix: Its format: .csv, .json, .gpx, .nmea or .arrow.

    Raises:
        TooLargeTrace: It is.
        ReadError: Its size cannot be found, as its structure is damaged.
    """
    rows = f"at most {MOST_ROWS:,} rows are taken here"
    if suffix == ".csv":
        _most(max(data.count(b"\n"), data.count(b"\r")), MOST_ROWS + 1000, rows)
        head = data[: data.find(b"\n") % (len(data) + 1)]
        _most(max(map(head.count, (b",", b";", b"\t"))), _MOST_COLUMNS, "at most 1,000 columns")
    elif suffix == ".json":
        _most(max(data.count(b"{"), data.count(b"[")), MOST_ROWS + 1000, rows)
        _most(data.count(b","), _MOST_VALUES, f"at most {_MOST_VALUES:,} values are taken here")
    elif suffix == ".gpx":
        _most(data.count(b"<trkpt"), MOST_ROWS, rows)
        _most(data.count(b"<"), _MOST_TAGS, f"at most {_MOST_TAGS:,} tags are taken here")
    elif suffix == ".nmea":
        _most(max(data.count(b"\n"), data.count(b"\r")), _MOST_LINES, rows)
    elif suffix == ".arrow":
        check_arrow(data)


def stream_of(data: bytes) -> bytes:
    """The stream within an Arrow file, or the stream that it is.

    The index of a file may name a batch any number of times, so it is not used.

    Raises:
        ReadError: It is a file of the older Feather format.
    """
    if data.startswith(b"FEA1"):
        raise ReadError("trace: Feather version 1; an Arrow stream was expected")
    return data[_FILE_HEAD:] if data.startswith(_FILE) else data


def check_arrow(data: bytes) -> None:
    """See that the batches of an Arrow stream are not too large once decompressed.

    Only the metadata of its messages is read (Arrow columnar format, "Encapsulated message
    format"), and of compressed buffers the length that stands before them.

    Args:
        data: The stream.

    Raises:
        TooLargeTrace: They have too many rows, or too many bytes.
        ReadError: The metadata is damaged.
    """
    rows = size = values = batches = 0
    try:
        for metadata, body in _messages(memoryview(data)):
            message = _Table.root(metadata)
            kind = message.number(1, "B")
            if kind not in (_RECORD_BATCH, _DICTIONARY_BATCH):
                continue
            batch = message.table(2)
            if batch is not None and kind == _DICTIONARY_BATCH:
                batch = batch.table(1)
            if batch is None:
                continue
            batches += 1
            rows += batch.number(0, "q")
            values += sum(abs(length) for length, _ in batch.structs(1, "qq"))
            size += _decompressed(batch, body)
            _most(rows, MOST_ROWS, f"at most {MOST_ROWS:,} rows are taken here")
            _most(values, MOST_ROWS * _MOST_COLUMNS, "too many columns")
            _most(size, MOST_BYTES, f"at most {MOST_BYTES:,} bytes, decompressed, are taken here")
            _most(batches, _MOST_BATCHES, f"at most {_MOST_BATCHES:,} batches are taken here")
    except (struct.error, IndexError, AttributeError, ValueError):
        raise ReadError("trace: no readable Arrow stream; was it cut short?") from None


def _most(count: int, most: int, why: str) -> None:
    if not 0 <= count <= most:
        raise TooLargeTrace(f"trace: {why}")


def _messages(data: memoryview) -> Any:
    """Metadata and body of each message."""
    at = 0
    while at + 4 <= len(data):
        (size,) = struct.unpack_from("<I", data, at)
        at += 4
        if size == _CONTINUED:
            (size,) = struct.unpack_from("<I", data, at)
            at += 4
        if size == 0:
            return
        metadata = data[at : at + size]
        if len(metadata) < size:
            return  # a recording that is torn
        at += size
        length = _Table.root(metadata).number(3, "q")
        if length < 0:
            raise ValueError
        yield metadata, data[at : at + length]
        at += length


def _decompressed(batch: "_Table", body: memoryview) -> int:
    """Bytes of a batch's buffers once they are decompressed."""
    buffers = batch.structs(2, "qq")
    if batch.table(3) is None:  # not compressed
        return sum(abs(length) for _, length in buffers)
    size = 0
    for offset, length in buffers:
        if length == 0:
            continue
        (plain,) = struct.unpack_from("<q", body, offset)
        size += length if plain == -1 else plain
        if plain < -1:
            raise ValueError
    return size


class _Table:
    """A table of a FlatBuffer: fields by their numbers, absent ones zero or None."""

    def __init__(self, data: memoryview, at: int) -> None:
        self._data, self._at = data, at
        (back,) = struct.unpack_from("<i", data, at)
        self._fields = at - back
        if not 0 <= self._fields < len(data):
            raise ValueError
        (self._size,) = struct.unpack_from("<H", data, self._fields)

    @classmethod
    def root(cls, data: memoryview) -> "_Table":
        """The table that the buffer holds."""
        return cls(data, struct.unpack_from("<I", data)[0])

    def _place(self, field: int) -> int:
        """Where a field lies; 0: it is absent."""
        entry = 4 + 2 * field
        if entry + 2 > self._size:
            return 0
        (offset,) = struct.unpack_from("<H", self._data, self._fields + entry)
        return self._at + offset if offset else 0

    def number(self, field: int, kind: str) -> int:
        """A number; `kind` as in `struct`."""
        place = self._place(field)
        return int(struct.unpack_from(f"<{kind}", self._data, place)[0]) if place else 0

    def table(self, field: int) -> "_Table | None":
        """A table within this one."""
        place = self._place(field)
        if not place:
            return None
        return _Table(self._data, place + struct.unpack_from("<I", self._data, place)[0])

    def structs(self, field: int, kind: str) -> list[tuple[int, ...]]:
        """A list of records of numbers."""
        place = self._place(field)
        if not place:
            return []
        begin = place + struct.unpack_from("<I", self._data, place)[0]
        (count,) = struct.unpack_from("<I", self._data, begin)
        size = struct.calcsize(f"<{kind}")
        end = begin + 4 + count * size
        if end > len(self._data):
            raise ValueError
        return list(struct.iter_unpack(f"<{kind}", self._data[begin + 4 : end]))
