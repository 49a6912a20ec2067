"""Where a vehicle was while its fixes only repeated a place: on the path between others.

Such epochs were passed over, and their estimates stand where the last fix was.  The path says which
way was driven.  The vehicle may have gone faster and slower, or have stood: of the way between the
estimates at both fixes, a share f of which is driven at an even speed at the time t,

    σ = 0.4 way √(f (1 − f))
"""

import math

from ..._compile import Record, entry, kernel
from ...graph.geometry import angle_of, locate
from ...graph.network import Roads
from ..gaussian import normal_cdf
from ..state import NO_EDGE, Epochs
from ..summary.estimate import Estimates
from .passage import Traversals

_UNEVEN = 0.4  # of the way
_TIMES = 3.3  # sigmas that a level reaches
_LIKELY = 0.5  # P of a path that is followed
_LEAST = 1.0  # m


@entry
def place_in_gaps(roads: Roads, driven: Traversals, epochs: Epochs, estimates: Estimates) -> None:
    """Put the estimates of epochs whose fix fills a gap on the path.

    Args:
        roads: The network.
        driven: (r,) TRAVERSAL of the path, timed.
        epochs: (n,) EPOCH of the drive.
        estimates: (n,) ESTIMATE, in place.
    """
    row = 0
    k = 1
    while k < len(epochs):
        if epochs[k].filled == 0:
            k += 1
            continue
        end = k + 1
        while end < len(epochs) and epochs[end].filled == 1:
            end += 1
        if end == len(epochs) or len(driven) == 0:
            return
        first = _row_at(driven, row, epochs[k - 1].time)
        last = _row_at(driven, first, epochs[end].time)
        if _is_whole(driven, first, last):
            _place(roads, driven, epochs, estimates, (k, end), (first, last))
        row = last
        k = end


@kernel
def _row_at(driven: Traversals, row: int, time: float) -> int:
    """The row of a path at a time, from another one on."""
    while row + 1 < len(driven) and driven[row].exit_time < time:
        row += 1
    return row


@kernel
def _is_whole(driven: Traversals, first: int, last: int) -> bool:
    """Whether a path between two rows has no gap, and is likely."""
    for i in range(first, last + 1):
        if driven[i].p_route < _LIKELY or (i > first and driven[i].gap):
            return False
    return True


@kernel
def _far(driven: Traversals, row: int, time: float) -> float:
    """How far along its edge a vehicle is at a time, from where it entered, m."""
    own = driven[row]
    seconds = own.exit_time - own.enter_time
    part = (time - own.enter_time) / seconds if seconds > 0.0 else 1.0
    return float(min(max(part, 0.0), 1.0) * (own.exit_m - own.enter_m))


@kernel
def _seen(driven: Traversals, row: int, time: float, estimate: Record) -> float:
    """How far along the edge of a row a vehicle is at a fix, from where it entered, m."""
    own = driven[row]
    if estimate.edge == own.edge:
        return float(min(max(estimate.s - own.enter_m, 0.0), own.exit_m - own.enter_m))
    return _far(driven, row, time)


@kernel
def _place(
    roads: Roads, driven: Traversals, epochs: Epochs, estimates: Estimates,
    gap: tuple[int, int], rows: tuple[int, int],
) -> None:  # fmt: skip
    """Put the estimates of one gap on the rows of the path between the fixes around."""
    before, after = epochs[gap[0] - 1], epochs[gap[1]]
    start = _seen(driven, rows[0], before.time, estimates[gap[0] - 1])
    way = _seen(driven, rows[1], after.time, estimates[gap[1]]) - start
    for i in range(rows[0], rows[1]):
        way += driven[i].exit_m - driven[i].enter_m
    way = max(way, 0.0)
    level = max(estimates[gap[0] - 1].protection_level, estimates[gap[1]].protection_level)
    row = rows[0]
    begin = 0.0
    for k in range(gap[0], gap[1]):
        share = (epochs[k].time - before.time) / (after.time - before.time)
        far = start + share * way
        while row < rows[1] and far - begin > driven[row].exit_m - driven[row].enter_m:
            begin += driven[row].exit_m - driven[row].enter_m
            row += 1
        sigma = max(_UNEVEN * way * math.sqrt(share * (1.0 - share)), _LEAST)
        s = driven[row].enter_m + far - begin
        out = estimates[k]
        _move(roads, out, estimates[gap[0] - 1], driven[row].edge, s, sigma)
        length = roads.edges[driven[row].edge].length
        on = normal_cdf((length - s) / sigma) - normal_cdf(-s / sigma)
        out.edge = driven[row].edge
        out.p_way = driven[row].p_route
        out.p_edge = driven[row].p_route * on
        out.p_off_road = 1.0 - driven[row].p_route
        for a in range(len(out.alt_edge)):
            out.alt_edge[a] = NO_EDGE
            out.alt_p[a] = 0.0
        out.alt_edge[0] = out.edge
        out.alt_p[0] = out.p_edge
        out.protection_level = level + _TIMES * sigma
        out.level_along = out.level_across = out.protection_level


@kernel
def _move(roads: Roads, out: Record, known: Record, edge: int, s: float, sigma: float) -> None:
    """Put an estimate at an abscissa, as certain as a known one, and less so along the road."""
    _, x, y, tx, ty = locate(roads, edge, roads.edges[edge].first_vertex, s)
    out.x = x + known.x - known.map_x
    out.y = y + known.y - known.map_y
    out.map_x = out.match_x = x
    out.map_y = out.match_y = y
    out.heading = angle_of(tx, ty)
    out.s = s
    out.lateral = 0.0
    for i in range(6):
        out.cov[i] = known.cov[i]
    for i in range(3):
        out.map_cov[i] = known.map_cov[i]
    xx, xy, yy = sigma * sigma * tx * tx, sigma * sigma * tx * ty, sigma * sigma * ty * ty
    out.cov[0] += xx
    out.cov[1] += xy
    out.cov[3] += yy
    out.map_cov[0] += xx
    out.map_cov[1] += xy
    out.map_cov[2] += yy
