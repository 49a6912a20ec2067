"""Whether fixes lie on the map: one of another region fits no road, and does not say why."""

import math

import numpy as np

from ..observations import GeoFix
from ..roadmap import RoadMap
from ..roadmap.extent import NEAR, are_near, outside_reason
from .troubles import Troubles

_EVERY = 1.0  # s between two fixes that are looked at
_IN_A_ROW = 5  # fixes off the map, from which on it is told


class OutsideMap:
    """Tells when several fixes in a row are off the map, and when one is on it again.

    Args:
        roads: The map.
        troubles: Where it is told.
    """

    def __init__(self, roads: RoadMap, troubles: Troubles) -> None:
        self._roads, self._troubles = roads, troubles
        self._seen = -math.inf  # time of the last fix that was looked at, s
        self._outside: list[tuple[float, float]] = []

    def take(self, fix: GeoFix) -> None:
        """A fix has come."""
        if abs(fix.time - self._seen) < _EVERY:
            return
        self._seen = fix.time
        place = np.array([fix.lat_deg]), np.array([fix.lon_deg])
        if are_near(*place, self._roads)[0]:
            self._outside.clear()
            self._troubles.end("map", "the fixes are on the map again")
        elif len(self._outside) < _IN_A_ROW:
            self._outside.append((fix.lat_deg, fix.lon_deg))
            if len(self._outside) == _IN_A_ROW:
                lat, lon = np.array(self._outside).T
                reason = (
                    f"none of the last {_IN_A_ROW} fixes is within {NEAR / 1e3:g} km of a road; "
                    + outside_reason(lat, lon, self._roads)
                )
                self._troubles.begin("map", reason, f"map: {reason}")
