"""Large mixtures for a start somewhere on the map: more hypotheses than a belief holds.

A population is a belief with a larger capacity, so that the filter's own kernels move it
and weigh it.  Here is what those cannot do with many rows: initialise hypotheses along the
roads, branch in parts, merge neighbours in sorted order, and summarise by moments.
"""

import math

from ..._compile import Ints, Ints32, Matrix, Record, Vector, entry, kernel
from ...graph.geometry import locate
from ...graph.index import vertex_at
from ...graph.network import Roads
from .._simd import N, copy_record
from ..gaussian import merge_moments
from ..motion import Increment, extrapolated, predict_plane, wheel_noise
from ..road import heading_regression
from ..state import (
    GX,
    GY,
    KEPT,
    MX,
    MY,
    NO_EDGE,
    OFF_ROAD,
    B,
    Belief,
    Context,
    D,
    H,
    K,
    Path,
    X,
    Y,
    blank,
    lane_mean,
    lane_sigma,
)
from .branching import branch, own_all
from .reduction import enter_new_edges

_HEADING_VARIANCE = 0.015  # rad², of a vehicle about its road's heading
_ACROSS_VARIANCE = 0.1  # m², of a vehicle about its lane
_MOST_SAGITTA = 400.0  # m², limit of the variance across a bend


@kernel
def turn_sum(roads: Roads, first: int, last: int) -> float:
    """Sum of the absolute turns at the vertices between two of them, rad."""
    total = 0.0
    for v in range(first + 1, last):
        ax = roads.vertices[v].x - roads.vertices[v - 1].x
        ay = roads.vertices[v].y - roads.vertices[v - 1].y
        bx = roads.vertices[v + 1].x - roads.vertices[v].x
        by = roads.vertices[v + 1].y - roads.vertices[v].y
        total += abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
    return total


@entry
def turn_sums(roads: Roads, total: Vector) -> None:
    """How much each edge turns on its way, rad, into total (E,)."""
    for e in range(len(total)):
        total[e] = turn_sum(roads, roads.edges[e].first_vertex, roads.edges[e].last_vertex)


@entry
def locate_all(
    roads: Roads, edge: Ints32, s: Vector, sigma: Vector, x: Vector, y: Vector, heading: Vector
) -> None:
    """Positions and headings of pieces of road.

    Args:
        roads: The network.
        edge: (n,) edges.
        s: (n,) abscissae, m.
        sigma: (n,) sigmas of the abscissae, m.
        x: (n,) out, m, plane.
        y: (n,) out.
        heading: (n,) out, rad.
    """
    for k in range(len(edge)):
        v = vertex_at(roads, edge[k], s[k])
        _, x[k], y[k], _, _ = locate(roads, edge[k], v, s[k])
        heading[k], _, _ = heading_regression(roads, edge[k], v, s[k], sigma[k])


@entry
def initialise(
    population: Belief, ctx: Context, edge: Ints32, s: Vector, sigma: Vector, log_weight: Vector
) -> None:
    """Append a hypothesis on each piece of road: p = c(s) + n d − m, heading that of the road.

    Args:
        population: Rows are appended; pieces are left out when it is full.
        ctx: The drive's constants.
        edge: (n,) edges.
        s: (n,) abscissae of the middles of the pieces, m.
        sigma: (n,) sigmas of the abscissae, m.
        log_weight: (n,) prior.
    """
    state = population.state[0]
    scale = state.scale
    for k in range(len(edge)):
        i = state.count
        if i >= len(population.hyp):
            return
        e = edge[k]
        hyp = population.hyp[i]
        v, x, y, tx, ty = locate(ctx.roads, e, vertex_at(ctx.roads, e, s[k]), s[k])
        heading, slope, bow = heading_regression(ctx.roads, e, v, s[k], sigma[k])
        variance = _HEADING_VARIANCE + bow * bow
        blank(hyp, e, v)
        _fill(hyp, ctx.par[0], (tx, ty), slope, sigma[k] ** 2, variance, lane_sigma(ctx, e))
        offset = lane_mean(ctx, e)
        hyp.mu[X] = x + scale * ty * offset
        hyp.mu[Y] = y - scale * tx * offset
        hyp.mu[H] = heading
        hyp.mu[D] = offset
        hyp.log_weight = log_weight[k]
        hyp.along = s[k]
        hyp.along_sigma = sigma[k]
        own_all(hyp, ctx.roads.edges[e].length)
        state.count = i + 1


@kernel
def _fill(
    hyp: Record, par: Record, tangent: tuple[float, float], slope: float, along: float,
    heading: float, lane_sigma: float,
) -> None:  # fmt: skip
    """Moments of a vehicle on a piece of road; `along` and `heading` are variances.

    δp = t a + n (d + e + ½ slope a²) − δm,    δθ = slope a + e_θ
    """
    mean = hyp.mu
    cov = hyp.cov
    mean[K] = 1.0
    tx, ty = tangent
    lane = lane_sigma * lane_sigma
    sag = 0.5 * slope * along
    across = lane + _ACROSS_VARIANCE + min(sag * sag, _MOST_SAGITTA)
    m = par.map_sigma**2
    cov[X, X] = tx * tx * along + ty * ty * across + m
    cov[X, Y] = tx * ty * along - ty * tx * across
    cov[Y, Y] = ty * ty * along + tx * tx * across + m
    cov[X, H] = slope * along * tx
    cov[Y, H] = slope * along * ty
    cov[H, H] = slope * slope * along + heading
    cov[X, D] = ty * lane
    cov[Y, D] = -tx * lane
    cov[D, D] = lane
    cov[X, MX] = -m
    cov[Y, MY] = -m
    cov[MX, MX] = m
    cov[MY, MY] = m
    cov[K, K] = par.scale_sigma**2
    cov[B, B] = par.drift_sigma**2
    cov[GX, GX] = 1.0
    cov[GY, GY] = 1.0
    _mirror(cov)


