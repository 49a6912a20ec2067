"""Hypotheses merge within an edge, and the negligible ones die.

Merging by moments within the same directed edge loses next to nothing, and pruning
alone loses much: measured against exact enumeration on forks, four components in all
stay within 1e-2 of the exact road probabilities, and the four best unmerged within 0.2.
"""

import math

from ._jit import entry, kernel, part
from .angles import wrap
from .belief import KEPT, NO_EDGE, NOW, OFF_ROAD, ORIGINS, Belief, H, Route, X, Y, normalise
from .gaussian import merge_moments
from .switching import copy_hypothesis, enter

_OFF_LIMIT = 0.3  # nats, relative, below which two off-road components are merged
_CLEAR = 1e-4  # probability of all other edges, below which
_CLEAR_LIMIT = 0.003  # nats, relative, are little to lose by merging
_OPPOSED = 1.6  # rad
_OFF_MOST = 8  # off-road components kept
_OFF_PRUNE = 0.01  # of the usual floor; it is the way back when every road was wrong


@kernel
def _loss(wi: float, vi: float, wj: float, vj: float, v: float, best: float, alone: bool) -> float:
    """½ (w_i log(v / v_i) + w_j log(v / v_j)), or a lower bound of it that is above `best`.

    `alone`: or an upper bound of it that is below, for a pair that is compared with no other.
    """
    least = 0.5 * (wi + wj - (wi * vi + wj * vj) / v)  # as log x >= 1 - 1 / x
    if least > best:
        return least
    if alone:
        most = 0.5 * (wi * (v / vi - 1.0) + wj * (v / vj - 1.0))  # as log x <= x - 1
        if most < best:
            return most
    return 0.5 * (wi * math.log(v / vi) + wj * math.log(v / vj))


@part
def _merge_cost(
    belief: Belief, i: int, j: int, best: float, scale: float, alone: bool = False
) -> float:
    """Runnalls' bound on what merging two hypotheses loses, along the road only, nats.

        B = ½ (W log v − w_i log v_i − w_j log v_j)

    with v the variance of the merged abscissa.  Off the roads it is the worst of x, y
    and heading, relative to W: that hypothesis is mostly light, and must stay sharp.
    """
    wi = max(belief.probability[i], 1e-300)
    wj = max(belief.probability[j], 1e-300)
    w = wi + wj
    shares = wi * wj / (w * w)
    if belief.edge[i] != OFF_ROAD:
        vi = belief.spread[i] ** 2
        vj = belief.spread[j] ** 2
        gap = belief.abscissa[i] - belief.abscissa[j]
        v = (wi * vi + wj * vj) / w + shares * gap * gap
        along = _loss(wi, vi, wj, vj, v, best, alone)
        if along > best:
            return float(along)  # dearer than another pair, whatever the rest
        gap = wrap(belief.mean[i, H] - belief.mean[j, H])
        vi = belief.cov[i, H, H]
        vj = belief.cov[j, H, H]
        v = (wi * vi + wj * vj) / w + shares * gap * gap
        turned = _loss(wi, vi, wj, vj, v, best, alone)
        if turned > best:
            return float(turned)
        nx = math.sin(belief.mean[i, H])
        ny = -math.cos(belief.mean[i, H])
        dx = belief.mean[i, X] - belief.mean[j, X]
        dy = belief.mean[i, Y] - belief.mean[j, Y]
        gap = (nx * dx + ny * dy) / scale
        ci = belief.cov[i]
        cj = belief.cov[j]
        vi = nx * nx * ci[X, X] + 2.0 * nx * ny * ci[X, Y] + ny * ny * ci[Y, Y]
        vj = nx * nx * cj[X, X] + 2.0 * nx * ny * cj[X, Y] + ny * ny * cj[Y, Y]
        v = (wi * vi + wj * vj) / w + shares * gap * gap
        across = _loss(wi, vi, wj, vj, v, best, alone)
        return float(max(along, turned, across))
    gap = wrap(belief.mean[i, H] - belief.mean[j, H])
    if abs(gap) > _OPPOSED:
        return math.inf
    vi = belief.cov[i, H, H]
    vj = belief.cov[j, H, H]
    v = (wi * vi + wj * vj) / w + shares * gap * gap
    turned = _loss(wi / w, vi, wj / w, vj, v, best, alone)
    if turned > best:
        return float(turned)
    dx = (belief.mean[i, X] - belief.mean[j, X]) / scale
    dy = (belief.mean[i, Y] - belief.mean[j, Y]) / scale
    ci = belief.cov[i]
    cj = belief.cov[j]
    xx = (wi * ci[X, X] + wj * cj[X, X]) / w + shares * dx * dx
    xy = (wi * ci[X, Y] + wj * cj[X, Y]) / w + shares * dx * dy
    yy = (wi * ci[Y, Y] + wj * cj[Y, Y]) / w + shares * dy * dy
    vi = ci[X, X] * ci[Y, Y] - ci[X, Y] ** 2
    vj = cj[X, X] * cj[Y, Y] - cj[X, Y] ** 2
    v = xx * yy - xy * xy
    apart = _loss(wi / w, vi, wj / w, vj, v, best, alone)
    return float(max(turned, apart))


