"""A vehicle off the roads that does not follow any, or follows one that the map lacks.

It is free to turn, and pays by distance for following a road by chance.  It does not follow the
road that it leaves.  And roads run beside each other for long: on an unmapped one, far enough from
the mapped one to be another, it drives as that one's vehicles do.  Only the way there tells them
apart.
"""

import math

from .._compile import Record, kernel
from ..graph.geometry import HALF_CHORD, chord_heading, project, wrap
from .gaussian import LOG_2PI, normal_cdf, update_in_part
from .state import (
    MOTION,
    MX,
    MY,
    OFF_ROAD,
    WHEELS,
    Belief,
    Context,
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
_LIGHT = 1e-3  # weight of a vehicle off the roads below which it is not asked for,
_JUDGES = 1e-3  # and of a hypothesis on a road that may be beside it
_LEAST = -10.0  # log-odds of free motion that are remembered, over the usual ones


@kernel
def merged_odds(a: float, b: float, share: float) -> float:
    """Log-odds of free motion of two that become one, of which the first has a share."""
    return math.log(share * math.exp(a) + (1.0 - share) * math.exp(b))


@kernel
def gain_beside(
    belief: Belief, ctx: Context, i: int, lateral: float, heading: float, usual: float, cost: float
) -> float:
    """What a hypothesis off the roads gains over one that follows a road by chance.

    It is one of two: free (F), or on a road that runs beside a mapped one (B).  With the offset o
    from a road's lane, the misfit ν of its heading with variance s, and the log-odds a of F over
    B:

        outside   = P(|o| > 7 m),    parallel = exp(-½ max(ν² / s - 1, 0))
        ℓ_F       = usual - parallel cost
        ℓ_B       = lateral - ½ (ν² / s + log 2πs_r) - metres / 1 km
        gain      = log (e^(a + ℓ_F) + outside e^ℓ_B) - log (e^a + outside) - (usual - cost)
        a        += ℓ_F - ℓ_B

    `beside` of a hypothesis is a over its value of a vehicle that has just left a road, and P(B).

    The offset's uncertainty lasts, and so it is asked for once, not in each row.  So does that of
    the heading: s_r is the row's variance on the road.  By motion that follows no road, a does
    not grow beyond its value of a vehicle that leaves one: it may come to a road beside.

    Whoever blames the motion for a misfit has not shown that it left the road.  Nor has anybody
    within a minute of one: wheels that are wrong leave roads as well.

    Args:
        belief: Tracked; the hypothesis' odds are changed.
        ctx: The drive's constants.
        i: The hypothesis.
        lateral: Log-likelihood of the row across, of those on roads.
        heading: Variance of the row of the heading, rad².
        usual: Log-likelihood of rows that fit as a road does on average.
        cost: What it pays for following a road by chance, nats.
    """
    hyp = belief.hyp[i]
    if not _is_believed(belief.state[0]) or hyp.weight < _LIGHT or hyp.blames == MOTION:
        return 0.0
    s_heading = hyp.cov[H, H] + heading
    inside = turned = 0.0
    least = variance = math.inf
    for j in range(belief.state[0].count):
        road = belief.hyp[j]
        if road.edge == OFF_ROAD or road.weight < _JUDGES:
            continue
        offset, sigma, nu = _beside(hyp, road, ctx, belief.state[0].scale)
        if abs(offset) > _REACH or sigma > _REACH:
            continue
        near = normal_cdf((_WIDTH - offset) / sigma) - normal_cdf((-_WIDTH - offset) / sigma)
        inside = max(inside, near)
        if nu * nu / s_heading < least:
            least = nu * nu / s_heading
            turned = nu
        variance = min(variance, road.cov[H, H] + heading)
    if least == math.inf:
        return 0.0
    free = usual - cost * math.exp(-0.5 * max(least - 1.0, 0.0))
    along = lateral - 0.5 * (least + math.log(variance) + LOG_2PI)
    along -= belief.state[0].since_map / _LASTS
    outside = 1.0 - inside
    odds = math.exp(_FREE + hyp.beside[0])
    after = odds * math.exp(free - along)
    gain = along + math.log((after + outside) / (odds + outside)) - (usual - cost)
    most = max(hyp.beside[0], 0.0)
    hyp.beside[0] = max(min(hyp.beside[0] + free - along, most), _LEAST)
    hyp.beside[1] = outside / (after + outside)
    update_in_part(
        hyp.mu, hyp.cov, H, turned, heading, hyp.beside[1], belief.state[0].scale
    )
    return float(gain)


@kernel
def is_judge(belief: Belief, edge: int) -> bool:
    """Whether a hypothesis is on an edge that a vehicle off the roads was seen to be beside."""
    for j in range(belief.state[0].count):
        if belief.hyp[j].edge == edge and belief.hyp[j].weight >= _JUDGES:
            return True
    return False


@kernel
def _is_believed(state: Record) -> bool:
    """Whether wheels show who leaves a road: no misfit has made them doubtful of late."""
    calm = state.misfits == 0.0 and state.time - state.vetting.undecided_at > _CALM
    return bool(state.mode == WHEELS and calm)


@kernel
def _beside(hyp: Record, road: Record, ctx: Context, scale: float) -> tuple[float, float, float]:
    """Where a hypothesis is beside the road of another one.

    Returns:
        Offset from its lane, right positive, and the sigma of that, m; the road's heading less
        that of the hypothesis, rad.
    """
    mean = hyp.mu
    cov = hyp.cov
    qx = mean[X] + scale * mean[MX]
    qy = mean[Y] + scale * mean[MY]
    segment, s, across, tx, ty = project(ctx.roads, road.edge, road.segment, qx, qy)
    vxx = cov[X, X] + 2.0 * cov[X, MX] + cov[MX, MX]
    vyy = cov[Y, Y] + 2.0 * cov[Y, MY] + cov[MY, MY]
    vxy = cov[X, Y] + cov[X, MY] + cov[Y, MX] + cov[MX, MY]
    variance = ty * ty * vxx - 2.0 * tx * ty * vxy + tx * tx * vyy
    lane = lane_sigma(ctx, road.edge)
    sigma = math.sqrt(max(variance, 0.0) + lane * lane)
    turned = wrap(chord_heading(ctx.roads, road.edge, segment, s, HALF_CHORD) - mean[H])
    return float(across / scale - lane_mean(ctx, road.edge)), sigma, turned
