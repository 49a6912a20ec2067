"""Lines of the map that may be drawings of one course, as of roads above each other.

Two roads that lie apart have a course each: which line fits better tells which one is driven.
A bridge and the road below it have one, and each line is a drawing of it with errors of its own.
Which of them fits better is chance then, and says nothing.
"""

import math

from .._compile import Record, kernel
from ..graph.geometry import locate, project
from ..graph.network import Roads, backwards, onwards
from .state import MX, MY, OFF_ROAD, Belief, Context, X, Y

ROWS = 2  # scratch of a hypothesis: log-likelihood of its road's rows
_ALIKE = 50.0  # prior odds of lines that are as good as equal: they are one course
_POINTS = 50.0  # m, from point to point of a line that is drawn by hand
_PART = 4.24  # times relative_sigma: three sigmas of the distance between points of two lines
_FORK = 60.0  # m past a node, for which roads that part there are near each other
_FACES = 0.9  # cosine of the angle between lines, from which they may be
_NEAR = 15.0  # m along the road, within which hypotheses are at one place


@kernel
def weigh_rows(belief: Belief, ctx: Context) -> None:
    """Multiply each hypothesis on a road by the likelihood of its rows.

    Where its line is a drawing of the most probable one's course, it has that road's likelihood:

        log w_i += ℓ_i + P(one course) (ℓ_top - ℓ_i)

    ℓ_top is the mean over the hypotheses on that road, by their weights.

    Args:
        belief: Tracked; the log-weights are changed.
        ctx: The drive's constants.
    """
    top = _most_probable_on_road(belief)
    shared = _mean_row(belief, top)
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge == OFF_ROAD:
            continue
        row = hyp.scratch[ROWS]
        best = belief.hyp[top]
        if hyp.edge != best.edge:
            row += _p_one_course(belief, ctx, i, top) * (shared - row)
        hyp.log_weight += row


@kernel
def _most_probable_on_road(belief: Belief) -> int:
    top = -1
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.edge != OFF_ROAD and (top < 0 or hyp.weight > belief.hyp[top].weight):
            top = i
    return top


@kernel
def _mean_row(belief: Belief, top: int) -> float:
    """The log-likelihood of the rows of a hypothesis' road, on average over those on it."""
    total = weight = 0.0
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if top >= 0 and hyp.edge == belief.hyp[top].edge:
            total += hyp.weight * hyp.scratch[ROWS]
            weight += hyp.weight
    return float(total / weight) if weight > 0.0 else 0.0


@kernel
def _p_one_course(belief: Belief, ctx: Context, i: int, top: int) -> float:
    """P(lines of hypothesis i and of the most probable one are drawings of one course).

    With the distance d across and the angle α between the lines, in the middle of what was driven
    since the last rows, and the errors σ of each across,

        χ²            = (d² + ½ (50 m α)²) / 2σ²
        P(one course) = 1 / (1 + 0.02 e^(½ χ²))

    Roads that have just parted at a node have a course each, if they are surely apart 50 m past
    it.  So have a road and the one that leads to it.
    """
    hyp, best = belief.hyp[i], belief.hyp[top]
    tx, ty = best.tangent
    if tx * hyp.tangent[0] + ty * hyp.tangent[1] < _FACES:
        return 0.0
    scale = belief.state[0].scale
    x = best.mu[X] + scale * best.mu[MX]
    y = best.mu[Y] + scale * best.mu[MY]
    along = (hyp.mu[X] + scale * hyp.mu[MX] - x) * tx + (hyp.mu[Y] + scale * hyp.mu[MY] - y) * ty
    if abs(along) > _NEAR * scale:
        return 0.0
    back = 0.5 * belief.state[0].since_map
    x -= scale * back * tx
    y -= scale * back * ty
    _, s, there, ux, uy = project(ctx.roads, hyp.edge, hyp.segment, x, y)
    if s < -back or s > ctx.roads.edges[hyp.edge].length:
        return 0.0
    _, _, here, tx, ty = project(ctx.roads, best.edge, best.segment, x, y)
    across = (there - here) / scale
    turned = _POINTS * (tx * uy - ty * ux)
    sigma = ctx.par[0].relative_sigma
    chi2 = 0.5 * (across * across + 0.5 * turned * turned) / sigma**2
    if _part(ctx.roads, hyp, best, _PART * sigma * scale):
        return 0.0
    return 1.0 / (1.0 + math.exp(min(0.5 * chi2, 500.0)) / _ALIKE)


@kernel
def _part(roads: Roads, one: Record, other: Record, apart: float) -> bool:
    """Whether two roads have parted at a node in the last 60 m, or one leads to the other.

    Args:
        roads: The network.
        one: A hypothesis.
        other: Another one.
        apart: Distance between their points 50 m past the node, beyond which they part, plane m.
    """
    first, second = _first_edge(roads, one), _first_edge(roads, other)
    if first >= 0 and roads.edges[first].from_node == roads.edges[other.edge].to_node:
        return True
    if second >= 0 and roads.edges[second].from_node == roads.edges[one.edge].to_node:
        return True
    if first < 0 or second < 0 or first == second:
        return False
    if roads.edges[first].from_node != roads.edges[second].from_node:
        return False
    ax, ay = _point_on(roads, first)
    bx, by = _point_on(roads, second)
    return math.hypot(ax - bx, ay - by) > apart


@kernel
def _first_edge(roads: Roads, hyp: Record) -> int:
    """The edge with which the road of a hypothesis begins; -1: more than 60 m ago."""
    edge, s = int(hyp.edge), hyp.along
    before = backwards(roads, edge)
    while before >= 0 and s <= _FORK:
        edge = before
        s += roads.edges[edge].length
        before = backwards(roads, edge)
    return edge if s <= _FORK else -1


@kernel
def _point_on(roads: Roads, edge: int) -> tuple[float, float]:
    """The point of a road 50 m past its start, or its end, plane m."""
    s = _POINTS
    after = onwards(roads, edge)
    while after >= 0 and s > roads.edges[edge].length:
        s -= roads.edges[edge].length
        edge = after
        after = onwards(roads, edge)
    road = roads.edges[edge]
    _, x, y, _, _ = locate(roads, edge, road.first_vertex, min(s, road.length))
    return x, y
