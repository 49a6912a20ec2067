"""The paper's Switching Kalman Filter, taken literally: what `filter.step` does otherwise.

It is the baseline for comparison: docs/model.md states what follows from each line.  The
state is (x, y, θ): hypotheses are those of `filter.state`, with K at 1 and the slow
states at 0, so that the Kalman update and the merging are the default filter's own.

What the text leaves open, and what is taken here:

- B(i, j) of §3.1: the same road with a fixed probability, the rest in equal parts.
- Which estimate the 30 m are drawn around (Figure 1): that of the most probable hypothesis.
- Candidates: the closest segment of every directed edge, so that a street open both ways is
  two, which the heading separates.
- Inference (§3.1 names JLO, exact and exponential in time): every hypothesis is continued on
  every candidate and merged there by moments, the generalised pseudo-Bayesian filter of
  order two.
- The time between two steps (Figure 11 counts "seven steps"): one second, by default.
- The heading at the start, where nothing reports one: each candidate's, with equal chances
  (Figure 8).

Our additions: a speed where there is no odometry, which the paper always has, and a new start
after fixes that fit nothing for long.
"""

import math

from .._compile import Record, Vector, kernel
from ..graph.geometry import project, wrap
from ..graph.index import near, vertex_at
from ._simd import copy_record
from .along import forward_only
from .gaussian import condition, merge_moments
from .gnss.position import Axes, has_course, observe_position, observe_state
from .motion import Increment, Noise, blind_noise, extrapolated, predict_plane, wheel_noise
from .state import (
    CLOCK,
    DISTANCE,
    NO_EDGE,
    WHEELS,
    Belief,
    Context,
    H,
    K,
    N,
    X,
    Y,
    blank,
    heaviest,
    normalise,
)
from .summary.estimate import LOST, OUTAGE, Output
from .vetting.motion_sources import AHEAD

_ANYWHERE = 1000.0  # m, sigma of the position before the first fix
_CANDIDATES = 48  # the closest segments, where more are within the radius
_STILL = 0.05  # m/s
_HELD = 0  # scratch of a hypothesis: 1 where its road is still a candidate


@kernel
def predict(belief: Belief, ctx: Context, epoch: Record, dt: float) -> None:
    """Equation (1) for every hypothesis, and its Jacobian for the covariance.

    δs and δθ come from the wheels.  With a mere odometer δθ = 0 and the heading walks;
    without one, too, the vehicle keeps its speed, which is then the state K.
    """
    par = ctx.par[0]
    state = belief.state[0]
    metres = abs(epoch.arc)
    move = Increment(epoch.arc, epoch.turn, epoch.forward, epoch.left, epoch.arc)
    wheels = wheel_noise(par, metres, 0.0)
    ahead = epoch.odometry_valid == 0 or epoch.odometry_valid == AHEAD
    if par.mode == WHEELS and ahead:
        wheels = extrapolated(wheels, 0.0, metres)
    heading = wheels.heading + (par.turn_noise * epoch.turn) ** 2
    q = Noise(wheels.along, wheels.across, heading, 0.0, 0.0, 0.0)
    if par.mode == CLOCK:
        move = Increment(dt, epoch.turn, dt, 0.0, dt)
        blind = blind_noise(par, dt, 0.0, CLOCK, False, False)
        q = Noise(blind.along, 0.25 * blind.along, blind.heading, blind.rate, 0.0, 0.0)
    elif par.mode == DISTANCE:
        heading = blind_noise(par, metres, metres, DISTANCE, False, False).heading
        q = Noise(wheels.along, wheels.across, heading, 0.0, 0.0, 0.0)
    for i in range(state.count):
        predict_plane(belief.hyp[i].mu, belief.hyp[i].cov, move, state.scale, q)
    if par.mode == CLOCK:
        forward_only(belief, ctx)
        normalise(belief)


@kernel
def _anywhere(
    hyp: Record, fix: Vector, heading: float, heading_sigma: float, rate: float, rate_sigma: float
) -> None:
    """A hypothesis anywhere about a fix, with this heading, on no road yet."""
    blank(hyp, NO_EDGE, 0)
    hyp.mu[X] = fix[0]
    hyp.mu[Y] = fix[1]
    hyp.mu[H] = wrap(heading)
    hyp.mu[K] = rate
    hyp.cov[X, X] = _ANYWHERE**2
    hyp.cov[Y, Y] = _ANYWHERE**2
    hyp.cov[H, H] = heading_sigma**2
    hyp.cov[K, K] = rate_sigma**2


@kernel
def _candidates(ctx: Context, x: float, y: float) -> int:
    """List the closest segments within the radius; returns how many."""
    return near(ctx.roads, x, y, ctx.par[0].paper_radius, ctx.work.near[:_CANDIDATES])


