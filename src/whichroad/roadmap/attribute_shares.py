"""An attribute of the road that is driven: its values, each with the probability of its roads."""

from collections.abc import Iterable
from typing import Any

from .roadmap import RoadMap


def shares_by_value(
    roads: RoadMap, column: str, places: Iterable[tuple[int, float | None, float]]
) -> list[tuple[Any, float]]:
    """Values of an attribute with P, the most probable first.

    Args:
        roads: The map.
        column: Of `attribute_names.known_name`.
        places: Edge, m from its start (None: its longest piece) and P, of each road.

    Returns:
        Each value once.  None has what the roads leave of 1, and the roads without a value.
    """
    shares: dict[Any, float] = {}
    known = 0.0
    for edge, s, p in places:
        value = roads.attribute(column, edge, s)
        shares[value] = shares.get(value, 0.0) + p
        known += p
    if known < 1.0:
        shares[None] = shares.get(None, 0.0) + 1.0 - known
    return sorted(shares.items(), key=lambda share: -share[1])
