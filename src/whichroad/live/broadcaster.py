"""Broadcaster: sends each message to all listeners without waiting for any of them.

A message is framed once and written to every socket.  Unsent bytes wait in a buffer of
bounded size.  A listener whose buffer overflows is disconnected.
"""

import asyncio
from collections.abc import AsyncIterator
from typing import Any, Protocol

MOST_WAITING = 256 * 1024  # bytes that may wait for one listener
MOST_LISTENERS = 512
_MOST_EVENTS = 100  # messages that may wait for one listener of server-sent events


class Transport(Protocol):
    """The methods of `asyncio.Transport` that are used."""

    def write(self, data: bytes) -> None:
        """Send, or buffer, some bytes."""

    def get_write_buffer_size(self) -> int:
        """Bytes that wait to be sent."""

    def is_closing(self) -> bool:
        """Whether the connection is closing."""

    def abort(self) -> None:
        """Close without sending what is buffered."""


def websocket_frame(text: bytes) -> bytes:
    """A whole text frame of a server (RFC 6455, §5.2): not masked, not compressed."""
    size = len(text)
    if size < 126:
        return bytes((0x81, size)) + text
    if size < 1 << 16:
        return b"\x81\x7e" + size.to_bytes(2) + text
    return b"\x81\x7f" + size.to_bytes(8) + text


class Sockets:
    """A set of sockets that receive the same bytes.

    Attributes:
        dropped: Number of listeners that were disconnected because they were too slow.
    """

    def __init__(self) -> None:
        self._open: set[Transport] = set()
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._open)

    def add(self, transport: Transport) -> None:
        """Add a socket."""
        self._open.add(transport)

    def discard(self, transport: Transport) -> None:
        """Remove a socket."""
        self._open.discard(transport)

    def send(self, data: bytes) -> None:
        """Send to all sockets; disconnect those with too many unsent bytes."""
        for transport in tuple(self._open):
            if transport.is_closing():
                self._open.discard(transport)
            elif transport.get_write_buffer_size() > MOST_WAITING:
                self._open.discard(transport)
                self.dropped += 1
                transport.abort()
            else:
                transport.write(data)

    def close(self) -> None:
        """Disconnect all sockets."""
        for transport in tuple(self._open):
            transport.abort()
        self._open.clear()


class Broadcaster:
    """Sends messages over WebSockets and as server-sent events.

    Attributes:
        sockets: The WebSocket connections.
        sent: Number of messages sent.
    """

    def __init__(self) -> None:
        self.sockets = Sockets()
        self.sent = 0
        self._queues: set[asyncio.Queue[bytes | None]] = set()
        self._dropped = 0

    @property
    def listeners(self) -> int:
        """Number of listeners."""
        return len(self.sockets) + len(self._queues)

    @property
    def dropped(self) -> int:
        """Number of listeners disconnected because they were too slow."""
        return self._dropped + self.sockets.dropped

    @property
    def full(self) -> bool:
        """Whether the number of listeners is at its limit."""
        return self.listeners >= MOST_LISTENERS

    def send(self, text: bytes, message: Any = None) -> None:
        """Send one message to all listeners."""
        self.sent += 1
        if len(self.sockets):
            self.sockets.send(websocket_frame(text))
        for queue in tuple(self._queues):
            if queue.full():
                self._queues.discard(queue)
                self._dropped += 1
                queue.get_nowait()
                queue.put_nowait(None)
            else:
                queue.put_nowait(text)

    async def events(self, first: bytes) -> AsyncIterator[bytes]:
        """Messages as server-sent events, the last one first; ends where the reader is too slow."""
        queue: asyncio.Queue[bytes | None] = asyncio.Queue(_MOST_EVENTS)
        self._queues.add(queue)
        try:
            yield b"retry: 1000\n\n"
            if first:
                yield b"event: estimate\ndata: " + first + b"\n\n"
            while (text := await queue.get()) is not None:
                yield b"event: estimate\ndata: " + text + b"\n\n"
        finally:
            self._queues.discard(queue)

    def close(self) -> None:
        """Disconnect all listeners."""
        self.sockets.close()
        for queue in self._queues:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(None)
