"""Fixes that lie beside the road on which the vehicle seems to drive: it may drive on another one.

Receivers and maps err, both for long, and what lasts is learnt.  So a road that the map lacks
looks, where it leaves a mapped one slowly and runs beside it, like a map that is off there.  How
far the fixes lie beside the road, over what receiver and map are said to err by, tells which of
the two is more likely.

Where no turns are measured, a road far beside which fixes lie is then left.  Beside wheels or a
gyro it is not: fixes that are pulled away look so, too.
"""

import math

from .._compile import Record, kernel
from .state import (
    GX,
    GY,
    MX,
    MY,
    OFF_ROAD,
    RECEIVER,
    WHEELS,
    Belief,
    Context,
    H,
    X,
    Y,
    redraw,
)

_PRIOR = 10.0  # nats for the road where fixes lie beside it as expected
_SOFT = 1.5  # times: squared distances from mapped roads over their variances
_BEGINS = 1.0  # the square over its variance where they begin to lie beside it, seen later
_LEAST, _EVEN = 1e-3, 0.45  # P of another road, from which on it counts, and at most,
_TAIL = 33.0  # but where the square is much larger


@kernel
def _heaviest_on_road(belief: Belief) -> int:
    """The heaviest hypothesis on a road; the first one where there is none."""
    top = 0
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        above = hyp.log_weight > belief.hyp[top].log_weight or belief.hyp[top].edge == OFF_ROAD
        if hyp.edge != OFF_ROAD and above:
            top = i
    return top


@kernel
def watch_fixes(belief: Belief, ctx: Context) -> None:
    """P(the vehicle is on no mapped road, as fixes lie beside the likeliest), and their place.

        u = S γ − (m − c),    P = 1 / (1 + exp(10 − (n·u)² / 3 (n·R n + map_sigma²)))

    with c the map's error as a whole, R the covariance that the receiver reports, and n the
    unit vector across the vehicle's heading.  Real errors have long tails, so that P is 0.45 at
    most, or 1 − 33 / χ² where that is more, with χ² the square over the variance.  Who blames
    the receiver has seen it err.

    Args:
        belief: Conditioned on fixes and map.
        ctx: The drive's constants.
    """
    state = belief.state[0]
    beside = state.separation.unmapped
    beside.p = beside.chi2 = 0.0
    hyp = belief.hyp[_heaviest_on_road(belief)]
    if hyp.edge == OFF_ROAD or hyp.blames == RECEIVER or state.gnss_factor <= 0.0:
        return
    mean = hyp.mu
    root, cov, whole = state.bias_root, state.bias_cov, state.map.whole
    dx = root[0] * mean[GX] + root[1] * mean[GY]
    dy = root[1] * mean[GX] + root[2] * mean[GY]
    nx, ny = math.sin(mean[H]), -math.cos(mean[H])
    away = nx * (dx - mean[MX] + whole[0]) + ny * (dy - mean[MY] + whole[1])
    reported = nx * nx * cov[0] + 2.0 * nx * ny * cov[1] + ny * ny * cov[2]
    variance = reported / state.gnss_factor + ctx.par[0].map_sigma ** 2
    beside.chi2 = away * away / variance
    beside.sigma = math.sqrt(max(cov[0], cov[2]) / state.gnss_factor)
    beside.at[0] = mean[X] + state.scale * dx
    beside.at[1] = mean[Y] + state.scale * dy
    beside.road[0] = mean[X] + state.scale * (mean[MX] - whole[0])
    beside.road[1] = mean[Y] + state.scale * (mean[MY] - whole[1])
    p = _likelier(beside)
    most = max(_EVEN, 1.0 - _TAIL / max(beside.chi2, 1.0))
    beside.p = hyp.weight * min(p, most) if p > _LEAST else 0.0


@kernel
def _likelier(beside: Record) -> float:
    """P that fixes so far beside a road tell another one, but for the tails of real errors."""
    return 1.0 / (1.0 + math.exp(_PRIOR - min(0.5 * beside.chi2 / _SOFT, 2.0 * _PRIOR)))


@kernel
def followed(state: Record) -> float:
    """Share of the cost of following a road by chance: 1, and −1 where fixes lie far beside it.

    Then who is on the road follows fixes by chance, and pays for that.  It is 0 where the roads
    are no place for the vehicle's speed: it follows another one then.
    """
    beside = state.separation.unmapped
    p = _likelier(beside)
    share = 1.0 - 2.0 * p if state.mode != WHEELS and p > _LEAST else 1.0
    return min(share, 1.0 - float(beside.haste[0]))


@kernel
def leave_for_fixes(hyp: Record, state: Record) -> None:
    """Let a hypothesis that leaves a road be where the fixes are, if they lie far beside it."""
    if state.mode == WHEELS or _likelier(state.separation.unmapped) < 0.5:
        return
    root, cov = state.bias_root, state.bias_cov
    hyp.mu[X] += state.scale * (root[0] * hyp.mu[GX] + root[1] * hyp.mu[GY])
    hyp.mu[Y] += state.scale * (root[1] * hyp.mu[GX] + root[2] * hyp.mu[GY])
    redraw(hyp, GX, 0.0, 1.0)
    redraw(hyp, GY, 0.0, 1.0)
    hyp.cov[X, X] += cov[0]
    hyp.cov[X, Y] += cov[1]
    hyp.cov[Y, X] += cov[1]
    hyp.cov[Y, Y] += cov[2]


@kernel
def carry_back(beside: Record, later: float) -> None:
    """What was found out later holds as far back as fixes lay beside the road.

    Args:
        beside: Of a step; P is changed.
        later: P at the step after it.
    """
    if beside.chi2 > _BEGINS:
        beside.p = max(beside.p, later)
