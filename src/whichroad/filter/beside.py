"""A vehicle off the roads that does not follow any, or follows one that the map lacks.

It is free to turn, and pays by distance for following a road by chance.  It does not follow the
road that it leaves.  And roads run beside each other for long: on an unmapped one, far enough from
the mapped one to be another, it drives as that one's vehicles do.  Only the way there tells them
apart.
"""

import math
from typing import NamedTuple

from .._compile import Record, kernel
from ..graph.geometry import HALF_CHORD, chord_heading, locate, project, wrap
from .gaussian import LOG_2PI, normal_cdf, update_across_in_part, update_state_in_part
from .state import (
    BESIDE_SIGMA,
    MOTION,
    MX,
    MY,
    OFF_ROAD,
    WHEELS,
    Belief,
    Context,
    D,
    H,
    X,
    Y,
    lane_mean,
    lane_sigma,
)

_FREE = 4.0  # log-odds of free motion over a road beside, of a vehicle that leaves a road,
STARTS = 3.0  # and more of one that begins off the roads
_LASTS = 1000.0  # m, for which a road runs beside another
_WIDTH = 7.0  # m, that two roads' lanes are apart at least
_REACH = 40.0  # m, from which on a road tells nothing of one beside it
_CALM = 60.0  # s since fixes fitted nothing, from which on the motion shows it
_LARGEST = 500.0  # nats, of which the exponential is finite
_LIGHT = 1e-3  # weight of a vehicle off the roads below which it is not asked for,
_JUDGES = 1e-3  # and of a hypothesis on a road that may be beside it
_LEAST = -10.0  # log-odds of free motion that are remembered, over the usual ones


class Place(NamedTuple):
    """Where a hypothesis is beside a road."""

    lateral: float  # offset from its line, right positive, m
    offset: float  # and from its lane,
    sigma: float  # and the sigma of that
    turned: float  # the road's heading less that of the hypothesis, rad
    tx: float  # unit vector of that
    ty: float
    s: float  # abscissa of the foot, m
    segment: int  # of the road


class Course(NamedTuple):
    """The course of the road beside a vehicle."""

    inside: float  # P(within 7 m of any road's lane), the largest
    misfit: float  # chi-square of the heading by the road that fits best; infinite: there is none
    variance: float  # of the row of the heading on the road, the least, rad²
    place: Place  # beside that road


@kernel
def merged_odds(a: float, b: float, share: float) -> float:
    """Log-odds of free motion of two that become one, of which the first has a share."""
    if a == b:
        return a
    return math.log(share * math.exp(a) + (1.0 - share) * math.exp(b))


