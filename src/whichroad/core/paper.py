"""The paper's Switching Kalman Filter, taken literally: one step of S_k.

It is there to be seen beside ours: docs/model.md tells what follows from each line.  The
state is (x, y, θ): rows of the belief are those of `core.belief`, with K at 1 and the slow
states at 0, so that the Kalman update and the merging are the default filter's own.

What the text leaves open, and what is taken here:

- B(i, j) of §3.1: stay with a fixed probability, the rest in equal parts.
- Which estimate the 30 m are drawn around (Figure 1): that of the most probable hypothesis.
- Candidates: the closest segment of every directed edge, so that a street open both ways is
  two, which the heading tells apart.
- Inference (§3.1 names JLO, exact and exponential in time): every hypothesis is continued on
  every candidate and merged there by moments, the generalised pseudo-Bayesian filter of
  order two.
"""

import math
from typing import NamedTuple

import numpy as np

from ._jit import Ints, Vector, kernel
from .angles import wrap
from .belief import GNSS_YY, NO_EDGE, NOW, Belief, H, N, X, Y, new_belief, normalise
from .gaussian import condition, merge_moments
from .grid import near, vertex_at
from .network import Roads
from .segment import project

CANDIDATES = 48  # the closest segments, where more are within the radius
STEPPED = GNSS_YY + 1  # clock: time of the last map observation, s


class Literal(NamedTuple):
    """The paper's own numbers; `settings.Settings` tells units, bounds and reasons."""

    paper_stay: float
    paper_radius: float
    paper_width: float
    paper_heading_sigma: float
    paper_step: float


class Bench(NamedTuple):
    """Scratch."""

    merged: Belief  # the hypotheses to be, and one child more
    edge: Ints  # (CANDIDATES,)
    s: Vector  # (CANDIDATES,)
    lateral: Vector  # (CANDIDATES,)
    distance: Vector  # (CANDIDATES,)
    row: Vector  # (N,)
    no_bias: Vector  # (3,) zeros: GNSS errors are independent in time


def new_bench() -> Bench:
    """Scratch for one drive."""
    s, lateral, distance = np.zeros((3, CANDIDATES))
    edge = np.zeros(CANDIDATES, np.int64)
    return Bench(new_belief(), edge, s, lateral, distance, np.zeros(N), np.zeros(3))


@kernel
def most_probable(belief: Belief) -> int:
    """Row of the heaviest hypothesis: the one the paper plots (Figures 8 to 11)."""
    top = 0
    for i in range(belief.size[0]):
        if belief.log_weight[i] > belief.log_weight[top]:
            top = i
    return top


@kernel
def transition(same: bool, held: bool, count: int, stay: float) -> float:
    """B(i, j) of §3.1, which the text leaves open.

    Args:
        same: Whether i and j are one road.
        held: Whether i is still a candidate; if not, all have the same chance (Figure 8).
        count: Candidates.
        stay: P(the same road).
    """
    if not held or count == 1:
        return 1.0 / count
    return stay if same else (1.0 - stay) / (count - 1)


