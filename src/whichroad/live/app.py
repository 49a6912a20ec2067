"""The HTTP and WebSocket endpoints of the live service, as a Starlette application."""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from ..page.compressed import compressed
from .access import AccessControl
from .broadcaster import Broadcaster, websocket_frame
from .filter_loop import FilterLoop
from .metrics import metrics_of
from .playback import Player
from .recent import KEPT, History, history_json
from .refusals import HANDLERS, asked_of
from .schemas import schemas
from .traces import LARGEST_TRACE, Traces

_FASTEST = 1000.0
_FRESH = {"cache-control": "no-store"}


@dataclass(frozen=True, slots=True)
class Served:
    """A vehicle: its filter, its listeners, its last minutes."""

    filter_loop: FilterLoop
    broadcaster: Broadcaster
    history: History


class Service:
    """Handlers of the endpoints.

    Args:
        filter_loop: The filter.
        broadcaster: Its listeners.
        player: Plays a recording; None: live inputs.
        compiled: The file of the map, where it is a compiled one.
        others: Filters and listeners of further vehicles, by name.
    """

    def __init__(
        self, filter_loop: FilterLoop, broadcaster: Broadcaster, player: Player | None = None,
        compiled: Path | None = None,
        others: Mapping[str, tuple[FilterLoop, Broadcaster]] | None = None,
    ) -> None:  # fmt: skip
        self.filter_loop, self.broadcaster, self.player = filter_loop, broadcaster, player
        first = filter_loop.localizer
        self.traces = Traces(first.roads, first.vehicle, first.settings, compiled)
        served = {filter_loop.vehicle or "": (filter_loop, broadcaster), **(others or {})}
        self.vehicles = {name: Served(*both, History()) for name, both in served.items()}
        for one in self.vehicles.values():
            one.filter_loop.sinks += [one.broadcaster.send, one.history.send]

    def routes(self) -> list[BaseRoute]:
        """All endpoints but the page's."""
        return [
            WebSocketRoute("/ws", self.websocket),
            Route("/events", self.events),
            Route("/estimate", self.estimate),
            Route("/history", self.history),
            Route("/vehicles", self.list_vehicles),
            Route("/health", self.health),
            Route("/metrics", self.metrics),
            Route("/schema", self.list_schemas),
            Route("/schema/{name}", self.schema),
            Route("/match", self.match, methods=["POST"]),
            Route("/control", self.control, methods=["POST"]),
        ]

    async def websocket(self, socket: WebSocket) -> None:
        """Every message as it is made; the last one at once.  Nothing is expected back."""
        try:
            one = self._asked(socket)
        except HTTPException as unknown:
            await socket.send_denial_response(
                JSONResponse({"error": unknown.detail}, unknown.status_code)
            )
            return
        if one.broadcaster.full:
            await socket.close(1013)
            return
        await socket.accept()
        connection = socket.scope["state"]["connection"]
        transport = connection.transport
        if one.filter_loop.published:
            transport.write(websocket_frame(one.filter_loop.published))
        one.broadcaster.sockets.add(transport)
        try:
            while True:
                await socket.receive_text()
                await asyncio.sleep(0.05)  # limits the rate of incoming messages
        except (WebSocketDisconnect, KeyError):
            pass
        finally:
            one.broadcaster.sockets.discard(transport)
            one.broadcaster.sockets.dropped += connection.stalled

    async def events(self, request: Request) -> Response:
        """The same as server-sent events."""
        one = self._asked(request)
        if one.broadcaster.full:
            raise HTTPException(503, "too many listeners")
        stream = one.broadcaster.events(one.filter_loop.published)
        headers = {"cache-control": "no-store", "x-accel-buffering": "no"}
        return StreamingResponse(stream, media_type="text/event-stream", headers=headers)

    async def estimate(self, request: Request) -> Response:
        """The last message."""
        published = self._asked(request).filter_loop.published
        if not published:
            raise HTTPException(503, "there is no estimate yet")
        return Response(published, media_type="application/json", headers=_FRESH)

    async def history(self, request: Request) -> Response:
        """The messages of the last minutes, `seconds` of them, `every` so many seconds one."""
        seconds = _asked_number(request, "seconds", KEPT, KEPT)
        every = _asked_number(request, "every", 0.0, KEPT)
        body = history_json(self._asked(request).history.since(seconds, every))
        return await compressed(request, body, "application/json", _FRESH)

    async def list_vehicles(self, request: Request) -> Response:
        """The vehicles of the service, and whether each is located."""
        return JSONResponse([_about(one) for one in self.vehicles.values()], headers=_FRESH)

    async def list_schemas(self, request: Request) -> Response:
        """Addresses of the JSON Schemas."""
        return JSONResponse([f"/schema/{name}" for name in schemas()])

    async def schema(self, request: Request) -> Response:
        """One JSON Schema."""
        found = schemas().get(request.path_params["name"])
        if found is None:
            raise HTTPException(404, f"one of {', '.join(schemas())} was expected")
        return JSONResponse(found, media_type="application/schema+json")

    async def match(self, request: Request) -> Response:
        """A posted trace, matched for the vehicle that is asked for."""
        localizer = self._asked(request).filter_loop.localizer
        return await self.traces.answer(request, localizer.vehicle, localizer.settings)

    def _asked(self, request: HTTPConnection) -> Served:
        """The vehicle that a request names; without a name the first.

        Raises:
            HTTPException: There is none of that name.
        """
        name = request.query_params.get("vehicle")
        if name is None:
            return next(iter(self.vehicles.values()))
        found = self.vehicles.get(name)
        if found is None:
            known = ", ".join(filter(None, self.vehicles)) or "no vehicle has a name here"
            raise HTTPException(404, f"there is no vehicle {name[:40]!r}; known: {known}")
        return found

    async def health(self, request: Request) -> Response:
        """How the service is doing."""
        one = self._asked(request)
        listeners = {"listeners": one.broadcaster.listeners, "dropped": one.broadcaster.dropped}
        return JSONResponse(
            {**one.filter_loop.health(), "vehicle": one.filter_loop.vehicle, **listeners}
        )

    async def metrics(self, request: Request) -> Response:
        """The same for Prometheus."""
        one = self._asked(request)
        text = "\n".join(metrics_of(one.filter_loop, one.broadcaster)) + "\n"
        return PlainTextResponse(text, media_type="text/plain; version=0.0.4")

    async def control(self, request: Request) -> Response:
        """`{"action": ..., "value": ...}`: what the buttons of the page do."""
        action, value = await asked_of(request)
        filter_loop = self._asked(request).filter_loop
        self._act(filter_loop, action, value)
        return JSONResponse({"gnss_masked": filter_loop.gnss_masked, "play": filter_loop.play()})

    def _act(self, filter_loop: FilterLoop, action: Any, value: Any) -> None:
        if action in ("mask", "unmask"):
            filter_loop.mask(action == "mask")
        elif action == "reset_reckoning":
            filter_loop.reset_reckoning()
        elif action not in ("pause", "resume", "step", "speed", "seek"):
            raise HTTPException(400, "an unknown action")
        elif self.player is None:
            raise HTTPException(409, "time is the world's: only a recording can be played so")
        elif action == "pause":
            self.player.pause()
        elif action == "resume":
            self.player.resume()
        elif action == "step":
            self.player.step(_number(0.1 if value is None else value, 0.0, 3600.0))
        elif action == "speed":
            fast = value is None
            self.player.set_speed(None if fast else _number(value, 0.01, _FASTEST))
        else:
            self.player.seek(_number(value, 0.0, 1e9))


