"""Answers in gzip for those who take it, compressed beside the event loop."""

import asyncio
import gzip
from collections.abc import Mapping

from starlette.requests import Request
from starlette.responses import Response

_SMALLEST = 1000  # bytes from which compression pays
LEVEL = 1  # text shrinks to a seventh; higher levels gain little and take several times as long


def takes_gzip(accept: str) -> bool:
    """Whether an `Accept-Encoding` header allows gzip (RFC 9110, section 12.5.3)."""
    weights: dict[str, float] = {}
    for part in accept.lower().split(","):
        name, _, rest = part.partition(";")
        weight = rest.strip().removeprefix("q=").strip() if rest else "1"
        try:
            weights[name.strip()] = float(weight)
        except ValueError:
            weights[name.strip()] = 0.0
    return weights.get("gzip", weights.get("*", 0.0)) > 0.0


async def compressed(
    request: Request, body: bytes, kind: str, headers: Mapping[str, str] | None = None
) -> Response:
    """An answer, in gzip where the client takes it and the body is worth it.

    Args:
        request: What is answered.
        body: The whole body.
        kind: Its media type.
        headers: More headers.
    """
    given = {**(headers or {}), "vary": "accept-encoding"}
    if len(body) >= _SMALLEST and takes_gzip(request.headers.get("accept-encoding", "")):
        body = await asyncio.to_thread(gzip.compress, body, LEVEL, mtime=0)
        given["content-encoding"] = "gzip"
    return Response(body, media_type=kind, headers=given)
