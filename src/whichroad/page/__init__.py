"""What a browser sees: the page, the roads of the map by viewport, one file for a report.

The page draws the messages that are sent to it and asks for nothing outside: MapLibre GL
is npm's, of the wheel or the cache (`static_files`), the roads from the compiled map.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .http_routes import page_routes as page_routes
    from .layer import RoadLayer as RoadLayer


def __getattr__(name: str) -> object:
    if name == "page_routes":
        from .http_routes import page_routes

        return page_routes
    if name == "RoadLayer":
        from .layer import RoadLayer

        return RoadLayer
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
