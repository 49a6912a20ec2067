"""The pose in the map's frame, on the most probable edge."""

from ..._compile import Record, kernel
from ...graph.geometry import locate, project
from ...graph.network import Roads
from ..road import track
from ..state import MX, MY, Belief, Context, X, Y

_ALONE = 0.999  # P of an edge beside which the others do not matter
_ABOUT = 3.0  # sigmas, both added, up to which hypotheses are about the same place


@kernel(inline=True)
def _put(roads: Roads, out: Record, hyp: Record, s: float, lateral: float) -> None:
    """The estimate's place on the edge of a hypothesis."""
    _, x, y, _, _ = locate(roads, hyp.edge, hyp.segment, s)
    out.match_x = x
    out.match_y = y
    out.s = s
    out.lateral = lateral


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
    s, lateral = hyp.along, hyp.lateral
    length = roads.edges[hyp.edge].length
    x = hyp.mu[X] + scale * hyp.mu[MX]
    y = hyp.mu[Y] + scale * hyp.mu[MY]
    if p_edge > _ALONE:
        _put(roads, out, hyp, min(max(s, 0.0), length), lateral)
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
    _, s, _, _, _ = project(roads, hyp.edge, hyp.segment, x + dx / total, y + dy / total)
    _put(roads, out, hyp, min(max(s, 0.0), length), lateral)
