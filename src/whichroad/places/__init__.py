"""Point objects of the map, located relative to the vehicle: what is ahead, what is near."""

from .places import Places, RelativePlace, StanceReader, places_on

__all__ = ["Places", "RelativePlace", "StanceReader", "places_on"]
