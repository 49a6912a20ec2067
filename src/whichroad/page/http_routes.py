"""The page's addresses, for any Starlette application."""

import gzip
import json
import math
from functools import lru_cache, partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Route

from ..errors import SettingError
from .compressed import compressed, takes_gzip
from .layer import RoadLayer, edge_of
from .static_files import STATIC, maplibre_folder

if TYPE_CHECKING:
    from ..roadmap import RoadMap

_KINDS = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
}
_KEPT = "public, max-age=31536000, immutable"  # cache header of versioned files
_FILE_LEVEL = 6  # of files that are compressed once
_EDGES = 64  # edges in one request, at most


def page_routes(
    roads: "RoadMap",
    *,
    tiles_url: str | None = None,
    tiles_by: str | None = None,
    timeline: bool = False,
) -> list[BaseRoute]:
    """The page itself, MapLibre's files, and the roads that the page draws.

    The page opens a WebSocket at `/ws` and posts to `/control`, relative to where it is.

    Args:
        roads: The map that is drawn.
        tiles_url: Raster tiles to lay below the roads, such as
            `https://tile.example/{z}/{x}/{y}.png`; none unless given.
        tiles_by: Whose tiles they are, as the map says; None: the host's name.
        timeline: Whether a whole recorded drive is served at `/timeline`.

    Returns:
        Routes for `/`, `/static/...`, `/maplibre/...`, `/roads/...` and `/favicon.ico`.

    Raises:
        SettingError: MapLibre is not installed, or the address of the tiles is not one.
    """
    layer, library = RoadLayer(roads), maplibre_folder()
    files = {path.name: path for path in STATIC.iterdir() if path.suffix in _KINDS}
    parts = {name: library / name for name in ("maplibre-gl.js", "maplibre-gl.css")}
    policy = _policy(tiles_url)
    about = {**layer.about(), "tiles_url": tiles_url, "timeline": timeline}
    if tiles_url is not None:
        about["tiles_by"] = escape(tiles_by or f"tiles: {urlsplit(tiles_url).hostname}")
    return [
        Route("/", partial(_page, files["page.html"], about, policy)),
        Route("/favicon.ico", partial(_file, files, "icon.svg")),
        Route("/static/{name}", partial(_file, files, None)),
        Route("/maplibre/{name}", partial(_file, parts, None)),
        Route("/roads/edges", partial(_edges, layer)),
        Route("/roads/near", partial(_near, layer)),
        Route("/roads/{version}/{z:int}/{x:int}/{y:int}.mvt", partial(_tile, layer)),
    ]


def _policy(tiles_url: str | None) -> str:
    """Where the page may load from: here, and where the user's own tiles are."""
    tiles = ""
    if tiles_url is not None:
        parts = urlsplit(tiles_url)
        named = all(name in tiles_url for name in ("{z}", "{x}", "{y}"))
        if parts.scheme not in ("http", "https") or not parts.netloc or not named:
            raise SettingError(
                f"tiles: {tiles_url!r} is not an address of map tiles; one such as "
                "https://tile.example/{z}/{x}/{y}.png was expected"
            )
        tiles = f" {parts.scheme}://{parts.netloc}"
    return (
        "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
        f"img-src 'self' data: blob:{tiles}; connect-src 'self'{tiles}; worker-src blob:; "
        "child-src blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


async def _page(path: Path, about: dict[str, object], policy: str, request: Request) -> Response:
    text = path.read_text("utf-8")
    encoded = json.dumps(about).replace("<", "\\u003c")
    return await compressed(
        request,
        text.replace("{{about}}", encoded).encode(),
        "text/html; charset=utf-8",
        {
            "Content-Security-Policy": policy,
            "Cache-Control": "no-cache",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
        },
    )


async def _file(files: dict[str, Path], name: str | None, request: Request) -> Response:
    path = files.get(name or request.path_params["name"])
    if path is None:
        return JSONResponse({"error": "there is no such file"}, 404)
    headers = {"Cache-Control": "no-cache", "X-Content-Type-Options": "nosniff"}
    kind, found = _KINDS[path.suffix], path.stat()
    if not takes_gzip(request.headers.get("accept-encoding", "")):
        return FileResponse(path, media_type=kind, headers=headers)
    packed = await run_in_threadpool(_packed, path, found.st_mtime_ns, found.st_size)
    etag = f'"{found.st_mtime_ns:x}-{found.st_size:x}-gzip"'
    headers |= {"Content-Encoding": "gzip", "Vary": "Accept-Encoding", "ETag": etag}
    if request.headers.get("if-none-match") == etag:
        return Response(status_code=304, headers=headers)
    return Response(packed, media_type=kind, headers=headers)


@lru_cache(maxsize=64)
def _packed(path: Path, stamp: int, size: int) -> bytes:
    """A file in gzip, compressed once for each state of it."""
    return gzip.compress(path.read_bytes(), _FILE_LEVEL, mtime=0)


async def _tile(layer: RoadLayer, request: Request) -> Response:
    at = request.path_params
    if at["version"] != layer.version:
        return JSONResponse({"error": "these are another map's tiles"}, 404)
    try:
        tile = await run_in_threadpool(layer.tile, at["z"], at["x"], at["y"])
    except ValueError as error:
        return JSONResponse({"error": str(error)}, 404)
    if not tile:
        return Response(status_code=204, headers={"Cache-Control": _KEPT})
    kind = "application/vnd.mapbox-vector-tile"
    return await compressed(request, tile, kind, {"Cache-Control": _KEPT})


async def _edges(layer: RoadLayer, request: Request) -> Response:
    """Edges by their ids, those that there are."""
    texts = request.query_params.get("ids", "").split(",")
    if len(texts) > _EDGES or not all(text.isdecimal() and len(text) < 12 for text in texts):
        return JSONResponse({"error": f"ids: 1 to {_EDGES} numbers were expected"}, 400)
    known = [int(text) for text in texts if int(text) < len(layer.roads)]
    text = json.dumps([edge_of(layer.roads, edge) for edge in known], ensure_ascii=False)
    return await compressed(request, text.encode(), "application/json")


async def _near(layer: RoadLayer, request: Request) -> Response:
    """`?lat=49.4&lon=2.7`: the street nearest to a place, as `/roads/edges` gives it."""
    try:
        lat, lon = (float(request.query_params[name]) for name in ("lat", "lon"))
        known = math.isfinite(lon) and abs(lon) <= 180.0 and abs(lat) < 85.0
    except (KeyError, ValueError):
        known = False
    if not known:
        return JSONResponse({"error": "lat and lon, degrees, were expected"}, 400)
    return JSONResponse(edge_of(layer.roads, await run_in_threadpool(layer.near, lat, lon)))
