"""Hypotheses branch along the roads.

The paper redraws its candidates from scratch within 30 m of every estimate and leaves
the transition B(i, j) unsaid.  Here a hypothesis moves along the road graph: it stays
on its edge with the probability that it has not passed the end, and gives the rest to
the edges that follow, by turn prior times the mass that lies on them.
"""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Ints, Ints32, Vector, kernel, part
from .belief import (
    CAPACITY,
    NOW,
    OFF_ROAD,
    ORIGINS,
    Belief,
    N,
    Route,
)
from .gaussian import normal_cdf, reshape_on_map, truncated_moments
from .motion import redraw_lane
from .network import Roads, lane_sigma_of
from .road import track
from .routes import Search, new_search
from .rows import set_to

_REACH = 3.5  # sigma of the abscissa beyond which no mass is looked for
MOSTLY = 0.5  # of a hypothesis beyond the end: it passes, however little it weighs
MOST = 64  # destinations of one hypothesis in one step


class Work(NamedTuple):
    """Scratch space of the kernels, allocated once."""

    row: Vector  # (N,)
    edge: Ints32  # (MOST,) destinations
    parent: Ints32  # (MOST,) destination it was reached from, -1: the origin itself
    offset: Vector  # (MOST,) abscissa of its start, from the origin's start
    prior: Vector  # (MOST,) product of turn priors
    mass: Vector  # (MOST,) prior times Gaussian mass
    turn: Vector  # (MOST,) sum of turns, rad
    near_edge: Ints
    near_s: Vector
    near_lateral: Vector
    near_distance: Vector
    search: Search  # routes between fixes far apart
    root: Vector  # (3,) scale of the slow GNSS error, see `observe.gnss_root`


def new_work() -> Work:
    """Scratch space for one thread."""
    return Work(
        np.zeros(N),
        np.zeros(MOST, np.int32),
        np.zeros(MOST, np.int32),
        np.zeros(MOST),
        np.zeros(MOST),
        np.zeros(MOST),
        np.zeros(MOST),
        np.zeros(128, np.int64),
        np.zeros(128),
        np.zeros(128),
        np.zeros(128),
        new_search(),
        np.zeros(3),
    )


@kernel
def copy_hypothesis(belief: Belief, source: int, target: int) -> None:
    """Copy one row of the belief over another."""
    set_to(belief.mean[target], belief.mean[source])
    for i in range(N):
        set_to(belief.cov[target, i], belief.cov[source, i])
    belief.log_weight[target] = belief.log_weight[source]
    belief.probability[target] = belief.probability[source]
    belief.edge[target] = belief.edge[source]
    belief.segment[target] = belief.segment[source]
    belief.abscissa[target] = belief.abscissa[source]
    belief.spread[target] = belief.spread[source]
    belief.stay[target] = belief.stay[source]
    belief.drove[target] = belief.drove[source]
    belief.node[target] = belief.node[source]
    belief.fresh[target] = belief.fresh[source]
    for a in range(int(belief.clock[ORIGINS])):
        belief.share[target, a] = belief.share[source, a]


@kernel
def rescale(belief: Belief, i: int, factor: float) -> None:
    """Multiply a hypothesis' weight."""
    belief.log_weight[i] += math.log(max(factor, 1e-300))
    belief.probability[i] *= factor


@kernel
def enter(route: Route, edge: int, parent: int, time: float, abscissa: float) -> int:
    """Add a node to the route tree; returns its number, the parent when it is full."""
    node = int(route.size[0])
    if node >= len(route.edge):
        return parent
    route.edge[node] = edge
    route.parent[node] = parent
    route.time[node] = time
    route.abscissa[node] = abscissa
    route.size[0] = node + 1
    return node


