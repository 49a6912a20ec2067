"""The road network: read, compile, store, query."""

from .opening import open_map
from .roadmap import Near, RoadMap

__all__ = ["Near", "RoadMap", "open_map"]