@kernel
def _merge_into(belief: Belief, i: int, j: int, scale: float) -> None:
    """Merge hypothesis j into i, the heavier; j is marked dead."""
    wi = max(belief.probability[i], 1e-300)
    wj = max(belief.probability[j], 1e-300)
    merge_moments(
        belief.mean[i], belief.cov[i], belief.mean[j], belief.cov[j], wi / (wi + wj), scale
    )
    share = wi / (wi + wj)
    belief.stay[i] = share * belief.stay[i] + (1.0 - share) * belief.stay[j]
    for a in range(int(belief.clock[ORIGINS])):
        belief.share[i, a] = share * belief.share[i, a] + (1.0 - share) * belief.share[j, a]
    belief.log_weight[i] = math.log(wi + wj)
    belief.probability[i] = wi + wj
    belief.edge[j] = NO_EDGE


@part
def _merge_edge(belief: Belief, first: int, limit: float, most: int, scale: float) -> bool:
    """Merge the cheapest pair on the edge of hypothesis `first`; False when all is well."""
    n = belief.size[0]
    edge = belief.edge[first]
    if edge == OFF_ROAD:
        limit = _OFF_LIMIT
        most = _OFF_MOST
    count = 0
    for i in range(first, n):
        if belief.edge[i] == edge:
            count += 1
    if count == 1:
        return False
    best = limit + 1e-300 if count <= most else math.inf  # dearer pairs stay two
    best_i = -1
    best_j = -1
    for i in range(first, n):
        if belief.edge[i] != edge:
            continue
        for j in range(i + 1, n):
            if belief.edge[j] != edge:
                continue
            cost = _merge_cost(belief, i, j, best, scale, count == 2)
            if cost < best:
                best, best_i, best_j = cost, i, j
    if best_i < 0:
        return False
    if belief.log_weight[best_j] > belief.log_weight[best_i]:
        copy_from = best_i
        best_i = best_j
        best_j = copy_from
    _merge_into(belief, best_i, best_j, scale)
    return True


@part
def _seen_before(belief: Belief, i: int) -> bool:
    """Whether a hypothesis before i is on the same edge: its pairs have been looked at."""
    j = 0
    while j < i and belief.edge[j] != belief.edge[i]:
        j += 1
    return j < i


@part
def _is_clear(belief: Belief) -> bool:
    """Whether one edge has nearly all the probability: then little hangs on its parts."""
    top = 0
    for i in range(belief.size[0]):
        if belief.probability[i] > belief.probability[top]:
            top = i
    rest = 1.0
    for i in range(belief.size[0]):
        if belief.edge[i] == belief.edge[top]:
            rest -= belief.probability[i]
    return rest < _CLEAR


@entry
def reduce(
    belief: Belief, route: Route, scale: float, prune: float, limit: float, most: int
) -> None:  # fmt: skip
    """Normalise; drop the negligible; merge within edges; enter the route tree.

    The off-road hypothesis is kept down to a hundredth of the usual floor: it is the way back
    when every road was wrong.  With less it is born anew wherever a road is left.

    Args:
        belief: In place, weights normalised afterwards.
        route: New edges of the survivors are entered here.
        scale: Local scale of the plane.
        prune: Floor of the probabilities.
        limit: Merging cost (nats) that is accepted.
        most: Components kept per directed edge.
    """
    normalise(belief)
    n = belief.size[0]
    if _is_clear(belief):
        limit = max(limit, _CLEAR_LIMIT)
    dropped = 0
    for i in range(n):
        low = _OFF_PRUNE * prune if belief.edge[i] == OFF_ROAD else prune
        if belief.probability[i] < low:
            belief.edge[i] = NO_EDGE
            dropped += 1
    for i in range(n):
        if belief.edge[i] == NO_EDGE or _seen_before(belief, i):
            continue
        while belief.edge[i] != NO_EDGE and _merge_edge(belief, i, limit, most, scale):
            dropped += 1
    if dropped > 0 or n > KEPT:
        m = 0
        for i in range(n):
            if belief.edge[i] != NO_EDGE:
                if m != i:
                    copy_hypothesis(belief, i, m)
                m += 1
        belief.size[0] = m
        while belief.size[0] > KEPT:
            _drop_lightest(belief)
        total = 0.0
        for i in range(belief.size[0]):
            total += belief.probability[i]
        log_total = math.log(total)
        for i in range(belief.size[0]):
            belief.probability[i] /= total
            belief.log_weight[i] -= log_total
    for i in range(belief.size[0]):
        if belief.fresh[i] == 1:
            belief.fresh[i] = 0
            belief.node[i] = enter(
                route, belief.edge[i], belief.node[i], belief.clock[NOW],
                min(max(belief.abscissa[i], 0.0), 1e9),
            )  # fmt: skip


@kernel
def _drop_lightest(belief: Belief) -> None:
    lightest = 0
    for i in range(belief.size[0]):
        if belief.probability[i] < belief.probability[lightest]:
            lightest = i
    last = belief.size[0] - 1
    if lightest != last:
        copy_hypothesis(belief, last, lightest)
    belief.size[0] = last
