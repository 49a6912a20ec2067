"""The pose in the map's frame, on the most probable edge."""

from ..._compile import Record, kernel
from ...graph.geometry import locate, project
from ..road import track
from ..state import MX, MY, Belief, Context, X, Y

_ALONE = 0.999  # P of an edge beside which the others do not matter
_ABOUT = 3.0  # sigmas, both added, up to which hypotheses are about the same place


@kernel(inline=True)
def match_pose(belief: Belief, ctx: Context, out: Record, best: int, p_edge: float) -> None:
    """Project the pose in the map's frame on the edge of hypothesis `best`.

    The pose is the mean of the hypotheses about that one, so that near the end of an edge
    it is not drawn to the middle because the next edge has hypotheses of its own.
    """
    roads = ctx.roads
    scale = belief.state[0].scale
    hyp = belief.hyp[best]
    track(belief, roads, best)
    s, lateral, tx, ty = hyp.along, hyp.lateral, hyp.tangent[0], hyp.tangent[1]
    length = roads.edges[hyp.edge].length
    x = hyp.mu[X] + scale * hyp.mu[MX]
    y = hyp.mu[Y] + scale * hyp.mu[MY]
    if p_edge > _ALONE:
        across = lateral * scale
        inside = min(max(s, 0.0), length)
        out.match_x = x - across * ty + (inside - s) * scale * tx
        out.match_y = y + across * tx + (inside - s) * scale * ty
        out.s = inside
        out.lateral = lateral
        return
    total = 0.0
    dx = 0.0
    dy = 0.0
    for i in range(belief.state[0].count):
        other = belief.hyp[i]
        if other.edge < 0:
            continue
        track(belief, roads, i)
        ax = other.mu[X] + scale * other.mu[MX] - x
        ay = other.mu[Y] + scale * other.mu[MY] - y
        reach = _ABOUT * (hyp.along_sigma + other.along_sigma) * scale
        if ax * ax + ay * ay < reach * reach:
            total += other.weight
            dx += other.weight * ax
            dy += other.weight * ay
    segment, s, _, _, _ = project(roads, hyp.edge, hyp.segment, x + dx / total, y + dy / total)
    inside = min(max(s, 0.0), length)
    _, px, py, _, _ = locate(roads, hyp.edge, segment, inside)
    out.match_x = px
    out.match_y = py
    out.s = inside
    out.lateral = lateral
