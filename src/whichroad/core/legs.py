"""Which routes lead from the hypotheses to the roads near a fix, and which are worth taking."""

import math

from ._jit import kernel
from .belief import MX, MY, OFF_ROAD, Belief, K, X, Y
from .network import Roads
from .road import track
from .routes import find_routes, goal_of
from .switching import Work

SPEED_SIGMA = 5.0  # m/s, about the usual speed of the roads
_SPEED_TIME = 22.0  # s, in which a speed is forgotten
USUAL = 0.7  # of the usual speed is driven on average, stops included
_FAST = 20.0  # m/s; up to here no road is too slow for what fixes ask for
_FASTER = 0.15  # of the highest speed; how much more is likely
_TAIL = 0.3  # of the squared deviation of a distance is its variance at least,
_SLOW_TAIL = 2.0  # and where it is shorter than the speed would have it
_WORTH = 7.0  # nats below the best, from which on a route is not worth its while
_DETOUR = 4.0  # nats; a detour that nobody can avoid costs nothing up to this
_EXCESS = 10.0  # m longer than the shortest way a route is likely to be,
_EXCESS_RATE = 1.8  # m/s, and the more, the longer it took,
_EXCESS_MOST = 120.0  # m, up to this
_U_TURN = 5.0  # nats, of turning round between junctions; twice that into a one-way


@kernel
def spread_of(dt: float) -> tuple[float, float, float, float]:
    """An Ornstein-Uhlenbeck speed about the usual one, over dt seconds.

    Returns:
        What is kept of the old speed, the seconds of it in the distance, the variance of
        the distance (m²), its covariance with the new speed (m²/s).
    """
    keep = math.exp(-dt / _SPEED_TIME)
    old = _SPEED_TIME * (1.0 - keep)
    v = SPEED_SIGMA * SPEED_SIGMA
    far = v * _SPEED_TIME**2 * (2.0 * dt / _SPEED_TIME - 3.0 + 4.0 * keep - keep * keep)
    cross = v * _SPEED_TIME * (1.0 - keep) ** 2
    return keep, old, max(far, 0.0), cross


@kernel
def variance_along(belief: Belief, i: int, tx: float, ty: float, old: float, far: float) -> float:
    """Variance of the abscissa after the step, m2."""
    cov = belief.cov[i]
    cross = tx * (cov[X, K] + cov[MX, K]) + ty * (cov[Y, K] + cov[MY, K])
    return float(max(belief.spread[i] ** 2 + old * (2.0 * cross + old * cov[K, K]) + far, 1.0))


@kernel
def heavy_tail(variance: float, off: float) -> float:
    """Variance of a distance that is `off` longer than expected: cars stand, and hurry."""
    return max(variance, (_TAIL if off > 0.0 else _SLOW_TAIL) * off * off)


@kernel
def usual_speed(roads: Roads, length: float, time: float, edge: int) -> float:
    """Average speed on a route of so many metres and seconds, m/s; of an edge where it is none."""
    if time > 0.5 and length > 1.0:
        return USUAL * length / time
    return USUAL * float(roads.speed[edge])


