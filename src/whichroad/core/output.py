"""What the filter says of an epoch: moments of the mixture, roads, status."""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Bytes, Ints32, Matrix, Matrix32, Table32, Vector, entry, part
from .angles import wrap
from .belief import (
    GNSS_SCALE,
    LAST_FIX,
    MISFITS,
    MX,
    MY,
    NO_EDGE,
    NOW,
    OFF_ROAD,
    SPEED,
    STOOD,
    Belief,
    H,
    X,
    Y,
)
from .network import Roads
from .road import track
from .segment import locate, project

ON_ROAD, AMBIGUOUS, OFF, OUTAGE, STOPPED, LOST = range(6)  # status

ALTERNATIVES = 6

_ALONE = 0.999  # P of an edge beside which the others do not matter
_ABOUT = 3.0  # sigmas, both added, up to which hypotheses are about the same place


class Output(NamedTuple):
    """What the filter says, one row an epoch."""

    value: Matrix  # (n, VALUES) see the V_ names
    edge: Ints32  # (n,)
    status: Bytes  # (n,)
    live: Ints32  # (n,) hypotheses
    alt_edge: Table32  # (n, ALTERNATIVES)
    alt_p: Matrix32  # (n, ALTERNATIVES)
    alt_pose: Matrix  # (n or 0, ALTERNATIVES * 6) x, y, heading, cov xx, xy, yy


V_X, V_Y, V_H, V_XX, V_XY, V_XH, V_YY, V_YH, V_HH = range(9)
V_P, V_OFF, V_S, V_LATERAL, V_MAP_X, V_MAP_Y, V_MATCH_X, V_MATCH_Y, V_SPEED, V_CHI2 = range(9, 19)
V_MAP_XX, V_MAP_XY, V_MAP_YY, V_PROTECTION, V_GNSS_SCALE = range(19, 24)
VALUES = 24


def new_output(n: int, poses: bool) -> Output:
    """Empty output for n epochs."""
    return Output(
        np.zeros((n, VALUES)),
        np.full(n, NO_EDGE, np.int32),
        np.full(n, LOST, np.uint8),
        np.zeros(n, np.int32),
        np.full((n, ALTERNATIVES), NO_EDGE, np.int32),
        np.zeros((n, ALTERNATIVES), np.float32),
        np.zeros((n if poses else 0, ALTERNATIVES * 6)),
    )


