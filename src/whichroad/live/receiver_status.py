"""Satellites, HDOP and height as a receiver says them: in GGA, or in NAV-PVT of UBX.

They are passed on, never used by the filter.
"""

import struct

from ..nmea_frame import checksum
from .message_types import UNKNOWN, ReceiverStatus

_LONGEST = 120  # bytes of a sentence or message that may still be incomplete
_PVT = b"\xb5\x62\x01\x07\x5c\x00"  # frame of NAV-PVT, 92 bytes of payload
_PVT_SIZE = len(_PVT) + 92 + 2


class StatusReader:
    """Bytes in, the newest status out; of a sentence in pieces only the end is kept.

    Attributes:
        now: The newest status.
    """

    def __init__(self) -> None:
        self.now: ReceiverStatus = UNKNOWN
        self._tail = b""

    def feed(self, data: bytes) -> None:
        """Take the next bytes."""
        data = self._tail + data
        self._tail = data[-_LONGEST:]
        found = _gga(data) or _pvt(data)
        if found is not None:
            self.now = found


def _gga(data: bytes) -> ReceiverStatus | None:
    """Of the last whole GGA sentence whose checksum is right."""
    end = len(data)
    while (at := data.rfind(b"GGA,", 0, end)) >= 0:
        end = at
        begin, stop = data.rfind(b"$", 0, at), data.find(b"*", at)
        if begin < 0 or at - begin > 5 or stop < 0 or len(data) < stop + 3:
            continue
        body, told = data[begin + 1 : stop], data[stop + 1 : stop + 3]
        if told.upper() != b"%02X" % checksum(body):
            continue
        fields = body.decode("ascii", "replace").split(",")
        if len(fields) < 12 or fields[6] in ("", "0"):
            return UNKNOWN
        count = _number(fields[7])
        return ReceiverStatus(
            None if count is None else int(count), *map(_number, (fields[8], fields[9], fields[11]))
        )
    return None


def _pvt(data: bytes) -> ReceiverStatus | None:
    """Of the last whole NAV-PVT (u-blox interface description): it has no HDOP."""
    end = len(data)
    while (at := data.rfind(_PVT, 0, end)) >= 0:
        end = at
        frame = data[at : at + _PVT_SIZE]
        if len(frame) < _PVT_SIZE or frame[-2:] != _ubx_checksum(frame[2:-2]):
            continue
        payload = frame[len(_PVT) : -2]
        height, sea = struct.unpack_from("<ii", payload, 32)  # mm
        return ReceiverStatus(payload[23], None, sea / 1000.0, (height - sea) / 1000.0)
    return None


def _number(text: str) -> float | None:
    """A plain decimal number; None for anything else."""
    whole, _, part = text.removeprefix("-").partition(".")
    return float(text) if (whole + part).isdecimal() and len(text) < 12 else None


def _ubx_checksum(body: bytes) -> bytes:
    first = second = 0
    for letter in body:
        first = (first + letter) & 255
        second = (second + first) & 255
    return bytes((first, second))
