"""The situations that the tests drive through: small hand-made maps and exact drives."""

from .drives import Truth, drive_along, epochs_of, gnss
from .filter import Town, localize, steps
from .networks import grid_town, network, parallel_roads, straight_road

__all__ = [
    "Town",
    "Truth",
    "drive_along",
    "epochs_of",
    "gnss",
    "grid_town",
    "localize",
    "network",
    "parallel_roads",
    "steps",
    "straight_road",
]
