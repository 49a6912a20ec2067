"""A start from odometry and the map alone: no fix, and no pose or only a vague one.

Every piece of every road gets a hypothesis, and all of them follow the wheels until the
turns driven fit so few roads that the ordinary belief holds them.  Meanwhile every epoch
is answered from the whole population: `ambiguous`, with probabilities that sum to one.

One more hypothesis, on none of the mapped roads, is as wide as the place looked at.  Its
vehicle may come on to any road, so where nothing fits the search begins again.
"""

from .follow import MAP, is_vague, search, set_clock
from .pieces import Pieces, pieces_of
from .pose import start_at

__all__ = ["MAP", "Pieces", "is_vague", "pieces_of", "search", "set_clock", "start_at"]
