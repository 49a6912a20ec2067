"""UBX frames in bytes: where they are, whether their checksums are right, their fields.

All frames of a block are checked at once.  Both sums of the checksum are differences of
running sums, which may wrap: only their last eight bits count.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .checks import Bools, Ints, Skipped

# class and number of a message
NAV_PVT, NAV_COV, NAV_RELPOSNED, ESF_MEAS = 0x0107, 0x0136, 0x013C, 0x1002
WANTED = (NAV_PVT, NAV_COV, ESF_MEAS)
SYNC = b"\xb5\x62"
HEAD, TAIL = 6, 2  # bytes before and after the payload
LONGEST = HEAD + 0x2000 + TAIL  # of a frame; raw measurements of 100 signals take 0xD00
CHECKSUM = "UBX checksum that is wrong"
CUT = "UBX message cut short"
_BLOCK = 1 << 24  # bytes scanned at once

Bytes = NDArray[np.uint8]


class Frames(NamedTuple):
    """Whole frames in the order of the log, shape (n,) each."""

    start: Ints  # byte at which the frame begins
    end: Ints  # byte behind it
    kind: Ints  # class and number of the message


def scan(data: bytes, skipped: Skipped, *, ended: bool = True) -> tuple[Frames, int]:
    """Find the whole frames.

    Args:
        data: Bytes of a receiver, other protocols among them.
        skipped: Counts wanted messages that are damaged.
        ended: Whether no bytes follow; else a frame that is not whole is left to the next call.

    Returns:
        The frames, and how many bytes need not be given again.
    """
    found: list[Frames] = []
    begin, rest = 0, len(data)
    while begin < len(data) or not found:
        more = begin + _BLOCK < len(data)
        block = np.frombuffer(data, np.uint8)[begin : begin + _BLOCK + LONGEST]
        frames, open_at = _block(block, _BLOCK, skipped, ended=ended or more)
        found.append(Frames(frames.start + begin, frames.end + begin, frames.kind))
        if not more:
            rest = begin + open_at
        begin = max(begin + _BLOCK, int(found[-1].end[-1]) if len(frames.end) else 0)
    return Frames(*(np.concatenate(column) for column in zip(*found, strict=True))), rest


def _block(data: Bytes, until: int, skipped: Skipped, *, ended: bool) -> tuple[Frames, int]:
    """The frames that begin before `until`, and where an unfinished one begins."""
    at = np.flatnonzero((data[:-1] == SYNC[0]) & (data[1:] == SYNC[1]))
    headed = at[(at + HEAD <= len(data)) & (at < until)]
    length = data[headed + 4].astype(np.int64) | data[headed + 5].astype(np.int64) << 8
    possible = length <= LONGEST - HEAD - TAIL
    headed, length = headed[possible], length[possible]
    kind = data[headed + 2].astype(np.int64) << 8 | data[headed + 3]
    end = headed + HEAD + length + TAIL
    whole = end <= len(data)
    good = np.zeros(len(headed), np.bool_)
    good[whole] = _checked(data, headed[whole], end[whole])
    start, stop, what = headed[good], end[good], kind[good]
    outer = _outermost(start, stop)
    frames = Frames(start[outer], stop[outer], what[outer])
    wanted = np.isin(kind, WANTED) & ~good & ~_inside(headed, frames)
    wrong, short = wanted & whole, wanted & ~whole
    if wrong.any():
        skipped[CHECKSUM] += int(np.count_nonzero(wrong))
    if ended and short.any():
        skipped[CUT] += int(np.count_nonzero(short))
    return frames, len(data) if ended else _open(data, at, headed[~whole], frames)


def _open(data: Bytes, at: Ints, short: Ints, frames: Frames) -> int:
    """Where bytes begin that may be those of a frame whose end has not come."""
    begun = np.concatenate([short, at[at + HEAD > len(data)]])
    begun = begun[~_inside(begun, frames)]
    if len(begun):
        return int(begun.min())
    return len(data) - int(len(data) > 0 and data[-1] == SYNC[0])


def _checked(data: Bytes, start: Ints, end: Ints) -> Bools:
    """Whether the checksums are right, by RFC 1145's two running sums."""
    place = np.arange(len(data), dtype=np.uint8)  # modulo 256, as all of this
    sums = np.concatenate([np.zeros(1, np.uint8), np.cumsum(data, dtype=np.uint8)])
    weighted = np.cumsum(data * place, dtype=np.uint8)
    weighted = np.concatenate([np.zeros(1, np.uint8), weighted])
    first, last = start + 2, end - TAIL
    a = sums[last] - sums[first]
    b = last.astype(np.uint8) * a - (weighted[last] - weighted[first])
    good: Bools = (a == data[last]) & (b == data[last + 1])
    return good


def _outermost(start: Ints, end: Ints) -> Ints:
    """Frames that begin behind the frame before them; a payload may hold a frame."""
    if len(start) < 2 or (start[1:] >= end[:-1]).all():
        return np.arange(len(start))
    chosen, reach = [], 0
    for k, (begin, stop) in enumerate(zip(start.tolist(), end.tolist(), strict=True)):
        if begin >= reach:
            chosen.append(k)
            reach = stop
    return np.array(chosen, np.int64)


def _inside(at: Ints, frames: Frames) -> Bools:
    """Whether bytes are those of a frame."""
    if not len(frames.start):
        return np.zeros(len(at), np.bool_)
    before = np.searchsorted(frames.start, at, side="right") - 1
    inside: Bools = (before >= 0) & (at < frames.end[np.maximum(before, 0)])
    return inside


def payloads(data: bytes, start: Ints, layout: np.dtype[np.void]) -> NDArray[np.void]:
    """The fields of messages of one type.

    Args:
        data: The bytes in which `scan` found them.
        start: (n,) where they begin; each has a payload of `layout`'s size at least.
        layout: Fields and their places in the payload.

    Returns:
        (n,) records.
    """
    size = layout.itemsize
    values = np.frombuffer(data, np.uint8)
    rows = np.lib.stride_tricks.sliding_window_view(values, size)[start + HEAD]
    return np.ascontiguousarray(rows).view(layout)[:, 0]


def without(data: bytes, frames: Frames) -> bytes:
    """The bytes of other protocols."""
    if not len(frames.start):
        return data
    begins = [0, *frames.end.tolist()]
    ends = [*frames.start.tolist(), len(data)]
    return b"".join(data[a:b] for a, b in zip(begins, ends, strict=True))
