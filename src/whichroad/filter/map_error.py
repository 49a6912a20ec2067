"""How far the map is off, learnt within the drive.

The map's error m is a state of every hypothesis.  It varies about a mean, which is how far the
map is off as a whole.  The hypotheses share this mean and the variance about it.  It is
learnt beside wheels only.
"""

import math

from .._compile import Record, kernel
from .gnss.inflation import NEVER
from .road import INNOVATION, VARIANCE
from .slow_states import keep_map
from .state import GX, GY, MX, MY, OFF_ROAD, START, WHEELS, Belief, Context, most_probable

_PRIOR_GROWING = 0.2  # weight of map_sigma against what makes it larger, in lengths of the error,
_PRIOR_SHRINKING = 1.0  # and against what makes it smaller
_LEAST = 1.0  # m, below which no map is believed to be: lanes are not told from it
_MOST = 100.0  # m
_REMEMBERED = 20.0  # lengths of the error, for which it is remembered
_GOOD = 0.3  # variance of offsets over that of the map, from which on no map is said to be good,
_PRIOR_GOOD = 0.3  # and the weight of that before, in lengths
_TOO_SMALL = 2.0  # times that a reported sigma may be too small on a good map
_LIGHT = 1e-3  # weight below which a hypothesis says nothing
_SURE = 0.8  # P of one hypothesis, from which on the error is learnt
_WINDOW = 50.0  # m, over which what lasts of the headings' innovations is seen
_PRIOR_HEADING = 3.0  # weight of edge_heading_sigma, in windows
_MOST_HEADING = 16.0  # times its variance
_RECENT = 10.0  # s without a fix, or with a misfit, from which on nothing is learnt


@kernel
def map_variance(state: Record, par: Record) -> float:
    """Variance of the map's error of each axis, m², as learnt."""
    return float(state.map.factor * par.map_sigma**2)


@kernel
def least_factor(state: Record, par: Record) -> float:
    """The least factor λ_r on reported variances of a receiver beside wheels.

    Both its errors, white and lasting, are as large together as reported.  And where fixes keep
    their offset from the roads, the map is good, and the receiver may be what varies: nothing
    else tells the two apart.  With v the variance of the offset about its mean c, and r² the
    reported variance,

        g    = 1 − (v / 0.3 map_sigma²)², not below 0
        λ_r >= l + g (min((v + min(c², r²)) / r², 4) − l),    l = 1 / (1 + ρ²)
    """
    least = 1.0 / (1.0 + par.gnss_white_ratio**2)
    offset = state.map.offset
    known = offset[0]
    reported = 0.5 * (state.bias_cov[0] + state.bias_cov[2]) / state.gnss_factor
    if known <= 0.0 or reported <= 0.0:
        return float(least)
    constant = 0.5 * (offset[2] ** 2 + offset[3] ** 2) / known**2
    varies = max(0.5 * offset[1] / known - constant, 0.0)
    poor = _GOOD * par.map_sigma**2
    believed = (_PRIOR_GOOD * poor + known * varies) / (_PRIOR_GOOD + known)
    good = max(1.0 - (believed / poor) ** 2, 0.0)
    apart = max(_about_its_mean(state.learnt_time / par.gnss_time), 1e-3)
    constant = min(constant, varies * (1.0 - apart) / apart, reported)
    seen = min((varies + constant) / reported, _TOO_SMALL**2)
    return float(least + good * max(seen - least, 0.0))


@kernel
def _about_its_mean(lengths: float) -> float:
    """Share of an error's variance about its mean, over so many of the lengths it lasts for."""
    if lengths <= 0.01:
        return lengths / 3.0
    return 1.0 - 2.0 * (lengths - 1.0 + math.exp(-lengths)) / (lengths * lengths)


@kernel
def forget_map(state: Record) -> None:
    """Begin: nothing is known of the map's error but what is usual."""
    learnt = state.map
    _forget(learnt, 0.0)
    learnt.factor = learnt.local = learnt.prior = learnt.rate = learnt.heading_factor = 1.0
    learnt.whole[0] = learnt.whole[1] = 0.0
    for a in range(3):
        learnt.heading_window[a] = 0.0


@kernel
def map_scale(state: Record, par: Record) -> float:
    """Error of the map as a whole and about that, each axis, over `map_sigma`."""
    whole = state.map.whole
    square = 0.5 * (whole[0] ** 2 + whole[1] ** 2) / par.map_sigma**2
    return float(math.sqrt(square + state.map.factor))