@kernel
def reachable(roads: Roads, work: Work, edge: int, s: float, sigma: float, least: float) -> int:
    """List the edges on which a vehicle that left `edge` may be.

    Breadth first over the successors; an edge's mass is its turn priors' product times
    the Gaussian mass of the abscissa on it.

    Args:
        roads: The network.
        work: `edge, parent, offset, prior, mass, turn` are filled.
        edge: The origin.
        s: Mean abscissa, from the origin's start, m.
        sigma: Its standard deviation, m.
        least: Priors below this are not followed.

    Returns:
        How many.
    """
    count = 0
    end = roads.length[edge]
    k = -1
    current = edge
    prior = 1.0
    turn = 0.0
    while True:
        low = normal_cdf((end - s) / sigma)
        for t in range(roads.succ_first[current], roads.succ_first[current + 1]):
            p = prior * roads.succ_prior[t]
            if p < least or count >= MOST:
                continue
            f = roads.succ[t]
            high = normal_cdf((end + roads.length[f] - s) / sigma)
            work.edge[count] = f
            work.parent[count] = k
            work.offset[count] = end
            work.prior[count] = p
            work.mass[count] = p * (high - low)
            work.turn[count] = turn + roads.succ_turn[t]
            count += 1
        k += 1
        while k < count and work.offset[k] + roads.length[work.edge[k]] > s + _REACH * sigma:
            k += 1
        if k >= count:
            return count
        current = work.edge[k]
        end = work.offset[k] + roads.length[current]
        prior = work.prior[k]
        turn = work.turn[k]


@kernel
def adopt(
    belief: Belief, roads: Roads, route: Route, work: Work, i: int, child: int, d: int,
    share: float, side: float, lane_sigma: float,
) -> None:  # fmt: skip
    """Make row `child` a copy of i on destination d, with its share of the weight."""
    copy_hypothesis(belief, i, child)
    edge = work.edge[d]
    rescale(belief, child, share)
    belief.edge[child] = edge
    belief.segment[child] = roads.first[edge]
    belief.fresh[child] = 1
    up = work.parent[d]
    if up >= 0 and belief.node[i] >= 0:
        chain = 0
        while up >= 0:
            chain += 1
            up = work.parent[up]
        for back in range(chain, 0, -1):
            up = work.parent[d]
            for _ in range(back - 1):
                up = work.parent[up]
            belief.node[child] = enter(
                route, work.edge[up], belief.node[child], belief.clock[NOW], 0.0
            )
    redraw_lane(
        belief.mean[child], belief.cov[child], work.turn[d],
        side * roads.lane[belief.edge[i]], side * roads.lane[edge],
        lane_sigma_of(roads, edge, lane_sigma),
    )  # fmt: skip


@kernel
def leave_map(belief: Belief, i: int, child: int, share: float) -> None:
    """The road ends at the map's border or in a one-way trap: what leaves is off road."""
    copy_hypothesis(belief, i, child)
    rescale(belief, child, share)
    belief.edge[child] = OFF_ROAD
    belief.fresh[child] = 1


@kernel
def destinations(
    roads: Roads, work: Work, edge: int, s: float, sigma: float, share: float, prune: float
) -> tuple[int, float]:
    """Reachable edges, and the mass on them altogether."""
    least = min(0.1 * prune / max(share, prune), 0.05)
    count = reachable(roads, work, edge, s, sigma, least)
    total = 0.0
    for d in range(count):
        total += work.mass[d]
    if total <= 1e-12 and count > 0:  # all mass before the end: the nearest edges take it
        total = 0.0
        for d in range(count):
            work.mass[d] = work.prior[d] if work.parent[d] < 0 else 0.0
            total += work.mass[d]
    return count, total


