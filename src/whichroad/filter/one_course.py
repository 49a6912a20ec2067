"""Lines of the map that may be drawings of one course, as of roads above each other.

Two roads that lie apart have a course each: which line fits better tells which one is driven.
A bridge and the road below it have one, and each line is a drawing of it with errors of its own.
Which of them fits better is chance then, and says nothing.
"""

import math

from .._compile import kernel
from ..graph.geometry import project
from .state import MX, MY, OFF_ROAD, Belief, Context, X, Y

ROWS = 2  # scratch of a hypothesis: log-likelihood of its road's rows
_ALIKE = 50.0  # prior odds of lines that are as good as equal: they are one course
_POINTS = 50.0  # m, from point to point of a line that is drawn by hand
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
    chi2 = 0.5 * (across * across + 0.5 * turned * turned) / ctx.par[0].relative_sigma ** 2
    return 1.0 / (1.0 + math.exp(min(0.5 * chi2, 500.0)) / _ALIKE)