@kernel
def gain_beside(
    belief: Belief, ctx: Context, i: int, across: float, variances: tuple[float, float],
    usual: float, cost: float,
) -> float:  # fmt: skip
    """What a hypothesis off the roads gains over one that follows a road by chance.

    It is one of two: free (F), or on a road that runs beside a mapped one (B).  With the offset o
    from a road's lane, the misfit ν of its heading with variance s, and the log-odds a of F over
    B:

        outside   = P(|o| > 7 m),    parallel = exp(-½ max(ν² / s - 1, 0))
        ℓ_F       = usual - parallel cost
        ℓ_B       = across - ½ (ν² / s + log 2πs_r) - metres / 1 km
        gain      = log (e^(a + ℓ_F) + outside e^ℓ_B) - log (e^a + before) - (usual - cost)
        a        += ℓ_F - ℓ_B

    `beside` of a hypothesis is a over its value of a vehicle that has just left a road, P(B),
    outside, and the largest that this was.

    The offset's uncertainty lasts, and so it is asked for once, not in each row: as it is now.
    Before is outside at the last row; what exceeds its largest value counts as if it was so then.
    So who leaves a road may come to be beside it, but who was off a line that is drawn badly is
    not where the line is right again.  The uncertainty of the heading lasts as well: s_r is the
    row's variance on the road.  By motion that follows no road, a does not grow beyond its value
    of a vehicle that leaves one: it may come to a road beside.

    With P(B) the hypothesis follows the course of the road beside, as one on that road does: both
    rows hold, with D the offset from its line.

    Whoever blames the motion for a misfit has not shown that it left the road.  Nor has anybody
    within a minute of one: wheels that are wrong leave roads as well.

    Args:
        belief: Tracked; the hypothesis is changed.
        ctx: The drive's constants.
        i: The hypothesis.
        across: Log-likelihood of the row across, of those on roads.
        variances: Of the row across, m², and of that of the heading, rad².
        usual: Log-likelihood of rows that fit as a road does on average.
        cost: What it pays for following a road by chance, nats.
    """
    hyp = belief.hyp[i]
    if not _is_believed(belief.state[0]) or hyp.weight < _LIGHT or hyp.blames == MOTION:
        return 0.0
    course = _course(belief, ctx, i, variances[1])
    if course.misfit == math.inf:
        return 0.0
    free = usual - cost * math.exp(-0.5 * max(course.misfit - 1.0, 0.0))
    along = across - 0.5 * (course.misfit + math.log(course.variance) + LOG_2PI)
    along -= belief.state[0].since_map / _LASTS
    outside = 1.0 - course.inside
    odds = math.exp(_FREE + hyp.beside[0])
    after = odds * math.exp(min(free - along, _LARGEST))
    gain = along + math.log((after + outside) / (odds + _before(hyp, outside))) - (usual - cost)
    most = max(hyp.beside[0], 0.0)
    hyp.beside[0] = max(min(hyp.beside[0] + free - along, most), _LEAST)
    hyp.beside[1] = outside / (after + outside)
    _follow(hyp, course, variances, belief.state[0].scale)
    return float(gain)


@kernel
def _before(hyp: Record, outside: float) -> float:
    """`outside` as it was, and if it is larger than ever it was so before."""
    largest = hyp.beside[3]
    before = outside
    if largest > 0.0:  # else it is asked for the first time
        before = hyp.beside[2] * max(outside / largest, 1.0)
    hyp.beside[2] = outside
    hyp.beside[3] = max(outside, largest)
    return float(before)


@kernel
def update_beside(
    belief: Belief, ctx: Context, variances: tuple[float, float], cost: float
) -> None:
    """`gain_beside` where no hypothesis is on a road: who ran beside one may still do so.

    The row across is taken to fit as usual, and nobody gains.
    """
    usual = -0.5 * (1.0 + math.log(variances[1]) + LOG_2PI)
    for i in range(belief.state[0].count):
        gain_beside(belief, ctx, i, 0.0, variances, usual, cost)


@kernel
def _course(belief: Belief, ctx: Context, i: int, heading: float) -> Course:
    """The course of the road beside hypothesis i, which keeps that in mind.

    Of roads that others are on it is the one whose heading and distance fit best, else the one
    that it was beside before.

    Args:
        belief: The hypothesis' course is set.
        ctx: The drive's constants.
        i: The hypothesis.
        heading: Variance of the row of the heading, rad².
    """
    hyp = belief.hyp[i]
    best = Place(0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0)
    inside = 0.0
    misfit = variance = least = math.inf
    for j in range(belief.state[0].count):
        road = belief.hyp[j]
        if road.edge == OFF_ROAD or road.weight < _JUDGES:
            continue
        here = _beside(hyp, ctx, road.edge, road.segment, belief.state[0].scale)
        if abs(here.offset) > _REACH or here.sigma > _REACH:
            continue
        inside = max(inside, _inside(here))
        variance = min(variance, road.cov[H, H] + heading)
        chi2 = here.turned * here.turned / (hyp.cov[H, H] + heading)
        far = (here.offset / BESIDE_SIGMA) ** 2
        if chi2 + far < least:
            least = chi2 + far
            misfit = chi2
            best = here
            hyp.course = road.edge
    if misfit == math.inf and hyp.course >= 0:
        best = _beside(hyp, ctx, hyp.course, hyp.segment, belief.state[0].scale)
        ends = best.s < 0.0 or best.s > ctx.roads.edges[hyp.course].length
        if not ends and abs(best.offset) <= _REACH and best.sigma <= _REACH:
            inside = _inside(best)
            variance = hyp.cov[H, H] + heading
            misfit = best.turned * best.turned / variance
    if misfit < math.inf:
        hyp.segment = best.segment
    return Course(inside, misfit, variance, best)


