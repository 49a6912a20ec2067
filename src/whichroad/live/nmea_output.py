"""NMEA output: the estimated pose as NMEA 0183 sentences.

Each message becomes GGA, RMC and GST, in this order, of the middle of the rear axle.
Without GNSS the quality is 6 and the mode is E: estimated.  Where the status is lost, or the
estimate stale, they are invalid: quality 0, status V.
"""

import asyncio
import math
from datetime import UTC, datetime
from typing import Any

from ..geodesy.angles import radians, wrap_bearing
from ..geodesy.units import KNOT
from ..nmea_frame import sealed
from ..writers.nmea_text import place_of
from .broadcaster import MOST_LISTENERS, Sockets
from .message_types import EstimateMessage, FixMessage

_FRESH = 5.0  # s, age of a fix up to which its satellites are those of the estimate
_MOST_IGNORED = 65_536  # bytes read from a consumer before reading stops


def sentences(message: EstimateMessage) -> bytes:
    """The sentences of one message."""
    hundredths = math.floor(100.0 * message["epoch_s"] + 1e-3)  # never rounded into the future
    moment = datetime.fromtimestamp(hundredths / 100.0, UTC)
    clock = f"{moment:%H%M%S}.{moment.microsecond // 10_000:02d}"
    pose, ellipse = message["pose"], message["ellipse"]
    if pose is None or ellipse is None or message["status"] == "lost":
        bodies = [
            f"GNGGA,{clock},,,,,0,00,,,M,,M,,",
            f"GNRMC,{clock},V,,,,,,,{moment:%d%m%y},,,N",
        ]
        return b"".join(map(sealed, bodies))
    alone = message["status"] == "outage" or message["dead_reckoning"]
    place = place_of(pose["lat"], pose["lon"])
    speed = abs(pose["speed_mps"] or 0.0)
    major, minor, axis = ellipse["major_m"], ellipse["minor_m"], ellipse["bearing_deg"]
    sin, cos = math.sin(radians(axis)), math.cos(radians(axis))
    north, east = math.hypot(major * cos, minor * sin), math.hypot(major * sin, minor * cos)
    bodies = [
        f"GNGGA,{clock},{place},{6 if alone else 1},{_receiver(message['fix'])},,",
        f"GNRMC,{clock},A,{place},{speed / KNOT:.3f},{wrap_bearing(pose['bearing_deg']):.2f},"
        f"{moment:%d%m%y},,,{'E' if alone else 'A'}",
        f"GNGST,{clock},,{major:.3f},{minor:.3f},{axis:.1f},{north:.3f},{east:.3f},",
    ]
    return b"".join(map(sealed, bodies))


def _receiver(fix: FixMessage | None) -> str:
    """Satellites, HDOP, altitude and geoid height as in GGA; empty where nobody says them.

    Satellites and HDOP are of the last fix, so they are left out once it is old or withheld.
    """
    if fix is None:
        return ",,,M,,M"
    fresh = fix["age_s"] <= _FRESH and not fix["masked"]
    satellites, hdop = (fix["satellites"], fix["hdop"]) if fresh else (None, None)
    height, geoid = fix["altitude_m"], fix["geoid_m"]
    return ",".join(
        (
            "" if satellites is None else f"{min(satellites, 99):02d}",
            "" if hdop is None else f"{hdop:.2f}",
            "" if height is None else f"{height:.1f}", "M",
            "" if geoid is None else f"{geoid:.1f}", "M",
        )
    )  # fmt: skip


class NmeaOutput:
    """Sends sentences to all TCP clients, or to one UDP address.

    Args:
        scheme: `tcp`: listen at the address; `udp`: send to it.
        host: Host name or address.
        port: Port; 0: any free port.
    """

    def __init__(self, scheme: str, host: str, port: int) -> None:
        self.scheme, self.host, self.port = scheme, host, port
        self.sockets = Sockets()
        self._server: asyncio.Server | None = None
        self._datagrams: asyncio.DatagramTransport | None = None

    async def start(self) -> None:
        """Open the socket.

        Raises:
            OSError: The socket cannot be opened.
        """
        loop = asyncio.get_running_loop()
        if self.scheme == "udp":
            self._datagrams, _ = await loop.create_datagram_endpoint(
                asyncio.DatagramProtocol, remote_addr=(self.host, self.port)
            )
            return
        self._server = await loop.create_server(
            lambda: _Listener(self.sockets), self.host, self.port
        )
        self.port = self._server.sockets[0].getsockname()[1]

    def send(self, text: bytes, message: EstimateMessage) -> None:
        """Send one message as sentences."""
        if self._datagrams is None and not len(self.sockets):
            return
        burst = sentences(message)
        if self._datagrams is not None:
            self._datagrams.sendto(burst)
        else:
            self.sockets.send(burst)

    def close(self) -> None:
        """Close all sockets."""
        if self._datagrams is not None:
            self._datagrams.close()
        if self._server is not None:
            self._server.close()
        self.sockets.close()


class _Listener(asyncio.Protocol):
    """A TCP client; what it sends is ignored."""

    def __init__(self, sockets: Sockets) -> None:
        self._sockets, self._received = sockets, 0
        self._transport: Any = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport
        if len(self._sockets) >= MOST_LISTENERS:
            self._transport.abort()
            return
        self._transport.set_write_buffer_limits(high=16_384)
        self._sockets.add(self._transport)

    def data_received(self, data: bytes) -> None:
        self._received += len(data)
        if self._received > _MOST_IGNORED:
            self._transport.pause_reading()

    def connection_lost(self, exc: Exception | None) -> None:
        self._sockets.discard(self._transport)
