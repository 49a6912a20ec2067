"""The road network: read, compile, store, query."""

from .checked import shared_map
from .edge_geometry import Near
from .folder import RoadMaps, Share, shared_maps
from .open_map import left_out, open_map
from .roadmap import RoadMap

__all__ = [
    "Near",
    "RoadMap",
    "RoadMaps",
    "Share",
    "left_out",
    "open_map",
    "shared_map",
    "shared_maps",
]
