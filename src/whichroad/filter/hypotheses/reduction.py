"""Hypotheses merge within an edge, and the negligible ones are pruned.

Merging by moments within the same directed edge loses next to nothing, and pruning
alone loses much: measured against exact enumeration on forks, four components in all
are within 1e-2 of the exact road probabilities, and the four best unmerged within 0.2.
"""

import math

from ..._compile import Record, entry, kernel
from ...graph.geometry import wrap
from ..beside import merged_odds
from ..gaussian import merge_moments
from ..sparse.origin import is_waiting
from ..state import (
    KEPT,
    NO_BOUND,
    NO_EDGE,
    OFF_ROAD,
    WHEELS,
    Belief,
    Context,
    H,
    Path,
    X,
    Y,
    enter,
    floor_of,
    most_probable,
    move_row,
    normalise,
)
from .branching import p_within

_OFF_LIMIT = 0.3  # nats, relative, below which two off-road components are merged
_CLEAR = 1e-4  # probability of all other edges, below which
_CLEAR_LIMIT = 0.003  # nats, relative, are little to lose by merging
_OPPOSED = 1.6  # rad
_OFF_MOST = 8  # off-road components kept
_OFF_PRUNE = 0.01  # of the usual floor; it is the way back when every road was wrong
_BLIND = 500.0  # times more merging without a heading sensor
_WAITING = 1e-6  # floor of those that take the last fix to be wrong
_NEXT = 0  # scratch while hypotheses are merged: the next row that may merge with this one,
_END, _UNLISTED = -1.0, -2.0  # or none; or it is on no list yet


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


@kernel(inline=True)
def _merge_cost(a: Record, b: Record, best: float, scale: float, alone: bool) -> float:
    """Runnalls' bound on what merging two hypotheses loses, along the road only, nats.

        B = ½ (W log v − w_i log v_i − w_j log v_j)

    with v the variance of the merged abscissa; the most of it, of the heading's and of the
    lateral offset's.
    """
    wi = max(a.weight, 1e-300)
    wj = max(b.weight, 1e-300)
    w = wi + wj
    shares = wi * wj / (w * w)
    vi = a.along_sigma**2
    vj = b.along_sigma**2
    gap = a.along - b.along
    v = (wi * vi + wj * vj) / w + shares * gap * gap
    along = _loss(wi, vi, wj, vj, v, best, alone)
    if along > best:
        return float(along)  # more than the best pair already
    gap = wrap(a.mu[H] - b.mu[H])
    if abs(gap) > _OPPOSED:
        return math.inf
    vi = a.cov[H, H]
    vj = b.cov[H, H]
    v = (wi * vi + wj * vj) / w + shares * gap * gap
    turned = _loss(wi, vi, wj, vj, v, best, alone)
    if turned > best:
        return float(turned)
    nx = math.sin(a.mu[H])
    ny = -math.cos(a.mu[H])
    dx = a.mu[X] - b.mu[X]
    dy = a.mu[Y] - b.mu[Y]
    gap = (nx * dx + ny * dy) / scale
    vi = nx * nx * a.cov[X, X] + 2.0 * nx * ny * a.cov[X, Y] + ny * ny * a.cov[Y, Y]
    vj = nx * nx * b.cov[X, X] + 2.0 * nx * ny * b.cov[X, Y] + ny * ny * b.cov[Y, Y]
    v = (wi * vi + wj * vj) / w + shares * gap * gap
    across = _loss(wi, vi, wj, vj, v, best, alone)
    return float(max(along, turned, across))


@kernel(inline=True)
def _merge_cost_off_road(a: Record, b: Record, best: float, scale: float, alone: bool) -> float:
    """The same off the roads: the worst of position and heading, relative to W.

    That hypothesis mostly has little weight, and must keep its precision.
    """
    wi = max(a.weight, 1e-300)
    wj = max(b.weight, 1e-300)
    w = wi + wj
    shares = wi * wj / (w * w)
    gap = wrap(a.mu[H] - b.mu[H])
    if abs(gap) > _OPPOSED:
        return math.inf
    vi = a.cov[H, H]
    vj = b.cov[H, H]
    v = (wi * vi + wj * vj) / w + shares * gap * gap
    turned = _loss(wi / w, vi, wj / w, vj, v, best, alone)
    if turned > best:
        return float(turned)
    dx = (a.mu[X] - b.mu[X]) / scale
    dy = (a.mu[Y] - b.mu[Y]) / scale
    ci = a.cov
    cj = b.cov
    xx = (wi * ci[X, X] + wj * cj[X, X]) / w + shares * dx * dx
    xy = (wi * ci[X, Y] + wj * cj[X, Y]) / w + shares * dx * dy
    yy = (wi * ci[Y, Y] + wj * cj[Y, Y]) / w + shares * dy * dy
    vi = ci[X, X] * ci[Y, Y] - ci[X, Y] ** 2
    vj = cj[X, X] * cj[Y, Y] - cj[X, Y] ** 2
    v = xx * yy - xy * xy
    apart = _loss(wi / w, vi, wj / w, vj, v, best, alone)
    return float(max(turned, apart))


