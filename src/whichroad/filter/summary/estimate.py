"""The estimate of an epoch: moments of the mixture, roads, status."""

import functools
import math
from typing import Annotated, NamedTuple

import numpy as np

from ..._compile import Array, Cube, Record, Records, Vector, entry, kernel
from ...graph.geometry import wrap
from ...graph.network import records
from ..gnss.behind import cover_delay
from ..gnss.bias import BIASED_BY
from ..gnss.carried import cover_carried
from ..gnss.departure import cover_departure, p_elsewhere
from ..gnss.separation import cover, cover_fixes, cover_gross_error, cover_scale
from ..map_error import map_scale
from ..records import ALTERNATIVES as ALTERNATIVES
from ..roads_left import cover_way, p_turned_wrong
from ..sparse.dropped import reach_of
from ..state import (
    MX,
    MY,
    NO_EDGE,
    OFF_ROAD,
    WHEELS,
    Belief,
    Context,
    H,
    X,
    Y,
    heaviest,
)
from ..vetting.facing import p_other_way
from .matched_pose import match_pose
from .node_shares import share_out, take_back
from .protection import Centre, set_levels, set_odds
from .ranking import rank
from .way import way_share

ON_ROAD, AMBIGUOUS, OFF, OUTAGE, STOPPED, LOST = range(6)  # status

POSE = 13  # numbers of the pose of one, see `Output`

LOST_UNKNOWN = 0.9  # P of what no hypothesis knows where no fix fits any of them
_MOST_DEPARTED = 0.3  # P that a vehicle whose odometer stands has left its road, at most
_LEAST_DEPARTED = 0.01  # P from which on that is told
_MISFITS = 3.0  # in a row, from which on that is so
_CANCELLED = 1e-12  # squared mean of unit vectors that have no mean direction
_ANY_HEADING = math.pi**2 / 3.0  # rad², of a heading that is not known
_ABOUT = math.pi**2  # rad², of two headings that are opposite
_WIDEST = 4.0  # sigmas, of a level where the vehicle may be elsewhere

ESTIMATE = np.dtype(
    [
        ("x", "f8"),  # m, plane; the mean of the mixture
        ("y", "f8"),
        ("heading", "f8"),  # rad
        ("cov", "f8", (6,)),  # xx, xy, xh, yy, yh, hh; true m, rad
        ("p_edge", "f8"),
        ("p_way", "f8"),  # of the chain of edges about it, see `filter.summary.way`
        ("p_off_road", "f8"),
        ("s", "f8"),  # abscissa on the most probable edge, m
        ("lateral", "f8"),  # m, right positive
        ("map_x", "f8"),  # the pose in the map's frame, m, plane
        ("map_y", "f8"),
        ("match_x", "f8"),  # the point on the most probable edge, m, plane
        ("match_y", "f8"),
        ("speed", "f8"),  # m/s
        ("chi2", "f8"),  # of the fix, under the hypothesis that fits it best; 0: no fix
        ("map_cov", "f8", (3,)),  # xx, xy, yy of the position in the map's frame, m²
        ("protection_level", "f8"),  # m
        ("level_along", "f4"),  # m, bound on the error along the heading
        ("level_across", "f4"),  # m, and across it
        ("gnss_scale", "f8"),  # GNSS sigmas over the reported ones, as learnt
        ("map_scale", "f8"),  # error of the map over map_sigma, as learnt
        ("edge", "i4"),  # the most probable one, OFF_ROAD, NO_EDGE
        ("live", "i4"),  # hypotheses
        ("alt_edge", "i4", (ALTERNATIVES,)),  # the most probable edges, in order
        ("alt_p", "f4", (ALTERNATIVES,)),
        ("status", "u1"),
    ],
    align=True,
)


Estimates = Annotated[Records, Array(ESTIMATE, 1)]  # of a drive


class Output(NamedTuple):
    """Estimates, one row an epoch."""

    rows: Estimates  # (n,)
    # (n or 0, ALTERNATIVES, POSE) x, y, heading, cov xx, xy, yy; abscissa and its sigma; map error
    # x, y, cov xx, xy, yy of the position in the map's frame
    alt_pose: Cube


