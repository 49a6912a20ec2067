"""From one fix to the next when they lie far apart: hypotheses move along routes.

In place of many small steps, each hypothesis is taken along the cheapest routes to the
roads near the new fix, with the distance that its speed allows; the fix is then taken as
ever, and what it puts beyond an edge's ends is cut off.
"""

import math

from ._jit import Matrix, Vector, kernel, part
from .angles import wrap
from .belief import (
    CAPACITY,
    GNSS_SCALE,
    GX,
    GY,
    MX,
    MY,
    NO_EDGE,
    NOW,
    OFF_ROAD,
    WHITE,
    Belief,
    D,
    H,
    K,
    N,
    Route,
    X,
    Y,
)
from .gaussian import condition, normal_cdf
from .grid import closest, vertex_at
from .legs import (
    SPEED_SIGMA,
    USUAL,
    choose_legs,
    heavy_tail,
    mass_near,
    spread_of,
    usual_speed,
    variance_along,
)
from .motion import age_map, decay, predict_along, redraw_lane
from .network import Roads, lane_sigma_of
from .parameters import Parameters
from .road import track
from .routes import Search, set_goals
from .segment import locate, project
from .switching import Work, copy_hypothesis, enter, rescale

_BY_CHANCE = 2.0  # nats, at most, for being beside a road without being on one
_LEAVE = 0.1  # of the usual rate roads are left at between such fixes
_RETURN = 0.5  # of what was off the roads is back on one at the next fix
_STAND_TIME = 30.0  # s, about which who stands goes on standing
_MOST = 24  # routes that become hypotheses
_LEAST = 1e-5  # probability of what comes back to a road
_FAR_ABOVE = 3.0  # nats
_ANYWHERE = 1e6  # m², of the way that somebody drove who comes from nowhere
_STANDING = 1e-3  # probability of standing that is looked at
WIDE = 30.0  # m, across the road before the road is observed


@kernel
def _on_line(
    mean: Vector, cov: Matrix, row: Vector, tx: float, ty: float, behind: float,
    relative_sigma: float, scale: float,
) -> float:  # fmt: skip
    """Condition on the road's line; `behind` is d less the lateral offset, m."""
    for j in range(N):
        row[j] = 0.0
    row[X] = ty
    row[Y] = -tx
    row[MX] = ty
    row[MY] = -tx
    row[D] = -1.0
    return float(condition(mean, cov, row, behind, relative_sigma**2, scale))


