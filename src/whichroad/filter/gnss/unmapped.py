"""Fixes that lie beside the road on which the vehicle seems to drive: it may drive on another one.

Receivers and maps err, both for long, and what lasts is learnt.  So a road that the map lacks
looks, where it leaves a mapped one slowly and runs beside it, like a map that is off there.  How
far the fixes lie beside the road, over what receiver and map are said to err by, tells which of
the two is more likely.
"""

import math

from ..._compile import Record, Vector, kernel
from ..state import GX, GY, MX, MY, OFF_ROAD, RECEIVER, Belief, Context, H, X, Y, heaviest
from .separation import cover_place

_PRIOR = 10.0  # nats for the road where fixes lie beside it as expected
_SOFT = 1.5  # times: squared distances from mapped roads over their variances
_BEGINS = 1.0  # the square over its variance where they begin to lie beside it, seen later
_LEAST, _EVEN = 1e-3, 0.45  # P of another road, from which on it counts, and at most,
_TAIL = 33.0  # but where the square is much larger


@kernel
def watch_fixes(belief: Belief, ctx: Context) -> None:
    """P(the heaviest hypothesis is on a wrong road, as fixes lie beside it), and their place.

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
    hyp = belief.hyp[heaviest(belief)]
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
    p = 1.0 / (1.0 + math.exp(_PRIOR - min(0.5 * beside.chi2 / _SOFT, 2.0 * _PRIOR)))
    most = max(_EVEN, 1.0 - _TAIL / max(beside.chi2, 1.0))
    beside.p = min(p, most) if p > _LEAST else 0.0


@kernel
def carry_back(beside: Record, later: float) -> None:
    """What was found out later holds as far back as fixes lay beside the road.

    Args:
        beside: Of a step; P is changed.
        later: P at the step after it.
    """
    if beside.chi2 > _BEGINS:
        beside.p = max(beside.p, later)


@kernel
def cover_fixes(state: Record, out: Record, risk: float) -> None:
    """Let an estimate cover both the place of fixes that lie beside the road, and that on it.

    Args:
        state: With these places.
        out: The estimate, in place: levels and covariance.
        risk: Of the level.
    """
    beside = state.separation.unmapped
    if beside.p <= risk:
        return
    sigma = beside.sigma * math.sqrt(2.0 * math.log(beside.p / risk))
    _cover(state, out, beside.at, sigma)
    _cover(state, out, beside.road, sigma)


@kernel(inline=True)
def _cover(state: Record, out: Record, place: Vector, sigma: float) -> None:
    """Let an estimate cover one of the two places, and as much about it."""
    dx = (place[0] - out.x) / state.scale
    dy = (place[1] - out.y) / state.scale
    cover_place(out, dx, dy, state.separation.unmapped.p, (sigma, sigma, sigma))