def application(
    service: Service,
    *,
    pages: Sequence[BaseRoute] = (),
    local: bool = True,
    token: str | None = None,
) -> Starlette:
    """The whole application.

    Args:
        service: Answers.
        pages: Routes of the page, if there is one.
        local: Whether only the own host is served.
        token: Asked of everybody; None: nobody.
    """
    access = Middleware(AccessControl, local=local, token=token, largest={"/match": LARGEST_TRACE})
    return Starlette(
        routes=[*service.routes(), *pages], middleware=[access], exception_handlers=HANDLERS
    )


def _asked_number(request: Request, name: str, usual: float, most: float) -> float:
    """A number of the address."""
    text = request.query_params.get(name)
    try:
        value = usual if text is None else float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= most:
        raise HTTPException(400, f"{name}: a number from 0 to {most:g} was expected")
    return value


def _about(one: Served) -> dict[str, Any]:
    """A row of `/vehicles`."""
    loop, said = one.filter_loop, one.filter_loop.message
    return {
        "vehicle": loop.vehicle, "answered": loop.answered, "status": loop.health()["status"],
        "epoch_s": None if said is None else said["epoch_s"],
    }  # fmt: skip


def _number(value: Any, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise HTTPException(400, f"a value from {low:g} to {high:g} was expected")
    return float(value)