@part
def _arrive(
    belief: Belief, roads: Roads, route: Route, work: Work, i: int, pair: int,
    scale: float, zx: float, zy: float, jitter: float, dt: float, since: float, side: float,
    par: Parameters,
) -> None:  # fmt: skip
    """Append a child of hypothesis i that has taken the route of a pair."""
    search = work.search
    label = search.pair_label[pair]
    goal = search.pair_goal[pair]
    edge = work.near_edge[goal]
    child = belief.size[0]
    _, tx, ty = track(belief, roads, i, scale)
    copy_hypothesis(belief, i, child)
    mean = belief.mean[child]
    cov = belief.cov[child]
    keep, old, far, cross = spread_of(dt)
    if label >= 0:
        length = search.length[label]
        turn = search.turn[label]
        usual = usual_speed(roads, length, search.time[label], edge)
    else:
        length = -belief.abscissa[i]
        turn = 0.0
        usual = USUAL * float(roads.speed[edge])
    distance = usual * (dt - old) + mean[K] * old
    at = distance - length  # where the speed would have it
    variance = variance_along(belief, i, tx, ty, old, far)
    off = work.near_s[goal] - at
    heavy = heavy_tail(variance, off, jitter) - variance
    variance += heavy
    drove = max(variance - belief.spread[i] ** 2, 1.0)
    harder = 1.0 + heavy / max(far, 1.0)  # than usual it braked, or hurried
    far += heavy
    segment, foot, _, nx, ny = project(
        roads, edge, vertex_at(roads, edge, work.near_s[goal]), zx, zy
    )
    weight = variance / (variance + 100.0)
    foot = min(max(at + weight * (foot - at), 0.0), roads.length[edge])
    segment, cx, cy, nx, ny = locate(roads, edge, segment, foot)
    heading = math.atan2(ny, nx)
    bent = wrap(heading - math.atan2(ty, tx))
    predict_along(
        mean, cov, old, bent, heading, nx, ny, far, 0.0, 0.0,
        par.edge_heading_sigma**2 + 0.02,
    )  # fmt: skip
    decay(mean, cov, K, usual, keep, SPEED_SIGMA * SPEED_SIGMA * harder)
    cross *= harder
    cov[X, K] += cross * nx
    cov[Y, K] += cross * ny
    cov[K, X] = cov[X, K]
    cov[K, Y] = cov[Y, K]
    went = max(foot + length, 0.0)
    lane = side * roads.lane[edge]
    if edge != belief.edge[i]:
        redraw_lane(
            mean, cov, turn, side * roads.lane[belief.edge[i]], lane,
            lane_sigma_of(roads, edge, par.lane_sigma),
        )  # fmt: skip
    age_map(
        mean, cov, lane, math.exp(-went / par.lane_length),
        lane_sigma_of(roads, edge, par.lane_sigma), math.exp(-went / par.map_length),
        par.map_sigma,
    )  # fmt: skip
    wide = WIDE * WIDE
    cov[X, X] += wide * ny * ny
    cov[Y, Y] += wide * nx * nx
    cov[X, Y] -= wide * nx * ny
    cov[Y, X] = cov[X, Y]
    ahead = at - foot
    mean[X] = cx + scale * (mean[D] * ny - mean[MX] + ahead * nx)
    mean[Y] = cy + scale * (-mean[D] * nx - mean[MY] + ahead * ny)
    _on_line(mean, cov, work.row, nx, ny, 0.0, par.relative_sigma, scale)
    belief.log_weight[child] -= search.pair_cost[pair]
    belief.edge[child] = edge
    belief.segment[child] = segment
    belief.stay[child] = 1.0
    belief.drove[child] = drove
    belief.abscissa[child] = foot
    if label >= 0:
        belief.fresh[child] = 1
        _enter_chain(belief, roads, route, search, child, label, went, dt, since)
    belief.size[0] = child + 1


@part
def _stand(belief: Belief, roads: Roads, i: int, dt: float) -> None:
    """Append a child of hypothesis i that has stood all the time; the others drove."""
    mean = belief.mean[i]
    cov = belief.cov[i]
    share = math.exp(-dt / _STAND_TIME - 0.5 * mean[K] ** 2 / (cov[K, K] + 0.5))
    share /= math.sqrt(1.0 + 2.0 * cov[K, K])
    if belief.probability[i] * share < _STANDING or belief.size[0] >= CAPACITY:
        return
    child = belief.size[0]
    copy_hypothesis(belief, i, child)
    rescale(belief, i, 1.0 - share)
    edge = belief.edge[i]
    on_edge = normal_cdf((roads.length[edge] - belief.abscissa[i]) / belief.spread[i])
    on_edge -= normal_cdf(-belief.abscissa[i] / belief.spread[i])
    rescale(belief, child, share / max(on_edge, 0.3))  # what lies beyond was not there
    decay(belief.mean[child], belief.cov[child], K, 0.0, 0.0, 0.02)
    belief.drove[child] = 0.0
    belief.size[0] = child + 1


@kernel
def _enter_chain(
    belief: Belief, roads: Roads, route: Route, search: Search, child: int, label: int,
    went: float, dt: float, since: float,
) -> None:  # fmt: skip
    """Enter the edges between two fixes in the route tree, timed by the distance."""
    chain = 0
    up = search.parent[label]
    while up >= 0:
        chain += 1
        up = search.parent[up]
    for back in range(chain, 0, -1):
        up = label
        for _ in range(back):
            up = search.parent[up]
        share = min(max(search.length[up] / max(went, 1.0), 0.0), 1.0)
        belief.node[child] = enter(
            route, search.edge[up], belief.node[child], since + share * dt, 0.0
        )


