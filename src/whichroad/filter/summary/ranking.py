"""The most probable edges of an epoch, in order, and the one that is told."""

from ..._compile import Record, kernel
from ..records import ALTERNATIVES
from ..state import NO_EDGE, OFF_ROAD, Belief, Context
from .way import find_chain


@kernel
def rank(belief: Belief, ctx: Context, off: float, unknown: float) -> None:
    """Rank the edges by P, choose the one that is told, and find its way.

    Args:
        belief: Normalised; its ranking is set.
        ctx: The drive's constants.
        off: P(off the roads), what is unknown included.
        unknown: P of what no hypothesis knows.
    """
    ranking = belief.state[0].ranking
    ranking.unknown = unknown
    _rank(belief, ranking, unknown)
    edge = ranking.edge[0]
    if edge == OFF_ROAD and ranking.edge[1] >= 0 and off <= 0.5:
        edge = ranking.edge[1]
    ranking.chosen = edge
    ranking.best = -1
    ranking.p_chosen = 0.0
    ranking.facing = 0.0
    if edge >= 0:
        _sum_up(belief, ranking)
        opposite = ctx.roads.edges[edge].opposite
        for a in range(ALTERNATIVES):
            if ranking.edge[a] >= 0 and ranking.edge[a] == opposite:
                ranking.facing += float(ranking.p[a])
    find_chain(ctx.roads, ranking, (1.0 - unknown) * ranking.p_chosen, 1.0 - off)


@kernel(inline=True)
def _sum_up(belief: Belief, ranking: Record) -> None:
    """P of the chosen edge, and its heaviest hypothesis."""
    best = -1
    for i in range(belief.state[0].count):
        if belief.hyp[i].edge == ranking.chosen:
            ranking.p_chosen += belief.hyp[i].weight
            if best < 0 or belief.hyp[i].log_weight > belief.hyp[best].log_weight:
                best = i
    ranking.best = best


@kernel(inline=True)
def _rank(belief: Belief, ranking: Record, unknown: float) -> None:
    """The most probable edges, components of one edge added up."""
    n = belief.state[0].count
    for a in range(ALTERNATIVES):
        ranking.edge[a] = NO_EDGE
        ranking.p[a] = 0.0
    filled = 0
    for i in range(n):
        edge = belief.hyp[i].edge
        j = 0
        while belief.hyp[j].edge != edge:
            j += 1
        if j < i:
            continue  # its components have been added up
        p = 0.0
        best = i
        for j in range(i, n):
            if belief.hyp[j].edge == edge:
                p += belief.hyp[j].weight
                if belief.hyp[j].weight > belief.hyp[best].weight:
                    best = j
        p *= 1.0 - unknown
        if edge == OFF_ROAD:
            p += unknown
        slot = filled
        while slot > 0 and ranking.p[slot - 1] < p:
            slot -= 1
        if slot < ALTERNATIVES and p > 0.0:
            filled = min(filled + 1, ALTERNATIVES)
            for a in range(filled - 1, slot, -1):
                ranking.edge[a] = ranking.edge[a - 1]
                ranking.p[a] = ranking.p[a - 1]
                ranking.row[a] = ranking.row[a - 1]
            ranking.edge[slot] = edge
            ranking.p[slot] = p
            ranking.row[slot] = best
