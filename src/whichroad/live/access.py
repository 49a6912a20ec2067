"""Access control of `live` and `replay`: the checks that come before a request is handled.

The defaults are closed.  Only this host is served, and no other origin.  Requests and
bytes are limited to what a person needs.  A token is required where one is set.
"""

import asyncio
import hmac
import ipaddress
import json
import re
import time
from collections import OrderedDict
from collections.abc import Mapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .web_server import READ_AT_ONCE

_COOKIE = "whichroad"
_MOST_CALLERS = 4096
_LONGEST_PATH = 1000  # characters of an address without its query
_SMALL_BODY = 16_384  # bytes, largest request body without a length limit of its own
_MOST_HELD = 48 * 1024 * 1024  # bytes of bodies that are being received, over all connections
_DRAINED = 256 * 1024  # bytes of a refused body that are read, at most
_AT_ONCE = 2 * READ_AT_ONCE  # bytes of it that may come in one message
_DRAIN_TIME = 1.0  # s for which they are read, at most
_NOTICED = 0.25  # s for which a longer body waits unread: closed at once, the answer may be lost
_READ = "whichroad.body_read"  # key of a scope: the whole body was taken
_SAFE = [(b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"no-referrer")]
_PLACE = r"(\[[0-9a-f:.]+\]|[a-z0-9._~%-]*)(:[0-9]{0,5})?"
_HOST = re.compile(_PLACE, re.IGNORECASE)
_ORIGIN = re.compile(rf"null|[a-z][a-z0-9+.-]*://{_PLACE}", re.IGNORECASE)

Headers = dict[str, str]


class TooLarge(Exception):
    """A request body exceeds its limit."""


class TooMany(Exception):
    """All request bodies together exceed their limit."""


def is_local(host: str) -> bool:
    """Whether a name or an address is this machine's own, seen by nobody else."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


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
        self._held = 0  # bytes of bodies that are being received

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request or connection."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        most = self._largest.get(scope["path"], _SMALL_BODY)
        too_large = 413, f"at most {most} bytes are taken here"
        headers = headers_of(scope)
        refused = self._refused(scope, headers)
        if refused is None and not _fits(headers, most):
            refused = too_large
        if refused is not None:
            await refuse(scope, receive, send, *refused)
            return
        seen = 0

        async def bounded() -> Message:
            nonlocal seen
            message = await receive()
            if message["type"] == "http.request":
                scope[_READ] = not message.get("more_body", False)
                size = len(message.get("body", b""))
                seen += size
                self._held += size
                if seen > most:
                    raise TooLarge
                if self._held > _MOST_HELD:
                    raise TooMany
            return message

        begun = False

        async def dressed(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                given = message["headers"]
                safe = [one for one in _SAFE if one not in given]
                message = {**message, "headers": [*given, *safe, *self._cookie(scope)]}
            await send(message)

        try:
            await self._app(scope, bounded, dressed)
        except TooLarge:
            if not begun:
                await refuse(scope, receive, send, *too_large)
        except TooMany:
            if not begun:
                await refuse(scope, receive, send, 503, "too many bodies at once")
        except ClientDisconnect:
            pass  # there is nobody to answer
        finally:
            self._held -= seen

    def _refused(self, scope: Scope, headers: Headers) -> tuple[int, str] | None:
        """Status and reason of a refusal; None: the request is allowed."""
        caller = scope["client"][0] if scope.get("client") else ""
        if not self._may_ask(caller):
            return 429, "too many requests"
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if not _HOST.fullmatch(host):
            return 400, "the Host header is malformed"
        if self._local and not is_local(_name(host)):
            return 403, "this host is not served"
        if origin is not None and not _ORIGIN.fullmatch(origin):
            return 400, "the Origin header is malformed"
        if origin is not None and urlsplit(origin.lower()).netloc != host:
            return 403, "other origins are not served"
        if self._token is not None and not self._knows_token(scope, headers):
            return 401, "a token is needed"
        if len(scope["path"]) > _LONGEST_PATH:
            return 414, f"an address of at most {_LONGEST_PATH} characters was expected"
        if scope.get("method") in ("GET", "HEAD") and _has_body(headers):
            return 400, "a request without a body was expected"
        return None

    def _may_ask(self, caller: str) -> bool:
        now = time.monotonic()
        left, since = self._allowed.pop(caller, (self._burst, now))
        left = min(left + (now - since) * self._per_second, self._burst)
        if len(self._allowed) >= _MOST_CALLERS:
            self._allowed.popitem(last=False)
        self._allowed[caller] = (max(left - 1.0, 0.0), now)
        return left >= 1.0

    def _knows_token(self, scope: Scope, headers: Headers) -> bool:
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


def headers_of(scope: Scope) -> Headers:
    """A request's headers as text."""
    return {key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]}