@kernel
def _note_rest(a: Record, b: Record, share: float) -> None:
    """P(before the bound) of two that are merged; what was passed on of either is of neither."""
    gap = b.along - a.along
    variance = share * a.along_sigma**2 + (1.0 - share) * b.along_sigma**2
    a.along += (1.0 - share) * gap
    a.along_sigma = math.sqrt(variance + share * (1.0 - share) * gap * gap)
    a.p_not_passed = p_within(a)


@kernel
def _merge_into(belief: Belief, i: int, j: int) -> None:
    """Merge hypothesis j into i, the heavier; j is marked dead."""
    state = belief.state[0]
    a = belief.hyp[i]
    b = belief.hyp[j]
    wi = max(a.weight, 1e-300)
    wj = max(b.weight, 1e-300)
    share = wi / (wi + wj)
    merge_moments(a.mu, a.cov, b.mu, b.cov, share, state.scale)
    a.p_not_passed = share * a.p_not_passed + (1.0 - share) * b.p_not_passed
    a.bound = min(a.bound, b.bound)
    a.freed = share * a.freed + (1.0 - share) * b.freed
    a.leg.haste = share * a.leg.haste + (1.0 - share) * b.leg.haste
    if state.mode != WHEELS and a.bound < NO_BOUND:
        _note_rest(a, b, share)
    a.beside[0] = merged_odds(a.beside[0], b.beside[0], share)
    for k in range(state.parents):
        belief.lineage[i, k] = share * belief.lineage[i, k] + (1.0 - share) * belief.lineage[j, k]
    a.log_weight = math.log(wi + wj)
    a.weight = wi + wj
    b.edge = NO_EDGE


@kernel(inline=True)
def _merges(belief: Belief, i: int, first: int) -> bool:
    """Whether hypothesis i may merge with another one: on its edge, and it stands as that does.

    One that waits for the next fix stays apart.
    """
    hyp = belief.hyp[i]
    other = belief.hyp[first]
    alike = hyp.edge == other.edge and (hyp.stood > 0.0) == (other.stood > 0.0)
    return bool(alike and hyp.backs == other.backs and not is_waiting(hyp, belief.state[0].time))


@kernel(inline=True)
def _list_edge(belief: Belief, first: int) -> int:
    """List those that may merge with hypothesis `first`, all behind it; returns how many."""
    last = first
    count = 1
    for i in range(first + 1, belief.state[0].count):
        if _merges(belief, i, first):
            belief.hyp[last].scratch[_NEXT] = i
            last = i
            count += 1
    belief.hyp[last].scratch[_NEXT] = _END
    return count


@kernel(inline=True)
def _unlist(belief: Belief, first: int, row: int) -> int:
    """Take a row off the list that begins with `first`; returns the first one then."""
    following = belief.hyp[row].scratch[_NEXT]
    if row == first:
        return int(following)
    at = first
    while int(belief.hyp[at].scratch[_NEXT]) != row:
        at = int(belief.hyp[at].scratch[_NEXT])
    belief.hyp[at].scratch[_NEXT] = following
    return first


@kernel(inline=True)
def _cheapest_pair(belief: Belief, first: int, best: float, alone: bool) -> tuple[int, int]:
    """The rows of the list whose merging costs least, and less than `best`; -1: there are none.

    The heavier one is the first of the two.  `alone`: the list holds no other pair.
    """
    scale = belief.state[0].scale
    off = belief.hyp[first].edge == OFF_ROAD
    best_i = best_j = -1
    i = first
    while i >= 0:
        following = int(belief.hyp[i].scratch[_NEXT])
        j = following
        while j >= 0:
            if off:
                cost = _merge_cost_off_road(belief.hyp[i], belief.hyp[j], best, scale, alone)
            else:
                cost = _merge_cost(belief.hyp[i], belief.hyp[j], best, scale, alone)
            if cost < best:
                best, best_i, best_j = cost, i, j
            j = int(belief.hyp[j].scratch[_NEXT])
        i = following
    if best_i >= 0 and belief.hyp[best_j].log_weight > belief.hyp[best_i].log_weight:
        return best_j, best_i
    return best_i, best_j


