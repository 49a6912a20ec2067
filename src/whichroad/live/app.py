"""The HTTP and WebSocket endpoints of the live service, as a Starlette application."""

import asyncio
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from .access import AccessControl
from .broadcaster import Broadcaster, websocket_frame
from .filter_loop import FilterLoop
from .health import label, metric
from .playback import Player
from .refusals import HANDLERS, asked_of
from .traces import LARGEST_TRACE, Traces

_FASTEST = 1000.0


class Service:
    """Handlers of the endpoints.

    Args:
        filter_loop: The filter.
        broadcaster: Its listeners.
        player: Plays a recording; None: live inputs.
        compiled: The file of the map, where it is a compiled one.
    """

    def __init__(
        self, filter_loop: FilterLoop, broadcaster: Broadcaster, player: Player | None = None,
        compiled: Path | None = None,
    ) -> None:  # fmt: skip
        self.filter_loop, self.broadcaster, self.player = filter_loop, broadcaster, player
        localizer = filter_loop.localizer
        self.traces = Traces(localizer.roads, localizer.vehicle, localizer.settings, compiled)
        filter_loop.sinks.append(broadcaster.send)

    def routes(self) -> list[BaseRoute]:
        """All endpoints but the page's."""
        return [
            WebSocketRoute("/ws", self.websocket),
            Route("/events", self.events),
            Route("/estimate", self.estimate),
            Route("/health", self.health),
            Route("/metrics", self.metrics),
            Route("/match", self.traces.answer, methods=["POST"]),
            Route("/control", self.control, methods=["POST"]),
        ]

    async def websocket(self, socket: WebSocket) -> None:
        """Every message as it is made; the last one at once.  Nothing is expected back."""
        if self.broadcaster.full:
            await socket.close(1013)
            return
        await socket.accept()
        connection = socket.scope["state"]["connection"]
        transport = connection.transport
        if self.filter_loop.published:
            transport.write(websocket_frame(self.filter_loop.published))
        self.broadcaster.sockets.add(transport)
        try:
            while True:
                await socket.receive_text()
                await asyncio.sleep(0.05)  # limits the rate of incoming messages
        except (WebSocketDisconnect, KeyError):
            pass
        finally:
            self.broadcaster.sockets.discard(transport)
            self.broadcaster.sockets.dropped += connection.stalled

    async def events(self, request: Request) -> Response:
        """The same as server-sent events."""
        if self.broadcaster.full:
            raise HTTPException(503, "too many listeners")
        stream = self.broadcaster.events(self.filter_loop.published)
        headers = {"cache-control": "no-store", "x-accel-buffering": "no"}
        return StreamingResponse(stream, media_type="text/event-stream", headers=headers)

    async def estimate(self, request: Request) -> Response:
        """The last message."""
        if not self.filter_loop.published:
            raise HTTPException(503, "there is no estimate yet")
        headers = {"cache-control": "no-store"}
        return Response(self.filter_loop.published, media_type="application/json", headers=headers)

    async def health(self, request: Request) -> Response:
        """How the service is doing."""
        listeners = {"listeners": self.broadcaster.listeners, "dropped": self.broadcaster.dropped}
        return JSONResponse({**self.filter_loop.health(), **listeners})

    async def metrics(self, request: Request) -> Response:
        """The same for Prometheus."""
        text = "\n".join(_metrics(self.filter_loop, self.broadcaster)) + "\n"
        return PlainTextResponse(text, media_type="text/plain; version=0.0.4")

    async def control(self, request: Request) -> Response:
        """`{"action": ..., "value": ...}`: what the buttons of the page do."""
        action, value = await asked_of(request)
        self._act(action, value)
        return JSONResponse(
            {"gnss_masked": self.filter_loop.gnss_masked, "play": self.filter_loop.play()}
        )

    def _act(self, action: Any, value: Any) -> None:
        if action in ("mask", "unmask"):
            self.filter_loop.mask(action == "mask")
        elif action == "reset_reckoning":
            self.filter_loop.reset_reckoning()
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


def _number(value: Any, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise HTTPException(400, f"a value from {low:g} to {high:g} was expected")
    return float(value)


def _metrics(filter_loop: FilterLoop, broadcaster: Broadcaster) -> list[str]:
    """Lines of the Prometheus text format."""
    message, health = filter_loop.message, filter_loop.health()
    sensors = {f'{{sensor="{label(s["name"])}"}}': s for s in health["sensors"]}
    lines = metric(
        "whichroad_messages_total", "counter", "Messages published.", {"": filter_loop.seq}
    )
    lines += metric(
        "whichroad_observations_total", "counter", "Observations taken, by input.",
        {key: s["count"] for key, s in sensors.items()},
    )  # fmt: skip
    lines += metric(
        "whichroad_skipped_total", "counter", "Records that could not be used, by input.",
        {key: s["skipped"] for key, s in sensors.items()},
    )  # fmt: skip
    lines += metric(
        "whichroad_sensor_up", "gauge", "1: the input delivers.",
        {key: int(s["ok"]) for key, s in sensors.items()},
    )  # fmt: skip
    lines += metric("whichroad_listeners", "gauge", "Listeners.", {"": broadcaster.listeners})
    lines += metric(
        "whichroad_dropped_total", "counter", "Listeners too slow.", {"": broadcaster.dropped}
    )
    late = filter_loop.buffer.skipped["late"]
    lines += metric("whichroad_late_total", "counter", "Observations too late.", {"": late})
    if message is not None:
        lines += metric("whichroad_p_road", "gauge", "P of the road.", {"": message["p_road"]})
        off = message["p_off_road"]
        lines += metric("whichroad_p_off_road", "gauge", "P of being off the roads.", {"": off})
        level = message["protection_m"]
        level = math.inf if level is None else level
        lines += metric("whichroad_protection_meters", "gauge", "Protection level.", {
            "": "+Inf" if level == math.inf else level})  # fmt: skip
    name = "whichroad_latency_seconds"
    lines += [f"# HELP {name} From arrival to publication.", f"# TYPE {name} histogram"]
    return lines + filter_loop.latency.histogram(name)
