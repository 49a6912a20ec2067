"""The road network: read, compile, store, query."""

from .roadmap import Near, RoadMap

__all__ = ["Near", "RoadMap"]
