"""More hypotheses than a belief holds: a start somewhere on the map.

A population is a `belief.Belief` with more rows, so that the filter's own kernels move it
and weigh it.  What is here is what those cannot do with many rows: lay hypotheses out
along the roads, hand them over in parts, keep them in order, and sum them up.
"""

import math

import numpy as np

from ._jit import Ints, Ints32, Matrix, Vector, entry, kernel
from .belief import (
    GX,
    GY,
    KEPT,
    MX,
    MY,
    NO_EDGE,
    NOW,
    OFF_ROAD,
    B,
    Belief,
    D,
    H,
    K,
    N,
    Route,
    X,
    Y,
)
from .gaussian import merge_moments, normal_cdf
from .grid import vertex_at
from .network import Roads, lane_sigma_of
from .parameters import Parameters
from .road import bend
from .rows import set_to
from .segment import locate
from .switching import Work, enter, hand_over

_HEADING = 0.015  # rad², of a vehicle about its road's heading
_ACROSS = 0.1  # m², of a vehicle about its lane


def new_population(capacity: int, clock: Vector) -> Belief:
    """An empty belief with room for more, which keeps the given clock."""
    return Belief(
        np.zeros((capacity, N)),
        np.zeros((capacity, N, N)),
        np.zeros(capacity),
        np.zeros(capacity),
        np.full(capacity, NO_EDGE, np.int32),
        np.zeros(capacity, np.int32),
        np.zeros(capacity),
        np.ones(capacity),
        np.ones(capacity),
        np.zeros(capacity),
        np.full(capacity, -1, np.int64),
        np.zeros(capacity, np.uint8),
        np.zeros(1, np.int64),
        clock,
        np.zeros((6, capacity)),
        np.zeros((capacity, 0)),
    )


@kernel
def turning(roads: Roads, first: int, last: int) -> float:
    """Sum of the absolute turns at the vertices between two of them, rad."""
    total = 0.0
    for v in range(first + 1, last):
        ax = roads.x[v] - roads.x[v - 1]
        ay = roads.y[v] - roads.y[v - 1]
        bx = roads.x[v + 1] - roads.x[v]
        by = roads.y[v + 1] - roads.y[v]
        total += abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
    return total


@entry
def turnings(roads: Roads, total: Vector) -> None:
    """How much each edge turns on its way, rad, into total (E,)."""
    for e in range(len(total)):
        total[e] = turning(roads, roads.first[e], roads.first[e + 1] - 1)


@entry
def places(
    roads: Roads, edge: Ints32, s: Vector, spread: Vector, x: Vector, y: Vector, heading: Vector
) -> None:
    """Where pieces of road are, and whereto they lead.

    Args:
        roads: The network.
        edge: (n,) edges.
        s: (n,) abscissae, m.
        spread: (n,) sigma of the abscissa, m.
        x: (n,) out, plane m.
        y: (n,) out.
        heading: (n,) out, rad.
    """
    for k in range(len(edge)):
        v = vertex_at(roads, edge[k], s[k])
        _, x[k], y[k], _, _ = locate(roads, edge[k], v, s[k])
        heading[k], _, _ = bend(roads, edge[k], v, s[k], spread[k])