@kernel
def _mirror(cov: Matrix) -> None:
    """Copy the upper triangle to the lower one."""
    for i in range(N):
        for j in range(i):
            cov[i, j] = cov[j, i]


@entry
def predict_all(population: Belief, ctx: Context, move: Increment, measured: bool) -> None:
    """Move every hypothesis by an increment of the wheels' odometry (equation 1)."""
    state = population.state[0]
    metres = abs(move.arc)
    q = wheel_noise(ctx.par[0], metres, move.turn)
    if measured:
        state.unmeasured = 0.0
    else:
        q = extrapolated(q, state.unmeasured, metres)
        state.unmeasured += metres
    for i in range(state.count):
        hyp = population.hyp[i]
        predict_plane(hyp.mu, hyp.cov, move, state.scale, q)


@kernel
def copy_state(target: Belief, source: Belief, count: int) -> None:
    """Copy what all hypotheses share, for a target of so many hypotheses."""
    copy_record(target.state[0], source.state[0])
    target.state[0].count = count


@entry
def branch_all(
    population: Belief, target: Belief, part: Belief, path: Path, ctx: Context, arc: float
) -> bool:
    """`branching.branch` for a population, so many rows at a time.

    Args:
        population: Normalised.
        target: Out, the population with the children.
        part: A belief of the usual capacity, as a buffer.
        path: The tree of edges entered.
        ctx: The drive's constants.
        arc: Distance moved, m.

    Returns:
        Whether none was left out.
    """
    n = population.state[0].count
    m = 0
    complete = True
    for first in range(0, n, KEPT):
        count = min(KEPT, n - first)
        for i in range(count):
            copy_record(part.hyp[i], population.hyp[first + i])
        copy_state(part, population, count)
        branch(part, path, ctx, arc, 0.0)
        for i in range(part.state[0].count):
            if m < len(target.hyp):
                copy_record(target.hyp[m], part.hyp[i])
                m += 1
            else:
                complete = False
    copy_state(target, population, m)
    return complete


@entry
def merge_neighbours(
    population: Belief, kept: Belief, path: Path, order: Ints, limit: float
) -> None:
    """Copy the rows that are kept, and merge neighbours on an edge that are nearly one.

    Args:
        population: Normalised.
        kept: Out; weights as they were, not normalised again.
        path: New edges are entered here.
        order: (m,) rows to keep, by edge and abscissa.
        limit: Cost that is accepted, nats.
    """
    n = 0
    for k in range(len(order)):
        hyp = population.hyp[order[k]]
        if n > 0 and _merge_neighbour(kept.hyp[n - 1], hyp, limit, population.state[0].scale):
            continue
        copy_record(kept.hyp[n], hyp)
        n += 1
    copy_state(kept, population, n)
    enter_new_edges(kept, path)


@kernel
def _merge_neighbour(kept: Record, hyp: Record, limit: float, scale: float) -> bool:
    """Merge a hypothesis into its neighbour on the same edge if that costs little.

    Runnalls' cost along the road, as if both had the same weight: a light one far from a
    heavy one may become the most probable.

        B = ½ log v − ¼ (log v_i + log v_j),    v = ½ (v_i + v_j) + ¼ (s_i − s_j)²
    """
    if hyp.edge != kept.edge or hyp.edge == OFF_ROAD:
        return False
    wi = hyp.weight
    wj = kept.weight
    share = wj / (wi + wj)
    vi = hyp.along_sigma**2
    vj = kept.along_sigma**2
    gap = hyp.along - kept.along
    v = 0.5 * (vi + vj) + 0.25 * gap * gap
    if not 0.5 * math.log(v) - 0.25 * math.log(vi * vj) < limit:
        return False
    merge_moments(kept.mu, kept.cov, hyp.mu, hyp.cov, share, scale)
    kept.along += (1.0 - share) * gap
    v = share * vj + (1.0 - share) * vi + share * (1.0 - share) * gap * gap
    kept.along_sigma = math.sqrt(v)
    kept.bound = min(kept.bound, hyp.bound)
    kept.p_not_passed = share * kept.p_not_passed + (1.0 - share) * hyp.p_not_passed
    kept.weight = wi + wj
    kept.log_weight = math.log(wi + wj)
    if wi > wj:
        kept.segment = hyp.segment
        kept.path_entry = hyp.path_entry
        kept.new_edge = hyp.new_edge
    return True


@entry
def match_moments(population: Belief, target: Belief, order: Ints, apart: int) -> None:
    """The first rows of an order, and one row of no edge with the moments of all others.

    Args:
        population: Normalised.
        target: Out, a belief of the usual capacity.
        order: (n,) all rows, those to be kept apart first.
        apart: How many.
    """
    copy_state(target, population, min(apart + 1, len(order)))
    for k in range(apart):
        copy_record(target.hyp[k], population.hyp[order[k]])
    if len(order) <= apart:
        return
    rest = target.hyp[apart]
    copy_record(rest, population.hyp[order[apart]])
    total = rest.weight
    for k in range(apart + 1, len(order)):
        hyp = population.hyp[order[k]]
        total += hyp.weight
        share = 1.0 - hyp.weight / max(total, 1e-300)
        merge_moments(rest.mu, rest.cov, hyp.mu, hyp.cov, share, population.state[0].scale)
    rest.edge = NO_EDGE
    rest.weight = total
    rest.log_weight = math.log(max(total, 1e-300))
