"""The page on a recorded drive: the same page, the same messages, a clock that can be turned."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from ..page import page_routes
from .player import Player, Refused

if TYPE_CHECKING:
    from ..roadmap import RoadMap

_LARGEST = 4096  # bytes of a control
_SLOW = 5.0  # s after which who does not take a message is let go
_CROWD = 64  # lookers-on at a time


def replay_app(
    player: Player, roads: "RoadMap", *, tiles_url: str | None = None, hosts: tuple[str, ...] = ()
) -> Starlette:
    """The application that plays a film.

    Args:
        player: The film and its clock.
        roads: The map that the page draws.
        tiles_url: Raster tiles below it, as `page_routes` takes them.
        hosts: Names besides localhost under which it may be asked.
    """
    crowd: set[WebSocket] = set()

    async def show(socket: WebSocket) -> None:
        if len(crowd) >= _CROWD or not _from_here(socket):
            return await socket.close(1013 if len(crowd) >= _CROWD else 1008)
        await socket.accept()
        crowd.add(socket)
        listening = asyncio.create_task(_listen(socket))
        telling = asyncio.create_task(_tell(socket, player))
        try:
            await asyncio.wait((listening, telling), return_when=asyncio.FIRST_COMPLETED)
        finally:
            listening.cancel()
            telling.cancel()
            await asyncio.gather(listening, telling, return_exceptions=True)
            crowd.discard(socket)

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

    allowed = ["127.0.0.1", "localhost", "[::1]", *hosts]
    return Starlette(
        routes=[
            *page_routes(roads, tiles_url=tiles_url),
            Route("/timeline", columns),
            Route("/control", control, methods=["POST"]),
            WebSocketRoute("/ws", show),
        ],
        middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=allowed)],
        lifespan=lifespan,
    )


def serve(app: Starlette, host: str, port: int) -> None:
    """Serve until interrupted."""
    import uvicorn

    uvicorn.run(app, host=host, port=port, log_level="warning", ws_max_size=_LARGEST)


async def _listen(socket: WebSocket) -> None:
    """Nothing is expected; reading tells when the other side has gone."""
    try:
        while True:
            await socket.receive_text()
    except (WebSocketDisconnect, RuntimeError, KeyError):
        return


async def _tell(socket: WebSocket, player: Player) -> None:
    try:
        async for message in player.messages():
            text = json.dumps(message, ensure_ascii=False, separators=(",", ":"))
            await asyncio.wait_for(socket.send_text(text), _SLOW)
    except (WebSocketDisconnect, RuntimeError, TimeoutError, OSError):
        return


async def _control(request: Request, player: Player) -> JSONResponse:
    if not _from_here(request):
        return _refused("a page of this service was expected to ask", 403)
    if request.headers.get("content-type", "").partition(";")[0] != "application/json":
        return _refused("application/json was expected", 415)
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > _LARGEST:
            return _refused("that is too long", 413)
    try:
        asked: Any = json.loads(body)
    except ValueError:
        return _refused('JSON such as {"action": "pause"} was expected', 400)
    if not isinstance(asked, dict) or not isinstance(asked.get("action"), str):
        return _refused('JSON such as {"action": "pause"} was expected', 400)
    try:
        await player.control(asked["action"], asked.get("value"))
    except Refused as refused:
        return _refused(str(refused), 409)
    return JSONResponse({"ok": True})


def _from_here(asker: HTTPConnection) -> bool:
    """Whether it is no other site's page that asks."""
    origin = asker.headers.get("origin")
    return origin is None or urlsplit(origin).netloc == asker.headers.get("host")


def _refused(why: str, code: int) -> JSONResponse:
    return JSONResponse({"error": why}, code)
