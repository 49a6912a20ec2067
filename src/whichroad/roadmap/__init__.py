"""The road network: read, compile, store, query."""

from .checked import shared_map
from .open_map import open_map
from .roadmap import Near, RoadMap

__all__ = ["Near", "RoadMap", "open_map", "shared_map"]