@functools.cache
def _empty_row() -> Estimates:
    """(1,) an estimate of nothing."""
    row = records(1, ESTIMATE)
    row.edge = NO_EDGE
    row.status = LOST
    row.alt_edge = NO_EDGE
    return row


def new_output(n: int, poses: bool) -> Output:
    """Empty output for n epochs; `poses`: with those of the alternatives."""
    return Output(np.repeat(_empty_row(), n), np.zeros((n if poses else 0, ALTERNATIVES, POSE)))


@entry
def summarise(belief: Belief, ctx: Context, output: Output, k: int, chi2: float) -> None:
    """Write epoch k: moments of the mixture, the most probable edge, the alternatives.

    P of what no hypothesis knows (`unknown`) counts as off the roads: no road is surer than
    that.  It is 0.9 while fixes fit no hypothesis.

    Args:
        belief: Normalised.
        ctx: The drive's constants.
        output: Row k is written.
        k: The epoch.
        chi2: Of its fix, 0 without.
    """
    describe(belief, ctx, output, k, chi2, True)


@kernel
def describe(
    belief: Belief, ctx: Context, output: Output, k: int, chi2: float, changed: bool
) -> None:
    """`summarise`; where nothing has changed but places, the ranking of before holds."""
    state = belief.state[0]
    ranking = state.ranking
    out = output.rows[k]
    if changed or ctx.par[0].paper:
        ranking.known = 0
    if ranking.known == 0:
        set_odds(belief, ctx.par[0].protection_risk)
    top = belief.hyp[heaviest(belief)]
    off = _moments(belief, out, top)
    if not ctx.par[0].paper:
        cover(state, top, out, ctx.par[0].protection_risk)
        cover_departure(state, out, ctx.par[0].protection_risk)
        cover_carried(state, out, ctx.par[0].protection_risk)
        cover_delay(state, out, ctx.par[0].protection_risk)
        cover_way(state, out, ctx.par[0].protection_risk)
        cover_fixes(state, out, ctx.par[0].protection_risk)
        cover_scale(state, out, ctx.par[0].protection_risk)
        cover_gross_error(state, top, out, ctx.par[0].protection_risk)
        _cover_astray(state, off, out, ctx.par[0].protection_risk)
    unknown = _unknown(state, out, ctx.par[0].unknown)
    off += unknown * (1.0 - off)
    out.p_off_road = off
    out.speed = -abs(state.speed) if top.backs == 1 else state.speed
    out.chi2 = chi2
    out.gnss_scale = math.sqrt(state.gnss_factor)
    out.map_scale = map_scale(state, ctx.par[0])
    out.live = state.count
    hypotheses = int(state.count)
    shared = (state.mode != WHEELS or state.hindsight == 1) and not ctx.par[0].paper
    if shared:
        share_out(belief, ctx)
    if ranking.known == 0 or ranking.unknown != unknown:
        rank(belief, ctx, off, unknown)
    ranking.known = not shared
    _name_edges(belief, ctx, output, k)
    take_back(belief, hypotheses)
    out.status = _status(state, ctx.par[0], off, out.p_way, out.p_way + ranking.facing)


@kernel(inline=True)
def _name_edges(belief: Belief, ctx: Context, output: Output, k: int) -> None:
    """Write the ranked edges, the pose on the most probable one, P of it and of its way."""
    out = output.rows[k]
    ranking = belief.state[0].ranking
    for a in range(ALTERNATIVES):
        out.alt_edge[a] = ranking.edge[a]
        out.alt_p[a] = ranking.p[a]
        if len(output.alt_pose) > 0 and ranking.edge[a] != NO_EDGE:
            _set_pose(belief.hyp[ranking.row[a]], output.alt_pose[k, a])
    out.edge = ranking.chosen
    p_edge = ranking.p_chosen
    if ranking.best >= 0:
        match_pose(belief, ctx, out, ranking.best, p_edge)
        p_edge *= 1.0 - ranking.unknown
    else:
        out.match_x = out.x
        out.match_y = out.y
        out.s = 0.0
        out.lateral = 0.0
    out.p_edge = p_edge
    out.p_way = way_share(belief, ctx, ranking, p_edge, out.p_off_road)