def _name(host: str) -> str:
    """A Host header without its port, brackets and the dot of a full name."""
    if host.startswith("["):
        return host[1 : host.index("]")]
    return host.partition(":")[0].removesuffix(".")


def _fits(headers: Headers, most: int) -> bool:
    length = headers.get("content-length", "0")
    return length.isdecimal() and len(length) < 19 and int(length) <= most


def _has_body(headers: Headers) -> bool:
    return "transfer-encoding" in headers or headers.get("content-length", "0").strip("0") != ""


def _query_token(scope: Scope) -> str | None:
    try:
        found: list[str] = parse_qs(scope.get("query_string", b"").decode("latin-1")).get(
            "token", []
        )
    except ValueError:
        return None
    return found[0] if found else None


async def refuse(
    scope: Scope, receive: Receive, send: Send, status: int, why: str,
    *, headers: Mapping[str, str] | None = None,
) -> None:  # fmt: skip
    """Answer with an error and do not call the application.

    The body of the request is not taken.  A little of it is read, so that a client that sends
    before it reads finds the answer; then the connection is closed.

    Args:
        scope: Of the request.
        receive: Gives its body.
        send: Takes the answer.
        status: Of the answer.
        why: In words.
        headers: More headers of the answer.
    """
    body = json.dumps({"error": why}).encode()
    if scope["type"] == "websocket":
        await receive()
        if "websocket.http.response" not in scope.get("extensions", {}):
            await send({"type": "websocket.close", "code": 1008})
            return
    kind = "http" if scope["type"] == "http" else "websocket.http"
    given = {"retry-after": "1"} if status in (429, 503) else {}
    given |= {name.lower(): value for name, value in (headers or {}).items()}
    head: list[Any] = [
        (b"content-type", b"application/json"), (b"content-length", str(len(body)).encode()),
        (b"connection", b"close"), *_SAFE,
        *((name.encode(), value.encode()) for name, value in given.items()),
    ]  # fmt: skip
    await send({"type": f"{kind}.response.start", "status": status, "headers": head})
    if kind == "http" and _has_body(headers_of(scope)) and not scope.get(_READ, False):
        await send({"type": "http.response.body", "body": body, "more_body": True})
        body = b""
        await _drain(scope, receive)
    await send({"type": f"{kind}.response.body", "body": body})


async def _drain(scope: Scope, receive: Receive) -> None:
    """Read some of a body that nobody takes, for a short time."""
    connection = scope.get("state", {}).get("http")
    if connection is not None:
        connection.ask_for_no_body()
    left = _DRAINED
    try:
        async with asyncio.timeout(_DRAIN_TIME):
            while left >= _AT_ONCE:
                message = await receive()
                left -= len(message.get("body", b""))
                if message["type"] != "http.request" or not message.get("more_body", False):
                    return
            await asyncio.sleep(_NOTICED)  # a sender that must wait looks for an answer
    except (TimeoutError, TooLarge, TooMany):
        return
