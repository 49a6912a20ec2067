"""The web server of a replay: the live page and messages, with controls of time."""

import asyncio
import json
import socket
import threading
import webbrowser
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from ..errors import SettingError
from ..live.access import AccessControl
from ..page import page_routes
from .player import Player, Refused

if TYPE_CHECKING:
    from ..roadmap import RoadMap

_LARGEST = 4096  # bytes of the largest message of a viewer
_LOCAL = ("127.0.0.1", "::1", "localhost")
_SLOW = 5.0  # s after which a viewer that takes no message is disconnected
_CROWD = 64  # viewers at a time


def replay_app(
    player: Player, roads: "RoadMap", *, tiles_url: str | None = None, host: str = "127.0.0.1"
) -> Starlette:
    """The application that serves a replay.

    Args:
        player: The recorded messages and their clock.
        roads: The map that the page draws.
        tiles_url: Raster tiles below it, as `page_routes` takes them.
        host: Where it listens; on this machine, none but its own names are served.
    """
    crowd: set[WebSocket] = set()

    async def show(viewer: WebSocket) -> None:
        if len(crowd) >= _CROWD:
            return await viewer.close(1013)
        await viewer.accept()
        crowd.add(viewer)
        listening = asyncio.create_task(_listen(viewer))
        sending = asyncio.create_task(_send_frames(viewer, player))
        try:
            await asyncio.wait((listening, sending), return_when=asyncio.FIRST_COMPLETED)
        finally:
            listening.cancel()
            sending.cancel()
            await asyncio.gather(listening, sending, return_exceptions=True)
            crowd.discard(viewer)

    async def control(request: Request) -> JSONResponse:
        return await _control(request, player)

    async def columns(_: Request) -> JSONResponse:
        return JSONResponse(
            await asyncio.to_thread(player.timeline), headers={"Cache-Control": "no-store"}
        )

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        running = asyncio.create_task(player.run())
        yield
        running.cancel()

    return Starlette(
        routes=[
            *page_routes(roads, tiles_url=tiles_url, timeline=True),
            Route("/timeline", columns),
            Route("/control", control, methods=["POST"]),
            WebSocketRoute("/ws", show),
        ],
        middleware=[Middleware(AccessControl, local=host in _LOCAL)],
        lifespan=lifespan,
    )


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens there.

    Raises:
        SettingError: It cannot: the port is taken, or the address is not this machine's.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except OSError as error:
        why = error.strerror or str(error)
        raise SettingError(
            f"{host}, port {port}: {why}; a free port of this machine was expected; choose "
            "another by --port, or 0 for any"
        ) from error


def serve(app: Starlette, listener: socket.socket, page: str | None = None) -> None:
    """Serve until interrupted.

    Args:
        app: What answers.
        listener: The socket that listens.
        page: An address to open in a browser, if any.
    """
    import uvicorn

    if page is not None:
        threading.Timer(0.8, webbrowser.open, (page,)).start()
    config = uvicorn.Config(app, log_level="warning", ws_max_size=_LARGEST, lifespan="on")
    uvicorn.Server(config).run(sockets=[listener])


async def _listen(viewer: WebSocket) -> None:
    """Read until the viewer disconnects; its messages are ignored."""
    try:
        while True:
            await viewer.receive_text()
    except (WebSocketDisconnect, RuntimeError, KeyError):
        return


async def _send_frames(viewer: WebSocket, player: Player) -> None:
    try:
        async for message in player.messages():
            text = json.dumps(message, ensure_ascii=False, separators=(",", ":"))
            await asyncio.wait_for(viewer.send_text(text), _SLOW)
    except (WebSocketDisconnect, RuntimeError, TimeoutError, OSError):
        return


async def _control(request: Request, player: Player) -> JSONResponse:
    try:
        asked: Any = json.loads(await request.body())
        action, value = asked["action"], asked.get("value")
    except (ValueError, RecursionError, KeyError, TypeError, AttributeError):
        return _refused('a JSON object with an "action" was expected', 400)
    try:
        await player.control(action, value)
    except Refused as refused:
        return _refused(str(refused), 409)
    return JSONResponse({"play": player.message["play"]})


def _refused(why: str, code: int) -> JSONResponse:
    return JSONResponse({"error": why}, code)