@part
def _fly(belief: Belief, i: int, x: float, y: float, dt: float, scale: float) -> None:
    """Off the roads anything may have happened in between."""
    mean = belief.mean[i]
    cov = belief.cov[i]
    keep, _, far, _ = spread_of(dt)
    reach = max(mean[K], 5.0) * dt
    spread = 0.5 * reach * reach + far
    heading = math.atan2(y - mean[Y], x - mean[X])
    for j in range(N):
        cov[H, j] = 0.0
        cov[j, H] = 0.0
    cov[H, H] = 0.5
    mean[H] = heading
    cov[X, X] += spread
    cov[Y, Y] += spread
    decay(mean, cov, K, 8.0, keep, SPEED_SIGMA * SPEED_SIGMA)


@part
def _come_back(
    belief: Belief, roads: Roads, work: Work, i: int, first: int, found: int, sigma: float,
    scale: float, side: float, par: Parameters,
) -> None:  # fmt: skip
    """Children of an off-road hypothesis on the roads near the fix, in proportion to length.

    A road that a route leads to as well, far more likely, needs none from nowhere.
    """
    mass = belief.scratch[0]
    total = 0.0
    for c in range(found):
        mass[c] = mass_near(roads, work, c, sigma, par)
        total += mass[c]
    if total <= 0.0:
        return
    rescale(belief, i, 1.0 - _RETURN)
    for c in range(found):
        share = _RETURN / (1.0 - _RETURN) * mass[c] / total
        if belief.probability[i] * share < _LEAST or belief.size[0] >= CAPACITY:
            continue
        if _is_reached(belief, first, work.near_edge[c], belief.log_weight[i] + math.log(share)):
            continue
        edge = work.near_edge[c]
        child = belief.size[0]
        copy_hypothesis(belief, i, child)
        rescale(belief, child, share)
        segment, cx, cy, tx, ty = locate(
            roads, edge, vertex_at(roads, edge, work.near_s[c]), work.near_s[c]
        )
        mean = belief.mean[child]
        cov = belief.cov[child]
        for j in range(N):
            cov[D, j] = 0.0
            cov[j, D] = 0.0
        cov[D, D] = lane_sigma_of(roads, edge, par.lane_sigma) ** 2
        cov[H, H] = par.edge_heading_sigma**2 + 0.02
        mean[D] = side * roads.lane[edge]
        mean[H] = math.atan2(ty, tx)
        lateral = ty * (mean[X] - cx) / scale - tx * (mean[Y] - cy) / scale
        lateral += ty * mean[MX] - tx * mean[MY]
        _on_line(mean, cov, work.row, tx, ty, mean[D] - lateral, par.relative_sigma, scale)
        belief.edge[child] = edge
        belief.segment[child] = segment
        belief.stay[child] = 1.0
        belief.drove[child] = _ANYWHERE
        belief.fresh[child] = 1
        belief.size[0] = child + 1


@kernel
def _is_reached(belief: Belief, first: int, edge: int, log_weight: float) -> bool:
    """Whether a hypothesis from `first` on is on an edge, and far above a weight."""
    top = -math.inf
    for j in range(first, belief.size[0]):
        if belief.edge[j] == edge:
            top = max(top, belief.log_weight[j])
    return bool(top > log_weight + _FAR_ABOVE)