@kernel
def _unknown(state: Record, out: Record, least: float) -> float:
    """P of what no hypothesis knows; where the vehicle may be elsewhere the estimate is wider."""
    other_way = p_other_way(state.vetting)
    out.cov[5] += other_way * (1.0 - other_way) * _ABOUT
    if state.elsewhere[0] > 0.0:
        _widen(out, state.elsewhere[0], state.elsewhere[1])
    lost = 0.0
    if state.misfits >= _MISFITS:  # the fixes may be right
        lost = LOST_UNKNOWN
        _reach(out, state.vetting.misfit)
    spin = state.vetting.spin
    spins = spin.p if spin.alone == 1 else 0.0
    departed = min(max(p_elsewhere(state), spins), _MOST_DEPARTED)
    departed = departed if departed > _LEAST_DEPARTED else 0.0
    dropped = state.separation.dropped
    _reach(out, reach_of(dropped, least))
    _add_variance(out, dropped.p * dropped.sigma**2)
    unmapped = max(state.separation.unmapped.p, state.separation.unmapped.hasty)
    left = max(p_turned_wrong(state), unmapped, dropped.p)
    left = max(left, min(other_way, 1.0 - other_way))
    return float(max(least, state.elsewhere[0], lost, departed, left))


@kernel
def _add_variance(out: Record, variance: float) -> None:
    """Add a variance (m²) to the place of an estimate."""
    out.cov[0] += variance
    out.map_cov[0] += variance
    out.cov[3] += variance
    out.map_cov[2] += variance


@kernel
def _widen(out: Record, share: float, sigma: float) -> None:
    """Widen an estimate by what is elsewhere with a probability, within so many metres."""
    _add_variance(out, share * sigma * sigma)
    out.cov[5] += share * _ANY_HEADING
    _reach(out, _WIDEST * sigma)


@kernel
def _reach(out: Record, least: float) -> None:
    """Widen the levels of an estimate to some metres at least."""
    out.protection_level = max(out.protection_level, least)
    out.level_along = max(out.level_along, least)
    out.level_across = max(out.level_across, least)


@kernel
def _cover_astray(state: Record, off: float, out: Record, risk: float) -> None:
    """Let an estimate off the roads cover that fixes err, where they have led it there.

        r = a √(2 log(p P(off) / risk)),    a = 30 m

    with p = P(they err), since they have jumped.  Roads would show it; off them nothing does.
    """
    p = state.separation.gross.astray * off
    if p > risk:
        _reach(out, BIASED_BY * math.sqrt(2.0 * math.log(p / risk)))
        _add_variance(out, p * BIASED_BY**2)


@kernel
def _status(state: Record, par: Record, off: float, p_way: float, facing: float) -> int:
    """Status of an epoch, the gravest first.

    Two directions of one street compete only once the vehicle moves: `facing` is P(way) and
    that of the direction opposite to it.
    """
    if state.misfits >= _MISFITS:
        return LOST
    silent = state.time - state.last_fix > par.outage_after
    if off > 0.5:
        return OUTAGE if silent else OFF
    stands = state.standing > 1.0
    if (facing if stands else p_way) < par.ambiguous_below:
        return AMBIGUOUS
    if silent:
        return OUTAGE
    return STOPPED if stands else ON_ROAD


