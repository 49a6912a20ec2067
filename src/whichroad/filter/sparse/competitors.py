"""Routes that compete with the one taken between two sparse fixes: which of its edges are sure?

The search keeps the cheapest way to each edge, and remembers the others as rivals.  A rival
leaves the route taken at one edge and joins it again at another one; it avoids those between.
"""

import math
from typing import NamedTuple

from ..._compile import kernel
from ...graph.labels import Search, leaves_at, mark_route, place_of
from ..state import Belief, Context
from .candidates import Departure, SparseFix, departure_of, usual_speed
from .choice import distance_cost

SHARPNESS = 1.5  # of the odds between two routes, over what their costs say


class Taken(NamedTuple):
    """A route to the edge of a fix."""

    edge: int
    to: float  # abscissa of the fix on that edge, m
    length: float  # to the start of the edge, m
    time: float  # at the usual speeds, s
    nats: float  # what the distance says of it


@kernel
def weigh_rivals(belief: Belief, ctx: Context, p: int, fix: SparseFix) -> float:
    """Weigh what is against each edge of a pair's route: the routes that avoid it.

    Args:
        belief: With the pair's source as it was before the transition.
        ctx: `against` of the labels of the pair's route is written.
        p: The pair; its route has a label.
        fix: The fix that the route leads to.

    Returns:
        What is against the whole route, over its own weight.
    """
    search = ctx.work.search
    pair = search.pair[p]
    place = mark_route(search, pair.label, pair.root)
    if place < 2:
        return 0.0
    start = departure_of(belief, ctx.roads, pair.source, fix)
    near, end = ctx.work.near[pair.goal], search.label[pair.label]
    usual = usual_speed(ctx.roads, end.length, end.time, near.edge, near.s)
    nats = distance_cost(end.length + near.s, usual, start, fix)
    taken = Taken(near.edge, near.s, end.length, end.time, nats)
    first = place_of(search, search.run[0].first)
    label = int(pair.label)
    total = 0.0
    while place > 1:
        entry = search.label[label]
        total += _weigh_list(ctx, taken, label, label, 0, start, fix)
        if entry.twin >= 0:
            total += _weigh_list(ctx, taken, label, entry.twin, first, start, fix)
        label = int(entry.parent)
        place -= 1
    return total


@kernel
def _weigh_list(
    ctx: Context, taken: Taken, label: int, owner: int, origin: int, start: Departure,
    fix: SparseFix,
) -> float:  # fmt: skip
    """Count the rivals of a label's owner: itself, or the label that it was copied from.

    `origin` is the place of their search's origin on the route, -1: it is not on it.  Returns
    the sum of their weights.
    """
    total = 0.0
    search = ctx.work.search
    place = place_of(search, label)
    way = search.label[owner]
    at = way.rival
    while at >= 0:
        rival = search.rival[at]
        at = rival.next
        left = leaves_at(search, rival.parent, origin)
        if left < 0 or left >= place - 1:  # it comes from the route behind here, or avoids nothing
            continue
        length = taken.length + rival.length - way.length
        time = taken.time + rival.time - way.time
        usual = usual_speed(ctx.roads, length, time, taken.edge, taken.to)
        more = rival.cost - way.cost - taken.nats
        more += distance_cost(length + taken.to, usual, start, fix)
        weight = math.exp(-SHARPNESS * more)
        total += weight
        _count_against(search, label, left, weight)
    return total


@kernel
def _count_against(search: Search, label: int, left: int, weight: float) -> None:
    """Add a weight against the route's edges between the place `left` and a label."""
    at = search.label[label].parent
    while place_of(search, at) > left:
        search.label[at].against += weight
        at = search.label[at].parent