@kernel
def _follow(hyp: Record, course: Course, variances: tuple[float, float], scale: float) -> None:
    """Condition a hypothesis on the course of the road beside, with the probability of that."""
    share = hyp.beside[1]
    place = course.place
    normal = place.ty, -place.tx
    before = hyp.mu[H]
    nu = hyp.mu[D] - place.lateral
    update_across_in_part(hyp.mu, hyp.cov, normal, nu, variances[0], share, scale)
    nu = place.turned - (hyp.mu[H] - before)
    update_state_in_part(hyp.mu, hyp.cov, H, nu, variances[1], share, scale)


@kernel
def p_apart(belief: Belief, ctx: Context, i: int, edge: int, segment: int) -> float:
    """P(a hypothesis off the roads runs beside the road of an edge), so that it is not on that."""
    hyp = belief.hyp[i]
    if belief.state[0].mode != WHEELS or hyp.beside[1] == 0.0:
        return 0.0
    for j in range(belief.state[0].count):
        if belief.hyp[j].edge == edge and belief.hyp[j].weight >= _JUDGES:
            return float(hyp.beside[1])
    if edge == hyp.course:
        return float(hyp.beside[1])
    here = _beside(hyp, ctx, edge, segment, belief.state[0].scale)
    return float(hyp.beside[1] * (1.0 - _inside(here)))


@kernel
def _is_believed(state: Record) -> bool:
    """Whether wheels show who leaves a road: no misfit has made them doubtful of late."""
    calm = state.misfits == 0.0 and state.time - state.vetting.undecided_at > _CALM
    return bool(state.mode == WHEELS and calm)


@kernel
def _beside(hyp: Record, ctx: Context, edge: int, segment: int, scale: float) -> Place:
    """Where a hypothesis is beside the road of an edge; `segment` is a guess."""
    mean = hyp.mu
    cov = hyp.cov
    qx = mean[X] + scale * mean[MX]
    qy = mean[Y] + scale * mean[MY]
    segment, s, _, _, _ = project(ctx.roads, edge, segment, qx, qy)
    inside = min(max(s, 0.0), ctx.roads.edges[edge].length)
    segment, x, y, _, _ = locate(ctx.roads, edge, segment, inside)
    course = chord_heading(ctx.roads, edge, segment, inside, HALF_CHORD)
    tx, ty = math.cos(course), math.sin(course)
    vxx = cov[X, X] + 2.0 * cov[X, MX] + cov[MX, MX]
    vyy = cov[Y, Y] + 2.0 * cov[Y, MY] + cov[MY, MY]
    vxy = cov[X, Y] + cov[X, MY] + cov[Y, MX] + cov[MX, MY]
    variance = ty * ty * vxx - 2.0 * tx * ty * vxy + tx * tx * vyy
    lane = lane_sigma(ctx, edge)
    sigma = math.sqrt(max(variance, 0.0) + lane * lane)
    lateral = ((qx - x) * ty - (qy - y) * tx) / scale
    offset = lateral - lane_mean(ctx, edge)
    return Place(lateral, offset, sigma, wrap(course - mean[H]), tx, ty, s, segment)


@kernel
def _inside(place: Place) -> float:
    """P(within 7 m of the lane of that road)."""
    near = normal_cdf((_WIDTH - place.offset) / place.sigma)
    return float(near - normal_cdf((-_WIDTH - place.offset) / place.sigma))