@kernel(inline=True)
def _moments(belief: Belief, out: Record, top: Record) -> float:
    """Mean and covariance of the mixture, in the world and on the map; returns P(off road).

    Deviations are from the heaviest hypothesis, `top`, and headings on the circle.
    """
    state = belief.state[0]
    n = state.count
    x0, y0, h0 = top.mu[X], top.mu[Y], top.mu[H]
    off = 0.0
    mx = 0.0
    my = 0.0
    mh = 0.0
    ux = 0.0
    uy = 0.0
    opposed = False
    for i in range(n):
        hyp = belief.hyp[i]
        p = hyp.weight
        mx += p * (hyp.mu[X] - x0)
        my += p * (hyp.mu[Y] - y0)
        turned = wrap(hyp.mu[H] - h0)
        mh += p * turned
        opposed = opposed or abs(turned) > 1.0
        ux += p * hyp.mu[MX]
        uy += p * hyp.mu[MY]
        if hyp.edge == OFF_ROAD:
            off += p
    if opposed:  # the mean direction: an angle of about pi has no sign
        mh = _mean_direction(belief, h0)
    out.x = x0 + mx
    out.y = y0 + my
    out.heading = wrap(h0 + mh)
    out.map_x = x0 + mx + state.scale * ux
    out.map_y = y0 + my + state.scale * uy
    mid = Centre(x0, y0, h0, mx, my, mh, ux, uy)
    _covariances(belief, out, mid)
    set_levels(belief, out, mid)
    return off


@kernel
def _mean_direction(belief: Belief, heading: float) -> float:
    """Mean direction of the headings, less a heading, rad."""
    sine = 0.0
    cosine = 0.0
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        sine += hyp.weight * math.sin(hyp.mu[H] - heading)
        cosine += hyp.weight * math.cos(hyp.mu[H] - heading)
    if sine * sine + cosine * cosine < _CANCELLED:
        return 0.0
    return math.atan2(sine, cosine)


@kernel(inline=True)
def _covariances(belief: Belief, out: Record, mid: Centre) -> None:
    """Covariances of the mixture, in the world and on the map."""
    n = belief.state[0].count
    scale = belief.state[0].scale
    xx = 0.0
    xy = 0.0
    xh = 0.0
    yy = 0.0
    yh = 0.0
    hh = 0.0
    map_xx = 0.0
    map_xy = 0.0
    map_yy = 0.0
    for i in range(n):
        hyp = belief.hyp[i]
        p = hyp.weight
        cov = hyp.cov
        dx = (hyp.mu[X] - mid.x - mid.mx) / scale
        dy = (hyp.mu[Y] - mid.y - mid.my) / scale
        dh = wrap(hyp.mu[H] - mid.heading - mid.mh)
        cxx = cov[X, X]
        cxy = cov[X, Y]
        cyy = cov[Y, Y]
        xx += p * (cxx + dx * dx)
        xy += p * (cxy + dx * dy)
        xh += p * (cov[X, H] + dx * dh)
        yy += p * (cyy + dy * dy)
        yh += p * (cov[Y, H] + dy * dh)
        hh += p * (cov[H, H] + dh * dh)
        dx += hyp.mu[MX] - mid.ux
        dy += hyp.mu[MY] - mid.uy
        map_xx += p * (cxx + 2.0 * cov[X, MX] + cov[MX, MX] + dx * dx)
        map_xy += p * (cxy + cov[X, MY] + cov[Y, MX] + cov[MX, MY] + dx * dy)
        map_yy += p * (cyy + 2.0 * cov[Y, MY] + cov[MY, MY] + dy * dy)
    out.cov[0], out.cov[1], out.cov[2] = xx, xy, xh
    out.cov[3], out.cov[4], out.cov[5] = yy, yh, hh
    out.map_cov[0], out.map_cov[1], out.map_cov[2] = map_xx, map_xy, map_yy


@kernel
def _set_pose(hyp: Record, pose: Vector) -> None:
    """Write the pose of one of the alternatives."""
    pose[0], pose[1], pose[2] = hyp.mu[X], hyp.mu[Y], hyp.mu[H]
    cov = hyp.cov
    pose[3], pose[4], pose[5] = cov[X, X], cov[X, Y], cov[Y, Y]
    pose[6], pose[7] = hyp.along, hyp.along_sigma
    pose[8], pose[9] = hyp.mu[MX], hyp.mu[MY]
    pose[10] = cov[X, X] + 2.0 * cov[X, MX] + cov[MX, MX]
    pose[11] = cov[X, Y] + cov[X, MY] + cov[Y, MX] + cov[MX, MY]
    pose[12] = cov[Y, Y] + 2.0 * cov[Y, MY] + cov[MY, MY]
