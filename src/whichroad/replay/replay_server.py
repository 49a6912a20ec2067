"""The web server of a replay: the live page and messages, with controls of time."""

import asyncio
import json
import socket
import threading
import webbrowser
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from ..live.access import AccessControl, is_local
from ..live.refusals import HANDLERS, asked_of
from ..live.web_server import listen, web_server
from ..page import page_routes
from ..page.compressed import compressed
from .player import Player, Refused

if TYPE_CHECKING:
    from ..roadmap import RoadMap

_SLOW = 5.0  # s after which a viewer that takes no message is disconnected
_CROWD = 64  # viewers at a time


def replay_app(
    player: Player, roads: "RoadMap", *, tiles_url: str | None = None, host: str = "127.0.0.1",
    token: str | None = None,
) -> Starlette:  # fmt: skip
    """The application that serves a replay.

    Args:
        player: The recorded messages and their clock.
        roads: The map that the page draws.
        tiles_url: Raster tiles below it, as `page_routes` takes them.
        host: Where it listens; on this machine, none but its own names are served.
        token: Asked of everybody; None: nobody.
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

    async def columns(request: Request) -> Response:
        body = await asyncio.to_thread(lambda: json.dumps(player.timeline()).encode())
        return await compressed(request, body, "application/json", {"Cache-Control": "no-store"})

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
        middleware=[Middleware(AccessControl, local=is_local(host), token=token)],
        exception_handlers=HANDLERS,
        lifespan=lifespan,
    )


def serve(app: Starlette, listener: socket.socket, page: str | None = None) -> None:
    """Serve until interrupted.

    Args:
        app: What answers.
        listener: The socket that listens.
        page: An address to open in a browser, if any.
    """
    if page is not None:
        threading.Timer(0.8, webbrowser.open, (page,)).start()
    web_server(app, lifespan=True).run(sockets=[listener])


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
    action, value = await asked_of(request)
    try:
        await player.control(action, value)
    except Refused as refused:
        raise HTTPException(409, str(refused)) from None
    return JSONResponse({"play": player.message["play"]})


__all__ = ["listen", "replay_app", "serve"]