@kernel
def choose_legs(
    belief: Belief, roads: Roads, work: Work, found: int, scale: float,
    x: float, y: float, radius: float, sigma: float, dt: float,
) -> int:  # fmt: skip
    """Routes from all hypotheses to the roads near a fix, by what they may be worth.

    Args:
        belief: Normalised.
        roads: The network.
        work: Its `near_edge, near_s, near_distance` are the roads near the fix, its search
            has been told them as goals and gets `pair_*` filled.
        found: How many roads are near.
        scale: Local scale of the plane.
        x: Where the fix would be on the map, plane.
        y: Where the fix would be on the map, plane.
        radius: In which the roads lie, m.
        sigma: Of the fix and the map together, m.
        dt: Since the last epoch, s.

    Returns:
        How many pairs of a hypothesis and a road are worth taking.
    """
    search = work.search
    pairs = 0
    best = -math.inf
    cheapest = _DETOUR
    _, old, far, _ = spread_of(dt)
    n = belief.size[0]
    waits = belief.scratch[0]
    for i in range(n):
        waits[i] = -math.inf if belief.edge[i] == OFF_ROAD else belief.log_weight[i]
    while True:
        i = 0  # the heaviest that waits
        for j in range(n):
            if waits[j] > waits[i]:
                i = j
        if n == 0 or waits[i] < best - _WORTH or waits[i] == -math.inf:
            break
        waits[i] = -math.inf
        edge = belief.edge[i]
        _, tx, ty = track(belief, roads, i, scale)
        s = min(max(belief.abscissa[i], 0.0), roads.length[edge])
        variance = variance_along(belief, i, tx, ty, old, far)
        spread = math.sqrt(variance)
        rate = belief.mean[i, K]
        straight = math.hypot(belief.mean[i, X] - x, belief.mean[i, Y] - y) / scale
        per_metre = 1.0 / (_EXCESS + min(_EXCESS_RATE * dt, _EXCESS_MOST))
        longest = (
            max(
                old * rate + 1.3 * float(roads.speed[edge]) * (dt - old) + 4.0 * spread,
                1.5 * straight,
            )
            + 100.0
        )
        u_turn = math.inf
        if roads.opposite[edge] >= 0:
            u_turn = _U_TURN
            if roads.rule[roads.opposite[edge]]:
                u_turn = 2.0 * _U_TURN
        stay = goal_of(search, work.near_edge, edge)
        floor = belief.log_weight[i] - 0.5 * math.log(variance + sigma * sigma)
        limit = floor + per_metre * straight - best + _WORTH
        hits = find_routes(
            roads, search, work.near_edge, edge, s, x, y, radius * scale, per_metre, u_turn,
            longest, limit, _WORTH, 3000,
        )  # fmt: skip
        for h in range(-1, hits):
            label = -1
            cost = 0.0
            length = -s
            usual = USUAL * float(roads.speed[edge])
            if h < 0:
                if stay < 0:
                    continue
                goal = stay
            else:
                label = search.hit[h]
                goal = goal_of(search, work.near_edge, search.edge[label])
                cost = search.cost[label]
                length = search.length[label]
                usual = usual_speed(roads, length, search.time[label], search.edge[label])
            to = work.near_s[goal]
            went = length + to
            if went < -4.0 * sigma:
                continue
            cost += per_metre * (max(to, 0.0) if h >= 0 else max(to - s, 0.0))
            cost -= per_metre * straight
            cheapest = min(cheapest, cost)
            fast = (
                went
                / max(dt, 1.0)
                / max(1.3 * usual / USUAL, 1.3 * rate, _FAST, 1.15 * straight / max(dt, 1.0))
            )
            if fast > 1.0:  # nobody drives that fast
                cost += 0.5 * ((fast - 1.0) / _FASTER) ** 2
            off = went - usual * (dt - old) - rate * old
            wide = heavy_tail(variance, off) + sigma * sigma
            score = (
                belief.log_weight[i] - cost - 0.5 * (off * off / wide + math.log(wide))
                - 0.5 * (work.near_distance[goal] / sigma) ** 2
            )  # fmt: skip
            if score < best - _WORTH or pairs >= len(search.pair_score):
                continue
            best = max(best, score)
            search.pair_source[pairs] = i
            search.pair_label[pairs] = label
            search.pair_goal[pairs] = goal
            search.pair_score[pairs] = score
            search.pair_cost[pairs] = cost
            pairs += 1
    kept = 0
    for p in range(pairs):
        if search.pair_score[p] < best - _WORTH:
            continue
        search.pair_source[kept] = search.pair_source[p]
        search.pair_label[kept] = search.pair_label[p]
        search.pair_goal[kept] = search.pair_goal[p]
        search.pair_score[kept] = search.pair_score[p]
        search.pair_cost[kept] = search.pair_cost[p] - cheapest
        kept += 1
    return kept
