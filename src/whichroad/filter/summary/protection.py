"""Protection levels: bounds that the error exceeds with the risk only."""

import math
from typing import NamedTuple

from ..._compile import Record, kernel
from ..state import Belief, X, Y

# scratch of a hypothesis: distances from the mean and sigmas, of the position, along, across
_AWAY, _SIGMA = 0, 3
_NEGLIGIBLE = -20.0  # twice the logarithm of a part over the risk that does not count
_SMALL = 0.06  # sigmas; a step of Newton's method that need not be followed by another one
_LARGE = 1.0  # sigmas; one that goes too far
_STEPS, _MOST_STEPS = 3, 24  # of it at most, free, and between limits
_NEARLY = 2e-4  # of the risk: near enough


class Centre(NamedTuple):
    """A reference pose, and the mixture's mean beside it."""

    x: float  # reference, m, plane
    y: float
    heading: float  # rad
    mx: float  # mean of the deviations, m, plane
    my: float
    mh: float  # rad
    ux: float  # mean of the map's offset, m
    uy: float


@kernel(inline=True)
def set_odds(belief: Belief, risk: float) -> None:
    """Twice the logarithm of each weight over the risk, and its root (−1 where there is none)."""
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        odds = 2.0 * math.log(max(hyp.weight, 1e-300) / risk)
        hyp.odds[0] = odds
        hyp.odds[1] = math.sqrt(odds) if odds > 0.0 else -1.0


@kernel(inline=True)
def set_levels(belief: Belief, out: Record, mid: Centre) -> None:
    """Protection level, and levels along the heading and across it.

    Each bounds the probability of a larger error.  With weights w_i, distances d_i from the
    mean and major axes a_i of the hypotheses (along and across: distances and sigmas of that
    direction) r is the root of

        P(error > r) <= sum w_i exp(-max(r - d_i, 0)^2 / 2 a_i^2) = risk

    The sigmas are wider while the receiver's scale is uncertain (`gnss.inflation.tail_of`).
    The level does not depend on the number of hypotheses into which a Gaussian is cut.  Their
    odds are set (`set_odds`).
    """
    state = belief.state[0]
    c = math.cos(out.heading)
    s = math.sin(out.heading)
    per_scale = 1.0 / state.scale
    tail = max(state.level_tail, 1.0)
    for i in range(state.count):
        hyp = belief.hyp[i]
        to = hyp.scratch
        cov = hyp.cov
        dx = (hyp.mu[X] - mid.x - mid.mx) * per_scale
        dy = (hyp.mu[Y] - mid.y - mid.my) * per_scale
        xx, xy, yy = cov[X, X], cov[X, Y], cov[Y, Y]
        apart = xx - yy
        along = c * c * xx + 2.0 * c * s * xy + s * s * yy
        to[_AWAY] = math.sqrt(dx * dx + dy * dy)
        longest = 0.5 * (xx + yy + math.sqrt(apart * apart + 4.0 * xy * xy))
        to[_SIGMA] = tail * math.sqrt(longest)
        to[_AWAY + 1] = abs(c * dx + s * dy)
        to[_SIGMA + 1] = tail * math.sqrt(along)
        to[_AWAY + 2] = abs(c * dy - s * dx)
        to[_SIGMA + 2] = tail * math.sqrt(xx + yy - along)
    out.protection_level = _level(belief, 0)
    out.level_along = _level(belief, 1)
    out.level_across = _level(belief, 2)


@kernel
def _level(belief: Belief, kind: int) -> float:
    """Distance beyond which the mixture has a probability of at most the risk.

    The largest of the hypotheses' own levels, and a step or two of Newton's method, of the
    logarithm, for what the others add.
    """
    n = belief.state[0].count
    r = -1.0
    top = 0
    for i in range(n):
        to = belief.hyp[i].scratch
        own = belief.hyp[i].odds[1]
        level = to[_AWAY + kind] + own * to[_SIGMA + kind]
        if level > r and own > 0.0:
            r, top = level, i
    if n == 1:
        return float(r)
    if r < 0.0:
        return _level_between(belief, kind, 0.0)
    least = r
    sigma = belief.hyp[top].scratch[_SIGMA + kind]
    total = 1.0  # in units of the risk
    slope = belief.hyp[top].odds[1] / sigma
    for _ in range(_STEPS):
        for i in range(n):
            if i == top:
                continue
            to = belief.hyp[i].scratch
            z = max(r - to[_AWAY + kind], 0.0) / to[_SIGMA + kind]
            rest = belief.hyp[i].odds[0] - z * z
            if rest > _NEGLIGIBLE:
                part = math.exp(0.5 * rest)
                total += part
                slope += part * z / to[_SIGMA + kind]
        if total < 1.0 + _NEARLY and top >= 0:
            return float(r)
        step = total * math.log(total) / slope if slope > 0.0 else math.inf
        if abs(step) > _LARGE * sigma:
            break
        r += step
        if abs(step) < _SMALL * sigma:
            return float(r)
        top, total, slope = -1, 0.0, 0.0  # its part has to be found as well
    return _level_between(belief, kind, least)


@kernel
def _level_between(belief: Belief, kind: int, low: float) -> float:
    """The level, which is at least `low`, to 2e-4 of the risk."""
    n = belief.state[0].count
    high = low
    for i in range(n):
        to = belief.hyp[i].scratch
        odds = belief.hyp[i].odds[0] + 2.0 * math.log(n)
        if odds > 0.0:
            high = max(high, to[_AWAY + kind] + to[_SIGMA + kind] * math.sqrt(odds))
    r = low
    for _ in range(_MOST_STEPS):
        total = 0.0
        slope = 0.0
        for i in range(n):
            to = belief.hyp[i].scratch
            z = max((r - to[_AWAY + kind]) / to[_SIGMA + kind], 0.0)
            rest = belief.hyp[i].odds[0] - z * z
            if rest > _NEGLIGIBLE:
                part = math.exp(0.5 * rest)
                total += part
                slope += part * z / to[_SIGMA + kind]
        if abs(total - 1.0) < _NEARLY:
            return float(r)
        if total > 1.0:
            low = r
        else:
            high = r
        r += total * math.log(total) / max(slope, 1e-300) if total > 0.0 else 0.0
        if not low < r < high:
            r = 0.5 * (low + high)
    return float(high)
