"""The places about a recorded drive, epoch by epoch."""

from typing import TYPE_CHECKING

from ..live.place_messages import AHEAD_M, NEARBY_M, PlaceMessages
from ..tables.relative_places import Surroundings, stances_of

if TYPE_CHECKING:
    from ..live.message_types import PlaceMessage


class PlacesAbout:
    """Asks for the places ahead and nearby.

    Args:
        drive: A matched drive and its places.
    """

    def __init__(self, drive: Surroundings) -> None:
        self._places = drive.places
        self._live = drive.output.rows.live
        self._stances = stances_of(drive.output, drive.places)
        self._messages = PlaceMessages(drive.places)

    def ahead(self, k: int) -> "list[PlaceMessage]":
        """Those within 500 m along the road at epoch k, the nearest first."""
        if not self._live[k]:
            return []
        return self._messages.of(self._places.ahead(self._stances[k].tobytes(), AHEAD_M))

    def nearby(self, k: int) -> "list[PlaceMessage]":
        """Those within 50 m in a straight line at epoch k."""
        if not self._live[k]:
            return []
        return self._messages.of(self._places.nearby(self._stances[k].tobytes(), NEARBY_M))
