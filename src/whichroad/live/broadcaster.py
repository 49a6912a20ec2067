"""Many listeners of one stream: none of them may slow the filter down.

A message is framed once and written to the sockets as it is.  What a listener does not take
waits in a buffer of bounded size; who lets it overflow is dropped.
"""

import asyncio
from collections.abc import AsyncIterator
from typing import Any, Protocol

MOST_WAITING = 256 * 1024  # bytes that a listener may leave lying
MOST_LISTENERS = 512
_MOST_EVENTS = 100  # messages that a listener of events may leave lying


class Transport(Protocol):
    """What is needed of `asyncio.Transport`."""

    def write(self, data: bytes) -> None:
        """Send, later if need be."""

    def get_write_buffer_size(self) -> int:
        """Bytes not sent yet."""

    def is_closing(self) -> bool:
        """Whether it is of no use any more."""

    def abort(self) -> None:
        """Close now."""


def websocket_frame(text: bytes) -> bytes:
    """A whole text frame of a server (RFC 6455, §5.2): not masked, not compressed."""
    size = len(text)
    if size < 126:
        return bytes((0x81, size)) + text
    if size < 1 << 16:
        return b"\x81\x7e" + size.to_bytes(2) + text
    return b"\x81\x7f" + size.to_bytes(8) + text


class Sockets:
    """Sockets that all get the same bytes.

    Attributes:
        dropped: Listeners that were too slow.
    """

    def __init__(self) -> None:
        self._open: set[Transport] = set()
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._open)

    def add(self, transport: Transport) -> None:
        """From now on it gets what is sent."""
        self._open.add(transport)

    def discard(self, transport: Transport) -> None:
        """No more."""
        self._open.discard(transport)

    def send(self, data: bytes) -> None:
        """To all of them; those that left too much lying are dropped."""
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
        """Drop all of them."""
        for transport in tuple(self._open):
            transport.abort()
        self._open.clear()


class Broadcaster:
    """Listeners of WebSockets and of server-sent events.

    Attributes:
        sockets: Those of WebSockets.
        sent: Messages handed out.
    """

    def __init__(self) -> None:
        self.sockets = Sockets()
        self.sent = 0
        self._queues: set[asyncio.Queue[bytes | None]] = set()
        self._dropped = 0

    @property
    def listeners(self) -> int:
        """How many there are."""
        return len(self.sockets) + len(self._queues)

    @property
    def dropped(self) -> int:
        """How many were too slow."""
        return self._dropped + self.sockets.dropped

    @property
    def full(self) -> bool:
        """Whether nobody else may listen."""
        return self.listeners >= MOST_LISTENERS

    def send(self, text: bytes, message: Any = None) -> None:
        """One message to everybody."""
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
        """Let everybody go."""
        self.sockets.close()
        for queue in self._queues:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(None)
