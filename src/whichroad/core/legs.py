"""Which routes lead from the hypotheses to the roads near a fix, and which are worth taking."""

import math

from ._jit import Vector, kernel
from .belief import MX, MY, OFF_ROAD, Belief, K, X, Y
from .gaussian import normal_cdf
from .hops import HOP_PRICE
from .network import Roads
from .parameters import Parameters
from .road import track
from .routes import Search, find_routes, goal_of
from .switching import Work

SPEED_SIGMA = 5.0  # m/s, about the usual speed of the roads
_SPEED_TIME = 22.0  # s, in which a speed is forgotten
USUAL = 0.7  # of the usual speed is driven on average, stops included
_FAST = 20.0  # m/s; up to here no road is too slow for what fixes ask for
_FASTER = 0.15  # of the highest speed; how much more is likely
_TAIL = 0.3  # of the squared deviation of a distance is its variance at least,
_SLOW_TAIL = 2.0  # and where it is shorter than the speed would have it
_WORTH = 6.0  # nats below the best, from which on a route is not worth its while
_AHEAD = 5.0  # nats; the same for what a route may still be worth at most
_SLACK = 4.0  # nats that a route may cost more than the cheapest of its hypothesis
_DETOUR = 4.0  # nats; a detour that nobody can avoid costs nothing up to this
_EXCESS = 10.0  # m longer than the shortest way a route is likely to be,
_EXCESS_RATE = 1.8  # m/s, and the more, the longer it took,
_EXCESS_MOST = 120.0  # m, up to this
_LABELS = 3000  # of one search
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
def heavy_tail(variance: float, off: float, sigma: float) -> float:
    """Variance of a distance that is `off` longer than expected: cars stand, and hurry.

    What the fix's own sigma explains is not counted.
    """
    beyond = max(abs(off) - 2.0 * sigma, 0.0)
    return max(variance, (_TAIL if off > 0.0 else _SLOW_TAIL) * beyond * beyond)


@kernel
def usual_speed(roads: Roads, length: float, time: float, edge: int) -> float:
    """Average speed on a route of so many metres and seconds, m/s; of an edge where it is none."""
    if time > 0.5 and length > 1.0:
        return USUAL * length / time
    return USUAL * float(roads.speed[edge])


@kernel
def mass_near(roads: Roads, work: Work, c: int, sigma: float, par: Parameters) -> float:
    """What a road near the fix is worth to somebody who comes from nowhere."""
    edge = work.near_edge[c]
    s = work.near_s[c]
    mass = normal_cdf((roads.length[edge] - s) / sigma) - normal_cdf(-s / sigma)
    if roads.rule[edge]:
        mass *= max(par.wrong_way, 1e-6)
    return mass


@kernel
def _heaviest(waits: Vector, n: int) -> int:
    """The hypothesis of the largest weight among those that wait."""
    top = 0
    for j in range(n):
        if waits[j] > waits[top]:
            top = j
    return top


@kernel
def _u_turn_cost(roads: Roads, edge: int) -> float:
    """Nats of turning round on an edge."""
    other = roads.opposite[edge]
    if other < 0:
        return math.inf
    return 2.0 * _U_TURN if roads.rule[other] else _U_TURN


@kernel
def _haste_cost(went: float, dt: float, usual: float, rate: float, straight: float) -> float:
    """Nats of a route that is longer than anybody drives in that time."""
    speed = max(1.3 * usual / USUAL, 1.3 * rate, _FAST, 1.15 * straight / max(dt, 1.0))
    over = max(went / max(dt, 1.0) / speed - 1.0, 0.0)
    return 0.5 * (over / _FASTER) ** 2


@kernel
def _note(
    search: Search, pairs: int, i: int, label: int, goal: int, score: float, cost: float
) -> int:
    """Write down one pair of a hypothesis and a road, while there is room."""
    if pairs >= len(search.pair_score):
        return pairs
    search.pair_source[pairs] = i
    search.pair_label[pairs] = label
    search.pair_goal[pairs] = goal
    search.pair_score[pairs] = score
    search.pair_cost[pairs] = cost
    return pairs + 1


