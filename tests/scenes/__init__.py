"""The situations that the tests drive through: small hand-made maps and exact drives."""

from .beliefs import (
    On,
    belief_on,
    doubt_map,
    edge_weights,
    living,
    roomy_belief,
    untouched,
    weights,
)
from .drives import Truth, brake, drive_along, epochs_of, gnss, wandering
from .filter import Town, column, columns, localize, steps
from .kernels import context
from .networks import grid_town, network, parallel_roads, straight_road

__all__ = [
    "On",
    "Town",
    "Truth",
    "belief_on",
    "brake",
    "column",
    "columns",
    "context",
    "doubt_map",
    "drive_along",
    "edge_weights",
    "epochs_of",
    "gnss",
    "grid_town",
    "living",
    "localize",
    "network",
    "parallel_roads",
    "roomy_belief",
    "steps",
    "straight_road",
    "untouched",
    "wandering",
    "weights",
]