@kernel(inline=True)
def learn_map(belief: Belief, ctx: Context) -> None:
    """Learn the mean of the map's error and its variance, over the way since it was observed.

    Nothing is learnt without wheels: a wrong road would explain itself by a bad map.  Where
    the variance exceeds that of which the hypotheses' P have come, the difference is added to
    them at once.  Where it is smaller, P follows as the states age.

    Args:
        belief: Conditioned on the map.
        ctx: The drive's constants.
    """
    par = ctx.par[0]
    state = belief.state[0]
    late = state.time - state.last_fix > _RECENT or state.motion == START
    doubted = state.misfits > 0.0 or state.time - state.vetting.undecided_at < _RECENT
    doubted = doubted or belief.hyp[most_probable(belief)].weight < _SURE
    if late or doubted or par.gnss_adapt_time > NEVER or state.mode != WHEELS:
        return
    learnt = state.map
    share = state.since_map / par.map_length
    kept = keep_map(par, learnt.rate, state.since_map) ** 2
    learnt.prior = learnt.factor + kept * (learnt.prior - learnt.factor)
    _forget(learnt, math.exp(-share / _REMEMBERED))
    _add_errors(belief, par, share)
    _add_offsets(belief, par, share)
    _fit(learnt, par)
    _learn_headings(belief)
    learnt.rate = learnt.local * learnt.heading_factor / learnt.factor
    more = (learnt.factor - learnt.prior) * par.map_sigma**2
    if more > 0.0:
        for i in range(state.count):
            belief.hyp[i].cov[MX, MX] += more
            belief.hyp[i].cov[MY, MY] += more
        learnt.prior = learnt.factor


@kernel
def _forget(learnt: Record, kept: float) -> None:
    """Keep a share of all that was seen."""
    for a in range(2):
        learnt.energy[a] *= kept
        learnt.towards[a] *= kept
        learnt.heading_energy[a] *= kept
    for a in range(3):
        learnt.information[a] *= kept
        learnt.moments[a] *= kept
    for a in range(4):
        learnt.offset[a] *= kept


@kernel(inline=True)
def _add_errors(belief: Belief, par: Record, share: float) -> None:
    """Add what the hypotheses on roads say of the map's error, over a share of its length."""
    state = belief.state[0]
    learnt = state.map
    square = par.map_sigma**2
    prior = learnt.prior * square
    total = prior + 0.5 * (learnt.whole[0] ** 2 + learnt.whole[1] ** 2)
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.weight < _LIGHT or hyp.edge == OFF_ROAD:
            continue
        w = share * hyp.weight
        mx, my = hyp.mu[MX], hyp.mu[MY]
        left = (hyp.cov[MX, MX] + hyp.cov[MY, MY]) / total
        learnt.energy[0] += w * (mx * mx + my * my) / square
        learnt.energy[1] += w * max(2.0 - left, 0.0)
        learnt.moments[0] += w
        learnt.moments[1] += w * mx
        learnt.moments[2] += w * my
        _add_mean(hyp, learnt, prior, min(learnt.local * square, prior), 0.5 * w)


@kernel(inline=True)
def _add_mean(hyp: Record, learnt: Record, prior: float, local: float, share: float) -> None:
    """Add what one hypothesis says of the mean c.

    Along a principal axis of P, of variance p, it knows k = 1 - p / prior of m.  That is an
    observation of c with the variance p / k + local:

        information += share k / (p + local k)     towards += share (m - c + k c) / (p + local k)

    Args:
        hyp: The hypothesis.
        learnt: In place; its mean c is that of the prior.
        prior: Variance of m about c before any road was seen, m².
        local: The same without the uncertainty of c, m².
        share: Its weight, in lengths of which two are independent.
    """
    half = 0.5 * (hyp.cov[MX, MX] - hyp.cov[MY, MY])
    across = hyp.cov[MX, MY]
    middle = 0.5 * (hyp.cov[MX, MX] + hyp.cov[MY, MY])
    radius = math.sqrt(half * half + across * across)
    if radius > 0.0:  # the reflection about the major axis
        half /= radius
        across /= radius
    major = max(1.0 - (middle + radius) / prior, 0.0)  # k of it
    minor = max(1.0 - (middle - radius) / prior, 0.0)
    by_major = share / (middle + radius + local * major)
    by_minor = share / (middle - radius + local * minor)
    even = 0.5 * (by_major * major + by_minor * minor)
    odd = 0.5 * (by_major * major - by_minor * minor)
    xx, xy, yy = even + odd * half, odd * across, even - odd * half
    even, odd = 0.5 * (by_major + by_minor), 0.5 * (by_major - by_minor)
    cx, cy = learnt.whole[0], learnt.whole[1]
    dx, dy = hyp.mu[MX] - cx, hyp.mu[MY] - cy
    learnt.information[0] += xx
    learnt.information[1] += xy
    learnt.information[2] += yy
    learnt.towards[0] += (even + odd * half) * dx + odd * across * dy + xx * cx + xy * cy
    learnt.towards[1] += odd * across * dx + (even - odd * half) * dy + xy * cx + yy * cy


