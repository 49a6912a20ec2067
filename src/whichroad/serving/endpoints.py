"""The addresses of `whichroad serve`: those of OSRM and Valhalla, `/match` and `/health`."""

import contextlib
import os
from collections.abc import Awaitable, Callable
from typing import Any

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..live.access import AccessControl
from ..live.refusals import HANDLERS, body_of
from ..live.traces import LARGEST_TRACE, Traces
from .answering_process import ATTRIBUTES, OSRM, ROUTE, TABLES, TOO_MANY_POINTS
from .workers import Lane, TooSlow

LARGEST_BODY = 4 * 1024 * 1024  # bytes of a request of Valhalla
_LARGE = 65_536  # bytes of a request from which on it goes to the lane of large traces
MANY = 1000  # points likewise
_PER_SECOND, _BURST = 2000.0, 4000.0  # requests of one client
_ADDRESS = "whichroad.address"  # key of a scope: an address of OSRM
_PLAIN = {"/match", "/trace_attributes", "/trace_route", "/health"}


class LongAddresses:
    """Middleware that takes OSRM's addresses, which hold the trace, out of the path.

    Args:
        app: The application behind it.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if scope["type"] == "http" and scope["path"] not in _PLAIN:
            scope = {**scope, _ADDRESS: scope["path"], "path": "/osrm", "raw_path": b"/osrm"}
        await self._app(scope, receive, send)


class Endpoints:
    """Handlers.

    Args:
        usual: Processes for usual traces.
        large: Those for large ones.
        traces: Answers `POST /match` as `live` does, where a trace is no usual one.
    """

    def __init__(self, usual: Lane, large: Lane, traces: Traces) -> None:
        self.usual, self.large, self.traces = usual, large, traces

    def application(self, local: bool, token: str | None) -> Starlette:
        """The whole application.

        Args:
            local: Whether only the own host is served.
            token: Asked of everybody; None: nobody.
        """
        largest = {"/match": LARGEST_TRACE}
        largest |= dict.fromkeys(("/trace_attributes", "/trace_route"), LARGEST_BODY)
        return Starlette(
            routes=[
                Route("/osrm", self.osrm),
                Route("/trace_attributes", self._valhalla(ATTRIBUTES), methods=["GET", "POST"]),
                Route("/trace_route", self._valhalla(ROUTE), methods=["GET", "POST"]),
                Route("/match", self.tables, methods=["POST"]),
                Route("/health", self.health),
            ],
            middleware=[
                Middleware(LongAddresses),
                Middleware(
                    AccessControl, local=local, token=token, largest=largest,
                    per_second=_PER_SECOND, burst=_BURST,
                ),
            ],
            exception_handlers=HANDLERS,
        )  # fmt: skip

    async def osrm(self, request: Request) -> Response:
        """`/match/v1/{profile}/{coordinates}`; any profile is that of a car."""
        parts = request.scope.get(_ADDRESS, "/osrm").strip("/").split("/", 3)
        refused = _osrm_refusal(parts)
        if refused is not None:
            return JSONResponse(refused, 400)
        query = request.scope.get("query_string", b"").decode("latin-1")
        asked = OSRM + f"{parts[3]}\n{query}".encode("latin-1", "replace")
        return await self._answered(request, asked, parts[3].count(";"))

    async def tables(self, request: Request) -> Response:
        """`POST /match`: a usual trace by the usual lane, others in a process of their own."""
        asked = self.traces.asked(request)
        length = request.headers.get("content-length", "")
        if not (length.isdecimal() and int(length) <= _LARGE):
            return await self.traces.answer(request)
        body = await body_of(request)
        with contextlib.suppress(TooSlow):
            async with self.traces.written(asked, body) as folder:
                wanted = TABLES + os.fsencode(folder)
                status, answer = await self.usual.ask(wanted, request.is_disconnected)
            if status != TOO_MANY_POINTS:
                headers = {"vary": "accept-encoding"}
                if asked.gzip and status == 200:
                    headers["content-encoding"] = "gzip"
                return Response(answer, status, headers, "application/json")
        return _Again(body, await self.traces.answer(request))

    def _valhalla(self, kind: bytes) -> Callable[[Request], Awaitable[Response]]:
        async def handler(request: Request) -> Response:
            if request.method == "GET":
                body = request.query_params.get("json", "").encode()
            else:
                body = await body_of(request)
            return await self._answered(request, kind + body, body.count(b'"lat"'))

        return handler

    async def _answered(self, request: Request, asked: bytes, points: int) -> Response:
        """Ask the usual lane, and the large one about what is too much for that."""
        status, body = TOO_MANY_POINTS, b""
        if len(asked) <= _LARGE and points <= MANY:
            with contextlib.suppress(TooSlow):
                status, body = await self.usual.ask(asked, request.is_disconnected)
        if status == TOO_MANY_POINTS:  # an encoded line shows its length only to who decodes it
            status, body = await self.large.ask(asked, request.is_disconnected)
        return Response(body, status or 400, media_type="application/json")

    async def health(self, request: Request) -> Response:
        """How the service is doing."""
        return JSONResponse({"ok": True, "usual": _of(self.usual), "large": _of(self.large)})


class _Again(Response):
    """A response that reads the body of its request, which was read before.

    Args:
        body: The whole body.
        response: What reads it.
    """

    def __init__(self, body: bytes, response: Response) -> None:
        super().__init__()
        self._body, self._response = body, response

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send what the other one sends."""
        given = False

        async def again() -> Message:
            nonlocal given
            if given:
                return await receive()
            given = True
            return {"type": "http.request", "body": self._body, "more_body": False}

        await self._response(scope, again, send)


def _of(lane: Lane) -> dict[str, Any]:
    names = ("waiting", "answered", "refused", "left", "ended")
    return {name: getattr(lane, name) for name in names}


def _osrm_refusal(parts: list[str]) -> dict[str, str] | None:
    """What OSRM says of an address that is none."""
    if parts[0] != "match" and len(parts) == 4:
        return {"code": "InvalidService", "message": f"Service {parts[0][:40]} not found!"}
    if len(parts) < 4 or not all(parts):
        return {"code": "InvalidUrl", "message": "URL string malformed: "
                "/match/v1/{profile}/{coordinates} was expected"}  # fmt: skip
    if parts[1] != "v1":
        return {"code": "InvalidVersion", "message": f"Service {parts[0]} not found!"}
    return None