@entry
def say(
    belief: Belief, roads: Roads, output: Output, k: int, scale: float, outage_after: float,
    ambiguous_below: float, risk: float, unknown: float, chi2: float,
) -> None:  # fmt: skip
    """Write epoch k: moments of the mixture, the most probable edge, the alternatives.

    The protection level r bounds the probability of a position error beyond it: with
    major axes a_i, distances d_i from the mean, and weights w_i of n hypotheses,

        P(error > r) <= sum w_i exp(-(r - d_i)^2 / 2 a_i^2) <= risk
        r = max_i d_i + a_i sqrt(2 log(n w_i / risk))     over all w_i > risk / n

    (for the heaviest d is left for last, which makes r larger by as much).

    `unknown` of the probability is left for what no hypothesis knows, and said as off the
    roads: no road is surer than that.
    """
    n = belief.size[0]
    out = output.value[k]
    top = 0
    off = 0.0
    mx = 0.0
    my = 0.0
    mh = 0.0
    opposed = False
    ux = 0.0
    uy = 0.0
    for i in range(n):
        if belief.log_weight[i] > belief.log_weight[top]:
            top = i
    x0 = belief.mean[top, X]
    y0 = belief.mean[top, Y]
    h0 = belief.mean[top, H]
    for i in range(n):
        p = belief.probability[i]
        mx += p * (belief.mean[i, X] - x0)
        my += p * (belief.mean[i, Y] - y0)
        turned = wrap(belief.mean[i, H] - h0)
        mh += p * turned
        opposed = opposed or abs(turned) > 1.0
        ux += p * belief.mean[i, MX]
        uy += p * belief.mean[i, MY]
        if belief.edge[i] == OFF_ROAD:
            off += p
    if opposed:  # the mean direction: an angle of about pi has no sign
        sine = 0.0
        cosine = 0.0
        for i in range(n):
            sine += belief.probability[i] * math.sin(belief.mean[i, H] - h0)
            cosine += belief.probability[i] * math.cos(belief.mean[i, H] - h0)
        mh = math.atan2(sine, cosine)
    xx = 0.0
    xy = 0.0
    xh = 0.0
    yy = 0.0
    yh = 0.0
    hh = 0.0
    map_xx = 0.0
    map_xy = 0.0
    map_yy = 0.0
    level = 0.0
    for i in range(n):
        p = belief.probability[i]
        cov = belief.cov[i]
        dx = (belief.mean[i, X] - x0 - mx) / scale
        dy = (belief.mean[i, Y] - y0 - my) / scale
        dh = wrap(belief.mean[i, H] - h0 - mh)
        cxx = cov[X, X]
        cxy = cov[X, Y]
        cyy = cov[Y, Y]
        xx += p * (cxx + dx * dx)
        xy += p * (cxy + dx * dy)
        xh += p * (cov[X, H] + dx * dh)
        yy += p * (cyy + dy * dy)
        yh += p * (cov[Y, H] + dy * dh)
        hh += p * (cov[H, H] + dh * dh)
        odds = p * n / risk
        if odds > 1.0:
            apart = cxx - cyy
            major = 0.5 * (cxx + cyy + math.sqrt(apart * apart + 4.0 * cxy * cxy))
            reach = math.sqrt(2.0 * major * math.log(odds))
            if i != top:
                reach += math.sqrt(dx * dx + dy * dy)
            level = max(level, reach)
        dx += belief.mean[i, MX] - ux
        dy += belief.mean[i, MY] - uy
        map_xx += p * (cxx + 2.0 * cov[X, MX] + cov[MX, MX] + dx * dx)
        map_xy += p * (cxy + cov[X, MY] + cov[Y, MX] + cov[MX, MY] + dx * dy)
        map_yy += p * (cyy + 2.0 * cov[Y, MY] + cov[MY, MY] + dy * dy)
    out[V_MAP_X] = x0 + mx + scale * ux
    out[V_MAP_Y] = y0 + my + scale * uy
    out[V_MAP_XX] = map_xx
    out[V_MAP_XY] = map_xy
    out[V_MAP_YY] = map_yy
    out[V_PROTECTION] = level + math.sqrt(mx * mx + my * my) / scale
    out[V_GNSS_SCALE] = math.sqrt(belief.clock[GNSS_SCALE])
    out[V_XX] = xx
    out[V_XY] = xy
    out[V_XH] = xh
    out[V_YY] = yy
    out[V_YH] = yh
    out[V_HH] = hh
    out[V_X] = x0 + mx
    out[V_Y] = y0 + my
    out[V_H] = wrap(h0 + mh)
    off += unknown * (1.0 - off)
    out[V_OFF] = off
    out[V_SPEED] = belief.clock[SPEED]
    out[V_CHI2] = chi2
    output.live[k] = n
    _rank(belief, output, k, unknown)
    edge = output.alt_edge[k, 0]
    if edge == OFF_ROAD and output.alt_edge[k, 1] >= 0 and off <= 0.5:
        edge = output.alt_edge[k, 1]
    output.edge[k] = edge
    p_edge = 0.0
    if edge >= 0:
        best = -1
        for i in range(n):
            if belief.edge[i] == edge:
                p_edge += belief.probability[i]
                if best < 0 or belief.log_weight[i] > belief.log_weight[best]:
                    best = i
        _match(belief, roads, out, best, p_edge, scale)
        p_edge *= 1.0 - unknown
    else:
        out[V_MATCH_X] = out[V_X]
        out[V_MATCH_Y] = out[V_Y]
        out[V_S] = 0.0
        out[V_LATERAL] = 0.0
    out[V_P] = p_edge
    clock = belief.clock
    if clock[MISFITS] >= 3.0:
        status = LOST
    elif off > 0.5:
        status = OFF
    elif p_edge < ambiguous_below:
        status = AMBIGUOUS
    elif clock[NOW] - clock[LAST_FIX] > outage_after:
        status = OUTAGE
    elif clock[STOOD] > 1.0:
        status = STOPPED
    else:
        status = ON_ROAD
    output.status[k] = status