@kernel
def start(belief: Belief, ctx: Context, epoch: Record) -> bool:
    """Start, or start anew, from the epoch's fix.

    Without a course every candidate starts a hypothesis of its own heading.

    Returns:
        False, and nothing is changed, where there is neither a course nor a candidate.
    """
    par = ctx.par[0]
    state = belief.state[0]
    fix = epoch.fix
    rate = 1.0
    rate_sigma = 0.0
    if par.mode == CLOCK:
        rate = epoch.speed if epoch.speed_sigma < 10.0 else 6.0
        rate_sigma = min(epoch.speed_sigma, 8.0)
    count = _candidates(ctx, fix[0], fix[1])
    if has_course(epoch, 0.5):
        sigma = epoch.course_sigma + 0.03
        _anywhere(belief.hyp[0], fix, epoch.course, sigma, rate, rate_sigma)
        count = 1
    else:
        vertices = ctx.roads.vertices
        for j in range(count):
            v = vertex_at(ctx.roads, ctx.work.near[j].edge, ctx.work.near[j].s)
            heading = math.atan2(
                vertices[v + 1].y - vertices[v].y, vertices[v + 1].x - vertices[v].x
            )
            sigma = par.paper_heading_sigma
            _anywhere(belief.hyp[j], fix, heading, sigma, rate, rate_sigma)
    if count == 0:
        return False
    state.count = count
    state.started = 1
    state.misfits = 0.0
    state.last_fix = epoch.time
    normalise(belief)
    observe_position(belief, ctx, fix, _axes(fix), math.inf, False, 0.0)
    return True


@kernel
def restart_if_lost(belief: Belief, ctx: Context, epoch: Record) -> None:
    """Start anew after fixes that fit nothing for long."""
    lost = belief.state[0].misfits >= ctx.par[0].lost_after
    if lost and epoch.has_fix and start(belief, ctx, epoch):
        switch(belief, ctx)


@kernel
def estimate_speed(belief: Belief, ctx: Context, epoch: Record, dt: float) -> None:
    """Speed by the odometer, or of the most probable hypothesis; how long it stands."""
    state = belief.state[0]
    if ctx.par[0].mode == CLOCK:
        state.speed = belief.hyp[heaviest(belief)].mu[K]
    elif dt > 1e-6:
        state.speed = epoch.arc / dt
    state.standing = state.standing + dt if abs(state.speed) < _STILL else 0.0


@kernel
def _axes(fix: Vector) -> Axes:
    """A fix with the covariance that the receiver reports, independent from fix to fix."""
    return Axes(math.cos(fix[4]), math.sin(fix[4]), fix[2] ** 2, fix[3] ** 2)


@kernel
def observe_gnss(belief: Belief, ctx: Context, epoch: Record) -> float:
    """Y₁ with the covariance Q^gps that the receiver reports, independent from fix to fix.

    Without wheels the course, and without any odometer the speed, are observed as well.

    Returns:
        Chi-square of the fix under the hypothesis that fits it best.
    """
    par = ctx.par[0]
    state = belief.state[0]
    chi2 = observe_position(belief, ctx, epoch.fix, _axes(epoch.fix), math.inf, False, 0.0)
    if par.mode != WHEELS and has_course(epoch, 1.0):
        observe_state(belief, ctx, H, epoch.course, epoch.course_sigma**2 + 0.0025, 0.0)
    if par.mode == CLOCK and epoch.speed_sigma < 20.0:
        observe_state(belief, ctx, K, epoch.speed, epoch.speed_sigma**2 + 0.04, 0.0)
    normalise(belief)
    state.last_fix = epoch.time
    state.misfits = state.misfits + 1.0 if chi2 > 4.0 * par.gnss_gate else 0.0
    return chi2


@kernel
def transition(same: bool, held: bool, count: int, p_same: float) -> float:
    """B(i, j) of §3.1, which the text leaves open.

    Args:
        same: Whether i and j are one road.
        held: Whether i is still a candidate; if not, all have the same chance (Figure 8).
        count: Candidates.
        p_same: P(the same road).
    """
    if not held or count == 1:
        return 1.0 / count
    return p_same if same else (1.0 - p_same) / (count - 1)