@entry
def lay_out(
    population: Belief, roads: Roads, edge: Ints32, s: Vector, spread: Vector,
    log_weight: Vector, scale: float, side: float, par: Parameters,
) -> None:  # fmt: skip
    """Append a vehicle on each piece of road: p = c(s) + n d − m, heading that of the road.

    Args:
        population: Rows are appended; those that find no room are left out.
        roads: The network.
        edge: (n,) edges.
        s: (n,) abscissae of the middles, m.
        spread: (n,) sigma of the abscissa, m.
        log_weight: (n,) prior.
        scale: Local scale of the plane.
        side: 1 where one drives on the right, −1 on the left.
        par: The settings.
    """
    for k in range(len(edge)):
        i = population.size[0]
        if i >= len(population.edge):
            return
        e = edge[k]
        v, x, y, tx, ty = locate(roads, e, vertex_at(roads, e, s[k]), s[k])
        heading, slope, bow = bend(roads, e, v, s[k], spread[k])
        lane = lane_sigma_of(roads, e, par.lane_sigma)
        _fill(
            population.mean[i], population.cov[i], tx, ty, slope, spread[k] ** 2,
            _HEADING + bow * bow, lane * lane, par,
        )  # fmt: skip
        offset = side * roads.lane[e]
        mean = population.mean[i]
        mean[X] = x + scale * ty * offset
        mean[Y] = y - scale * tx * offset
        mean[H] = heading
        mean[D] = offset
        population.log_weight[i] = log_weight[k]
        population.edge[i] = e
        population.segment[i] = v
        population.abscissa[i] = s[k]
        population.spread[i] = spread[k]
        population.stay[i] = max(normal_cdf((roads.length[e] - s[k]) / spread[k]), 1e-6)
        population.node[i] = -1
        population.fresh[i] = 1
        population.size[0] = i + 1


@kernel
def _fill(
    mean: Vector, cov: Matrix, tx: float, ty: float, slope: float, along: float,
    heading: float, lane: float, par: Parameters,
) -> None:  # fmt: skip
    """Moments of a vehicle on a piece of road with tangent t; variances are given.

    δp = t a + n (d + e + ½ slope a²) − δm,    δθ = slope a + e_θ
    """
    for i in range(N):
        mean[i] = 0.0
        for j in range(N):
            cov[i, j] = 0.0
    mean[K] = 1.0
    nx = ty
    ny = -tx
    sag = 0.5 * slope * along
    across = lane + _ACROSS + min(sag * sag, 400.0)
    m = par.map_sigma**2
    cov[X, X] = tx * tx * along + nx * nx * across + m
    cov[X, Y] = tx * ty * along + nx * ny * across
    cov[Y, Y] = ty * ty * along + ny * ny * across + m
    cov[X, H] = slope * along * tx
    cov[Y, H] = slope * along * ty
    cov[H, H] = slope * slope * along + heading
    cov[X, D] = nx * lane
    cov[Y, D] = ny * lane
    cov[D, D] = lane
    cov[X, MX] = -m
    cov[Y, MY] = -m
    cov[MX, MX] = m
    cov[MY, MY] = m
    cov[K, K] = par.scale_sigma**2
    cov[B, B] = par.drift_sigma**2
    cov[GX, GX] = 1.0
    cov[GY, GY] = 1.0
    for i in range(N):
        for j in range(i):
            cov[i, j] = cov[j, i]


@kernel
def copy_row(source: Belief, i: int, target: Belief, j: int) -> None:
    """Copy row i of one belief to row j of another."""
    set_to(target.mean[j], source.mean[i])
    for a in range(N):
        set_to(target.cov[j, a], source.cov[i, a])
    target.log_weight[j] = source.log_weight[i]
    target.probability[j] = source.probability[i]
    target.edge[j] = source.edge[i]
    target.segment[j] = source.segment[i]
    target.abscissa[j] = source.abscissa[i]
    target.spread[j] = source.spread[i]
    target.stay[j] = source.stay[i]
    target.drove[j] = source.drove[i]
    target.node[j] = source.node[i]
    target.fresh[j] = source.fresh[i]


@entry
def hand_over_all(
    population: Belief, passed: Belief, part: Belief, roads: Roads, route: Route, work: Work,
    scale: float, arc: float, side: float, lane_sigma: float, prune: float,
) -> bool:  # fmt: skip
    """`switching.hand_over` for a population, so many rows at a time.

    Args:
        population: Normalised.
        passed: Out, the population with the children.
        part: A belief of the usual size, for work.
        roads: The network.
        route: The tree of edges entered.
        work: Scratch.
        scale: Local scale of the plane.
        arc: Distance moved, m.
        side: 1 where one drives on the right, −1 on the left.
        lane_sigma: Spread of the lane offset, m.
        prune: Probability below which a hypothesis is not worth its while.

    Returns:
        Whether all found room.
    """
    n = population.size[0]
    m = 0
    room = True
    part.clock[NOW] = population.clock[NOW]
    for first in range(0, n, KEPT):
        count = min(KEPT, n - first)
        for i in range(count):
            copy_row(population, first + i, part, i)
        part.size[0] = count
        hand_over(part, roads, route, work, scale, arc, side, lane_sigma, prune, 0.0, False)
        for i in range(part.size[0]):
            if m < len(passed.edge):
                copy_row(part, i, passed, m)
                m += 1
            else:
                room = False
    passed.size[0] = m
    return room