@kernel
def travel(
    belief: Belief, roads: Roads, route: Route, work: Work, scale: float,
    fix: Vector, dt: float, side: float, par: Parameters,
) -> float:  # fmt: skip
    """Take every hypothesis along the routes to the roads near a fix.

    Args:
        belief: In place, normalised; those on roads are replaced by those that arrive.
        roads: The network.
        route: The tree of edges entered.
        work: Scratch; its root is that of the last fix.
        scale: Local scale of the plane.
        fix: x, y (plane), sigma_major, sigma_minor (m), heading of the major axis.
        dt: Since the last epoch, s.
        side: 1 where one drives on the right, -1 on the left.
        par: The settings.

    Returns:
        About how far it was, m.
    """
    n = belief.size[0]
    top = 0
    for i in range(n):
        if belief.log_weight[i] > belief.log_weight[top]:
            top = i
    mean = belief.mean[top]
    moved = math.hypot(fix[0] - mean[X], fix[1] - mean[Y]) / scale
    age = math.exp(-dt / par.gnss_time)
    root = work.root
    x = fix[0] + scale * (mean[MX] - age * (root[0] * mean[GX] + root[1] * mean[GY]))
    y = fix[1] + scale * (mean[MY] - age * (root[1] * mean[GX] + root[2] * mean[GY]))
    factor = belief.clock[GNSS_SCALE] * (1.0 + par.gnss_white_ratio**2)
    sigma = math.sqrt(factor * fix[2] ** 2 + par.map_sigma**2)
    white = max(belief.clock[WHITE], belief.clock[GNSS_SCALE] * par.gnss_white_ratio**2)
    jitter = math.sqrt(white + belief.clock[GNSS_SCALE] * (1.0 - age * age)) * fix[2]
    radius = 4.0 * sigma + 3.0
    found = closest(roads, x, y, radius, work.near_edge, work.near_s, work.near_distance)
    search = work.search
    set_goals(search, work.near_edge, found)
    pairs = 0
    if found > 0:
        pairs = choose_legs(belief, roads, work, found, scale, x, y, radius, sigma, jitter, dt)
    children = 0
    since = belief.clock[NOW] - dt
    for i in range(n):
        if belief.edge[i] != OFF_ROAD:
            _stand(belief, roads, i, dt)
    while children < _MOST and pairs > 0 and belief.size[0] < CAPACITY:
        best = 0
        for p in range(pairs):
            if search.pair_score[p] > search.pair_score[best]:
                best = p
        if search.pair_score[best] == -math.inf:
            break
        i = search.pair_source[best]
        own = belief.mean[i]
        zx = fix[0] + scale * (own[MX] - age * (root[0] * own[GX] + root[1] * own[GY]))
        zy = fix[1] + scale * (own[MY] - age * (root[1] * own[GX] + root[2] * own[GY]))
        _arrive(belief, roads, route, work, i, best, scale, zx, zy, jitter, dt, since, side, par)
        search.pair_score[best] = -math.inf
        children += 1
    off = False
    for i in range(n):
        off = off or belief.edge[i] == OFF_ROAD
    if children == 0 and not off:  # no route: the way is not on the map
        belief.edge[top] = OFF_ROAD
        belief.fresh[top] = 1
    chance = 0.0
    if found > 0 and work.near_distance[0] < 2.0 * sigma:
        chance = min(_BY_CHANCE, par.off_road_cost * moved)
    share = min(_LEAVE * par.off_road_leave * (moved + 10.0), 0.3)
    leave = belief.log_weight[top] + math.log(max(share, 1e-300)) - _FAR_ABOVE
    for i in range(n):
        if belief.edge[i] == OFF_ROAD:
            if i != top and belief.probability[i] < _LEAST and belief.log_weight[i] < leave:
                belief.edge[i] = NO_EDGE  # who leaves the roads now is as good
                continue
            _fly(belief, i, fix[0], fix[1], dt, scale)
            belief.log_weight[i] -= chance
            if found > 0 and belief.probability[i] > _LEAST:
                _come_back(belief, roads, work, i, n, found, sigma, scale, side, par)
        elif i == top and belief.size[0] < CAPACITY:  # left the roads on the way
            child = belief.size[0]
            copy_hypothesis(belief, i, child)
            rescale(belief, child, share)
            belief.edge[child] = OFF_ROAD
            belief.fresh[child] = 1
            _fly(belief, child, fix[0], fix[1], dt, scale)
            belief.size[0] = child + 1
    for i in range(n - 1, -1, -1):  # the last one takes the place of who has gone
        if belief.edge[i] != OFF_ROAD:
            belief.size[0] -= 1
            if i != belief.size[0]:
                copy_hypothesis(belief, int(belief.size[0]), i)
    return moved
