"""The web server of a replay: the live page and messages, with controls of time."""

import asyncio
import json
import re
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

from ..errors import WhichroadError
from ..live.access import AccessControl, is_local
from ..live.refusals import HANDLERS, asked_of, body_of
from ..live.web_server import web_server
from ..page import page_routes
from ..page.compressed import compressed
from .drive_report import report_text
from .dropped import LARGEST, Opener
from .player import Player, Refused

if TYPE_CHECKING:
    from ..roadmap import RoadMap

_SLOW = 5.0  # s after which a viewer that takes no message is disconnected
_CROWD = 64  # viewers at a time


def replay_app(
    player: Player, roads: "RoadMap", *, tiles_url: str | None = None,
    tiles_by: str | None = None, host: str = "127.0.0.1", token: str | None = None,
    opener: Opener | None = None,
) -> Starlette:  # fmt: skip
    """The application that serves a replay.

    Args:
        player: The recorded messages and their clock.
        roads: The map that the page draws.
        tiles_url: Raster tiles below it, as `page_routes` takes them.
        tiles_by: Whose tiles they are.
        host: Where it listens; on this machine, none but its own names are served.
        token: Asked of everybody; None: nobody.
        opener: Opens files that are dropped onto the page; None: none are taken.
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

    async def report(request: Request) -> Response:
        recorded = player.recorded
        text = await asyncio.to_thread(report_text, recorded, roads)
        name = re.sub(r"[^A-Za-z0-9._-]+", "-", recorded.drive_id)[:80] or "drive"
        headers = {
            "Cache-Control": "no-store", "Content-Security-Policy": "sandbox",
            "Content-Disposition": f'attachment; filename="{name}.html"',
        }  # fmt: skip
        return await compressed(request, text.encode(), "text/html; charset=utf-8", headers)

    opening = asyncio.Lock()

    async def opened(request: Request) -> Response:
        if opener is None:
            raise HTTPException(409, "this replay takes no files")
        if opening.locked():
            raise HTTPException(429, "another file is being opened")
        content = await body_of(request)
        if opening.locked():
            raise HTTPException(429, "another file is being opened")
        async with opening:
            try:
                name = request.query_params.get("name", "")
                await player.open(*await asyncio.to_thread(opener, name, content))
            except WhichroadError as error:
                raise HTTPException(400, str(error)[:500]) from None
        return JSONResponse({"drive_id": player.recorded.drive_id})

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        running = asyncio.create_task(player.run())
        yield
        running.cancel()

    return Starlette(
        routes=[
            *page_routes(roads, tiles_url=tiles_url, tiles_by=tiles_by, timeline=True),
            Route("/timeline", columns),
            Route("/control", control, methods=["POST"]),
            Route("/report", report),
            Route("/open", opened, methods=["POST"]),
            WebSocketRoute("/ws", show),
        ],
        middleware=[
            Middleware(AccessControl, local=is_local(host), token=token, largest={"/open": LARGEST})
        ],
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
