"""Heights against roads above each other: each hypothesis weighed by how its road climbs.

z = g + h + e + noise, with the ground g and its slope, the road's height h over it by the map's
levels, and the sensor's slow error e (`whichroad.evidence.elevations`).  Covariance and gains are
the same for all hypotheses and come with the reading; a hypothesis keeps its mean of (g, slope, e).

It keeps two: one where the road climbs to its level, and one where the ground sinks or rises
instead, as at a river or in a hill.  Where the road is on the ground again, they become one.
"""

import math

from ..._compile import Record, kernel
from ..road import track
from ..state import Belief, Context
from .evidence_kinds import CLIMBS, LEVEL_UNIT, LEVEL_ZERO

_FLAT = 0.05  # m over the ground, up to which a road is on it
_FAR = 25.0  # chi-square of a reading that fits nothing: the ground begins anew
_BY_CHANCE = 1e-3  # density of readings that mean nothing, over that of the best ones


@kernel
def weigh_elevation(belief: Belief, ctx: Context, reading: Record) -> None:
    """Weigh every hypothesis by a height, and move its means.

    Args:
        belief: In place.
        ctx: The drive's constants.
        reading: Of kind ELEVATION: `log_likelihood` has metres since the last one, what slope and
            error keep, the three gains, and the variance.
    """
    state = belief.state[0]
    variance = reading.log_likelihood[6]
    best = math.inf
    for i in range(state.count):
        hyp = belief.hyp[i]
        over = 0.0  # as off the roads
        if hyp.edge >= 0:
            track(belief, ctx.roads, i)
            over = _over_ground(ctx, hyp, reading.column)
        hyp.scratch[2] = over
        for k in range(2):
            _advance(hyp, reading, k)
            nu = reading.value - (over if k == 0 else 0.0) - hyp.ground[k, 0] - hyp.ground[k, 2]
            hyp.scratch[k] = nu
            best = min(best, nu * nu / variance)
    for i in range(state.count):
        hyp = belief.hyp[i]
        if best > _FAR:
            hyp.ground[0, 0] += hyp.scratch[0]
            hyp.ground[1, 0] += hyp.scratch[1]
            continue
        _observe(hyp, reading, variance)


@kernel
def _advance(hyp: Record, reading: Record, k: int) -> None:
    """Move one of the means on to the time of a reading."""
    hyp.ground[k, 0] += reading.log_likelihood[0] * hyp.ground[k, 1]
    hyp.ground[k, 1] *= reading.log_likelihood[1]
    hyp.ground[k, 2] *= reading.log_likelihood[2]


@kernel
def _observe(hyp: Record, reading: Record, variance: float) -> None:
    """Weigh a hypothesis, and condition both of its means."""
    climbs = CLIMBS * math.exp(-0.5 * hyp.scratch[0] ** 2 / variance)
    sinks = (1.0 - CLIMBS) * math.exp(hyp.sinks - 0.5 * hyp.scratch[1] ** 2 / variance)
    before = CLIMBS + (1.0 - CLIMBS) * math.exp(hyp.sinks)
    hyp.log_weight += math.log((climbs + sinks) / before + _BY_CHANCE)
    hyp.sinks += 0.5 * (hyp.scratch[0] ** 2 - hyp.scratch[1] ** 2) / variance
    hyp.sinks = min(max(hyp.sinks, -30.0), 30.0)
    for k in range(2):
        for j in range(3):
            hyp.ground[k, j] += reading.log_likelihood[3 + j] * hyp.scratch[k]
    if abs(hyp.scratch[2]) < _FLAT:
        p = climbs / max(climbs + sinks, 1e-300)
        for j in range(3):
            mean = p * hyp.ground[0, j] + (1.0 - p) * hyp.ground[1, j]
            hyp.ground[0, j] = mean
            hyp.ground[1, j] = mean
        hyp.sinks = 0.0


@kernel
def _over_ground(ctx: Context, hyp: Record, column: int) -> float:
    """How high the road of a hypothesis is over the ground, m."""
    evidence = ctx.work.evidence
    piece = evidence.first[hyp.edge]
    last = evidence.first[hyp.edge + 1]
    while piece + 1 < last and evidence.start[piece + 1] <= hyp.along:
        piece += 1
    return float(LEVEL_UNIT * (float(evidence.classes[column, piece]) - LEVEL_ZERO))
