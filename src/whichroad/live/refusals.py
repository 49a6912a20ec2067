"""What `live` and `replay` answer to a request that they cannot handle: a status, a sentence."""

import asyncio
import json
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import Receive, Scope, Send

from .access import refuse

BODY_TIME = 30.0  # s, timeout of a request's body


class Refusal(Response):
    """An error as JSON; what is left of the request's body is not taken.

    Args:
        error: Status, reason and headers.
    """

    def __init__(self, error: HTTPException) -> None:
        super().__init__(status_code=error.status_code)
        self._error = error

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        error = self._error
        await refuse(scope, receive, send, error.status_code, error.detail, headers=error.headers)


async def _refusal(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return Refusal(error)


async def _broken(request: Request, error: Exception) -> Response:
    return JSONResponse({"error": "internal error of the service; please report it"}, 500)


HANDLERS: dict[Any, Any] = {HTTPException: _refusal, Exception: _broken}


async def asked_of(request: Request) -> tuple[Any, Any]:
    """Action and value that `/control` is asked for.

    Raises:
        HTTPException: The body is something else, or does not come in time.
    """
    try:
        asked = json.loads(await body_of(request))
        return asked["action"], asked.get("value")
    except (ValueError, RecursionError, KeyError, TypeError, AttributeError):
        raise HTTPException(400, 'a JSON object with an "action" was expected') from None


async def body_of(request: Request) -> bytes:
    """The whole body of a request.

    Raises:
        HTTPException: It does not come in time.
    """
    try:
        async with asyncio.timeout(BODY_TIME):
            return await request.body()
    except TimeoutError:
        raise HTTPException(408, "the body did not come in time") from None
