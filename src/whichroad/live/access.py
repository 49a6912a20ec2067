"""Access control of the web service: the checks that come before a request is handled.

The defaults are closed.  Only this host is served, and no other origin.  Requests and
bytes are limited to what a person needs.  A token is required where one is set.
"""

import hmac
import json
import time
from collections import OrderedDict
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from starlette.types import ASGIApp, Message, Receive, Scope, Send

_COOKIE = "whichroad"
_LOCAL = frozenset({"localhost", "127.0.0.1", "::1"})
_MOST_CALLERS = 4096
_SMALL_BODY = 16_384  # bytes, largest request body without a length limit of its own
_SAFE = [(b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"no-referrer")]


class TooLarge(Exception):
    """A request body exceeds its limit."""


class AccessControl:
    """Middleware that passes a request on or answers 4xx.

    Args:
        app: The application behind it.
        local: Whether requests must name this host.
        token: Token that every request must carry; None: no token.
        per_second: Sustained requests per second of one client.
        burst: Requests that one client may send at once.
        largest: Largest body in bytes, by path.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        local: bool = True,
        token: str | None = None,
        per_second: float = 100.0,
        burst: float = 500.0,
        largest: dict[str, int] | None = None,
    ) -> None:
        self._app, self._local, self._token = app, local, token
        self._per_second, self._burst = per_second, burst
        self._largest = largest or {}
        self._allowed: OrderedDict[str, tuple[float, float]] = OrderedDict()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request or connection."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {
            key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]
        }
        refused = self._refused(scope, headers)
        if refused is not None:
            await _refuse(scope, receive, send, *refused)
            return
        most = self._largest.get(scope["path"], _SMALL_BODY)
        length = headers.get("content-length", "0")
        if not length.isdecimal() or int(length) > most:
            await _refuse(scope, receive, send, 413, f"at most {most} bytes are taken here")
            return
        seen = 0

        async def bounded() -> Message:
            nonlocal seen
            message = await receive()
            if message["type"] == "http.request":
                seen += len(message.get("body", b""))
                if seen > most:
                    raise TooLarge
            return message

        begun = False

        async def dressed(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                message = {
                    **message,
                    "headers": [*message["headers"], *_SAFE, *self._cookie(scope)],
                }
            await send(message)

        try:
            await self._app(scope, bounded, dressed)
        except TooLarge:
            if not begun:
                await _refuse(scope, receive, send, 413, f"at most {most} bytes are taken here")

    def _refused(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        """Status and reason of a refusal; None: the request is allowed."""
        caller = scope["client"][0] if scope.get("client") else ""
        if not self._may_ask(caller):
            return 429, "too many requests"
        host = headers.get("host", "")
        if self._local and (urlsplit(f"//{host}").hostname or "") not in _LOCAL:
            return 403, "this host is not served"
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return 403, "other origins are not served"
        if self._token is not None and not self._knows_token(scope, headers):
            return 401, "a token is needed"
        return None

    def _may_ask(self, caller: str) -> bool:
        now = time.monotonic()
        left, since = self._allowed.pop(caller, (self._burst, now))
        left = min(left + (now - since) * self._per_second, self._burst)
        if len(self._allowed) >= _MOST_CALLERS:
            self._allowed.popitem(last=False)
        self._allowed[caller] = (max(left - 1.0, 0.0), now)
        return left >= 1.0

    def _knows_token(self, scope: Scope, headers: dict[str, str]) -> bool:
        assert self._token is not None
        offered = [
            headers.get("authorization", "").removeprefix("Bearer "),
            _query_token(scope) or "",
        ]
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(_COOKIE)
        except CookieError:
            cookie = None
        offered.append(cookie.value if cookie else "")
        token = self._token.encode()
        return any(hmac.compare_digest(one.encode(), token) for one in offered)

    def _cookie(self, scope: Scope) -> list[tuple[bytes, bytes]]:
        """The cookie that keeps the token in a browser that was opened with it."""
        if self._token is None or _query_token(scope) != self._token:
            return []
        value = f"{_COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
        return [(b"set-cookie", value.encode())]


def _query_token(scope: Scope) -> str | None:
    try:
        found: list[str] = parse_qs(scope.get("query_string", b"").decode("latin-1")).get(
            "token", []
        )
    except ValueError:
        return None
    return found[0] if found else None


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, why: str) -> None:
    """Answer with an error and do not call the application."""
    body = json.dumps({"error": why}).encode()
    if scope["type"] == "websocket":
        await receive()
        if "websocket.http.response" not in scope.get("extensions", {}):
            await send({"type": "websocket.close", "code": 1008})
            return
    kind = "http" if scope["type"] == "http" else "websocket.http"
    headers: list[Any] = [
        (b"content-type", b"application/json"), (b"content-length", str(len(body)).encode()),
        (b"connection", b"close"), *_SAFE,
    ]  # fmt: skip
    await send({"type": f"{kind}.response.start", "status": status, "headers": headers})
    await send({"type": f"{kind}.response.body", "body": body})
