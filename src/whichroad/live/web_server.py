"""The web server under `live` and `replay`: which connections it keeps, and for how long.

A connection must ask, and ask again, within some seconds.  A WebSocket must answer pings.  A
request whose body ends too early is answered with 400.
"""

import asyncio
import json
import signal
import socket
from types import FrameType
from typing import Any

import h11
import uvicorn
from starlette.applications import Starlette
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from ..errors import SettingError

_REQUEST_TIME = 10.0  # s, timeout of a request's head, the first and each that follows
_PATIENCE = 5.0  # s, interval and timeout of WebSocket pings
_MOST_CONNECTIONS = 2000
READ_AT_ONCE = 65_536  # bytes that are read from a connection before other work is done
_LARGEST_MESSAGE = 4096  # bytes of a WebSocket message that comes in


class Socket(WebSocketsSansIOProtocol):
    """A WebSocket whose transport the broadcaster may write to."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.app_state = {**self.app_state, "connection": self}
        self.stalled = False

    def keepalive_timeout(self) -> None:
        """It does not answer."""
        self.stalled = True
        super().keepalive_timeout()
        self.transport.abort()  # what it has not taken by now it never will


class Http(H11Protocol):
    """A connection that must ask within some seconds."""

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.app_state = {**self.app_state, "http": self}
        self._asked: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the clock."""
        super().connection_made(transport)
        transport.max_size = READ_AT_ONCE  # type: ignore[attr-defined]
        self._start_clock()

    def on_response_complete(self) -> None:
        """Start it again for the next request."""
        super().on_response_complete()
        self._start_clock()

    def _start_clock(self) -> None:
        self._stop_clock()
        self._asked = self.loop.call_later(_REQUEST_TIME, self._give_up)

    def _stop_clock(self) -> None:
        if self._asked is not None:
            self._asked.cancel()

    def _give_up(self) -> None:
        idle = self.cycle is None or self.cycle.response_complete
        if idle and not self.transport.is_closing():
            self.transport.abort()

    def ask_for_no_body(self) -> None:
        """Send no "100 Continue" to a client that waits for it before it sends a body."""
        if self.cycle is not None:
            self.cycle.waiting_for_100_continue = False

    def handle_websocket_upgrade(self, event: Any) -> None:
        """It has asked, and is not ours any more."""
        self._stop_clock()
        super().handle_websocket_upgrade(event)

    def eof_received(self) -> None:
        """Nothing more will come; a request that is not complete never will be."""
        cycle = self.cycle
        if cycle is not None and cycle.more_body and not cycle.response_started:
            self.send_400_response("the body ended before it was complete")

    def send_400_response(self, msg: str) -> None:
        """Answer what is no request in one sentence, and close."""
        cycle = self.cycle
        if self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE):
            self.transport.close()  # an answer has begun
            return
        if cycle is not None:
            cycle.response_started = cycle.response_complete = cycle.disconnected = True
            cycle.message_event.set()
        body = json.dumps({"error": msg}).encode()
        headers = [
            (b"content-type", b"application/json"), (b"content-length", str(len(body)).encode()),
            (b"connection", b"close"),
        ]  # fmt: skip
        for event in (
            h11.Response(status_code=400, headers=headers, reason=b"Bad Request"),
            h11.Data(data=body),
            h11.EndOfMessage(),
        ):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the clock."""
        self._stop_clock()
        super().connection_lost(exc)


class Server(uvicorn.Server):
    """A server that a signal stops, and no more than that: it is not raised again afterwards.

    So all that runs beside the server ends in order, too.
    """

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Stop; a second Ctrl-C waits for nothing."""
        self.force_exit = self.should_exit and sig == signal.SIGINT
        self.should_exit = True


def web_server(app: Starlette, *, lifespan: bool = False) -> uvicorn.Server:
    """A server of an application; it serves the sockets that it is given.

    Args:
        app: What answers.
        lifespan: Whether the application starts and ends something with the server.
    """
    config = uvicorn.Config(
        app, ws=Socket, http=Http, lifespan="on" if lifespan else "off",
        log_level="critical", access_log=False, ws_max_size=_LARGEST_MESSAGE,
        ws_per_message_deflate=False, ws_ping_interval=_PATIENCE, ws_ping_timeout=_PATIENCE,
        limit_concurrency=_MOST_CONNECTIONS, timeout_keep_alive=10, server_header=False,
        timeout_graceful_shutdown=1, h11_max_incomplete_event_size=16_384,
    )  # fmt: skip
    return Server(config)


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens there.

    Raises:
        SettingError: It cannot: the port is taken, or the address is not this machine's.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        listener = socket.create_server((host, port), family=family, backlog=512)
        # its connections inherit it, and asyncio sets it on sockets of its own only: a body does
        # not wait 40 ms until the client has acknowledged the head of the answer
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return listener
    except OSError as error:
        why = error.strerror or str(error)
        raise SettingError(
            f"{host}, port {port}: {why}; a free port of this machine was expected; choose "
            "another by --port, or 0 for any"
        ) from error