@entry
def collect(
    population: Belief, kept: Belief, route: Route, order: Ints, limit: float, scale: float
) -> None:
    """Copy the rows that are kept, and merge neighbours on an edge that are hardly two.

    Runnalls' cost along the road, as if both were of one weight: a light one far from a
    heavy one may yet win.

        B = ½ log v − ¼ (log v_i + log v_j),    v = ½ (v_i + v_j) + ¼ (s_i − s_j)²

    Args:
        population: Normalised.
        kept: Out; probabilities as they were, not normalised again.
        route: New edges are entered here.
        order: (m,) rows to keep, by edge and abscissa.
        limit: Cost that is accepted, nats.
        scale: Local scale of the plane.
    """
    n = 0
    for k in range(len(order)):
        i = order[k]
        edge = population.edge[i]
        if n > 0 and edge == kept.edge[n - 1] and edge != OFF_ROAD:
            j = n - 1
            wi = population.probability[i]
            wj = kept.probability[j]
            share = wj / (wi + wj)
            vi = population.spread[i] ** 2
            vj = kept.spread[j] ** 2
            gap = population.abscissa[i] - kept.abscissa[j]
            v = 0.5 * (vi + vj) + 0.25 * gap * gap
            if 0.5 * math.log(v) - 0.25 * math.log(vi * vj) < limit:
                merge_moments(
                    kept.mean[j], kept.cov[j], population.mean[i], population.cov[i], share, scale
                )
                kept.abscissa[j] += (1.0 - share) * gap
                v = share * vj + (1.0 - share) * vi + share * (1.0 - share) * gap * gap
                kept.spread[j] = math.sqrt(v)
                kept.stay[j] = share * kept.stay[j] + (1.0 - share) * population.stay[i]
                kept.probability[j] = wi + wj
                kept.log_weight[j] = math.log(wi + wj)
                if wi > wj:
                    kept.segment[j] = population.segment[i]
                    kept.node[j] = population.node[i]
                    kept.fresh[j] = population.fresh[i]
                continue
        copy_row(population, i, kept, n)
        n += 1
    kept.size[0] = n
    for i in range(n):
        if kept.fresh[i] == 1:
            kept.fresh[i] = 0
            kept.node[i] = enter(
                route, kept.edge[i], kept.node[i], kept.clock[NOW],
                min(max(kept.abscissa[i], 0.0), 1e9),
            )  # fmt: skip


@entry
def sum_up(population: Belief, part: Belief, order: Ints, apart: int, scale: float) -> None:
    """The first rows of an order, and all the others as one of no edge, by their moments.

    Args:
        population: Normalised.
        part: Out, a belief of the usual size.
        order: (n,) all rows, those to be kept apart first.
        apart: How many.
        scale: Local scale of the plane.
    """
    for k in range(apart):
        copy_row(population, order[k], part, k)
    if len(order) > apart:
        copy_row(population, order[apart], part, apart)
        total = population.probability[order[apart]]
        for k in range(apart + 1, len(order)):
            i = order[k]
            w = population.probability[i]
            total += w
            merge_moments(
                part.mean[apart], part.cov[apart], population.mean[i], population.cov[i],
                1.0 - w / max(total, 1e-300), scale,
            )  # fmt: skip
        part.edge[apart] = NO_EDGE
        part.probability[apart] = total
        part.log_weight[apart] = math.log(max(total, 1e-300))
    part.size[0] = min(apart + 1, len(order))