@kernel
def observe_segment(hyp: Record, ctx: Context, edge: int, s: float, scale: float) -> float:
    """Condition a hypothesis on the map observation of an edge's closest segment.

        Y_carto = (x_carto, y_carto, cap_carto) = (x, y, θ) + β          §2.2

    (x_carto, y_carto) is the projection of the hypothesis itself, the closer extremity where
    it misses the segment (Figure 3); β has the ellipse of Figure 4: the segment's length
    along it, the road's width across, read as sigmas, and a variance for the heading.  In
    the segment's axes the three errors are independent rows.

    Returns:
        Log-density of the innovation.
    """
    par = ctx.par[0]
    row = ctx.work.row
    mean = hyp.mu
    v, _, _, tx, ty = project(ctx.roads, edge, vertex_at(ctx.roads, edge, s), mean[X], mean[Y])
    a = ctx.roads.vertices[v]
    b = ctx.roads.vertices[v + 1]
    along = (mean[X] - a.x) * tx + (mean[Y] - a.y) * ty
    length = b.s - a.s
    inside = min(max(along, 0.0), math.hypot(b.x - a.x, b.y - a.y))
    foot_x = a.x + inside * tx
    foot_y = a.y + inside * ty
    cap = mean[H] + wrap(math.atan2(ty, tx) - mean[H])
    gain = 0.0
    for axis in range(2):
        for j in range(N):
            row[j] = 0.0
        row[X] = tx if axis == 0 else -ty
        row[Y] = ty if axis == 0 else tx
        nu = (row[X] * (foot_x - mean[X]) + row[Y] * (foot_y - mean[Y])) / scale
        sigma = length if axis == 0 else par.paper_width
        gain += condition(mean, hyp.cov, row, nu, sigma * sigma, scale)
    row[X] = 0.0
    row[Y] = 0.0
    row[H] = 1.0
    gain += condition(mean, hyp.cov, row, cap - mean[H], par.paper_heading_sigma**2, scale)
    mean[H] = wrap(mean[H])
    hyp.segment = v
    return gain


@kernel
def _arrive(belief: Belief, ctx: Context, j: int, count: int) -> None:
    """Continue every hypothesis on candidate j and merge them there by moments."""
    par = ctx.par[0]
    scale = belief.state[0].scale
    edge = ctx.work.near[j].edge
    into = ctx.work.merged[j]
    for i in range(belief.state[0].count):
        hyp = belief.hyp[i]
        child = into if i == 0 else ctx.work.merged[count]
        copy_record(child, hyp)
        chance = transition(hyp.edge == edge, hyp.scratch[_HELD] == 1.0, count, par.paper_stay)
        child.log_weight += math.log(chance) + observe_segment(
            child, ctx, edge, ctx.work.near[j].s, scale
        )
        if i > 0:
            a = into.log_weight
            b = child.log_weight
            top = max(a, b)
            total = top + math.log(math.exp(a - top) + math.exp(b - top))
            merge_moments(into.mu, into.cov, child.mu, child.cov, math.exp(a - total), scale)
            into.log_weight = total
    into.edge = edge


@kernel
def switch(belief: Belief, ctx: Context) -> None:
    """One step of S_k: candidates, their map observations, their probabilities (Figure 7).

    P(S = j) ∝ Σ_i w_i B(i, j) N(ν_ij; S_ij).  Where there is no candidate the most probable
    hypothesis goes on alone, on no road.

    Args:
        belief: In place, its weights normalised afterwards; one hypothesis a candidate.
        ctx: The drive's constants.
    """
    state = belief.state[0]
    top = belief.hyp[heaviest(belief)]
    count = _candidates(ctx, top.mu[X], top.mu[Y])
    if count == 0:
        copy_record(belief.hyp[0], top)
        belief.hyp[0].edge = NO_EDGE
        state.count = 1
    else:
        for i in range(state.count):
            hyp = belief.hyp[i]
            hyp.scratch[_HELD] = 0.0
            for j in range(count):
                if ctx.work.near[j].edge == hyp.edge:
                    hyp.scratch[_HELD] = 1.0
        for j in range(count):
            _arrive(belief, ctx, j, count)
        for j in range(count):
            copy_record(belief.hyp[j], ctx.work.merged[j])
        state.count = count
    normalise(belief)
    state.map_time = state.time


@kernel
def keep_most_probable(belief: Belief, ctx: Context, output: Output, k: int) -> None:
    """Make the pose of epoch k that of the most probable hypothesis."""
    state = belief.state[0]
    hyp = belief.hyp[heaviest(belief)]
    out = output.rows[k]
    out.x = hyp.mu[X]
    out.y = hyp.mu[Y]
    out.heading = hyp.mu[H]
    v = 0
    for a in range(3):
        for b in range(a, 3):
            out.cov[v] = hyp.cov[a, b]
            v += 1
    if out.edge == NO_EDGE:
        out.alt_p[0] = 0.0
        since_fix = state.time - state.last_fix
        out.status = OUTAGE if since_fix > ctx.par[0].outage_after else LOST
