"""Point objects ahead of the vehicle and near it, as they are published."""

from collections.abc import Iterable

from ..places import Places, RelativePlace
from .message_types import PlaceMessage

MOST = 20  # places of each kind in a message, the nearest,
LEAST_P = 0.01  # and no less probable than that


class PlaceMessages:
    """Makes them, with the position of each place.

    Args:
        places: The places.
    """

    def __init__(self, places: Places) -> None:
        plane, place = places.roads.plane, places.arrays.place
        lat, lon = plane.to_geodetic(place.x.copy(), place.y.copy())
        at = zip(lat.round(7).tolist(), lon.round(7).tolist(), strict=True)
        self._at = dict(zip(places.ids, at, strict=True))

    def of(self, found: Iterable[RelativePlace]) -> list[PlaceMessage]:
        """What is published of the places that were found, the nearest first."""
        likely = [one for one in found if one.p >= LEAST_P][:MOST]
        return [
            PlaceMessage(
                id=one.id,
                distance_m=round(one.distance_m, 2),
                sigma_m=round(one.sigma_m, 2),
                p=round(one.p, 4),
                lat=self._at[one.id][0],
                lon=self._at[one.id][1],
            )
            for one in likely
        ]
