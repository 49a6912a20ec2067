"""P(edge) about nodes, for estimates: a Gaussian may lie on both sides of a node.

Where a road just runs on, hypotheses move on as a whole (`branching.run_on`).  Elsewhere one that
has passed a node may be drawn back over it by fixes, and is before it then, wherever it will turn.
"""

import math

from ..._compile import kernel
from ...graph.network import backwards, onwards
from .._simd import copy_record
from ..gaussian import normal_cdf
from ..hypotheses.successors import REACH
from ..road import track
from ..state import CAPACITY, OFF_ROAD, WHEELS, Belief, Context

AFTER = 6  # scratch of a smoothed hypothesis: the edge that followed, or NO_EDGE
ORIGIN = 4  # scratch of a part beyond a node: the row of its hypothesis
_LIGHTEST = 1e-4  # weight of a hypothesis that is shared out beyond a node


@kernel(inline=True)
def share_out(belief: Belief, ctx: Context) -> None:
    """Append, of hypotheses about a node, the part on the other side of it.

    Before the start of its edge a hypothesis is on the edge from which it came, and where its road
    just runs on it is on the next one beyond its end.  P(edge) is that of each side.  With wheels
    Gaussians are not cut at nodes, so that both sides need to be known: in hindsight they are.
    """
    state = belief.state[0]
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD or hyp.weight < _LIGHTEST:
            continue
        opposite = ctx.roads.edges[hyp.edge].opposite
        after = onwards(ctx.roads, hyp.edge)
        if state.mode == WHEELS:  # in hindsight
            after = int(hyp.scratch[AFTER])
            if after < 0:
                continue
        before = int(hyp.before)
        if before < 0:
            before = backwards(ctx.roads, hyp.edge)
        after = -1 if after == opposite else after  # who turned round was not beyond the node
        before = -1 if before == opposite else before
        if after < 0 and before < 0:
            continue
        track(belief, ctx.roads, i)
        s, sigma = hyp.along, hyp.along_sigma
        left = ctx.roads.edges[hyp.edge].length - s
        weight = hyp.weight
        if left < REACH * sigma:
            _append_part(belief, ctx, i, after, weight * normal_cdf(-left / sigma), False)
        if s < REACH * sigma:
            _append_part(belief, ctx, i, before, weight * normal_cdf(-s / sigma), True)


@kernel
def _append_part(
    belief: Belief, ctx: Context, i: int, edge: int, part: float, at_end: bool
) -> None:  # fmt: skip
    """Append a part of hypothesis i near the start or end of another edge, and take it from i.

    Nothing is done where there is no edge (-1).
    """
    state = belief.state[0]
    if edge < 0 or state.count >= CAPACITY:
        return
    hyp = belief.hyp[state.count]
    copy_record(hyp, belief.hyp[i])
    hyp.edge = edge
    road = ctx.roads.edges[edge]
    hyp.segment = road.last_vertex - 1 if at_end else road.first_vertex
    hyp.weight = part
    hyp.log_weight = math.log(max(part, 1e-300))
    hyp.scratch[ORIGIN] = i
    belief.hyp[i].weight -= part
    state.count += 1
    track(belief, ctx.roads, int(state.count) - 1)


@kernel
def take_back(belief: Belief, count: int) -> None:
    """Undo `share_out`, before which there were `count` hypotheses; the parts stay behind them."""
    state = belief.state[0]
    state.rows = state.count
    for i in range(count, state.count):
        belief.hyp[int(belief.hyp[i].scratch[ORIGIN])].weight += belief.hyp[i].weight
    state.count = count