@kernel
def _keep(search: Search, pairs: int, least: float, cheapest: float) -> int:
    """Drop the pairs below a score; what even the cheapest costs is no one's."""
    kept = 0
    for p in range(pairs):
        if search.pair_score[p] >= least:
            kept = _note(
                search, kept, search.pair_source[p], search.pair_label[p], search.pair_goal[p],
                search.pair_score[p], search.pair_cost[p] - cheapest,
            )  # fmt: skip
    return kept


@kernel
def choose_legs(
    belief: Belief, roads: Roads, work: Work, found: int, scale: float,
    x: float, y: float, radius: float, sigma: float, jitter: float, dt: float,
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
        jitter: Of what the fix's error changes from one fix to the next, m.
        dt: Since the last epoch, s.

    Returns:
        How many pairs of a hypothesis and a road are worth taking.
    """
    search = work.search
    pairs = 0
    best = -math.inf
    cheapest = _DETOUR
    _, old, far, _ = spread_of(dt)
    per_metre = 1.0 / (_EXCESS + min(_EXCESS_RATE * dt, _EXCESS_MOST))
    beside = 0.5 * (work.near_distance[0] / sigma) ** 2  # no road is nearer
    n = belief.size[0]
    waits = belief.scratch[0]
    for i in range(n):
        waits[i] = -math.inf if belief.edge[i] == OFF_ROAD else belief.log_weight[i]
    while n > 0:
        i = _heaviest(waits, n)
        if waits[i] < best - _WORTH or waits[i] == -math.inf:
            break
        waits[i] = -math.inf
        edge = belief.edge[i]
        _, tx, ty = track(belief, roads, i, scale)
        s = min(max(belief.abscissa[i], 0.0), roads.length[edge])
        variance = variance_along(belief, i, tx, ty, old, far)
        rate = belief.mean[i, K]
        straight = math.hypot(belief.mean[i, X] - x, belief.mean[i, Y] - y) / scale
        reach = old * rate + 1.3 * float(roads.speed[edge]) * (dt - old)
        longest = max(reach + 4.0 * math.sqrt(variance), 1.5 * straight) + 100.0
        floor = belief.log_weight[i] - 0.5 * math.log(variance + sigma * sigma) - beside
        hits = find_routes(
            roads, search, work.near_edge, edge, s, x, y, radius * scale, per_metre,
            _u_turn_cost(roads, edge), longest, floor + per_metre * straight - best + _AHEAD,
            _SLACK, _LABELS,
        )  # fmt: skip
        for h in range(-1, hits):  # -1: on along the edge
            label = search.hit[h] if h >= 0 else -1
            goal = goal_of(search, work.near_edge, search.edge[label] if h >= 0 else edge)
            if goal < 0:
                continue
            to = work.near_s[goal]
            if h < 0:
                length = -s
                cost = per_metre * max(to - s, 0.0)
                usual = USUAL * float(roads.speed[edge])
            else:
                length = search.length[label]
                last = search.edge[label]
                dear = roads.hop[last, HOP_PRICE] / roads.length[last]
                cost = search.cost[label] + per_metre * max(to, 0.0) * dear
                usual = usual_speed(roads, length, search.time[label], search.edge[label])
            went = length + to
            if went < -4.0 * sigma:
                continue
            cost -= per_metre * min(straight, max(went, 0.0))
            cheapest = min(cheapest, cost)
            cost += _haste_cost(went, dt, usual, rate, straight)
            off = went - usual * (dt - old) - rate * old
            wide = heavy_tail(variance, off, jitter) + sigma * sigma
            score = belief.log_weight[i] - cost - 0.5 * (off * off / wide + math.log(wide))
            score -= 0.5 * (work.near_distance[goal] / sigma) ** 2
            if score >= best - _WORTH:
                best = max(best, score)
                pairs = _note(search, pairs, i, label, goal, score, cost)
    return _keep(search, pairs, best - _WORTH, cheapest)