@part
def hand_over(
    belief: Belief, roads: Roads, route: Route, work: Work, scale: float, arc: float,
    side: float, lane_sigma: float, prune: float, passed: float, cut: bool,
) -> bool:  # fmt: skip
    """Give the part of every hypothesis that has passed its edge's end to what follows.

        P(stay) = Φ((L − s₁)/σ₁) / Φ((L − s₀)/σ₀), at most 1

    with s₀ when last looked at: a standing car leaks nothing.  In reverse the part
    that passed the start goes to the edges before.

    Args:
        belief: In place; children are appended.
        roads: The network.
        route: The tree of edges entered.
        work: Scratch.
        scale: Local scale of the plane.
        arc: Distance moved in this step, m; its sign tells the direction.
        side: 1 where one drives on the right, −1 on the left.
        lane_sigma: Spread of the lane offset, m.
        prune: Probability below which a hypothesis is not worth its while.
        passed: Probability that has to have passed an end, or most of it, before it is handed over.
        cut: Whether to cut the Gaussians at the edge's end.

    Returns:
        Whether anything was handed over.
    """
    n = belief.size[0]
    changed = False
    for i in range(n):
        edge = belief.edge[i]
        if edge == OFF_ROAD:
            continue
        _, tx, ty = track(belief, roads, i, scale)
        s = belief.abscissa[i]
        sigma = belief.spread[i]
        length = roads.length[edge]
        p = belief.probability[i]
        if arc < 0.0 and s < _REACH * sigma:
            changed = (
                _back_up(belief, roads, i, s, sigma, -arc, p, side, lane_sigma, prune) or changed
            )
        if s + _REACH * sigma < length:
            belief.stay[i] = 1.0
            continue
        now = normal_cdf((length - s) / sigma)
        if arc < 0.0:
            belief.stay[i] = now
            continue
        share = 1.0 - min(1.0, now / max(belief.stay[i], 1e-6))
        enough = share * p >= 0.3 * prune and share >= min(passed / p, MOSTLY)
        if not enough or belief.size[0] >= CAPACITY:
            belief.stay[i] = max(belief.stay[i], now)
            continue
        changed = True
        count, total = destinations(roads, work, edge, s, sigma, share * p, prune)
        given = 0.0
        if total <= 0.0:
            leave_map(belief, i, belief.size[0], share)
            belief.size[0] += 1
            given = share
        for d in range(count):
            part = share * work.mass[d] / total if total > 0.0 else 0.0
            if part * p < 0.1 * prune or belief.size[0] >= CAPACITY:
                continue  # too little, or no room: it stays where it was
            given += part
            child = belief.size[0]
            adopt(belief, roads, route, work, i, child, d, part, side, lane_sigma)
            belief.size[0] = child + 1
            f = work.edge[d]
            ahead = s - work.offset[d]
            if cut:
                cut_along(belief, child, tx, ty, ahead, sigma, 0.0, 1e9, scale)
            track(belief, roads, child, scale)
            belief.stay[child] = max(
                normal_cdf((roads.length[f] - ahead) / belief.spread[child]), 1e-6
            )
        belief.stay[i] = now
        rescale(belief, i, 1.0 - given)
        if cut:
            cut_along(belief, i, tx, ty, s, sigma, -1e9, length, scale)
            track(belief, roads, i, scale)
            belief.stay[i] = max(normal_cdf((length - belief.abscissa[i]) / belief.spread[i]), 1e-6)
    return changed


@kernel
def _back_up(
    belief: Belief, roads: Roads, i: int, s: float, sigma: float, arc: float, p: float,
    side: float, lane_sigma: float, prune: float,
) -> bool:  # fmt: skip
    """Reversing: the hazard of passing the edge's start goes to its predecessors."""
    edge = belief.edge[i]
    count = 0
    for t in range(roads.pred_first[edge], roads.pred_first[edge + 1]):
        if roads.pred[t] != roads.opposite[edge]:
            count += 1
    density = math.exp(-0.5 * (s / sigma) ** 2) * 0.3989422804014327 / sigma
    share = min(arc * density / max(normal_cdf(s / sigma), 0.02), 0.9)
    if count == 0 or share * p < 0.3 * prune:
        return False
    given = 0.0
    for t in range(roads.pred_first[edge], roads.pred_first[edge + 1]):
        q = roads.pred[t]
        if q == roads.opposite[edge] or belief.size[0] >= CAPACITY:
            continue
        given += share / count
        child = belief.size[0]
        copy_hypothesis(belief, i, child)
        rescale(belief, child, share / count)
        belief.edge[child] = q
        belief.segment[child] = roads.first[q + 1] - 2
        belief.fresh[child] = 1
        belief.stay[child] = 1.0
        belief.size[0] = child + 1
    rescale(belief, i, 1.0 - given)
    return True


@kernel
def cut_along(
    belief: Belief, i: int, tx: float, ty: float, s: float, sigma: float,
    low: float, high: float, scale: float,
) -> None:  # fmt: skip
    """Cut the abscissa of hypothesis i to [low, high]."""
    mean, variance = truncated_moments(s, sigma, low, high)
    move_along(belief, i, tx, ty, mean - s, variance / (sigma * sigma), scale)


@kernel
def move_along(
    belief: Belief, i: int, tx: float, ty: float, shift: float, shrink: float,
    scale: float,
) -> None:  # fmt: skip
    """Shift the abscissa of hypothesis i, and multiply its variance."""
    reshape_on_map(belief.mean[i], belief.cov[i], tx, ty, shift, shrink, scale)
