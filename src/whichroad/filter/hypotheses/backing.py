"""Hypotheses that back over the start of their edge: onto what leads there.

With a heading sensor the plane moves them, and what has passed stays as it is.  Without one the
road does: what backs over the start is truncated there, and where the road just runs on before it
the whole hypothesis is on the edge before, as nothing is decided.
"""

import math

from ..._compile import Record, kernel
from ...graph.network import backwards
from ..gaussian import normal_cdf, reshape_on_map, truncated_moments
from ..state import (
    CAPACITY,
    NO_BOUND,
    WHEELS,
    Belief,
    Context,
    Path,
    enter,
    rescale,
    spawn,
)

LEAST_SHARE = 0.3  # of the pruning floor: weight of what branches


@kernel
def back_up(belief: Belief, ctx: Context, i: int, arc: float) -> bool:
    """Reversing: the hazard of passing the edge's start goes to its predecessors.

    Args:
        belief: In place; children are appended.
        ctx: The drive's constants.
        i: The hypothesis; it is tracked.
        arc: What it has backed, m.

    Returns:
        Whether there are any.
    """
    hyp = belief.hyp[i]
    road = ctx.roads.edges[hyp.edge]
    count = 0
    for t in range(road.first_predecessor, road.end_predecessor):
        if ctx.roads.predecessors[t] != road.opposite:
            count += 1
    z = hyp.along / hyp.along_sigma
    density = math.exp(-0.5 * z**2) * 0.3989422804014327 / hyp.along_sigma
    share = min(arc * density / max(normal_cdf(z), 0.02), 0.9)
    if count == 0 or share * hyp.weight < LEAST_SHARE * ctx.par[0].prune:
        return False
    given = 0.0
    for t in range(road.first_predecessor, road.end_predecessor):
        before = ctx.roads.predecessors[t]
        if before == road.opposite or belief.state[0].count >= CAPACITY:
            continue
        given += share / count
        last = ctx.roads.edges[before].last_vertex - 1
        child = belief.hyp[spawn(belief, i, share / count, before, last)]
        child.p_not_passed = 1.0
        if belief.state[0].mode != WHEELS:
            _truncate(belief, ctx, i, child)
    rescale(hyp, 1.0 - given)
    return True


@kernel
def _truncate(belief: Belief, ctx: Context, i: int, child: Record) -> None:
    """Truncate a child, which is where hypothesis i is, to what is before the start of i's edge."""
    hyp = belief.hyp[i]
    at, variance = truncated_moments(hyp.along, hyp.along_sigma, -NO_BOUND, 0.0)
    shrink = variance / hyp.along_sigma**2
    tx, ty = hyp.tangent[0], hyp.tangent[1]
    reshape_on_map(child.mu, child.cov, tx, ty, at - hyp.along, shrink, belief.state[0].scale)
    child.bound = ctx.roads.edges[child.edge].length
    child.along = child.bound + at
    child.along_sigma = math.sqrt(variance)


@kernel
def run_back(belief: Belief, path: Path, ctx: Context, i: int, s: float) -> float:
    """Move hypothesis i back, as a whole, where its road just runs on before its edge.

    Args:
        belief: Its edge is set.
        path: Edges that it passes are entered.
        ctx: The drive's constants.
        i: The hypothesis.
        s: Its abscissa, m.

    Returns:
        Its abscissa there.
    """
    hyp = belief.hyp[i]
    before = backwards(ctx.roads, hyp.edge) if s < 0.0 else -1
    while before >= 0 and s < 0.0:
        if hyp.new_edge == 1:
            hyp.path_entry = enter(path, hyp.edge, hyp.path_entry, belief.state[0].time, 0.0)
        s += ctx.roads.edges[before].length
        hyp.edge = before
        hyp.segment = ctx.roads.edges[before].last_vertex - 1
        hyp.new_edge = 1
        hyp.p_not_passed = 1.0
        hyp.bound = NO_BOUND
        before = backwards(ctx.roads, before)
    return s
