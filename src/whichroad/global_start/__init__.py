"""A start from odometry and the map alone: no fix, and no pose or only a vague one.

Every stretch of every road gets a hypothesis, and all of them follow the wheels until the
turns driven fit so few roads that the ordinary belief holds them.  Until then every epoch
is estimated from the whole mixture: `ambiguous`, with probabilities that sum to one.

One more hypothesis, off the mapped roads, is as wide as the region of the search.  Its
vehicle may return to any road, so where nothing fits the search begins again.
"""

from .pose import initial_state, start_at, start_of_coarse_fix
from .prior import Components, prior_components
from .search import MAP, is_vague, search

__all__ = [
    "MAP",
    "Components",
    "initial_state",
    "is_vague",
    "prior_components",
    "search",
    "start_at",
    "start_of_coarse_fix",
]