@kernel
def _ratio(seen: float, known: float) -> float:
    """Seen over known, with the weight of what is believed before."""
    prior = _PRIOR_GROWING if seen > known else _PRIOR_SHRINKING
    return (prior + seen) / (prior + known)


@kernel(inline=True)
def _fit(learnt: Record, par: Record) -> None:
    """The mean of the map's error, and its variance about that.

        total = (a + Σ|m|²) / (a + known)            over map_sigma²
        local = the same of |m|² about its mean over the way
        C     = total - local                        of the mean's prior
        P_c   = C (1 + C information)⁻¹,    c = P_c towards,    factor = local + ½ tr P_c

    The mean over a way of s lengths takes 2 (s - 1 + exp(-s)) / s² of the variance away.
    """
    square = par.map_sigma**2
    least = min((_LEAST / par.map_sigma) ** 2, 1.0)
    most = max((_MOST / par.map_sigma) ** 2, 1.0)
    seen, known = learnt.energy[0], learnt.energy[1]
    way = learnt.moments[0]
    if way <= 0.0:
        return
    by_mean = (learnt.moments[1] ** 2 + learnt.moments[2] ** 2) / (way * square)
    apart = _about_its_mean(way)
    total = min(max(_ratio(seen, known), least), most)
    local = min(max(_ratio(max(seen - by_mean, 0.0), known * apart), least), most)
    constant = max(total - local, 0.0) * square
    xx, yy = 1.0 + constant * learnt.information[0], 1.0 + constant * learnt.information[2]
    xy = constant * learnt.information[1]
    gain = constant / (xx * yy - xy * xy)
    learnt.whole[0] = gain * (yy * learnt.towards[0] - xy * learnt.towards[1])
    learnt.whole[1] = gain * (xx * learnt.towards[1] - xy * learnt.towards[0])
    learnt.local = local
    learnt.factor = local + 0.5 * gain * (xx + yy) / square


@kernel(inline=True)
def _learn_headings(belief: Belief) -> None:
    """Learn how far the map's lines are turned, from what lasts of the headings' innovations.

    Lines of a distorted map are turned for a hundred metres.  Innovations ν of variance s then
    keep their sign over a window:

        factor = (a + Σ factor (Σ ν)² / Σ s) / (a + windows), from 1 to 16
    """
    learnt = belief.state[0].map
    hyp = belief.hyp[most_probable(belief)]
    if hyp.edge == OFF_ROAD or belief.state[0].vetting.tried == 0:
        return
    window, energy = learnt.heading_window, learnt.heading_energy
    window[0] += belief.state[0].since_map
    window[1] += hyp.scratch[INNOVATION]
    window[2] += hyp.scratch[VARIANCE]
    if window[0] < _WINDOW:
        return
    energy[0] += learnt.heading_factor * window[1] ** 2 / window[2]
    energy[1] += 1.0
    factor = (_PRIOR_HEADING + energy[0]) / (_PRIOR_HEADING + energy[1])
    learnt.heading_factor = min(max(factor, 1.0), _MOST_HEADING)
    for a in range(3):
        window[a] = 0.0


@kernel(inline=True)
def _add_offsets(belief: Belief, par: Record, share: float) -> None:
    """Add what the hypotheses on roads say of the offset u = S γ − m of fixes from roads.

    What is kept of it: the lengths over which it was seen, Σ |u|², Σ u.
    """
    state = belief.state[0]
    offset = state.map.offset
    a, b, c = state.bias_root[0], state.bias_root[1], state.bias_root[2]
    prior = a * a + 2.0 * b * b + c * c + 2.0 * map_variance(state, par)
    for i in range(state.count):
        hyp = belief.hyp[i]
        if hyp.weight < _LIGHT or hyp.edge == OFF_ROAD:
            continue
        x = a * hyp.mu[GX] + b * hyp.mu[GY] - hyp.mu[MX]
        y = b * hyp.mu[GX] + c * hyp.mu[GY] - hyp.mu[MY]
        cov = hyp.cov
        left = (a * a + b * b) * cov[GX, GX] + (b * b + c * c) * cov[GY, GY]
        left += 2.0 * b * (a + c) * cov[GX, GY] + cov[MX, MX] + cov[MY, MY]
        left -= 2.0 * (a * cov[GX, MX] + b * (cov[GY, MX] + cov[GX, MY]) + c * cov[GY, MY])
        seen = share * hyp.weight * max(1.0 - left / prior, 0.0)
        offset[0] += seen
        offset[1] += seen * (x * x + y * y)
        offset[2] += seen * x
        offset[3] += seen * y