@kernel(inline=True)
def _merge_edge(belief: Belief, first: int, limit: float, most: int) -> int:
    """Merge on the edge of hypothesis `first`, the cheapest pair first; returns how often."""
    if belief.hyp[first].edge == OFF_ROAD:
        limit = _OFF_LIMIT
        most = _OFF_MOST
    count = _list_edge(belief, first)
    merged = 0
    while merged < count - 1:
        left = count - merged
        best = limit + 1e-300 if left <= most else math.inf  # pairs that cost more are not merged
        i, j = _cheapest_pair(belief, first, best, left == 2)
        if i < 0:
            break
        first = _unlist(belief, first, j)
        _merge_into(belief, i, j)
        merged += 1
    return merged


@kernel(inline=True)
def _shared_edges(belief: Belief) -> int:
    """Bits of edges modulo 64, set where two living hypotheses may be on one."""
    seen = shared = 0
    for i in range(belief.state[0].count):
        edge = belief.hyp[i].edge
        if edge != NO_EDGE:
            bit = 1 << (int(edge) & 63)
            shared |= seen & bit
            seen |= bit
    return shared


@kernel(inline=True)
def _is_clear(belief: Belief) -> bool:
    """Whether one edge has nearly all the weight: then little depends on its parts."""
    edge = belief.hyp[most_probable(belief)].edge
    rest = 1.0
    for i in range(belief.state[0].count):
        if belief.hyp[i].edge == edge:
            rest -= belief.hyp[i].weight
    return rest < _CLEAR


@entry
def reduce(belief: Belief, path: Path, ctx: Context) -> None:
    """Normalise; prune the negligible; merge within edges; enter the path tree.

    The off-road hypothesis is kept down to a hundredth of the usual floor: it is the way back
    when every road was wrong.  With less it is spawned anew wherever a road is left.

    Args:
        belief: In place, weights normalised afterwards.
        path: New edges of the survivors are entered here.
        ctx: The drive's constants.
    """
    par = ctx.par[0]
    state = belief.state[0]
    limit = par.merge
    most = int(par.components)
    if state.mode != WHEELS:  # without a heading there is less to keep apart
        limit *= _BLIND
        most = (most + 1) // 2
    normalise(belief)
    n = state.count
    if _is_clear(belief):
        limit = max(limit, _CLEAR_LIMIT)
    dropped = 0
    for i in range(n):
        hyp = belief.hyp[i]
        floor = _OFF_PRUNE * par.prune if hyp.edge == OFF_ROAD else floor_of(hyp, par.prune)
        if hyp.weight < floor and (hyp.weight < _WAITING or not is_waiting(hyp, state.time)):
            hyp.edge = NO_EDGE
            dropped += 1
        hyp.scratch[_NEXT] = _UNLISTED
    shared = _shared_edges(belief)
    for i in range(n):
        hyp = belief.hyp[i]
        if hyp.edge == NO_EDGE or shared & (1 << (int(hyp.edge) & 63)) == 0:
            continue
        if hyp.scratch[_NEXT] == _UNLISTED and not is_waiting(hyp, state.time):
            dropped += _merge_edge(belief, i, limit, most)
    if dropped > 0 or n > KEPT:
        _compact(belief)
    enter_new_edges(belief, path)


@kernel(inline=True)
def _compact(belief: Belief) -> None:
    """Close the gaps of dropped hypotheses, keep the heaviest, and make weights sum to one."""
    state = belief.state[0]
    m = 0
    for i in range(state.count):
        if belief.hyp[i].edge != NO_EDGE:
            if m != i:
                move_row(belief, i, m)
            m += 1
    state.count = m
    while state.count > KEPT:
        drop_lightest(belief)
    total = 0.0
    for i in range(state.count):
        total += belief.hyp[i].weight
    log_total = math.log(total)
    for i in range(state.count):
        belief.hyp[i].weight /= total
        belief.hyp[i].log_weight -= log_total


@kernel(inline=True)
def enter_new_edges(belief: Belief, path: Path) -> None:
    """Enter the edges on which hypotheses are since this epoch in the path tree."""
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        if hyp.new_edge == 1:
            hyp.new_edge = 0
            along = min(max(hyp.along, 0.0), 1e9)
            hyp.path_entry = enter(path, hyp.edge, hyp.path_entry, belief.state[0].time, along)


@kernel
def drop_lightest(belief: Belief) -> None:
    """Drop the hypothesis of the least weight."""
    lightest = 0
    for i in range(belief.state[0].count):
        if belief.hyp[i].weight < belief.hyp[lightest].weight:
            lightest = i
    last = belief.state[0].count - 1
    if lightest != last:
        move_row(belief, last, lightest)
    belief.state[0].count = last