@part
def _match(
    belief: Belief, roads: Roads, out: Vector, best: int, p_edge: float, scale: float
) -> None:
    """Project the pose in the map's frame on the edge of hypothesis `best`.

    The pose is the mean of the hypotheses about that one, so that near the end of an edge
    it is not drawn to the middle because the next edge has hypotheses of its own.
    """
    edge = belief.edge[best]
    lateral, tx, ty = track(belief, roads, best, scale)
    s = belief.abscissa[best]
    across = lateral * scale
    x = belief.mean[best, X] + scale * belief.mean[best, MX]
    y = belief.mean[best, Y] + scale * belief.mean[best, MY]
    if p_edge > _ALONE:
        inside = min(max(s, 0.0), roads.length[edge])
        out[V_MATCH_X] = x - across * ty + (inside - s) * scale * tx
        out[V_MATCH_Y] = y + across * tx + (inside - s) * scale * ty
        out[V_S] = inside
        out[V_LATERAL] = lateral
        return
    total = 0.0
    dx = 0.0
    dy = 0.0
    for i in range(belief.size[0]):
        if belief.edge[i] == OFF_ROAD:
            continue
        track(belief, roads, i, scale)
        ax = belief.mean[i, X] + scale * belief.mean[i, MX] - x
        ay = belief.mean[i, Y] + scale * belief.mean[i, MY] - y
        reach = _ABOUT * (belief.spread[best] + belief.spread[i]) * scale
        if ax * ax + ay * ay < reach * reach:
            total += belief.probability[i]
            dx += belief.probability[i] * ax
            dy += belief.probability[i] * ay
    segment, s, _, _, _ = project(roads, edge, belief.segment[best], x + dx / total, y + dy / total)
    inside = min(max(s, 0.0), roads.length[edge])
    _, out[V_MATCH_X], out[V_MATCH_Y], _, _ = locate(roads, edge, segment, inside)
    out[V_S] = inside
    out[V_LATERAL] = lateral


@part
def _rank(belief: Belief, output: Output, k: int, unknown: float) -> None:
    """The most probable edges of epoch k, components of one edge added up."""
    n = belief.size[0]
    edges = output.alt_edge[k]
    ps = output.alt_p[k]
    poses = len(output.alt_pose) > 0
    for a in range(ALTERNATIVES):
        edges[a] = NO_EDGE
        ps[a] = 0.0
    for i in range(n):
        edge = belief.edge[i]
        seen = False
        for j in range(i):
            if belief.edge[j] == edge:
                seen = True
                break
        if seen:
            continue
        p = 0.0
        best = i
        for j in range(i, n):
            if belief.edge[j] == edge:
                p += belief.probability[j]
                if belief.probability[j] > belief.probability[best]:
                    best = j
        p *= 1.0 - unknown
        if edge == OFF_ROAD:
            p += unknown
        slot = ALTERNATIVES
        while slot > 0 and ps[slot - 1] < p:
            slot -= 1
        if slot == ALTERNATIVES:
            continue
        for a in range(ALTERNATIVES - 1, slot, -1):
            edges[a] = edges[a - 1]
            ps[a] = ps[a - 1]
            if poses:
                for v in range(6):
                    output.alt_pose[k, 6 * a + v] = output.alt_pose[k, 6 * (a - 1) + v]
        edges[slot] = edge
        ps[slot] = p
        if poses:
            output.alt_pose[k, 6 * slot] = belief.mean[best, X]
            output.alt_pose[k, 6 * slot + 1] = belief.mean[best, Y]
            output.alt_pose[k, 6 * slot + 2] = belief.mean[best, H]
            output.alt_pose[k, 6 * slot + 3] = belief.cov[best, X, X]
            output.alt_pose[k, 6 * slot + 4] = belief.cov[best, X, Y]
            output.alt_pose[k, 6 * slot + 5] = belief.cov[best, Y, Y]