@kernel
def observe_segment(
    belief: Belief, i: int, roads: Roads, edge: int, s: float, scale: float, row: Vector,
    literal: Literal,
) -> float:  # fmt: skip
    """Condition hypothesis i on the map observation of an edge's closest segment.

        Y_carto = (x_carto, y_carto, cap_carto) = (x, y, θ) + β          §2.2

    (x_carto, y_carto) is the projection of the hypothesis itself, the closer extremity where
    it misses the segment (Figure 3); β has the ellipse of Figure 4: the segment's length
    along it, the road's width across, read as sigmas, and a variance for the heading.  In
    the segment's axes the three errors are independent rows.

    Returns:
        Log-density of the innovation.
    """
    mean = belief.mean[i]
    cov = belief.cov[i]
    v, _, _, tx, ty = project(roads, edge, vertex_at(roads, edge, s), mean[X], mean[Y])
    along = (mean[X] - roads.x[v]) * tx + (mean[Y] - roads.y[v]) * ty
    length = roads.s[v + 1] - roads.s[v]
    inside = min(
        max(along, 0.0), math.hypot(roads.x[v + 1] - roads.x[v], roads.y[v + 1] - roads.y[v])
    )
    foot_x = roads.x[v] + inside * tx
    foot_y = roads.y[v] + inside * ty
    cap = mean[H] + wrap(math.atan2(ty, tx) - mean[H])
    gain = 0.0
    for axis in range(2):
        for j in range(N):
            row[j] = 0.0
        row[X] = tx if axis == 0 else -ty
        row[Y] = ty if axis == 0 else tx
        nu = (row[X] * (foot_x - mean[X]) + row[Y] * (foot_y - mean[Y])) / scale
        sigma = length if axis == 0 else literal.paper_width
        gain += condition(mean, cov, row, nu, sigma * sigma, scale)
    row[X] = 0.0
    row[Y] = 0.0
    row[H] = 1.0
    gain += condition(mean, cov, row, cap - mean[H], literal.paper_heading_sigma**2, scale)
    mean[H] = wrap(mean[H])
    belief.segment[i] = v
    return gain


@kernel
def _copy_state(source: Belief, i: int, target: Belief, j: int) -> None:
    for a in range(N):
        target.mean[j, a] = source.mean[i, a]
        for b in range(N):
            target.cov[j, a, b] = source.cov[i, a, b]
    target.log_weight[j] = source.log_weight[i]
    target.segment[j] = source.segment[i]
    target.edge[j] = source.edge[i]


@kernel
def _arrive(
    belief: Belief, roads: Roads, bench: Bench, j: int, count: int, scale: float, literal: Literal
) -> None:
    """Continue every hypothesis on candidate j and merge them there by moments."""
    merged = bench.merged
    edge = bench.edge[j]
    held = belief.scratch[0]
    for i in range(belief.size[0]):
        child = j if i == 0 else count
        _copy_state(belief, i, merged, child)
        chance = transition(belief.edge[i] == edge, held[i] == 1.0, count, literal.paper_stay)
        merged.log_weight[child] += math.log(chance) + observe_segment(
            merged, child, roads, edge, bench.s[j], scale, bench.row, literal
        )
        if i > 0:
            a = merged.log_weight[j]
            b = merged.log_weight[child]
            top = max(a, b)
            total = top + math.log(math.exp(a - top) + math.exp(b - top))
            merge_moments(
                merged.mean[j], merged.cov[j], merged.mean[child], merged.cov[child],
                math.exp(a - total), scale,
            )  # fmt: skip
            merged.log_weight[j] = total
    merged.edge[j] = edge


@kernel
def switch(belief: Belief, roads: Roads, bench: Bench, scale: float, literal: Literal) -> None:
    """One step of S_k: candidates, their map observations, their probabilities (Figure 7).

    P(S = j) ∝ Σ_i w_i B(i, j) N(ν_ij; S_ij).  Where there is no candidate the most probable
    hypothesis goes on alone, on no road.

    Args:
        belief: In place, its weights normalised afterwards; one hypothesis a candidate.
        roads: The network.
        bench: Scratch.
        scale: Local scale of the plane.
        literal: The paper's numbers.
    """
    top = most_probable(belief)
    count = near(
        roads, belief.mean[top, X], belief.mean[top, Y], literal.paper_radius,
        bench.edge, bench.s, bench.lateral, bench.distance,
    )  # fmt: skip
    if count == 0:
        _copy_state(belief, top, belief, 0)
        belief.edge[0] = NO_EDGE
        belief.size[0] = 1
    else:
        for i in range(belief.size[0]):
            belief.scratch[0, i] = 0.0
            for j in range(count):
                if bench.edge[j] == belief.edge[i]:
                    belief.scratch[0, i] = 1.0
        for j in range(count):
            _arrive(belief, roads, bench, j, count, scale, literal)
        for j in range(count):
            _copy_state(bench.merged, j, belief, j)
        belief.size[0] = count
    normalise(belief)
    belief.clock[STEPPED] = belief.clock[NOW]
