"""Point objects of the map, located relative to the vehicle: what is ahead, what is near."""

from .places import AHEAD_M, NEARBY_M, Places, RelativePlace, StanceReader, places_on

__all__ = ["AHEAD_M", "NEARBY_M", "Places", "RelativePlace", "StanceReader", "places_on"]
