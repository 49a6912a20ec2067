"""P of the way: of the most probable chain of edges without a decision in it.

About a node one Gaussian lies on several edges that follow each other, and P(edge) falls
although the road is as sure as before.  Their sum does not.  Where a road forks, a chain holds
one branch.  What lies on another branch counts while it is at the node, where nothing has been
decided yet, and lowers P of the way from there on.
"""

from ..._compile import Record, kernel
from ...graph.network import TURN_BANNED, U_TURN, Roads
from .._simd import new_row
from ..records import ALTERNATIVES
from ..state import Belief, Context

_LEAST = 1e-4  # P of an edge that matters to a chain


@kernel(inline=True)
def find_chain(roads: Roads, ranking: Record, p_edge: float, on_roads: float) -> None:
    """Find the most probable chain among ranked edges, and its P.

    With edges in any order, and p_i their P, over chains of different edges:

        best_j = p_j + max(0, max over i that j follows of best_i)

    Args:
        roads: The network.
        ranking: `edge` and `p` are read, `chain` and `p_chain` set.
        p_edge: P of the most probable edge; 0 where none is named.
        on_roads: P of all roads.
    """
    ranking.chain = 0
    ranking.p_chain = p_edge
    if p_edge < _LEAST or p_edge > on_roads - _LEAST:
        return
    ranking.chain = _likeliest_chain(roads, ranking)
    ranking.p_chain = 0.0
    for a in range(ALTERNATIVES):
        if ranking.chain & (1 << a) > 0:
            ranking.p_chain += float(ranking.p[a])


@kernel
def way_share(belief: Belief, ctx: Context, ranking: Record, p_edge: float, off: float) -> float:
    """P of the way: of the most probable chain, and of what is undecided beside it.

    To the chain is added P of the hypotheses that are within `node_radius` behind a node of
    it, on another edge that leaves it.

    Args:
        belief: Normalised.
        ctx: The drive's constants.
        ranking: With the chain.
        p_edge: P of the most probable edge, at least which the answer is.
        off: P(off the roads), beside which it is at most the rest.
    """
    if ranking.chain == 0:
        return p_edge
    undecided = (1.0 - ctx.par[0].unknown) * _undecided(belief, ctx, ranking)
    return float(max(p_edge, min(ranking.p_chain + undecided, 1.0 - off)))


@kernel
def _likeliest_chain(roads: Roads, ranking: Record) -> int:
    """The ranked edges in the chain of the largest P, as bits."""
    best, chain = new_row(), new_row()
    n = 0
    while n < ALTERNATIVES and ranking.p[n] >= _LEAST:
        best[n] = ranking.p[n] if ranking.edge[n] >= 0 else 0.0
        chain[n] = 1 << n
        n += 1
    grown = (1 << n) - 1  # chains that are longer than when they were last followed, as bits
    rounds = 1
    while grown != 0 and rounds < n:
        rounds += 1
        last, grown = grown, 0
        for i in range(n):
            if (last | grown) & (1 << i) == 0:
                continue
            for j in range(n):
                longer = best[i] + ranking.p[j]
                if longer <= best[j] or int(chain[i]) & (1 << j) > 0:
                    continue
                if follows(roads, ranking.edge[i], ranking.edge[j]):
                    best[j] = longer
                    chain[j] = chain[i] + (1 << j)
                    grown |= 1 << j
    top = 0
    for j in range(1, n):
        if best[j] > best[top]:
            top = j
    return int(chain[top])


@kernel
def follows(roads: Roads, edge: int, after: int) -> bool:
    """Whether an edge follows another one by a turn that is neither banned nor a U-turn."""
    if edge < 0 or after < 0 or after == roads.edges[edge].opposite:
        return False
    for t in range(roads.edges[edge].first_turn, roads.edges[edge].end_turn):
        if roads.turns[t].edge == after:
            return int(roads.turns[t].rule) & (TURN_BANNED | U_TURN) == 0
    return False


@kernel
def _undecided(belief: Belief, ctx: Context, ranking: Record) -> float:
    """Weight of the hypotheses just behind a node of the chain, on edges beside it."""
    total = 0.0
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge < 0 or hyp.along > ctx.par[0].node_radius:
            continue
        node = ctx.roads.edges[hyp.edge].from_node
        beside = False
        for a in range(ALTERNATIVES):
            if ranking.chain & (1 << a) == 0:
                continue
            edge = ranking.edge[a]
            road = ctx.roads.edges[edge]
            if hyp.edge == edge or hyp.edge == road.opposite:
                beside = False
                break
            beside = beside or road.from_node == node or road.to_node == node
        if beside:
            total += hyp.weight
    return total
